"""Parameters and states of the half car while it is driven, row by row."""
