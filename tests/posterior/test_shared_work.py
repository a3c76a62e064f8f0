"""Threads of ours and of BLAS."""

from __future__ import annotations

from threadpoolctl import threadpool_info

from bayes_asv.posterior.likelihood import WHITE, Posterior, shared_work
from bayes_asv.posterior.parameters import make_parameter_space
from tests.posterior.cases import EXACT, case, prepared, vehicle


def _blas() -> list[int]:
    return [int(one["num_threads"]) for one in threadpool_info() if one["user_api"] == "blas"]


def test_blas_has_its_threads_back_when_the_last_has_left() -> None:
    """Of two diagnoses that overlap the first to come is the first to go."""
    car = vehicle(EXACT)
    posterior = Posterior(
        make_parameter_space(car, (prepared(case("bump", 31, EXACT)[2], car),)), (WHITE,)
    )
    before = _blas()
    assert before
    one, two = shared_work(posterior), shared_work(posterior)
    one.__enter__()
    two.__enter__()
    one.__exit__(None, None, None)
    assert _blas() == [1] * len(before)
    two.__exit__(None, None, None)
    assert _blas() == before
