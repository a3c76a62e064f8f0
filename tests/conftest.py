"""Settings that every test shares."""

from hypothesis import HealthCheck, settings

# Numba compiles on the first call, so the first example is slow and deadlines mean nothing.
settings.register_profile(
    "bayes_asv", deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("bayes_asv")
