"""Many files in worker processes: an index of what is done, workers that may die, dates."""
