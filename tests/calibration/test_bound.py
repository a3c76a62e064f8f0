"""The bound by the product's recursion against whole covariance matrices and a known answer."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from bayes_asv.posterior.parameters import make_parameter_space
from benchmarks.calibration import dense
from benchmarks.calibration.bound import bounds, information, true_noise, true_wheels
from benchmarks.calibration.cells import Cell, Group
from benchmarks.calibration.quantities import coordinates
from benchmarks.calibration.rig_runs import Case, drive_cell
from tests.posterior.cases import prepared
from tests.rig.sensors import SensorSpec

SHORT = Cell(Group("short", "Short drives"), "bump", rate=200.0, seconds=1.2, exact=True)


def _by_matrices(
    case: Case,
) -> tuple[dense.Drive, np.ndarray[tuple[int, int], np.dtype[np.float64]]]:
    line = prepared(case.recording, case.vehicle)
    fine, wheels = true_wheels(case.motion, case.sensors)
    known = true_noise(case.sensors)
    noise = [dense.Noise(known[c], known[4 + c], known[8 + c]) for c in (0, 2, 1, 3)]
    read = line.instants[line.kind[:, 0] != 0]
    inside = (fine > read[0] - 0.2) & (fine < read[-1] + 0.01)
    drive = dense.Drive(
        fine[inside], wheels[:, inside], line.times[0], read,
        (noise[0], noise[1], noise[2], noise[3]), np.diag(line.initial_covariance),
    )  # fmt: skip
    return drive, dense.information(case.car, drive, (0, 1, 2))[0]


@pytest.mark.parametrize("white", [False, True], ids=["filtered", "white"])
def test_both_computations_agree(white: bool) -> None:
    """To 0.2 %: the recursion takes the noise between samples as a flow, not as a spline."""
    case = drive_cell(replace(SHORT, white=white), 1, 2)
    where = make_parameter_space(case.vehicle, (prepared(case.recording, case.vehicle),))
    precision = information(case, where)
    _, wanted = _by_matrices(case)
    # from the estimator's coordinates to logarithms of c_f, c_r, i
    turn = where.prior.identified[:3] / where.prior.log_sd[:3, None]
    found = turn @ precision @ turn.T
    sd, sd_wanted = (np.sqrt(np.diag(np.linalg.inv(J))) for J in (found, wanted))
    np.testing.assert_allclose(sd, sd_wanted, rtol=2e-3)
    np.testing.assert_allclose(
        np.linalg.inv(found) / np.outer(sd, sd),
        np.linalg.inv(wanted) / np.outer(sd_wanted, sd_wanted),
        atol=2e-3,
    )


def test_what_the_noise_tells_is_next_to_nothing() -> None:
    """Why the bound may leave it out."""
    case = drive_cell(replace(SHORT, rate=100.0, seconds=0.8), 1, 2)
    drive, _ = _by_matrices(case)
    mean, noise = dense.information(case.car, drive, (0, 2), noise_too=True)
    assert np.all(np.diag(noise) > 0.0)
    before, after = (np.sqrt(np.diag(np.linalg.inv(J))) for J in (mean, mean + noise))
    np.testing.assert_allclose(after, before, rtol=1e-4)


def test_without_motion_the_bound_is_the_prior() -> None:
    case = drive_cell(replace(SHORT, exact=False), 1, 2)
    still = replace(case, motion=replace(case.motion, acceleration=0.0 * case.motion.acceleration))
    where = make_parameter_space(case.vehicle, (prepared(case.recording, case.vehicle),))
    found = bounds(still, where, ("c_f", "i", "k_g"))
    mass = math.sqrt(math.log(0.5 * (1.0 + math.sqrt(1.0 + 4.0 * 0.01**2))))
    assert found["c_f"] == pytest.approx(math.log(3.0), rel=1e-6)
    assert found["i"] == pytest.approx(math.log(2.0), rel=1e-6)
    assert found["k_g"] == pytest.approx(0.5 * math.hypot(math.log(2.0), mass), rel=1e-6)


def test_less_noise_and_faster_rows_bound_closer() -> None:
    case = drive_cell(SHORT, 1, 2)
    where = make_parameter_space(case.vehicle, (prepared(case.recording, case.vehicle),))
    base = bounds(case, where, ("c_f",))["c_f"]
    quiet = replace(case.sensors, noise=(1e-4,) * 4, adc=None)
    assert bounds(replace(case, sensors=quiet), where, ("c_f",))["c_f"] < 0.1 * base
    faster = drive_cell(replace(SHORT, rate=400.0), 1, 2)
    there = make_parameter_space(faster.vehicle, (prepared(faster.recording, faster.vehicle),))
    assert bounds(faster, there, ("c_f",))["c_f"] < base


def test_coordinates_of_a_car_lead_back_to_it() -> None:
    case = drive_cell(replace(SHORT, exact=False), 1, 3)
    where = make_parameter_space(case.vehicle, (prepared(case.recording, case.vehicle),))
    z = coordinates(where, case.car)
    # what cannot be seen is not in the coordinates: compare what can
    there, back = (
        dict(zip(where.car.names, car, strict=True)) for car in (case.car, where.cars(z[None])[0])
    )
    for name in ("c_f", "c_r", "k_f", "k_r"):
        assert back[name] / back["m"] == pytest.approx(there[name] / there["m"], rel=1e-9)
    assert back["i"] / back["m"] == pytest.approx(there["i"] / there["m"], rel=1e-9)
    assert back["wdf"] == pytest.approx(there["wdf"], rel=1e-12)


def test_true_noise_keeps_the_whole_variance() -> None:
    spec = SensorSpec()
    assert spec.adc is not None
    filtered, white = true_noise(spec), true_noise(replace(spec, noise_kind="white"))
    for column, c in enumerate((0, 2, 1, 3)):
        whole = spec.noise[c] ** 2 + spec.adc.scale[c] ** 2 / 12.0
        assert filtered[column] + filtered[4 + column] == pytest.approx(whole)
        assert white[column] == pytest.approx(whole)
        assert white[4 + column] == 0.0
