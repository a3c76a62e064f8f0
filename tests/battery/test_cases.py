"""Cases agree with their truth, are reproducible, and do not reveal it."""

from __future__ import annotations

import numpy as np
import pytest

from bayes_asv.domain.channels import CHANNELS
from benchmarks.battery.seal import digest
from tests.battery.cases import Case, case, make_case
from tests.battery.drives import TERRAIN_NAMES
from tests.battery.effects import EFFECTS, places
from tests.battery.names import parse
from tests.battery.strength import whitened_distance
from tests.battery.unlisted_faults import UNLISTED_FAULTS
from tests.battery.vehicles import FAMILIES, nominal_car

MASS = {name: family.car().m for fleet in FAMILIES.values() for name, family in fleet.items()}


@pytest.fixture(scope="module")
def with_friction() -> Case:
    return case("coulomb_friction@rear-400/rough~baja", 3, 0)


def test_known_sizes_give_the_same_case(with_friction: Case) -> None:
    known = make_case("coulomb_friction@rear-400/rough~baja", 3, 0, "dev",
                             with_friction.truth.effects)  # fmt: skip
    assert known.truth == with_friction.truth
    assert digest(known) == digest(with_friction)
    other = make_case(
        "coulomb_friction@rear-400/rough~baja", 3, 1, "dev", with_friction.truth.effects
    )
    assert digest(other) != digest(with_friction)


def test_an_effect_has_the_intended_strength(with_friction: Case) -> None:
    (effect,) = with_friction.truth.effects
    assert effect.noncentrality == pytest.approx(400.0, rel=0.1)
    assert (effect.name, effect.where) == ("coulomb_friction", "rear")
    assert effect.parameters == {"force": effect.size}
    # with noise: as much beyond its degrees of freedom, and the steps of the converter
    noisy, z = whitened_distance(with_friction.recordings, with_friction.vehicle)
    readings = sum(2 * (len(r.time) - 1) for r in with_friction.recordings)
    excess = noisy - float(z @ z) - readings
    assert 400.0 - 5.0 * np.sqrt(2.0 * readings) < excess < 400.0 + 7.0 * np.sqrt(2.0 * readings)


def test_two_runs_are_over_one_terrain_and_one_over_another(with_friction: Case) -> None:
    assert (len(with_friction.recordings), len(with_friction.holdout)) == (2, 1)
    assert with_friction.truth.terrain == "rough" != with_friction.truth.held_out
    for recording in (*with_friction.recordings, *with_friction.holdout):
        assert len(recording.time) == 1000
        assert recording.time[1] == pytest.approx(1.0 / 400.0)
    assert case("null", 2, 2).truth.terrain == TERRAIN_NAMES[2]


def test_the_input_of_the_diagnosis_does_not_reveal_the_truth(with_friction: Case) -> None:
    seen = [r.source for r in (*with_friction.recordings, *with_friction.holdout)]
    assert seen == ["run-1.csv", "run-2.csv", "held-out-1.csv"]
    assert all(r.metadata == () for r in with_friction.recordings)
    assert with_friction.vehicle.source == "car.toml"
    assert with_friction.vehicle.name == "2008 Cal Poly SAE Baja"
    assert not any(
        word in repr(with_friction.vehicle) for word in (*EFFECTS, *UNLISTED_FAULTS, "rough")
    )


def _level(one: Case) -> float:
    """Rms noise of the wheel channels before the bump, without quantization, over the declared."""
    ratios = []
    for c in (0, 2):
        sensor = one.vehicle.sensor(CHANNELS[c])
        parked = [r.values[c, :120] for r in (*one.recordings, *one.holdout)]
        parked_noise = np.concatenate([values - values.mean() for values in parked])
        step = (sensor.resolution or 0.0) ** 2 / 12.0
        ratios.append((np.var(parked_noise) - step) / (sensor.noise or 1.0) ** 2)
    return float(np.sqrt(np.mean(ratios)))


def test_noise_is_as_declared_unless_it_is_misstated() -> None:
    """With twice the usual noise, above the converter's steps; 720 samples each."""
    chosen = (("null", 2, 1.0), ("noisier+null", 1, 1.2), ("quieter+null", 4, 0.8))
    for name, number, truly in chosen:
        one = case(f"{name}/bump~baja", 2, number)
        assert one.truth.noise == 2.0
        assert _level(one) == pytest.approx(truly, rel=0.12)


def test_tyres_leave_the_ground_in_lifting_cases() -> None:
    one = case("lifting", 2, 0)
    assert one.truth.lifted
    assert one.truth.clipped == 0
    assert one.truth.effects == ()
    q, z = whitened_distance(one.recordings, one.vehicle)
    readings = sum(2 * (len(r.time) - 1) for r in one.recordings)
    assert q - float(z @ z) < readings + 5.0 * np.sqrt(2.0 * readings)  # the half car still holds


def test_deviations_within_tolerance_shift_the_equivalent_damping_slightly() -> None:
    one = case("clutter/rough", 2, 0)
    q, z = whitened_distance(one.recordings, one.vehicle)
    readings = sum(2 * (len(r.time) - 1) for r in one.recordings)
    assert q - float(z @ z) > readings + 30.0
    for name in ("c_f", "c_r"):
        low, high = one.truth.meant[name]
        assert 1.0 <= high / low < 1.03
    assert one.truth.meant["i"] == (one.truth.car["i"],) * 2


def test_a_force_pulse_is_in_one_run() -> None:
    one = case("external_force-400/bump", 2, 0)
    (effect,) = one.truth.effects
    assert effect.run in (0, 1)
    assert effect.held_out < 0.1 * effect.noncentrality  # by the shift of the fitted car


def test_fleets_are_disjoint() -> None:
    assert set(FAMILIES["dev"]).isdisjoint(FAMILIES["test"])
    assert len(MASS) == sum(len(fleet) for fleet in FAMILIES.values())
    rng = np.random.default_rng(0)
    for fleet in FAMILIES.values():
        for name, family in fleet.items():
            car = nominal_car(family, rng)
            assert car.m == pytest.approx(MASS[name], rel=0.5)
            assert car.m != MASS[name]


def test_names_are_parsed() -> None:
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
        ("", "is not the name"),
        ("a b", "is not the name"),
        ("moon-10", "is not a known fault"),
        ("null-40", "has no strength"),
        ("sensor_gain@front", "cannot be at"),
        ("loud+null", "is none of"),
        ("null/moon", "is none of"),
    ):
        with pytest.raises(ValueError, match=why):
            parse(wrong)
    with pytest.raises(ValueError, match="is none of"):
        case("null~hatchback", 1, 0, "dev")
