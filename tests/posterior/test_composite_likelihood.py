"""How far the parts of a recording agree, where it is known how far they should."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording
from bayes_asv.posterior.band_fit import composite_likelihood_power, fit_in_band, notes
from bayes_asv.preprocessing.band import low_pass_recording
from tests.posterior.cases import EXACT, case, prepared, vehicle

Array = NDArray[np.float64]


def _scores(parts: int, d: int, seed: int) -> tuple[Array, Array, Array]:
    """Scores of parts whose likelihood is right, its information, and a covariance."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(d, d)) + 2.0 * np.eye(d)
    information = root @ root.T
    covariance = np.asarray(np.linalg.inv(information + np.eye(d)), np.float64)
    scores = rng.normal(size=(parts, d)) @ root.T / np.sqrt(parts)
    return scores, information, covariance


def test_parts_of_a_right_likelihood_agree() -> None:
    raw = []
    for seed in range(200):
        scores, information, covariance = _scores(12, 6, seed)
        # a tenth of the scores, so that nothing meets the limit of one
        raw.append(composite_likelihood_power(10.0**0.5 * scores, information, covariance) * 10.0)
    # E(1/x) of a mean of squares with 66 degrees of freedom is 66/64; 2 % is 1.5 deviations.
    assert 1.0 / np.mean(1.0 / np.array(raw)) == pytest.approx(1.0, abs=0.04)
    assert np.std(raw) < 0.3


@settings(deadline=None, max_examples=50)
@given(factor=st.floats(1.5, 20.0), seed=st.integers(0, 1000))
def test_it_is_the_power_that_makes_the_width_right(factor: float, seed: int) -> None:
    scores, information, covariance = _scores(40, 3, seed)
    about = scores - scores.mean(axis=0)
    spread = about.T @ about * 40.0 / 39.0
    wanted = np.trace(information @ covariance) / np.trace(spread @ covariance) / factor**2
    found = composite_likelihood_power(factor * scores, information, covariance)
    assert found == pytest.approx(min(1.0, wanted))


def test_silence_is_not_held_against_a_recording() -> None:
    assert composite_likelihood_power(np.zeros((6, 2)), np.eye(2), np.eye(2)) == 1.0
    assert composite_likelihood_power(1e-3 * np.eye(3, 2), np.eye(2), np.eye(2)) == 1.0


def _changing(recording: Recording, seed: int) -> Recording:
    """Let the frame answer more to the wheels in one half than in the other, and shake it."""
    rng = np.random.default_rng(seed)
    values = recording.values.copy()
    n = values.shape[1]
    for c in (1, 3):
        slow = np.convolve(rng.normal(size=(n,)), np.hanning(25), "same")
        values[c] += 0.2 * values[c].std() * slow / slow.std()
        values[c, : n // 2] *= 1.2
        values[c, n // 2 :] /= 1.2
    return Recording(recording.time, values, recording.units, (), recording.source)


def test_a_car_that_changes_on_the_way_counts_for_less_than_one_that_does_not() -> None:
    car = vehicle(EXACT)
    _, _, steady = case("rough", 5, EXACT, rate=100.0, seconds=36.0)
    found = {}
    for name, recording in (("steady", steady), ("changing", _changing(steady, 1))):
        line = low_pass_recording(prepared(recording, car), 6.0)
        found[name] = fit_in_band((line,), car)
    # The sensors explain the first one by themselves; not the second.
    assert found["steady"].posterior.space.likelihood == "innovations"
    assert found["steady"].shares == ()
    assert found["changing"].posterior.space.likelihood == "coloured"
    (share,) = found["changing"].shares
    assert share is not None
    assert share < 0.5
    (line,) = found["changing"].posterior.space.recordings
    assert "times as much as the residuals predict" in notes(line, share)[0]


def test_a_short_recording_cannot_tell() -> None:
    car = vehicle(EXACT)
    _, _, recording = case("rough", 5, EXACT, rate=100.0, seconds=8.0)
    line = low_pass_recording(prepared(_changing(recording, 2), car), 6.0)
    found = fit_in_band((line,), car)
    assert found.shares == (None,)
    assert "too short to tell" in notes(line, None)[0]
