"""What a sensor's fault does must not share the wheels' noise with the innovations."""

from __future__ import annotations

import math

from bayes_asv.posterior.effect_fit import read_effect, with_effects
from bayes_asv.posterior.fitted_model import make_dataset
from bayes_asv.preprocessing.run_preparation import prepare_runs
from tests.battery.cases import case


def test_a_lag_of_a_chassis_sensor_is_as_long_as_it_is() -> None:
    """Patterns from noisy wheels made it 16 % too short, and a narrower filter 17 nats better."""
    one = case("sensor_lag-400", 2, 0, "test")
    (true,) = one.truth.effects
    lines, _, _ = prepare_runs(one.recordings, one.vehicle)
    where = make_dataset(one.vehicle, lines)
    fits = {}
    for name in ("sensor_lag", "sensor_bandwidth"):
        _, fits[name] = with_effects(where, (read_effect(f"{name}@{true.where}"),))
    lag = fits["sensor_lag"]
    (values,) = lag.space.effects(lag.mode.z).values()
    k = lag.space.names.index(f"effect sensor_lag@{true.where} lag")
    sd = 1e-3 * math.sqrt(float(lag.mode.covariance[k, k]))  # the prior's deviation is 1 ms
    assert abs(values["lag"] - true.parameters["lag"]) < 3.5 * sd
    assert lag.mode.log_posterior > fits["sensor_bandwidth"].mode.log_posterior + 5.0
