"""Recordings drawn from the model, against the kernel's density and exact responses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from bayes_asv.domain.recording import Recording
from bayes_asv.models.discretization import simulate_linear
from bayes_asv.models.half_car_equations import HalfCar, deflection_form
from bayes_asv.posterior.likelihood import WHITE, Posterior
from bayes_asv.posterior.parameters import ParameterSpace, make_parameter_space
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from benchmarks.calibration.cells import MODEL, Cell, Group
from benchmarks.calibration.model_draws import chassis_readings, draw_run, driven_states
from benchmarks.calibration.rig_runs import drive_cell
from tests.posterior.cases import prepared

Array = NDArray[np.float64]

CELL = Cell(Group("short", "Short draws"), MODEL, rate=200.0, seconds=1.2, checked=0)
BUMP = replace(CELL, terrain="bump")


RUNS = 20


@pytest.fixture(scope="module")
def drawn() -> tuple[PreparedRecording, ParameterSpace]:
    """A short drive over a bump, laid out."""
    case = drive_cell(BUMP, 1, 0)
    line = prepared(case.recording, case.vehicle)
    return line, make_parameter_space(case.vehicle, (line,))


def _posteriors(
    recording: PreparedRecording, where: ParameterSpace, truth: Array, runs: int, seed: int
) -> list[Posterior]:
    """Posteriors of recordings drawn at a truth."""
    rng = np.random.default_rng(seed)
    car = where.cars(truth[None])[0]
    noise = np.concatenate([x[0] for x in where.noises(truth[None], 0)])
    out = []
    for _ in range(runs):
        mine = replace(recording, reading=chassis_readings(recording, car, noise, rng))
        out.append(Posterior(replace(where, recordings=(mine,)), (WHITE,)))
    return out


def _squares(posteriors: list[Posterior], z: Array) -> float:
    return float(sum(np.sum(posterior.innovations(z, 0) ** 2) for posterior in posteriors))


def test_innovations_of_draws_are_as_large_as_the_kernel_says(
    drawn: tuple[PreparedRecording, ParameterSpace],
) -> None:
    """Whitened squares of 20 recordings (seed 6) sum to a χ²; false alarm one in 5000.

    And with any one source of noise taken half or twice as strong, or filtered the other way, their
    density is smaller.
    """
    recording, where = drawn
    recording = replace(
        recording, quantization_steps=np.zeros(4)
    )  # a converter's steps would hide the wheels' noise
    where = replace(where, recordings=(recording,))
    # Seed 8 draws 8.6 times the nominal front damping, where the power series of a step, whose
    # length the nominal car sets, no longer holds.
    truth = np.random.default_rng(9).normal(size=where.dimension)
    truth[where.names.index("filtered share 0")] = 0.0  # where both kinds of noise count
    posteriors = _posteriors(recording, where, truth, RUNS, 6)
    count = RUNS * recording.readings
    assert chi2.cdf(_squares(posteriors, truth), count) == pytest.approx(0.5, abs=0.4999)
    sources = [k for k, name in enumerate(where.names) if name.startswith("noise")]
    assert len(sources) == 4
    share = where.names.index("filtered share 0")
    wrong_by = [(k, np.log(f) / where.coordinates[k].scale) for k in sources for f in (0.5, 2.0)]
    wrong_by += [(share, -2.0), (share, 2.0)]  # a fiftieth or all but a fiftieth of the noise
    for k, change in wrong_by:
        off = truth.copy()
        off[k] += change
        points = np.stack([truth, off])
        right, wrong = np.sum(
            [posterior.log_likelihood(points) for posterior in posteriors], axis=0
        )
        assert right > wrong + 5.0, where.names[k]


def test_readings_have_the_covariance_that_the_kernel_states() -> None:
    """Whitened by the kernel, the first readings of 100 draws (seed 7) are uncorrelated."""
    case = drive_cell(BUMP, 1, 0)
    first = 14  # rows
    cut = Recording(case.recording.time[:first], case.recording.values[:, :first], ("m/s^2",) * 4)
    line = prepared(cut, case.vehicle)
    where = make_parameter_space(case.vehicle, (line,))
    truth = np.random.default_rng(9).normal(size=where.dimension)
    posteriors = _posteriors(line, where, truth, 100, 7)
    x = np.array([posterior.innovations(truth, 0)[:12].ravel() for posterior in posteriors])
    second = x.T @ x / len(x)
    apart = (second - np.eye(x.shape[1])) * np.sqrt(len(x))
    apart[np.diag_indices_from(apart)] /= np.sqrt(2.0)
    # 300 standard normal entries: beyond 4.6 one in a thousand times
    assert np.abs(apart).max() < 4.6


def test_driven_states_are_the_exact_response_to_the_splines(
    drawn: tuple[PreparedRecording, ParameterSpace],
) -> None:
    """Against the exact response to straight pieces so short that they are the spline."""
    recording, where = drawn
    car = where.cars(np.zeros((1, where.dimension)))[0]
    fine = np.union1d(
        recording.instants, np.linspace(recording.instants[0], recording.instants[-1], 6000)
    )
    u = np.stack([np.asarray(w.spline(fine)) for w in recording.wheels], axis=1)
    system = deflection_form(HalfCar(*(float(v) for v in car)))
    wanted = simulate_linear(system, fine, u)[np.searchsorted(fine, recording.instants)]
    found = driven_states(recording, car)
    scale = np.abs(wanted).max(axis=0)
    np.testing.assert_allclose(found / scale, wanted / scale, atol=1e-5)


def test_a_drawn_recording_is_laid_out_as_the_drive_it_came_from() -> None:
    """Only the chassis readings differ: the model's input must not move with its output."""
    drawn = draw_run(CELL, 3, 1)
    case = drive_cell(CELL, 3, 1)
    mine, theirs = prepared(drawn.recording, drawn.vehicle), prepared(case.recording, drawn.vehicle)
    np.testing.assert_array_equal(mine.moments, theirs.moments)
    np.testing.assert_array_equal(mine.process_noise, theirs.process_noise)
    np.testing.assert_array_equal(mine.instants, theirs.instants)
    np.testing.assert_array_equal(mine.kind, theirs.kind)
    assert np.abs(mine.reading - theirs.reading).max() > 0.1
    again = draw_run(CELL, 3, 1)
    np.testing.assert_array_equal(again.recording.values, drawn.recording.values)


def test_truths_are_drawn_from_the_prior() -> None:
    """Seed 1, 16 draws: coordinates standard normal, c_f log-normal about nominal by 30 %."""
    some = [draw_run(replace(CELL, seconds=0.5), 1, k) for k in range(16)]
    z = np.array([one.z for one in some])
    assert chi2.cdf(float(np.sum(z**2)), z.size) == pytest.approx(0.5, abs=0.4999)
    assert abs(float(z.mean())) < 4.0 / np.sqrt(z.size)
    logs = np.log([one.car[0] for one in some]) - np.log(some[0].vehicle.c_f.value)
    assert 0.29 * 0.4 < float(np.std(logs)) < 0.29 * 1.8
