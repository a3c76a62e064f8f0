"""Settings that every test shares."""

import os

import pytest
from hypothesis import HealthCheck, settings

# Numba compiles on the first call, so the first example is slow and deadlines mean nothing.
settings.register_profile(
    "bayes_asv", deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("bayes_asv")


def pytest_configure(config: pytest.Config) -> None:
    """Give each of several workers a processor of its own: threads of one would slow the other."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    if worker and hasattr(os, "sched_setaffinity"):
        processors = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {processors[int(worker.removeprefix("gw")) % len(processors)]})
