"""Discrepancy workflow: where simulation and measurement disagree, why, and held-out validation."""
