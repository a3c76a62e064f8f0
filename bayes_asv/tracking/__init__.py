"""Parameters and states of a car while it is driven, row by row."""
