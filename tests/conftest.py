"""Settings that every test shares."""

import os

import pytest
from hypothesis import HealthCheck, settings

# Numba compiles on the first call, so the first example is slow and deadlines mean nothing.
settings.register_profile(
    "bayes_asv", deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("bayes_asv")


@pytest.fixture
def without_input_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the search for a mistake in the input, where it is not what a test asks about.

    It fits the car once for each mistake as soon as a fit is doubtful or refused.
    """
    monkeypatch.setattr("bayes_asv.analysis.input_mistakes.likely_mistakes", lambda *_, **__: [])


def pytest_configure(config: pytest.Config) -> None:
    """Give each of several workers a processor of its own: threads of one would slow the other."""
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    if worker and hasattr(os, "sched_setaffinity"):
        processors = sorted(os.sched_getaffinity(0))
        os.sched_setaffinity(0, {processors[int(worker.removeprefix("gw")) % len(processors)]})
