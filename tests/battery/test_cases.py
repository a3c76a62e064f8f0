"""Cases are what their truth says, the same every time, and tell nothing of it themselves."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.battery.seal import digest
from tests.battery.cases import Case, case, make_case
from tests.battery.courses import TERRAIN_NAMES
from tests.battery.effects import EFFECTS, places
from tests.battery.names import parse
from tests.battery.outside import OUTSIDE
from tests.battery.strength import left_over
from tests.battery.vehicles import FAMILIES, nominal_car

MASS = {name: family.car().m for fleet in FAMILIES.values() for name, family in fleet.items()}


@pytest.fixture(scope="module")
def rubbed() -> Case:
    return case("coulomb_friction@rear-400/rough~baja", 3, 0)


def test_known_sizes_give_the_same_case(rubbed: Case) -> None:
    known = make_case("coulomb_friction@rear-400/rough~baja", 3, 0, "dev",
                             rubbed.truth.effects)  # fmt: skip
    assert known.truth == rubbed.truth
    assert digest(known) == digest(rubbed)
    other = make_case("coulomb_friction@rear-400/rough~baja", 3, 1, "dev", rubbed.truth.effects)
    assert digest(other) != digest(rubbed)


def test_an_effect_has_the_strength_that_was_asked_for(rubbed: Case) -> None:
    (effect,) = rubbed.truth.effects
    assert effect.noncentrality == pytest.approx(400.0, rel=0.1)
    assert (effect.name, effect.where) == ("coulomb_friction", "rear")
    assert effect.parameters == {"force": effect.size}
    # with noise: about as many more than its degrees of freedom, and the steps of the converter
    noisy, z = left_over(rubbed.recordings, rubbed.vehicle)
    readings = sum(2 * (len(r.time) - 1) for r in rubbed.recordings)
    excess = noisy - float(z @ z) - readings
    assert 400.0 - 5.0 * np.sqrt(2.0 * readings) < excess < 400.0 + 7.0 * np.sqrt(2.0 * readings)


def test_runs_are_two_over_one_terrain_and_one_over_another(rubbed: Case) -> None:
    assert (len(rubbed.recordings), len(rubbed.holdout)) == (2, 1)
    assert rubbed.truth.terrain == "rough" != rubbed.truth.held_out
    for recording in (*rubbed.recordings, *rubbed.holdout):
        assert len(recording.time) == 1000
        assert recording.time[1] == pytest.approx(1.0 / 400.0)
    assert case("null", 2, 2).truth.terrain == TERRAIN_NAMES[2]


def test_what_the_diagnosis_sees_says_nothing(rubbed: Case) -> None:
    seen = [r.source for r in (*rubbed.recordings, *rubbed.holdout)]
    assert seen == ["run-1.csv", "run-2.csv", "held-out-1.csv"]
    assert all(r.metadata == () for r in rubbed.recordings)
    assert rubbed.vehicle.source == "car.toml"
    assert rubbed.vehicle.name == "2008 Cal Poly SAE Baja"
    assert not any(word in repr(rubbed.vehicle) for word in (*EFFECTS, *OUTSIDE, "rough"))


def _level(made: Case) -> float:
    """Rms of a wheel's reading before the bump, over what is declared, steps of the reading out."""
    ratios = []
    for c in (0, 2):
        sensor = made.vehicle.sensors[c]
        parked = [r.values[c, :120] for r in (*made.recordings, *made.holdout)]
        quiet = np.concatenate([values - values.mean() for values in parked])
        step = (sensor.resolution or 0.0) ** 2 / 12.0
        ratios.append((np.var(quiet) - step) / (sensor.noise or 1.0) ** 2)
    return float(np.sqrt(np.mean(ratios)))


def test_noise_is_as_declared_unless_it_is_misstated() -> None:
    """With twice the usual noise, which the converter's steps do not drown; 720 samples each."""
    chosen = (("null", 2, 1.0), ("noisier+null", 1, 1.2), ("quieter+null", 4, 0.8))
    for name, number, truly in chosen:
        made = case(f"{name}/bump~baja", 2, number)
        assert made.truth.noise == 2.0
        assert _level(made) == pytest.approx(truly, rel=0.12)


def test_tyres_leave_the_ground_where_they_should() -> None:
    made = case("lifting", 2, 0)
    assert made.truth.lifted
    assert made.truth.clipped == 0
    assert made.truth.effects == ()
    q, z = left_over(made.recordings, made.vehicle)
    readings = sum(2 * (len(r.time) - 1) for r in made.recordings)
    assert q - float(z @ z) < readings + 5.0 * np.sqrt(2.0 * readings)  # the half car holds


def test_clutter_is_there_and_moves_what_c_means_by_its_size_alone() -> None:
    made = case("clutter/rough", 2, 0)
    q, z = left_over(made.recordings, made.vehicle)
    readings = sum(2 * (len(r.time) - 1) for r in made.recordings)
    assert q - float(z @ z) > readings + 30.0
    for name in ("c_f", "c_r"):
        low, high = made.truth.meant[name]
        assert 1.0 <= high / low < 1.03
    assert made.truth.meant["i"] == (made.truth.car["i"],) * 2


def test_a_push_comes_once() -> None:
    made = case("external_force-400/bump", 2, 0)
    (effect,) = made.truth.effects
    assert effect.run in (0, 1)
    assert effect.held_out < 0.1 * effect.noncentrality  # the car that it drew away is met again


def test_fleets_have_no_family_in_common() -> None:
    assert set(FAMILIES["dev"]).isdisjoint(FAMILIES["test"])
    assert len(MASS) == sum(len(fleet) for fleet in FAMILIES.values())
    rng = np.random.default_rng(0)
    for fleet in FAMILIES.values():
        for name, family in fleet.items():
            car = nominal_car(family, rng)
            assert car.m == pytest.approx(MASS[name], rel=0.5)
            assert car.m != MASS[name]


def test_names_are_taken_apart() -> None:
    name = parse("clutter+bound_rebound@rear-40/bump~city car")
    assert (name.modifier, name.kind, name.where) == ("clutter", "bound_rebound", "rear")
    assert (name.strength, name.terrain, name.family) == (40.0, "bump", "city car")
    assert parse("sensor_lag").strength == 400.0
    assert parse("null").strength == 0.0
    for kind in EFFECTS:
        for where in places(kind):
            if where:
                assert parse(f"{kind}@{where}").where == where
    for wrong, why in (
        ("", "is no name"),
        ("a b", "is no name"),
        ("moon-10", "is nothing that can be wrong"),
        ("null-40", "has no strength"),
        ("sensor_gain@front", "cannot sit at"),
        ("loud+null", "is none of"),
        ("null/moon", "is none of"),
    ):
        with pytest.raises(ValueError, match=why):
            parse(wrong)
    with pytest.raises(ValueError, match="is none of"):
        case("null~hatchback", 1, 0, "dev")
