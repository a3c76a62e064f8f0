"""The posterior of the roll car on drives of the rig's whole car, which shares no code with it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import ROLL_CHANNELS, Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.estimate_result import EstimationResult
from bayes_asv.estimation import estimate
from bayes_asv.filters.kalman import AT_LEAST, VALUE, log_likelihood
from bayes_asv.io import read_recording, write_recording
from bayes_asv.models.car_model import state_space
from bayes_asv.posterior.fisher_scoring import slopes
from bayes_asv.posterior.fit_checks import explained_power_findings, model_bandwidth
from bayes_asv.posterior.free_simulation import simulate_free, unexplained_in_band
from bayes_asv.posterior.likelihood import WHITE, Posterior
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.posterior.parameters import make_parameter_space
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.posterior.cases import prepared
from tests.rig import bump, flat, rough_road
from tests.rig.wide import WideCar, WideRun, shifted, wide_baja, wide_drive, wide_toml

Array = NDArray[np.float64]
DAMPING = ("c_fl", "c_fr", "c_rl", "c_rr")
SPRINGS = ("k_fl", "k_fr", "k_rl", "k_rr")


def worn() -> WideCar:
    """Front left damper at 80 %, other springs than nominal, more roll inertia."""
    car = wide_baja()
    c, k = car.c, car.k
    return replace(
        car, c=(0.8 * c[0], c[1], 1.1 * c[2], 0.95 * c[3]), i_roll=1.15 * car.i_roll,
        k=(1.03 * k[0], 0.98 * k[1], 1.01 * k[2], 0.97 * k[3]),
    )  # fmt: skip


def vehicle(folder: Path, sds: dict[str, float], noise: bool = True) -> Vehicle:
    path = folder / "car.toml"
    path.write_text(wide_toml(wide_baja(), sds, noise=noise), encoding="utf-8")
    return read_vehicle(path)


def as_recording(run: WideRun, name: str = "drive.csv") -> Recording:
    return Recording(run.time, run.channels, ("m/s^2",) * 7, (), name, channels=ROLL_CHANNELS)


def truth(car: WideCar) -> dict[str, float]:
    """Parameters that are estimated."""
    return {**dict(zip(DAMPING, car.c, strict=True)), "i": car.i, "i_roll": car.i_roll}


def values(car: WideCar) -> dict[str, float]:
    """All parameters of the model."""
    known = {name: getattr(car, name) for name in ("m", "l", "wdf", "t_f", "t_r")}
    springs = dict(zip(SPRINGS, car.k, strict=True))
    return truth(car) | known | springs | {"bar_f": 0.0, "bar_r": 0.0, "s_f": car.t_f}


def of_car(recording: PreparedRecording, car: WideCar) -> Array:
    """Parameters of a car in the order of its model."""
    return np.array([values(car)[name] for name in recording.car.names])


def posterior(car: Vehicle, recordings: tuple[PreparedRecording, ...]) -> Posterior:
    return Posterior(make_parameter_space(car, recordings), (WHITE,) * len(recordings))


@pytest.fixture(scope="module")
def estimated(tmp_path_factory: pytest.TempPathFactory) -> tuple[WideCar, EstimationResult]:
    """A worn car over a bump, right wheels 0.6 m later; mass and weight share exact."""
    car = worn()
    road = bump()
    run = wide_drive(car, (road, shifted(road, 0.6)), 4.4, 400.0, 2.0, 5)
    given = vehicle(tmp_path_factory.mktemp("roll"), {"k": 0.05})
    return car, estimate([as_recording(run)], given, seed=1, car="roll")


def test_the_truth_is_within_what_is_claimed(estimated: tuple[WideCar, EstimationResult]) -> None:
    car, result = estimated
    assert (result.verdict, result.reasons) == ("ok", ())
    for name, true in truth(car).items():
        logs = np.log(result.draws[name])
        sd = float(logs.std())
        assert sd < 0.005  # a known mass leaves half a per cent at most
        assert abs(float(logs.mean()) - np.log(true)) < 3.5 * sd


def test_a_worn_damper_is_found_on_its_side(estimated: tuple[WideCar, EstimationResult]) -> None:
    _, result = estimated
    sides = result.draws["c_fl"] / result.draws["c_fr"]
    low, high = np.quantile(sides, [0.025, 0.975])
    assert low < 0.8 < high < 0.82


def test_a_free_run_of_the_true_car_leaves_noise(
    tmp_path: Path, estimated: tuple[WideCar, EstimationResult]
) -> None:
    car, result = estimated
    (fit,) = result.runs
    assert max(unexplained_in_band(fit.prepared, fit.free, model_bandwidth(fit.prepared))) < 0.03
    road = bump()
    run = wide_drive(car, (road, shifted(road, 0.6)), 4.4, 800.0, 1.5, 0, quiet=True)
    recording = prepared(as_recording(run), vehicle(tmp_path, {}, noise=False), "roll")
    output = simulate_free(recording, of_car(recording, car)).output
    for y in range(3):
        use = recording.kind[:, y] == VALUE
        left = recording.reading[use, y] - output[use, y]
        assert np.std(left) < 2e-3 * np.std(recording.reading[use, y])


def test_slopes_are_those_of_the_posterior(tmp_path: Path) -> None:
    run = wide_drive(worn(), (rough_road(1), rough_road(2)), 4.0, 400.0, 1.0, 3)
    known = vehicle(tmp_path, {"m": 0.01, "wdf": 0.01, "k": 0.05})
    line = prepared(as_recording(run), known, "roll")
    # A deflection that starts anywhere within 0.1 m costs the log-likelihood eleven digits, too
    # many for differences over 1e-4; 1 mm leaves them.
    target = posterior(known, (replace(line, initial_covariance=1e-4 * line.initial_covariance),))
    z = 0.02 * np.random.default_rng(0).normal(size=target.space.dimension)
    found = slopes(target, z)
    precision = found.precision()
    step = 1e-3
    numeric = [
        float(np.diff(target.log_posterior(np.stack([z - step * e, z + step * e])))[0]) / (2 * step)
        for e in np.eye(len(z))
    ]
    deviation = np.sqrt(np.diag(precision))  # per posterior deviation, the scale that matters
    np.testing.assert_allclose(
        found.gradient(z) / deviation, numeric / deviation, rtol=1e-3, atol=0.02
    )
    assert np.all(np.linalg.eigvalsh(precision) > 0.9)  # at least the prior's


def test_the_mass_is_not_identified(tmp_path: Path) -> None:
    """Multiply all rates, the inertias and the mass by one factor: the likelihood is the same."""
    run = wide_drive(worn(), (rough_road(1), rough_road(2)), 4.0, 400.0, 1.0, 3)
    known = vehicle(tmp_path, {"m": 0.01, "k": 0.05})
    line = prepared(as_recording(run), known, "roll")
    where = make_parameter_space(known, (line,))
    assert where.prior.unidentified.shape[1] == 1
    z = np.zeros((1, where.dimension))
    scaled = {*truth(worn()), *SPRINGS, "m"}
    found = []
    for factor in (1.0, np.exp(0.05)):
        car = {name: x * (factor if name in scaled else 1.0) for name, x in where.values(z).items()}
        system = state_space(where.car, car, line.output_models)
        found.append(float(log_likelihood(system, where.noises(z, 0), line.measurements)[0]))
    assert found[1] == pytest.approx(found[0], abs=1e-4 * abs(found[0]))


def test_two_recordings_say_more_than_one(tmp_path: Path) -> None:
    known = vehicle(tmp_path, {"k": 0.05})
    lines = [
        prepared(
            as_recording(
                wide_drive(worn(), (rough_road(s), rough_road(s + 50)), 4.0, 400.0, 1.0, s)
            ),
            known,
            "roll",
        )
        for s in (1, 2)
    ]
    sds = []
    for used in (lines[:1], lines):
        target = posterior(known, tuple(used))
        precision = slopes(target, np.zeros(target.space.dimension)).precision()
        covariance = np.asarray(np.linalg.inv(precision), np.float64)
        sds.append([target.space.log_deviation(covariance, name) for name in truth(worn())])
    assert np.all(np.array(sds[1]) < 0.95 * np.array(sds[0]))


def test_a_clipped_reading_is_a_bound(tmp_path: Path) -> None:
    run = wide_drive(worn(), (bump(), bump()), 4.4, 400.0, 1.5, 5)
    top = float(np.sort(run.channels[4])[-4])
    clipped = np.minimum(run.channels, np.array([np.inf] * 4 + [top] + [np.inf] * 2)[:, None])
    path = tmp_path / "car.toml"
    text = wide_toml(wide_baja(), {})
    table = "[sensors.front_left_chassis]\n"
    path.write_text(text.replace(table, f'{table}range = "{top} m/s^2"\n'), encoding="utf-8")
    line = prepared(as_recording(replace(run, channels=clipped)), read_vehicle(path), "roll")
    assert np.count_nonzero(line.kind == AT_LEAST) == 4


@pytest.mark.usefixtures("without_input_search")
@pytest.mark.parametrize("cut", ["still", "short", "dead"])
def test_what_cannot_answer_is_refused_in_words(tmp_path: Path, cut: str) -> None:
    road = flat() if cut == "still" else bump()
    seconds = 0.3 if cut == "short" else 1.0
    run = wide_drive(worn(), (road, road), 4.0, 400.0, seconds, 1)
    channels = run.channels.copy()
    if cut == "dead":
        channels[6, 100:] = np.nan
    recording = as_recording(replace(run, channels=channels))
    result = estimate([recording], vehicle(tmp_path, {}), car="roll")
    assert result.verdict == "refused"
    said = {
        "still": "hardly moved",
        "short": "too short",
        "dead": "300 of 400 readings of the rear chassis sensor",
    }[cut]
    assert any(said in reason for reason in result.reasons)


def test_wheels_that_move_alike_roll_nothing(tmp_path: Path) -> None:
    road = bump()
    run = wide_drive(wide_baja(), (road, road), 4.0, 400.0, 1.5, 1)
    result = estimate([as_recording(run)], vehicle(tmp_path, {}), car="roll")
    assert result.verdict == "refused"
    assert len(result.reasons) == 1
    assert "move alike" in result.reasons[0]


def test_a_wrong_column_is_not_explained(tmp_path: Path) -> None:
    """Left and right chassis sensors mixed up: even the true car does not explain them."""
    road = bump()
    run = wide_drive(worn(), (road, shifted(road, 1.2)), 4.4, 400.0, 2.0, 5)
    given = vehicle(tmp_path, {})
    reasons = []
    for order in ([0, 1, 2, 3, 4, 5, 6], [0, 1, 2, 3, 5, 4, 6]):
        line = prepared(as_recording(replace(run, channels=run.channels[order])), given, "roll")
        refused, doubts = explained_power_findings(line, simulate_free(line, of_car(line, worn())))
        assert not doubts
        reasons.append(refused)
    assert not reasons[0]
    assert len(reasons[1]) == 2
    assert all("drive.csv, too little" in reason for reason in reasons[1])
    assert all("check channels" in reason for reason in reasons[1])
    assert best_fit((line,), given).misfit_reasons  # nor does the best one


def test_the_channels_have_to_fit(tmp_path: Path) -> None:
    n = np.arange(200) / 400.0
    given = vehicle(tmp_path, {})
    four = Recording(n, np.zeros((4, 200)), ("m/s^2",) * 4)
    with pytest.raises(InputError, match="lacks the channel front_left_wheel"):
        prepare_runs([four], given, car="roll")
    seven = Recording(n, np.zeros((7, 200)), ("m/s^2",) * 7, channels=ROLL_CHANNELS)
    text = (tmp_path / "car.toml").read_text(encoding="utf-8")
    (tmp_path / "no.toml").write_text(
        text[: text.index("[roll]")] + text[text.index("[sensors.") :], encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"\[roll\]: is missing"):
        prepare_runs([seven], read_vehicle(tmp_path / "no.toml"), car="roll")


def test_seven_channels_are_written_and_read_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    made = Recording(
        np.arange(50) / 400.0, rng.normal(size=(7, 50)), ("g", *("m/s^2",) * 5, "counts"),
        (("clock rear", "40 ppm"), ("delay rear_chassis", "0.001 s")), channels=ROLL_CHANNELS,
    )  # fmt: skip
    path = tmp_path / "seven.csv"
    write_recording(made, path)
    again = read_recording(path)
    assert (again.channels, again.units) == (made.channels, made.units)
    np.testing.assert_array_equal(again.values, made.values)
