"""Effects in the online filter: against the filter of ``estimate``, on the rig, and refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording, accelerations
from bayes_asv.filters import kalman
from bayes_asv.filters import ukf as unscented
from bayes_asv.filters.ukf_state import ALL
from bayes_asv.models.car_model import bias_directions, state_space
from bayes_asv.models.cars import car_model
from bayes_asv.models.effects import PlacedEffect, placed_effect
from bayes_asv.posterior.effects import law_table
from bayes_asv.tracking.effects import effect_parameters
from bayes_asv.tracking.filter import DEFAULT_SETTINGS, initial_state
from bayes_asv.tracking.filter_model import filter_model
from bayes_asv.tracking.parameters import coordinates
from bayes_asv.tracking.sensor_noise import sensor_model
from bayes_asv.tracking.streaming_timeline import StreamingTimeline
from bayes_asv.tracking.track import track
from bayes_asv.tracking.tracker import Tracker
from tests.posterior.cases import DECLARED, EXACT, as_recording, case, vehicle
from tests.rig import (
    DEFAULT_SPEEDS,
    TERRAINS,
    AsymmetricDamper,
    RigCar,
    SensorSpec,
    baja,
    draw,
    drive,
    with_terms,
)

RATIO = "bound_rebound@front"
NEVER = DEFAULT_SETTINGS._replace(
    gate=1e30, prior_readings=1e30, fast_threshold=1e30, information_gain=1e30,
    review_interval=1e30, fault_duration=1e30, drift_threshold=1e30,
)  # fmt: skip


def _uneven(seed: int, ratio: float = 1.5) -> tuple[RigCar, Recording]:
    car = draw(baja(), np.random.default_rng(seed), DECLARED)
    driven = with_terms(car, "front", AsymmetricDamper(car.c_f, ratio), damper=False)
    run = drive(driven, TERRAINS["bump"](seed), DEFAULT_SPEEDS["bump"], 400.0, 2.0, SensorSpec(), 7)
    return car, as_recording(run, f"uneven-{seed}.csv")


@pytest.mark.parametrize(
    "names", [("bound_rebound@front", "coulomb_friction@both"), ("progressive_spring@rear",)]
)
def test_with_known_parameters_it_is_the_filter_of_estimate(
    names: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The filter of ``estimate`` without forces with memory, which are neglected online."""
    monkeypatch.setattr(kalman, "forces_with_memory", lambda laws, elements: (0, 0))
    given, placed_effects = vehicle(EXACT), tuple(map(placed_effect, names))
    _, _, recording = case("bump", 4, EXACT, seconds=1.0)
    car = car_model("half", given)
    sensors = sensor_model(given, car, CHANNELS)
    steps = StreamingTimeline(given, sensors, 400.0).push(
        recording.time, accelerations(recording, given).T
    ).steps  # fmt: skip
    steps.use[:] = ALL  # the standstill at its beginning as well
    model = filter_model(coordinates(car, CHANNELS, placed_effects=placed_effects), sensors)
    nx = model.sizes.motion - model.sizes.forces
    model.arrays.start[range(nx, nx + 2), range(nx, nx + 2)] = 0.0
    state = initial_state(model)
    state.D[:] = 0.0
    laws = [e.parameter.name in ("ratio", "force", "kappa") for e in model.coordinates.law_effects]
    state.mu[3 : 3 + len(laws)] = np.where(laws, 0.5, 0.0)
    state.statistics[model.at.white_share] = 0.0
    state.statistics[model.at.white_information] = 1e300
    out = np.zeros((len(steps.step), model.into.width))
    unscented.run(model.sizes, 0, False, state, model.arrays, NEVER, steps, out)

    values: dict[PlacedEffect, dict[str, float]] = {
        s: {p.name: p.centre for p in s.effect.parameters if p.memory} for s in placed_effects
    }
    for effect, z in zip(model.coordinates.law_effects, state.mu[3:], strict=False):
        values[effect.placed][effect.parameter.name] = float(effect.values(np.array(z)))
    system = state_space(car, car.nominal, model.outputs)
    system = system._replace(N=bias_directions(system))
    noise = model.arrays.noise.reshape(3, 1, 4)
    start = model.arrays.start[np.ix_(model.initial, model.initial)]
    table = law_table(car, values, 0)[None]
    n = len(steps.step)
    expected = kalman.filter_pass(
        system,
        kalman.SensorNoise(*noise),
        kalman.Measurements(
            steps.step, steps.moments, steps.spread, steps.kind, steps.reading,
            np.zeros((n, 2)), start,
        ),
        kalman.Laws(
            table, model.arrays.laws.pole, steps.ends[:, 1], np.cumsum(steps.step),
            np.zeros((n, 2)),
        ),
    )  # fmt: skip
    assert table.shape[1] == sum(len(s.elements(car)) for s in placed_effects)
    nu = out[:, model.into.innovation : model.into.innovation + 2]
    np.testing.assert_allclose(nu, expected.innovations[0], rtol=1e-5, atol=1e-6)
    found = state.statistics[model.at.log_likelihood]
    assert found == pytest.approx(expected.log_likelihood[0], rel=1e-8)


def test_ratio_of_a_damper_is_tracked() -> None:
    """The rig's law has the ratio 1.46 at 0.5 m/s, see README; no row is lost between chunks."""
    car, recording = _uneven(3)
    given = vehicle(DECLARED)
    assert track(recording, given).consistency.verdict == "inconsistent"
    result = track(recording, given, effects=[placed_effect(RATIO)])
    assert result.verdict == "ok"
    assert result.consistency.verdict == "consistent"
    truth = np.array([car.c_f, car.c_r, car.i])
    assert np.all(np.abs(np.log(result.frames.median[-1] / truth)) < 3 * result.frames.log_sd[-1])
    low, high = np.quantile(result.effects[placed_effect(RATIO)]["ratio"], [0.025, 0.975])
    assert 1.44 < low < high < 1.51
    assert high - low < 0.03
    tracker = Tracker(given, 400.0, effects=[placed_effect(RATIO)])
    values = accelerations(recording, given).T
    for k in range(0, len(values), 77):
        tracker.feed(recording.time[k : k + 77], values[k : k + 77])
    tracker.finish()
    np.testing.assert_allclose(tracker.filter.state.mu, result.mean, rtol=1e-9, atol=1e-9)


def test_saved_tracker_keeps_its_effects(tmp_path) -> None:  # type: ignore[no-untyped-def]
    _, recording = _uneven(4)
    given = vehicle(DECLARED)
    values = accelerations(recording, given).T
    whole = Tracker(given, 400.0, effects=[placed_effect(RATIO)])
    whole.feed(recording.time[:500], values[:500])
    whole.save(tmp_path / "saved.npz")
    restored = Tracker.restore(tmp_path / "saved.npz", given)
    for tracker in (whole, restored):
        tracker.feed(recording.time[500:], values[500:])
    np.testing.assert_array_equal(whole.filter.state.mu, restored.filter.state.mu)


@given(
    name=st.sampled_from(["spring_rate@front", "weight_distribution", "sensor_gain@rear_chassis"]),
    seed=st.integers(0, 1000),
)
def test_wrong_given_values_follow_from_their_coordinates(name: str, seed: int) -> None:
    """Conditioning on the coordinate by draws of effect and given value."""
    given, rng = vehicle(DECLARED), np.random.default_rng(seed)
    space = coordinates(car_model("half", given), CHANNELS, placed_effects=[placed_effect(name)])
    (effect,) = space.effects
    p = len(space)
    mean, sd = space.effect_moments(np.zeros(p), space.factor.T @ space.factor)
    assert mean[0] == pytest.approx(0.0)
    assert sd[0] == pytest.approx(1.0)
    k = int(np.argmax(np.abs(space.by_effect[0])))
    by = space.by_effect[0, k]
    z, left = rng.normal(), 0.1
    at, covariance = np.zeros(p), space.factor.T @ space.factor
    at[k], covariance[k, k] = z, left**2
    mean, sd = space.effect_moments(at, covariance)
    assert mean[0] == pytest.approx(by * z)
    assert sd[0] == pytest.approx(np.hypot(by * left, np.sqrt(1.0 - by**2)))
    assert effect.values(np.array(0.0)) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("external_force@front", "known only after the drive"),
        ("damper_fade@front", "--forget 60"),
        ("sensor_lag@front_chassis", "before and after"),
        ("damper_curve@front", "estimate with it"),
        ("spring_curve@front", "estimate with it"),
        ("damper_hysteresis@front", "estimate with it"),
        ("sensor_gain@front_travel", "not measured"),
        ("bound_rebound@front_left", "no suspension of the half car"),
    ],
)
def test_what_cannot_be_tracked_is_refused_in_one_sentence(name: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        Tracker(vehicle(EXACT), 400.0, effects=[placed_effect(name)])
    assert "\n" not in str(caught.value)


def test_readable_engine_has_no_force_laws() -> None:
    with pytest.raises(InputError, match="no force laws"):
        Tracker(vehicle(EXACT), 400.0, effects=[placed_effect(RATIO)], engine="filterpy")


def test_a_force_is_reported_as_positive() -> None:
    car = car_model("half", vehicle(EXACT))
    force = effect_parameters(car, [placed_effect("coulomb_friction@front")])[0]
    for mean in (-0.5, 0.0, 2.0):
        draws = force.draws(mean, 0.2)
        assert draws.min() >= 0.0
    assert np.median(draws) == pytest.approx(float(force.values(np.array(2.0))), rel=1e-3)
    assert replace(force, linear=False) == force
