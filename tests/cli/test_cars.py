"""All models of a car as a person runs them: from a simulated drive to a report."""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from typing import NamedTuple

import pymupdf
import pytest

from bayes_asv.cli import common
from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.models.cars import CARS, WHEELS, car_model
from bayes_asv.report.schema import EstimateDocument, read_saved
from tests.cli.conftest import ROOT, Check, Command
from tests.report.conftest import without_pictures

BAJA = ROOT / "data" / "vehicles" / "baja2008.toml"
ROLL = ROOT / "data" / "vehicles" / "baja2008_roll.toml"


@pytest.mark.parametrize(
    ("car", "slowest", "undamped"),
    [
        ("quarter", 1.881, ["bounce", "hop", "bounce", "hop"]),
        ("half4", 1.899, ["bounce", "pitch", "front hop", "rear hop"]),
        ("roll", 2.027, ["bounce", "pitch", "roll"]),
    ],
)
def test_modes_of_each_car(
    invoke: Command, tmp_path: Path, car: str, slowest: float, undamped: list[str]
) -> None:
    file = tmp_path / "modes.json"
    said = invoke("modes", "-v", ROLL, "--car", car, "--json", file)
    assert (said.status, said.err) == (0, "")
    document = json.loads(file.read_text(encoding="utf-8"))
    assert (document["schema"], document["car"]) == ("bayes_asv/car_modes/1", car)
    assert document["modes"][0]["natural_hz"] == pytest.approx(slowest, abs=5e-4)
    assert sorted(mode["kind"] for mode in document["undamped"]) == sorted(undamped)
    for mode in document["modes"]:
        assert max(part["size"] for part in mode["shape"].values()) == pytest.approx(1.0)
        assert 0.0 < mode["energy_share"] <= 1.0
    assert f"{slowest:.3f} Hz" in said.out


def test_the_whole_car_has_seven(invoke: Command) -> None:
    said = invoke("modes", "-v", ROLL, "--car", "full7", "--json", "-")
    document = json.loads(said.out)
    kinds = sorted(mode["kind"] for mode in document["undamped"])
    assert kinds == sorted(
        ["bounce", "pitch", "roll", "front hop", "rear hop", "front tramp", "rear tramp"]
    )
    assert "Without damping" in said.err


def test_what_is_missing_is_said_in_one_line(
    invoke: Command, refuse: Check, baja: Path, stops: Path, tmp_path: Path
) -> None:
    assert refuse(invoke("modes", "-v", baja, "--car", "quarter"), "[unsprung]: is missing")
    assert refuse(invoke("modes", "-v", baja, "--car", "roll"), "[roll]: is missing")
    assert refuse(invoke("modes", stops, "-v", ROLL, "--car", "roll"), "need the half car")
    assert refuse(
        invoke("simulate", "-v", baja, "--car", "roll", "-o", tmp_path / "x.csv"), "[roll]"
    )
    text = ROLL.read_text(encoding="utf-8")
    for old, new, fault in (
        ("front_track = { value = 52", "front_track = { value = -52", "[roll] front_track"),
        ("front_track =", "front_trak =", "did you mean front_track?"),
        ("front_mass         =", "front_weight =", "[unsprung] front_weight"),
        ("[roll]\n", "[roll]\nfront_mass = 1\n", "move it to [unsprung]"),
    ):
        path = tmp_path / "at_fault.toml"
        path.write_text(text.replace(old, new), encoding="utf-8")
        assert refuse(invoke("modes", "-v", path, "--car", "full7"), fault)


class Case(NamedTuple):
    """A car with one worn damper."""

    worn: str
    headline: str
    vehicle: Path = BAJA


CASES = {
    "half": Case(
        "c_f", "Front damper: 20 % softer than nominal. Rear damper: agrees with nominal."
    ),
    "quarter-front": Case("c_f", "Front damper: 20 % softer than nominal."),
    "quarter-rear": Case("c_r", "Rear damper: 20 % softer than nominal."),
    "roll": Case(
        "c_rr", "Rear right damper: 20 % softer than nominal. The other three agree with nominal.",
        ROLL,
    ),
}  # fmt: skip


class Answer(NamedTuple):
    """What the commands wrote about a car, and its true parameters."""

    lines: list[str]
    truth: dict[str, float]
    drive: Path
    json_file: Path
    netcdf: Path

    @property
    def document(self) -> EstimateDocument:
        """Read the JSON back."""
        document = read_saved(self.json_file)
        assert isinstance(document, EstimateDocument)
        return document


class _Answers(dict[str, Answer]):
    """Answers by car, each computed when it is first asked for."""

    def __init__(self, invoke: Command, folder: Path) -> None:
        super().__init__()
        self._invoke, self._folder = invoke, folder

    def __missing__(self, car: str) -> Answer:
        case = CASES[car]
        drive, truth, answer, draws = (
            self._folder / f"{car}{suffix}" for suffix in (".csv", "-truth.json", ".json", ".nc")
        )
        said = self._invoke(
            "simulate", "-v", case.vehicle, "--car", car, "--set", f"{case.worn}=0.8",
            "--road", "bump", "--rate", "200", "--seconds", "1.4", "-o", drive, "--json", truth,
        )  # fmt: skip
        assert (said.status, said.err) == (0, "")
        # The recording says by its channels which car it is of.
        said = self._invoke(
            "estimate", drive, "-v", case.vehicle, "--json", answer, "--netcdf", draws
        )
        assert (said.status, said.err) == (0, "")
        true = json.loads(truth.read_text(encoding="utf-8"))["truth"]
        self[car] = Answer(said.sentences, true, drive, answer, draws)
        return self[car]


@pytest.fixture(scope="module")
def answers(invoke: Command, tmp_path_factory: pytest.TempPathFactory) -> _Answers:
    """Simulate and estimate each car once."""
    return _Answers(invoke, tmp_path_factory.mktemp("cars"))


each_car = pytest.mark.parametrize("car", CASES)


def test_the_command_names_the_cars_that_there_are() -> None:
    assert list(common.CARS) == list(CARS) == list(WHEELS) == list(CASES)
    for name, wheels in WHEELS.items():
        elements = car_model(name, read_vehicle(ROLL)).elements
        assert wheels == tuple(f"{element.name}_wheel" for element in elements)


@each_car
def test_from_a_simulated_drive_to_the_worn_damper(answers: _Answers, car: str) -> None:
    answer, document = answers[car], answers[car].document
    assert answer.lines[0] == CASES[car].headline
    assert (document.schema_name, document.verdict, document.car) == (
        "bayes_asv/estimate/1", "ok", car,
    )  # fmt: skip
    for element in document.elements.values():
        assert {element.damping, element.spring} <= {*document.parameters, *document.known}
    for name in document.prior:
        si = document.parameters[name].si
        assert si is not None
        low, high = si.eti95
        assert low < answer.truth[name] < high
    (run,) = document.runs
    assert list(run.travel.entries) == list(document.elements)
    assert list(run.wheels.entries) == list(WHEELS[car])
    assert list(document.fit.entries) == [*run.chassis, *run.outputs]
    if document.noise[0].colour_order == 0:
        assert {*document.noise[0].entries} == {*WHEELS[car], *document.fit.entries}


def test_left_and_right_dampers_of_an_axle_are_compared(answers: _Answers) -> None:
    ratios = answers["roll"].document.left_over_right
    assert ratios["front"].eti95[0] < 1.0 < ratios["front"].eti95[1]
    assert ratios["rear"].eti95[0] < 1.25 < ratios["rear"].eti95[1]
    assert ratios["rear"].p_left_softer < 0.01
    assert any(
        "it is virtually certain that it is the stiffer one" in x for x in answers["roll"].lines
    )
    assert answers["half"].document.left_over_right == {}


@each_car
def test_each_car_has_a_report(
    invoke: Command, answers: _Answers, tmp_path: Path, car: str
) -> None:
    answer, document = answers[car], answers[car].document
    html, pdf = tmp_path / "report.html", tmp_path / "report.pdf"
    for output in (html, pdf):
        drawn = (car, output) == ("roll", pdf)  # all the rest is asked of words
        with nullcontext() if drawn else without_pictures():
            said = invoke("report", "--from", answer.json_file, "-o", output)
        assert (said.status, said.err) == (0, "")
        assert said.out.splitlines() == [CASES[car].headline, str(output)]
    with pymupdf.open(pdf) as pages:
        paper = " ".join(" ".join(page.get_text() for page in pages).split())
    page = html.read_text(encoding="utf-8")
    words = [name.replace("_", " ") for name in document.elements]
    for text in (page, paper.replace("\u00a0", " ")):
        for place in words:
            assert f"{place.capitalize()} damping rate" in text
        for part in ("Pitch inertia", "Radius of gyration", "Roll inertia"):
            there = any(p.label == part.lower() for p in document.parameters.values())
            assert (part in text) == there
        for section in (
            "Uncertainty budget",
            "Fit of the simulation",
            "Posterior predictive checks",
        ):
            assert section in text
    for place in words:  # descriptions of the figures
        assert f"{place} damper velocity: compression" in page
        assert f"{place} suspension travel against time" in page
        assert f"{place} wheel acceleration against time" in page


@each_car
def test_each_car_has_draws_for_arviz(answers: _Answers, car: str) -> None:
    import xarray

    answer, document = answers[car], answers[car].document
    groups = {}
    white = document.noise[0].colour_order == 0
    names = ["posterior", "log_likelihood", "observed_data"]
    for name in [*names, "posterior_predictive"] if white else names:
        with xarray.open_dataset(answer.netcdf, group=name, engine="h5netcdf") as group:
            groups[name] = group.load()
    for name, parameter in document.parameters.items():
        assert parameter.si is not None
        draws = groups["posterior"][name]
        assert float(draws.mean()) == pytest.approx(parameter.si.mean)
        assert draws.attrs["units"] == parameter.si.unit
    outputs = [f"{channel}_0" for channel in document.fit.entries]
    assert list(groups["observed_data"].data_vars) == outputs
    if white:
        assert list(groups["posterior_predictive"].data_vars) == outputs
    assert groups["log_likelihood"]["recordings"].dims == ("chain", "draw", "recording")


def test_a_half_car_without_accelerometers_on_its_chassis(invoke: Command, tmp_path: Path) -> None:
    vehicle, drive, answer = (tmp_path / name for name in ("car.toml", "drive.csv", "a.json"))
    vehicle.write_text(
        BAJA.read_text(encoding="utf-8")
        + '\n[channels.body_vertical]\nposition = { value = 0.9, unit = "m" }\n'
        + '[sensors.body_vertical]\nnoise = { value = 0.05, unit = "m/s^2" }\n'
        + 'bandwidth = { value = 50, unit = "Hz" }\n'
        + '[sensors.body_pitch_rate]\nnoise = { value = 0.3, unit = "deg/s" }\n',
        encoding="utf-8",
    )
    channels = "front_wheel, rear_wheel, body_vertical, body_pitch_rate"
    said = invoke(
        "simulate", "-v", vehicle, "--channels", channels, "--rate", "200", "--seconds", "1.5",
        "--road", "bump", "--set", "c_r=0.8", "-o", drive,
    )  # fmt: skip
    assert (said.status, said.err) == (0, "")
    said = invoke("estimate", drive, "-v", vehicle, "--json", answer)
    assert said.status == 0
    assert "Rear damper: 20 % softer than nominal." in said.out.splitlines()[0]
    document = read_saved(answer)
    assert isinstance(document, EstimateDocument)
    assert document.runs[0].chassis == {}
    assert list(document.runs[0].outputs) == ["body_vertical", "body_pitch_rate"]
    # A report of the recording itself: it cannot be tracked, which takes four accelerometers.
    page = tmp_path / "x.html"
    said = invoke("report", drive, "-v", vehicle, "--from", answer, "--no-diagnosis", "-o", page)
    assert said.status == 0
    text = page.read_text(encoding="utf-8")
    assert "body pitch rate against time, measured and simulated" in text
    assert "deg/s" in text
    assert "Online filter" not in text


def test_a_recording_of_another_car_is_refused_with_the_fix(
    invoke: Command, refuse: Check, answers: _Answers, tmp_path: Path
) -> None:
    quarter, roll = answers["quarter-front"].drive, answers["roll"].drive
    for words, expected in (
        (
            ("estimate", quarter, "-v", BAJA, "--car", "half"),
            "lacks the channel rear_wheel, which the half car needs; choose the car that fits "
            "these channels: --car quarter-front",
        ),
        (
            ("estimate", quarter, "-v", BAJA, "--car", "quarter-rear"),
            "lacks the channel rear_wheel, which the quarter-rear car needs; choose the car that "
            "fits these channels: --car quarter-front",
        ),
        (("estimate", roll, "-v", ROLL, "--car", "half"), "these channels: --car roll"),
        (("estimate", roll, "-v", BAJA), "[roll]: is missing, and the roll car needs it"),
        (
            ("estimate", answers["half"].drive, "-v", ROLL, "--car", "roll"),
            "lacks the channel front_left_wheel, which the roll car needs; choose the car that "
            "fits these channels: --car half or --car quarter-front or --car quarter-rear",
        ),
        (("estimate", quarter, roll, "-v", ROLL), "lacks the channel front_wheel"),
        (("greybox", roll, "-v", ROLL), "use bayes-asv estimate --car roll"),
        (("track", quarter, "-v", BAJA, "--car", "half"), "rear_wheel"),
        (
            ("simulate", "-v", BAJA, "--skew", "20 in", "-o", tmp_path / "x.csv"),
            "skew: the half car has no right wheels; leave it out, or choose the roll car",
        ),
        (
            ("simulate", "-v", BAJA, "--channels", "rear_travl", "-o", tmp_path / "x.csv"),
            "channel 'rear_travl'",
        ),
        (
            ("simulate", "-v", BAJA, "--car", "quarter-front", "--channels", "rear_chassis",
             "-o", tmp_path / "x.csv"),
            "channel 'rear_chassis': is not one of the quarter-front car",
        ),
        (
            ("simulate", "-v", BAJA, "--car", "quarter-front", "--set", "c_r=0.8",
             "-o", tmp_path / "x.csv"),
            "c_r=0.8: is not a change; give one of c_f, m, wdf, k_f and a factor",
        ),
    ):  # fmt: skip
        assert refuse(invoke(*words), expected)
    assert not (tmp_path / "x.csv").exists()
