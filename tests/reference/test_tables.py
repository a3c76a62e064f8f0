"""Tables, and the recordings without a road."""

from __future__ import annotations

import numpy as np
import pytest

from bayes_asv.reference.experiments import common_sensor_readings, engine_readings, shipped_vehicle
from bayes_asv.reference.greybox import nominal_car
from bayes_asv.reference.printed import car_of_table_71, errata
from bayes_asv.reference.tables import Row, quantities, table_41, table_42, table_51, table_71

BAJA = shipped_vehicle("baja2008.toml")


def test_the_shipped_vehicles_are_the_printed_ones() -> None:
    assert nominal_car(BAJA) == pytest.approx(car_of_table_71(), rel=1e-12)
    ours = quantities(nominal_car(shipped_vehicle("thesis_simulation.toml")))
    assert ours["k_g"] == pytest.approx(10.0, rel=1e-9)
    assert (ours["zeta_f"], ours["zeta_r"]) == pytest.approx((0.7, 0.5), rel=1e-9)


def test_corrected_and_obtained_values_agree() -> None:
    for table in (table_41(), table_42()):
        for row in table.rows:
            assert row.obtained == pytest.approx(row.corrected, rel=1e-9), row.name
    for row in table_71().rows:
        assert row.corrected == pytest.approx(row.printed, rel=2e-3), row.name


def test_a_difference_is_that_of_the_obtained_from_the_printed() -> None:
    row = Row("x", "x", "", 2.0, None, None, 2.1, "here")
    assert row.difference == pytest.approx(0.05)
    assert row.plain()["difference_percent"] == pytest.approx(5.0)
    assert Row("x", "x", "", None, None, 1.0, 1.0, "here").difference is None


def test_table_51_shows_the_given_estimates() -> None:
    found = {"k_g": 9.0, "zeta_f": 0.72, "zeta_r": 0.51}
    rows = {row.name: row for row in table_51(found, found).rows}
    assert rows["k_g"].printed == 9.985
    assert rows["k_g"].corrected == 10.0
    assert rows["k_g"].as_in_reference == rows["k_g"].obtained == 9.0
    assert len(errata()) == len({e.where for e in errata()})


def test_one_sensor_on_all_channels_differs_by_the_delay_alone() -> None:
    readings = common_sensor_readings(BAJA)
    front, chassis, rear, rear_chassis = readings.values.T
    np.testing.assert_array_equal(front, rear)
    np.testing.assert_array_equal(chassis, rear_chassis)
    slope = np.gradient(front, readings.time)
    # two roundings to whole counts, and the gradient of a rounded signal
    np.testing.assert_allclose((chassis - front)[2:-2], 0.000675 * slope[2:-2], atol=2.0)
    assert np.corrcoef(chassis - front, slope)[0, 1] > 0.9


def test_an_engine_moves_the_rear_most_and_within_its_force() -> None:
    """Far above the modes the chassis is free: a ≤ F (1/m + l_r²/i) at the rear axle."""
    car = nominal_car(BAJA)
    readings = engine_readings(BAJA, car, seed=1, seconds=1.0)
    front, rear = readings.values.std(axis=0)
    assert rear > 2.0 * front
    lever = 0.8 * car.l_r - 0.2 * car.l_f
    most = 0.0045 * (2.0 * np.pi * 60.0) ** 2 * (1.0 / car.m + car.l_r * lever / car.i)
    assert 0.1 * most < np.abs(readings.values[:, 1]).max() < 1.1 * most
    again = engine_readings(BAJA, car, seed=1, seconds=1.0)
    np.testing.assert_array_equal(readings.values, again.values)
