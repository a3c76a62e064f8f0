"""From recordings to a posterior: timeline, parameters, likelihood, mode, ensembles."""
