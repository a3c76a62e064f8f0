"""Analysis of a posterior: predictive checks, run consistency, uncertainty budget, input checks."""
