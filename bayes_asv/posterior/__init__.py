"""Parameters, likelihood, optimisation and sampling of the posterior."""
