"""The posterior of the car that rolls on drives of the rig's whole car."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import CHANNELS, ROLL_CHANNELS, Recording
from bayes_asv.domain.vehicle import Vehicle, read_vehicle
from bayes_asv.filters.kalman import AT_LEAST, VALUE
from bayes_asv.io import read_recording, write_recording
from bayes_asv.models.roll_car import RollCar
from bayes_asv.posterior.roll.estimate import RollEstimate, estimate_roll
from bayes_asv.posterior.roll.freerun import free_run, left_over
from bayes_asv.posterior.roll.layout import lay_out
from bayes_asv.posterior.roll.posterior import _slopes, roll_posterior
from bayes_asv.posterior.roll.preflight import unexplained
from tests.rig import bump, flat, rough_road
from tests.rig.wide import WideCar, WideRun, shifted, wide_baja, wide_drive, wide_toml


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


def recording(run: WideRun, name: str = "drive.csv") -> Recording:
    return Recording(run.time, run.channels, ("m/s^2",) * 7, (), name, channels=ROLL_CHANNELS)


def truth(car: WideCar) -> dict[str, float]:
    rates = dict(zip(("c_fl", "c_fr", "c_rl", "c_rr"), car.c, strict=True))
    return {**rates, "i": car.i, "i_roll": car.i_roll}


def as_roll(car: WideCar) -> RollCar:
    return RollCar(
        *car.c,
        car.i,
        car.i_roll,
        car.m,
        car.l,
        car.wdf,
        *car.k,
        car.t_f,
        car.t_r,
        0.0,
        0.0,
        car.t_f,
    )


@pytest.fixture(scope="module")
def answered(tmp_path_factory: pytest.TempPathFactory) -> tuple[WideCar, RollEstimate]:
    """A worn car over a bump, right wheels 0.6 m later; mass and weight share exact."""
    car = worn()
    road = bump()
    run = wide_drive(car, (road, shifted(road, 0.6)), 4.4, 400.0, 2.0, 5)
    given = vehicle(tmp_path_factory.mktemp("roll"), {"k": 0.05})
    return car, estimate_roll([recording(run)], given, seed=1)


def test_the_truth_is_within_what_is_claimed(answered: tuple[WideCar, RollEstimate]) -> None:
    car, found = answered
    assert (found.verdict, found.reasons) == ("ok", ())
    assert found.weighted is not None
    for name, true in truth(car).items():
        logs = np.log(found.quantities[name])
        sd = found.weighted.sd(logs)
        assert sd < 0.005  # a known mass leaves half a per cent at most
        assert abs(found.weighted.mean(logs) - np.log(true)) < 3.5 * sd


def test_a_worn_damper_is_found_on_its_side(answered: tuple[WideCar, RollEstimate]) -> None:
    _, found = answered
    assert found.weighted is not None
    sides = found.quantities["c_fl"] / found.quantities["c_fr"]
    low, high = found.weighted.quantile(sides, np.array([0.025, 0.975]))
    assert low < 0.8 < high < 0.82


def test_a_free_run_of_the_true_car_leaves_noise(
    tmp_path: Path, answered: tuple[WideCar, RollEstimate]
) -> None:
    car, found = answered
    assert max(found.left[0].values()) < 0.03
    road = bump()
    run = wide_drive(car, (road, shifted(road, 0.6)), 4.4, 800.0, 1.5, 0, quiet=True)
    line = lay_out(recording(run), vehicle(tmp_path, {}, noise=False))
    output = free_run(as_roll(car), line)
    for y in range(3):
        use = line.kind[:, y] == VALUE
        left = line.reading[use, y] - output[use, y]
        assert np.std(left) < 2e-3 * np.std(line.reading[use, y])


def test_slopes_are_those_of_the_posterior(tmp_path: Path) -> None:
    run = wide_drive(worn(), (rough_road(1), rough_road(2)), 4.0, 400.0, 1.0, 3)
    target = roll_posterior(
        vehicle(tmp_path, {"m": 0.01, "wdf": 0.01, "k": 0.05}),
        (lay_out(recording(run), vehicle(tmp_path, {})),),
    )
    z = 0.02 * np.random.default_rng(0).normal(size=len(target.names))
    gradient, precision = _slopes(target, z)
    step = 1e-3
    numeric = [
        float(np.diff(target.log_posterior(np.stack([z - step * e, z + step * e])))[0]) / (2 * step)
        for e in np.eye(len(z))
    ]
    deviation = np.sqrt(np.diag(precision))  # per posterior deviation, the scale that matters
    np.testing.assert_allclose(gradient / deviation, numeric / deviation, rtol=1e-3, atol=0.02)
    assert np.all(np.linalg.eigvalsh(precision) > 0.9)  # at least the prior's


def test_mass_scales_everything_and_cannot_be_seen(tmp_path: Path) -> None:
    """All rates, inertias and the mass times one factor: the same likelihood."""
    run = wide_drive(worn(), (rough_road(1), rough_road(2)), 4.0, 400.0, 1.0, 3)
    known = vehicle(tmp_path, {"m": 0.01, "k": 0.05})
    target = roll_posterior(known, (lay_out(recording(run), known),))
    z = np.zeros(len(target.names))
    moved = z.copy()
    for name in ("c_fl", "c_fr", "c_rl", "c_rr", "i", "i_roll", "m", "k_f", "k_r"):
        k = target.names.index(name)
        moved[k] += 0.05 / target.scale[k]
    # the filter's small start and drift aside, which know no mass
    one, two = (target.innovations(at, 0)[0] for at in (z, moved))
    assert two == pytest.approx(one, abs=1e-4 * abs(one))


def test_two_recordings_say_more_than_one(tmp_path: Path) -> None:
    known = vehicle(tmp_path, {"k": 0.05})
    runs = [
        lay_out(
            recording(wide_drive(worn(), (rough_road(s), rough_road(s + 50)), 4.0, 400.0, 1.0, s)),
            known,
        )
        for s in (1, 2)
    ]
    sds = []
    for used in (runs[:1], runs):
        target = roll_posterior(known, tuple(used))
        _, precision = _slopes(target, np.zeros(len(target.names)))
        sds.append(np.sqrt(np.diag(np.linalg.inv(precision)))[:6])
    assert np.all(sds[1] < 0.95 * sds[0])


def test_a_clipped_reading_is_a_bound(tmp_path: Path) -> None:
    run = wide_drive(worn(), (bump(), bump()), 4.4, 400.0, 1.5, 5)
    top = float(np.sort(run.channels[4])[-4])
    clipped = np.minimum(run.channels, np.array([np.inf] * 4 + [top] + [np.inf] * 2)[:, None])
    path = tmp_path / "car.toml"
    text = wide_toml(wide_baja(), {})
    table = "[sensors.front_left_chassis]\n"
    path.write_text(text.replace(table, f'{table}range = "{top} m/s^2"\n'), encoding="utf-8")
    line = lay_out(recording(replace(run, channels=clipped)), read_vehicle(path))
    assert np.count_nonzero(line.kind == AT_LEAST) == 4


@pytest.mark.parametrize("cut", ["still", "short", "dead"])
def test_what_cannot_answer_is_refused_in_words(tmp_path: Path, cut: str) -> None:
    road = flat() if cut == "still" else bump()
    seconds = 0.3 if cut == "short" else 1.0
    run = wide_drive(worn(), (road, road), 4.0, 400.0, seconds, 1)
    channels = run.channels.copy()
    if cut == "dead":
        channels[6, 100:] = np.nan
    found = estimate_roll([recording(replace(run, channels=channels))], vehicle(tmp_path, {}))
    assert found.verdict == "refused"
    said = {"still": "hardly moves", "short": "too short", "dead": "lacks 75%"}[cut]
    assert any(said in reason for reason in found.reasons)


def test_wheels_that_move_alike_roll_nothing(tmp_path: Path) -> None:
    road = bump()
    run = wide_drive(wide_baja(), (road, road), 4.0, 400.0, 1.5, 1)
    found = estimate_roll([recording(run)], vehicle(tmp_path, {}))
    assert found.verdict == "refused"
    assert len(found.reasons) == 1
    assert "move alike" in found.reasons[0]


def test_a_wrong_column_is_not_explained(tmp_path: Path) -> None:
    """Left and right chassis sensors mixed up: even the true car does not explain them."""
    road = bump()
    run = wide_drive(worn(), (road, shifted(road, 1.2)), 4.4, 400.0, 2.0, 5)
    given = vehicle(tmp_path, {})
    reasons = []
    for order in ([0, 1, 2, 3, 4, 5, 6], [0, 1, 2, 3, 5, 4, 6]):
        line = lay_out(recording(replace(run, channels=run.channels[order])), given)
        refused, doubts = unexplained(left_over(as_roll(worn()), line), "drive.csv")
        assert not doubts
        reasons.append(refused)
    assert not reasons[0]
    assert len(reasons[1]) == 2
    assert all("motion of drive.csv; check channels" in reason for reason in reasons[1])


def test_the_channels_have_to_fit(tmp_path: Path) -> None:
    n = np.arange(200) / 400.0
    four = Recording(n, np.zeros((4, 200)), ("m/s^2",) * 4)
    assert four.channels == CHANNELS
    with pytest.raises(InputError, match="needs seven"):
        lay_out(four, vehicle(tmp_path, {}))
    seven = Recording(n, np.zeros((7, 200)), ("m/s^2",) * 7, channels=ROLL_CHANNELS)
    text = (tmp_path / "car.toml").read_text(encoding="utf-8")
    (tmp_path / "no.toml").write_text(
        text[: text.index("[roll]")] + text[text.index("[sensors.") :], encoding="utf-8"
    )
    with pytest.raises(InputError, match=r"\[roll\]: is missing"):
        lay_out(seven, read_vehicle(tmp_path / "no.toml"))


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
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(line.rsplit(",", 1)[0] for line in lines) + "\n", encoding="utf-8")
    with pytest.raises(InputError, match="column rear_chassis is missing"):
        read_recording(path)
