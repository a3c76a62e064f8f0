"""The tracker from rows to frames, on simulated drives."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import chi2

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import accelerations, timing
from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.io import read_recording
from bayes_asv.posterior.map_fit import best_fit
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.shipped import shipped
from bayes_asv.tracking.filter import parameter_covariance
from bayes_asv.tracking.frames import Frames, concatenate
from bayes_asv.tracking.tracker import Tracker, tracker_for
from tests.posterior.cases import DECLARED, EXACT, case, vehicle
from tests.rig import SensorSpec
from tests.tracking.drives import long_drive, tracked, true_parameters, z_scores

DATA = Path(__file__).parent / "data"


def _differing(one: Frames, two: Frames) -> list[str]:
    """Names of the columns that differ."""
    pairs = ((name, getattr(one, name), getattr(two, name)) for name in Frames.__dataclass_fields__)
    return [name for name, a, b in pairs if not np.array_equal(a, b, equal_nan=True)]


def test_estimate_agrees_with_the_posterior() -> None:
    """Mode and curvature of the posterior, on a shipped drive with uncertain given values."""
    recording = read_recording(str(shipped("recordings", "bump-400hz.csv")))
    car = read_vehicle(str(shipped("vehicles", "baja2008.toml")))
    lines, reasons, _ = prepare_runs([recording], car)
    assert not reasons
    found = best_fit(lines, car)
    mode = found.space.cars(found.mode.z[None])[0]
    _, frames = tracked(recording, car)
    for k, name in enumerate(("c_f", "c_r", "i")):
        sd = found.space.log_deviation(found.mode.covariance, name)
        assert abs(np.log(frames.median[-1, k] / mode[k])) < 0.3 * sd
        assert frames.log_sd[-1, k] == pytest.approx(sd, rel=0.1)


def test_nees_over_twelve_drives() -> None:
    """NEES over twelve drives of as many cars, with exact given values; seeds 700 to 711.

    The sum is χ² with 36 degrees of freedom; one set of seeds in a hundred lies outside.
    """
    total, inside = 0.0, 0
    for seed in range(700, 712):
        terrain = ("bump", "stops", "rough", "rollers")[seed % 4]
        car, _, recording = case(terrain, seed, EXACT)
        tracker, frames = tracked(recording, vehicle(EXACT))
        error = np.log(frames.median[-1] / true_parameters(car))
        scale = tracker.coordinates.scale[:3]
        covariance = parameter_covariance(tracker.filter.state)[:3, :3] * np.outer(scale, scale)
        total += float(error @ np.linalg.solve(covariance, error))
        inside += int(np.sum(np.abs(z_scores(frames, car)) < 1.96))
        assert np.median(np.abs(error)) < 0.01
        assert tracker.consistency.summary().verdict == "consistent"
    assert chi2.ppf(0.005, 36) < total < chi2.ppf(0.995, 36)
    assert inside >= 31  # of 36: fewer are seen once in a hundred


def test_nothing_is_learnt_at_rest() -> None:
    _, _, recording = case("flat", 1, DECLARED, seconds=3.0)
    _, frames = tracked(recording)
    before = tracker_for(recording, vehicle(DECLARED)).coordinates.scale[:3]
    np.testing.assert_allclose(frames.log_sd[-1], before, rtol=0.05)
    assert np.abs(frames.deflection[-2]).max() < 0.01


def test_chunk_size_has_no_effect() -> None:
    _, _, recording = case("stops", 3, DECLARED, seconds=0.9, sensors=SensorSpec(dropped=0.02))
    _, whole = tracked(recording)
    for chunk in (3, 100):
        assert _differing(whole, tracked(recording, chunk=chunk)[1]) == []


def test_columns_of_the_frames() -> None:
    _, run, recording = case("rough", 4, DECLARED)
    _, frames = tracked(recording)
    n = len(recording.time)
    np.testing.assert_array_equal(frames.time, recording.time)
    assert set(np.unique(frames.readings)) <= {0.0, 1.0, 2.0}
    measured = accelerations(recording, vehicle(DECLARED))[[1, 3]].T
    seen = np.isfinite(frames.measured)
    np.testing.assert_array_equal(frames.measured[seen], measured[seen])
    assert seen.mean() > 0.99
    # once the car is known, one-step prediction errors match their standard deviation
    late = slice(n // 2, n - 1)
    z = (frames.measured - frames.predicted)[late] / frames.predicted_sd[late]
    assert 0.8 < np.nanstd(z) < 1.2
    # deflection, up to the sensors' filters and biases
    difference = frames.deflection[n // 2 :] - run.deflection.T[n // 2 :]
    assert np.nanstd(difference) < 0.25 * run.deflection.std()
    assert np.all(frames.log_sd[n // 2 :, :] < 0.05)
    assert np.all((frames.nis_low <= 1.0) & (frames.nis_high >= 1.0))
    assert np.all(frames.inflation >= 1.0)


def test_restored_tracker_gives_the_same_results(tmp_path: Path) -> None:
    _, _, recording = case("bump", 6, DECLARED)
    car = vehicle(DECLARED)
    acc = accelerations(recording, car).T
    _, whole = tracked(recording)
    file = tmp_path / "car.npz"
    for at in (30, 180, 500):  # before it learns, while it relinearizes, and later
        first = tracker_for(recording, car)
        parts = [first.feed(recording.time[:at], acc[:at])]
        first.save(file)
        second = Tracker.restore(file, car)
        parts += [second.feed(recording.time[at:], acc[at:]), second.finish()]
        assert _differing(whole, concatenate(parts)) == []


def test_checkpoint_of_an_earlier_version_can_be_restored() -> None:
    """A file that version 0.1 wrote after 180 rows, while it relinearized.

    Until there it listened to a car that stood still, which this version does not.
    """
    _, _, recording = case("bump", 6, DECLARED)
    acc = accelerations(recording, vehicle(DECLARED)).T
    _, whole = tracked(recording)
    tracker = Tracker.restore(DATA / "checkpoint-1.npz", vehicle(DECLARED))
    assert tracker.filter.relinearizing
    frames = concatenate([tracker.feed(recording.time[180:], acc[180:]), tracker.finish()])
    rows = slice(-len(frames), None)
    difference = np.log(frames.median[-1] / whole.median[rows][-1])
    assert np.all(np.abs(difference) < 0.1 * whole.log_sd[-1])
    np.testing.assert_allclose(frames.log_sd[-1], whole.log_sd[-1], rtol=0.05)
    assert frames.consistent[-1] == whole.consistent[-1]


def test_damaged_or_foreign_checkpoints_are_refused(tmp_path: Path) -> None:
    _, _, recording = case("bump", 6, DECLARED, seconds=0.5)
    tracker, _ = tracked(recording)
    file = tmp_path / "car.npz"
    tracker.save(file)
    with pytest.raises(InputError, match="another vehicle"):
        Tracker.restore(file, vehicle(EXACT))
    data = file.read_bytes()
    for broken in (b"PK", data[: len(data) // 2], b"\x00" * 100):
        (tmp_path / "broken.npz").write_bytes(broken)
        with pytest.raises(InputError, match="no saved tracker"):
            Tracker.restore(tmp_path / "broken.npz", vehicle(DECLARED))
    with pytest.raises(InputError):
        Tracker.restore(tmp_path / "none.npz", vehicle(DECLARED))


def test_another_recording_starts_from_the_known_parameters() -> None:
    car, _, first = case("bump", 8, DECLARED)
    tracker, frames = tracked(first)
    second = replace(long_drive(2.0, 3)[1], time=first.time)
    tracker.resume()
    acc = accelerations(second, vehicle(DECLARED)).T
    again = concatenate([tracker.feed(second.time, acc), tracker.finish()])
    np.testing.assert_allclose(again.median[0], frames.median[-1], rtol=1e-9)
    np.testing.assert_allclose(again.log_sd[0], frames.log_sd[-1], rtol=1e-9)
    assert car.c_f > 0.0


def test_another_recording_has_delays_of_its_own() -> None:
    """It gives what a tracker gives that knew them from its beginning."""
    _, _, recording = case("bump", 8, DECLARED, seconds=1.0)
    late = replace(recording, metadata=(*recording.metadata, ("delay front_wheel", "0.003 s")))
    acc = accelerations(late, vehicle(DECLARED)).T
    tracker = tracker_for(recording, vehicle(DECLARED))
    tracker.resume(timing(late))
    again = concatenate([tracker.feed(late.time, acc), tracker.finish()])
    assert _differing(again, tracked(late)[1]) == []
    assert _differing(again, tracked(recording)[1])


def test_missing_noise_levels_are_estimated() -> None:
    car, _, recording = case("rough", 5, DECLARED, seconds=3.0)
    given = vehicle(DECLARED)
    sensors = {name: replace(s, noise=None) for name, s in given.sensors.items()}
    car_without_noise = replace(given, sensors=sensors)
    tracker = tracker_for(recording, car_without_noise)
    acc = accelerations(recording, car_without_noise).T
    assert len(tracker.feed(recording.time[:150], acc[:150])) == 0
    assert not tracker.started
    frames = concatenate([tracker.feed(recording.time[150:], acc[150:]), tracker.finish()])
    assert len(frames) == len(recording.time)
    assert np.all(np.abs(z_scores(frames, car)) < 3.0)
    assert tracker.consistency.summary().verdict == "consistent"


@pytest.mark.parametrize("terrain", ["bump", "rough"])
def test_missing_steps_of_a_converter_are_read_off(terrain: str) -> None:
    """Most readings at standstill are equal; that is no noise of zero."""
    car, _, recording = case(terrain, 5, DECLARED, seconds=3.0)
    given = vehicle(DECLARED)
    sensors = {
        name: replace(s, noise=None, resolution=None, counts_scale=None)
        for name, s in given.sensors.items()
    }
    acc = accelerations(recording, given)
    recording = replace(recording, values=acc, units=("m/s^2",) * len(acc))
    tracker, frames = tracked(recording, replace(given, sensors=sensors))
    assert np.all(np.abs(z_scores(frames, car)) < 3.0)
    assert tracker.consistency.summary().verdict == "consistent"


@pytest.mark.parametrize(
    ("rate", "forget", "engine"),
    [
        (0.0, None, "compiled"),
        (400.0, -1.0, "compiled"),
        (400.0, 1e300, "compiled"),
        (400.0, None, "steam"),
    ],
)
def test_impossible_arguments_are_refused(rate: float, forget: float | None, engine: str) -> None:
    with pytest.raises(InputError):
        Tracker(vehicle(EXACT), rate, forget=forget, engine=engine)
