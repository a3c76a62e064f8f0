"""Vehicle files: values, round trip, and one-line messages for faults."""

import dataclasses
import math
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bayes_asv.domain.channels import CHANNELS, KNOWN_CHANNELS, channel
from bayes_asv.domain.clocks import Clock
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.vehicle import (
    Given,
    Nominal,
    Roll,
    Sensor,
    Travel,
    Unsprung,
    Vehicle,
    read_vehicle,
    to_toml,
    write_vehicle,
)

VEHICLES = Path(__file__).parents[2] / "data" / "vehicles"
BAJA = re.sub(r"(?m)^#.*\n|#.*$", "", (VEHICLES / "baja2008.toml").read_text(encoding="utf-8"))
INCH = 0.0254
LBF = 0.45359237 * 9.80665

per_test = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture
def read(tmp_path: Path) -> Callable[[str], Vehicle]:
    def read_text(text: str) -> Vehicle:
        path = tmp_path / "car.toml"
        path.write_text(text, encoding="utf-8")
        return read_vehicle(path)

    return read_text


def test_baja_is_table_7_1() -> None:
    car = read_vehicle(VEHICLES / "baja2008.toml")
    assert car.m.value == pytest.approx(1.294 * LBF / INCH)
    assert car.m.sd == pytest.approx(0.01 * car.m.value)
    assert car.l == Given(68 * INCH)
    assert (car.wdf.value, car.wdf.sd) == pytest.approx((0.47, 0.0047))
    assert car.k_f.value == pytest.approx(100 * LBF / INCH)
    assert car.k_r.sd == pytest.approx(5 * LBF / INCH)
    assert car.c_f.value == pytest.approx(7.2 * LBF / INCH)
    assert car.c_f.sd is None
    assert car.i.value == pytest.approx(626 * LBF * INCH)
    assert car.l_f == pytest.approx(36.04 * INCH)
    assert car.l_r == pytest.approx(31.96 * INCH)
    assert car.k_g == pytest.approx(22 * INCH, rel=3e-4)
    # the table rounds down in its last digit
    assert (car.zeta_f, car.zeta_r) == pytest.approx((0.461, 0.603), abs=1.1e-3)
    assert car.travel.rear_bump == pytest.approx(4 * INCH)
    assert car.travel.rear_droop == pytest.approx(6 * INCH)
    assert car.travel.front_bump is car.travel.front_droop is None


def test_baja_sensors_are_those_of_the_reference() -> None:
    car = read_vehicle(VEHICLES / "baja2008.toml")
    factors = (7.87, 3.27, 7.93, 3.25)
    for name, sensor, factor in zip(CHANNELS, car.sensors_of(CHANNELS), factors, strict=True):
        assert sensor is car.sensor(name)
        assert sensor.zero_counts is not None
        assert sensor.resolution is not None
        scale = 24 * 32.2 / 1023 * factor * INCH
        assert sensor.counts_scale == pytest.approx(scale, rel=2e-4)
        assert sensor.resolution == sensor.counts_scale
        assert sensor.low == pytest.approx(-sensor.zero_counts * sensor.resolution)
        assert sensor.high == pytest.approx((1023 - sensor.zero_counts) * sensor.resolution)
        assert sensor.bandwidth == 50.0
        density = 250e-6 if "wheel" in name else 150e-6
        rms = density * 9.80665 * math.sqrt(50 * math.pi / 2)
        assert sensor.noise == pytest.approx(rms, rel=1e-3)
        assert sensor.delay == (0.0 if "wheel" in name else 0.000675)


def test_simulated_car_is_table_5_1() -> None:
    car = read_vehicle(VEHICLES / "thesis_simulation.toml")
    assert (car.zeta_f, car.zeta_r) == pytest.approx((0.7, 0.5), rel=1e-12)
    assert car.k_g == pytest.approx(10 * INCH, rel=1e-12)
    assert car.m.value == pytest.approx(1.3587 * LBF / INCH)
    assert car.m.sd == 0.0
    assert car.sensors == {}
    assert car.sensors_of(CHANNELS) == (Sensor(),) * 4


def test_equivalent_spellings_of_a_quantity(read: Callable[[str], Vehicle]) -> None:
    usual = read(BAJA)
    same = BAJA.replace('{ value = 68, unit = "in" }', '"68 in"')
    same = same.replace('{ value = 0.47, sd = "1 %" }', '{ value = 47, unit = "%", sd = "1%" }')
    same = same.replace(
        '{ value = 100, unit = "lbf/in", sd = "5 %" }',
        '{ value = 100, unit = "lbf/in", sd = "5 lbf/in" }',
    )
    other = read(same)
    assert other.l == usual.l
    assert other.wdf.value == pytest.approx(usual.wdf.value)
    assert other.wdf.sd == pytest.approx(usual.wdf.sd)
    assert other.k_f.sd == pytest.approx(usual.k_f.sd)


def test_range_of_one_value_is_symmetric(read: Callable[[str], Vehicle]) -> None:
    text = re.sub(r"range .*", 'range = { value = 5, unit = "g" }', BAJA, count=1)
    sensor = read(text).sensor("front_wheel")
    assert (sensor.low, sensor.high) == pytest.approx((-5 * 9.80665, 5 * 9.80665))


def test_nominal_may_carry_a_deviation(read: Callable[[str], Vehicle]) -> None:
    text = BAJA.replace('7.2, unit = "lbf*s/in"', '7.2, unit = "lbf*s/in", sd = "40 %"')
    assert read(text).c_f.sd == pytest.approx(0.4 * 7.2 * LBF / INCH)
    assert read(text).c_r.sd is None


def test_byte_order_mark_and_windows_lines(tmp_path: Path) -> None:
    path = tmp_path / "car.toml"
    path.write_bytes(b"\xef\xbb\xbf" + BAJA.replace("\n", "\r\n").encode())
    assert read_vehicle(path) == read_vehicle(VEHICLES / "baja2008.toml")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("wheelbase ", "wheelbas ", r"\[known\] wheelbas: .*did you mean wheelbase"),
        ("value = 68", "value = -68", r"\[known\] wheelbase: .*above zero"),
        ("value = 68", "value = 0", r"\[known\] wheelbase: .*above zero"),
        ("value = 68", "value = nan", r"\[known\] wheelbase: .*finite"),
        ("value = 68", "value = inf", r"\[known\] wheelbase: .*finite"),
        ("value = 68", "value = 68e40", r"\[known\] wheelbase: .*not plausible"),
        ("value = 68", f"value = {'9' * 400}", r"\[known\] wheelbase: .*finite"),
        ("value = 68", "value = true", r"\[known\] wheelbase: .*not a number"),
        ("value = 68", 'value = "68"', r"\[known\] wheelbase: .*without quotes"),
        ("value = 68", "vlaue = 68", r"\[known\] wheelbase: .*did you mean value"),
        ('{ value = 68, unit = "in" }', "68", r"\[known\] wheelbase: has no unit"),
        ('{ value = 68, unit = "in" }', "{ value = 68 }", r"\[known\] wheelbase: has no unit"),
        ('{ value = 68, unit = "in" }', "[68]", r"\[known\] wheelbase: "),
        ('{ value = 68, unit = "in" }', '"68 lb"', r"\[known\] wheelbase: .*lbf"),
        ('68, unit = "in"', '68, unit = "kg"', r"\[known\] wheelbase: .*not a unit of length"),
        ('68, unit = "in"', "68, unit = 3", r"\[known\] wheelbase: unit is not a text"),
        ('"1 %"', '"-1 %"', r"\[known\] sprung_mass: sd"),
        ('"1 %"', "-1", r"\[known\] sprung_mass: sd"),
        ('"1 %"', "nan", r"\[known\] sprung_mass: sd"),
        ('"1 %"', '"300 %"', r"\[known\] sprung_mass: sd is 3 times"),
        ('"1 %"', '"some"', r"\[known\] sprung_mass: "),
        ("value = 0.47", "value = 1.47", r"front_weight_fraction: .*between 0 and 1"),
        ("value = 0.47", "value = 0", r"front_weight_fraction: .*between 0 and 1"),
        ("value = 1.294", "value = 0", r"\[known\] sprung_mass: .*above zero"),
        ("[travel]", "[travels]", r"travels: unknown key; did you mean travel"),
        ("[known]", "[meta]\nx = 1\n[known]", r"meta: unknown key; known are name, units"),
        ("front_damping", "front_spring_rate", r"front_spring_rate: .*move it to \[known\]"),
        ("low = -3385.6775", "low = 9000", r"\[sensors.front_wheel\] range: low is not below"),
        ("{ value = 0.855", "{ value = 0", r"\[sensors.front_wheel\] noise: .*above zero"),
        ("{ value = 0.855", "{ value = -1", r"\[sensors.front_wheel\] noise: .*above zero"),
        ("resolution   = { value = 5.945", "resolution = { value = 0", r"resolution: .*above"),
        ("bandwidth    = { value = 50", "bandwidth = { value = 0", r"bandwidth: .*above zero"),
        ("bandwidth ", "bandwith ", r"bandwith: .*did you mean bandwidth"),
        ("[sensors.front_wheel]", "[sensors.frontwheel]", r"did you mean front_wheel"),
        ("zero_counts  = 569.5", 'zero_counts = "a"', r"zero_counts: .*not a number"),
        ("value = 0, ", "value = 3600, ", r"\[sensors.front_wheel\] delay: .*not plausible"),
        ('1.294, unit = "lbf*s^2/in"', '1.294, unit = "kg"', r"26 Hz, outside.*check the units"),
        ('68, unit = "in"', '68, unit = "ft"', r"0\.0029 times .*check the units of wheelbase"),
        ('units = "US"', 'units = "us"', r'units: .*"US" or units = "SI"'),
        ('units = "US"', "", r"units: is missing"),
        ("[nominal]", "[known2]", r"known2: unknown key"),
        ("[known]", "[known", r"not TOML.*line"),
        ("[known]", "x = " + "[" * 100_000, r"not TOML"),
        ("[known]", f"x = {'9' * 5000}\n[known]", r"not TOML"),
    ],
)
def test_faults_name_file_key_and_fix(
    read: Callable[[str], Vehicle], old: str, new: str, said: str
) -> None:
    assert old in BAJA
    with pytest.raises(InputError, match=said) as caught:
        read(BAJA.replace(old, new, 1))
    message = str(caught.value)
    assert "car.toml: " in message
    assert "\n" not in message
    assert caught.value.fix


def test_unknown_channel_is_an_input_error() -> None:
    with pytest.raises(InputError, match="did you mean rear_wheel"):
        read_vehicle(VEHICLES / "baja2008.toml").sensor("rear_weel")


def test_sensors_are_a_copy_in_the_order_of_the_channels() -> None:
    car = read_vehicle(VEHICLES / "baja2008.toml")
    given = {"body_pitch_rate": Sensor(noise=0.01), "front_wheel": Sensor(noise=0.02)}
    one = dataclasses.replace(car, sensors=given)
    other = dataclasses.replace(car, sensors=dict(reversed(given.items())))
    assert one == other
    assert hash(one) == hash(other)
    assert to_toml(one) == to_toml(other)
    given["front_wheel"] = Sensor(noise=1.0)
    assert one.sensor("front_wheel").noise == 0.02
    assert one != dataclasses.replace(car, sensors=given)
    assert one.sensors_of(("rear_wheel", "front_wheel")) == (Sensor(), Sensor(noise=0.02))
    with pytest.raises(InputError, match=r"'front_wheels': there is no such channel; did you mean"):
        dataclasses.replace(car, sensors={"front_wheels": Sensor()})


@pytest.mark.parametrize("name", KNOWN_CHANNELS)
def test_every_channel_has_a_table_in_its_own_unit(
    read: Callable[[str], Vehicle], name: str
) -> None:
    others = re.sub(r"(?ms)^\[sensors.*", "", BAJA) + f"[sensors.{name}]\n"
    known = channel(name)
    assert read(f'{others}noise = "0.25 {known.si_unit}"').sensors == {name: Sensor(noise=0.25)}
    noise = rf"\[sensors.{name}\] noise: "
    dimension = known.quantity.replace("_", " ")
    with pytest.raises(InputError, match=rf"{noise}unit 'kg' is not a unit of {dimension}"):
        read(f'{others}noise = "0.25 kg"')
    with pytest.raises(
        InputError, match=rf'{noise}has no unit; write "0.25 {re.escape(known.si_unit)}"'
    ):
        read(f"{others}noise = 0.25")


def test_missing_file_suggests_a_similar_name() -> None:
    with pytest.raises(InputError, match=r"did you mean .*baja2008\.toml"):
        read_vehicle(VEHICLES / "baja2007.toml")


sizes = st.floats(1e-2, 1e4)
shares = st.floats(0.0, 0.99)
maybe_size = st.none() | st.floats(1e-2, 900.0)  # plausible in m, m/s² and rad/s


@st.composite
def sensors(draw: st.DrawFn) -> Sensor:
    scale = draw(st.none() | st.floats(1e-3, 1e2) | st.floats(-1e2, -1e-3))
    low = draw(st.just(-math.inf) | st.floats(-1e4, -1.0))
    high = draw(st.just(math.inf) | st.floats(1.0, 1e4))
    return Sensor(
        zero_counts=draw(st.none() | st.floats(-1e5, 1e5)),
        counts_scale=scale,
        low=low,
        high=high,
        noise=draw(maybe_size),
        resolution=draw(maybe_size),
        bandwidth=draw(maybe_size),
        delay=draw(st.floats(-0.5, 0.5)),
        counts_scale_sd=abs(scale) * draw(shares) if scale is not None else 0.0,
    )


@st.composite
def vehicles(draw: st.DrawFn) -> Vehicle:
    def given_value() -> Given:
        value = draw(sizes)
        return Given(value, value * draw(shares))

    def nominal() -> Nominal:
        value = draw(sizes)
        return Nominal(value, draw(st.none() | st.floats(1e-3, 9.0).map(lambda x: x * value)))

    # numbers that go together: a bounce of 0.7 to 12 Hz, and an inertia near that on the axles
    m, l, wdf = given_value(), draw(st.floats(0.1, 100.0)), draw(st.floats(0.01, 0.99))
    rates = [0.5 * m.value * (2.0 * math.pi * draw(st.floats(1.0, 12.0))) ** 2 for _ in range(2)]
    inertia = m.value * l**2 * wdf * (1.0 - wdf) * draw(st.floats(0.02, 50.0))
    return Vehicle(
        name=draw(st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=30)),
        units=draw(st.sampled_from(["US", "SI"])),
        m=m,
        l=Given(l),
        wdf=Given(wdf, draw(st.floats(0.0, 0.009))),
        k_f=Given(rates[0], rates[0] * draw(shares)),
        k_r=Given(rates[1], rates[1] * draw(shares)),
        c_f=nominal(),
        c_r=nominal(),
        i=Nominal(inertia, draw(st.none() | st.floats(1e-3, 9.0).map(lambda x: x * inertia))),
        travel=Travel(*(draw(st.none() | st.floats(1e-3, 10.0)) for _ in range(4))),
        sensors=draw(st.dictionaries(st.sampled_from(KNOWN_CHANNELS), sensors(), max_size=6)),
    )


def numbers(item: object) -> list[object]:
    """Every leaf of nested dataclasses and tuples."""
    if isinstance(item, dict):
        return [leaf for value in item.values() for leaf in numbers(value)]
    if isinstance(item, tuple | list):
        return [leaf for value in item for leaf in numbers(value)]
    return [item]


@given(vehicle=vehicles())
@per_test
def test_written_file_reads_back_equal(tmp_path: Path, vehicle: Vehicle) -> None:
    path = tmp_path / "written.toml"
    write_vehicle(vehicle, path)
    again = read_vehicle(path)
    plain = dataclasses.replace(again, source="", sha256="")
    for a, b in zip(
        numbers(dataclasses.asdict(vehicle)), numbers(dataclasses.asdict(plain)), strict=True
    ):
        assert a == (pytest.approx(b, rel=1e-12) if isinstance(b, float) else b)
    # what was read once is stable
    assert to_toml(again) == to_toml(read_vehicle(path))


def test_shipped_files_round_trip_exactly(tmp_path: Path) -> None:
    for path in VEHICLES.glob("*.toml"):
        vehicle = read_vehicle(path)
        write_vehicle(vehicle, tmp_path / "again.toml")
        assert read_vehicle(tmp_path / "again.toml") == vehicle


def test_written_numbers_stay_short() -> None:
    text = to_toml(read_vehicle(VEHICLES / "baja2008.toml"))
    assert 'wheelbase = { value = 68, unit = "in" }' in text
    assert 'front_spring_rate = { value = 100, unit = "lbf/in", sd = 5 }' in text


def test_failed_write_leaves_the_old_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "car.toml"
    path.write_text("old")

    def full(_: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(InputError, match="No space left"):
        write_vehicle(read_vehicle(VEHICLES / "baja2008.toml"), path)
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["car.toml"]


@pytest.mark.parametrize("name", ["nowhere/car.toml", ".", "a\0b"])
def test_unwritable_paths_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError):
        write_vehicle(read_vehicle(VEHICLES / "baja2008.toml"), f"{tmp_path}/{name}")


PIECES = [*BAJA.split(), "nan", "inf", "-1", "0", "[", "]", "{", "}", '"', "'", "\\", "\0", "true"]


@given(
    edits=st.lists(
        st.tuples(st.integers(0, len(BAJA)), st.integers(0, 40), st.sampled_from(PIECES)),
        min_size=1,
        max_size=4,
    )
)
@settings(per_test, max_examples=200)
def test_mutated_files_are_read_or_refused(
    tmp_path: Path, edits: list[tuple[int, int, str]]
) -> None:
    text = BAJA
    for at, cut, piece in edits:
        text = text[:at] + piece + text[at + cut :]
    assert read_or_refuse(tmp_path / "car.toml", text.encode())


@given(data=st.binary(max_size=300))
@per_test
def test_any_bytes_are_refused(tmp_path: Path, data: bytes) -> None:
    assert read_or_refuse(tmp_path / "car.toml", data)


def read_or_refuse(path: Path, data: bytes) -> bool:
    """Whether a file is refused in one line with its name and a fix, or read in order."""
    path.write_bytes(data)
    try:
        vehicle = read_vehicle(path)
    except InputError as refusal:
        return "\n" not in str(refusal) and path.name in str(refusal) and bool(refusal.fix)
    to_toml(vehicle)
    return vehicle.m.value > 0 and 0 < vehicle.wdf.value < 1


def test_reading_loads_neither_pint_nor_scipy() -> None:
    code = (
        "import sys, bayes_asv.domain.vehicle as v, bayes_asv.domain.recording, bayes_asv.io;"
        "assert not {'pint', 'scipy', 'pydantic'} & set(sys.modules);"
        "v.read_vehicle(sys.argv[1]); assert 'pint' not in sys.modules"
    )
    path = str(VEHICLES / "baja2008.toml")
    subprocess.run([sys.executable, "-c", code, path], check=True)


@pytest.mark.skipif(os.name != "posix", reason="permissions and links are POSIX's here")
def test_written_file_keeps_permissions_and_links(tmp_path: Path) -> None:
    vehicle = read_vehicle(VEHICLES / "baja2008.toml")
    plain, new, link = tmp_path / "plain", tmp_path / "new.toml", tmp_path / "link.toml"
    plain.touch()
    write_vehicle(vehicle, new)
    assert new.stat().st_mode == plain.stat().st_mode
    new.chmod(0o640)
    link.symlink_to(new)
    write_vehicle(vehicle, link)
    assert link.is_symlink()
    assert new.stat().st_mode & 0o777 == 0o640


def test_roll_tables_round_trip(tmp_path: Path) -> None:
    text = (VEHICLES / "baja2008_roll.toml").read_text(encoding="utf-8")
    text = text.replace(
        "[sensors.front_wheel]",
        "[sensors.rear_left_wheel]\nzero_counts = 500\ncounts_scale = '6 in/s^2'\n\n"
        "[sensors.front_wheel]",
        1,
    ).replace("[roll]\n", "[roll]\nfront_bar = '20 lbf/in'\nfront_sensors = '30 in'\n")
    path = tmp_path / "car.toml"
    path.write_text(text, encoding="utf-8")
    car = read_vehicle(path)
    assert car.roll is not None
    assert car.roll.front_track.value == pytest.approx(52 * 0.0254)
    assert car.roll.front_bar == pytest.approx(20 * 175.12683524647636)
    assert car.sensor("rear_left_wheel").zero_counts == 500
    alike = car.sensor("front_right_wheel")  # like its axle's, but for counts
    assert alike.noise == car.sensor("front_wheel").noise
    assert (alike.zero_counts, alike.counts_scale) == (None, None)
    assert alike.resolution == pytest.approx(5.945 * 0.0254)
    potentiometer = Sensor(zero_counts=500.0, noise=0.001)
    more = dataclasses.replace(car, sensors={**car.sensors, "front_travel": potentiometer})
    assert more.sensor("front_right_travel") == Sensor(noise=0.001)
    assert more.sensor("rear_right_travel") == Sensor()
    path.write_text(to_toml(car), encoding="utf-8")
    assert read_vehicle(path) == car


@pytest.mark.parametrize("sd", ["0.5", '"0.5 kN/m"', '"500 N/m"', '"2.5 %"', '"2.5 percent"'])
def test_a_deviation_may_have_a_unit_of_its_own(read: Callable[[str], Vehicle], sd: str) -> None:
    line = f'front_spring_rate = {{ value = 20, unit = "kN/m", sd = {sd} }}'
    given = read(re.sub("(?m)^front_spring_rate.*", line, BAJA)).k_f
    assert (given.value, given.sd) == pytest.approx((20e3, 500.0))


def test_no_value_of_a_vehicle_is_written_in_place_of_another(
    read: Callable[[str], Vehicle],
) -> None:
    """All values and deviations differ."""
    car = dataclasses.replace(
        read_vehicle(VEHICLES / "baja2008.toml"),
        units="SI", m=Given(230.0, 2.0), l=Given(1.71, 0.013), wdf=Given(0.46, 0.003),
        k_f=Given(17e3, 300.0), k_r=Given(19e3, 400.0),
        c_f=Nominal(1300.0, 500.0), c_r=Nominal(1100.0, 600.0), i=Nominal(70.0, 20.0),
        travel=Travel(0.11, 0.12, 0.13, 0.14),
        unsprung=Unsprung(40.0, 55.0, 350e3, 420e3, 310.0, 520.0),
        roll=Roll(
            Given(1.31, 0.011), Given(1.22, 0.012), Nominal(33.0, 9.0), 3000.0, 2100.0, 0.83
        ),
        clocks=(Clock("phone", ("front_chassis", "rear_chassis"), 0.002, 0.03, 4e-5, 5e-5),),
    )  # fmt: skip
    assert read(to_toml(car)) == car


def test_a_sensor_on_the_body_needs_its_place(tmp_path: Path) -> None:
    text = (VEHICLES / "baja2008.toml").read_text()
    (tmp_path / "a.toml").write_text(text)
    with pytest.raises(InputError, match=r"a.toml: \[channels.body_vertical\]: is missing"):
        read_vehicle(tmp_path / "a.toml").channel("body_vertical")
    place = '\n[channels.body_vertical]\nposition = { value = 900, unit = "mm" }\n'
    (tmp_path / "b.toml").write_text(text + place)
    assert read_vehicle(tmp_path / "b.toml").channel("body_vertical").position == 0.9
