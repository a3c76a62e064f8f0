"""What a posterior says: predictive checks, consistency of runs, the uncertainty budget."""
