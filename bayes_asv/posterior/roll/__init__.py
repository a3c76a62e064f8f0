"""The posterior of the car that rolls: four dampers, two inertias, from seven accelerometers.

A separate path beside the half car's.  The likelihood is of the same kind (innovations with the
wheel sensors' noise in the covariance, initial state and biases integrated out), and the wheels'
splines, the priors' deviations, the importance sampler and the ensembles are shared.
"""
