"""Battery: the diagnosis of simulated cars with sealed faults, and its error rates."""
