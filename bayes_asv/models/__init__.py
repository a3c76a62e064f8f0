"""Models of cars: parameters, state-space matrices, outputs, effects; textbook forms beside."""
