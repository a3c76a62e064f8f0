import re
import subprocess
import sys
import xml.etree.ElementTree as ET

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import Run, Travel, TravelCurves, WheelCurves
from bayes_asv.report.schema.parts import Curve
from bayes_asv.report.sections import travel
from bayes_asv.report.sections.blocks import Figure
from bayes_asv.report.sections.parameters import log_normal_prior
from bayes_asv.report.sections.simulation import MAX_RUNS
from bayes_asv.report.sections.travel import velocity_shares
from bayes_asv.report.svg import (
    COLOURS,
    canvas,
    draw_autocorrelations,
    gauge,
    power_of_ten,
    style,
    themed,
)
from tests.report.conftest import data, figures, figures_of, load, without_pictures


@pytest.fixture(scope="module")
def drawn() -> list[Figure]:
    return list(figures(load("us")).values())


def test_every_figure_is_there_in_order(drawn: list[Figure]) -> None:
    assert [f.key for f in drawn] == ["suspension", "posterior", "run-0"]
    assert all(f.caption.endswith(".") and f.title and f.panels for f in drawn)
    assert len({p.key for f in drawn for p in f.panels}) == 15


def test_pictures_are_xml_that_scales_and_names_itself(drawn: list[Figure]) -> None:
    for panel in (p for f in drawn for p in f.panels):
        root = ET.fromstring(panel.svg)
        assert root.get("width") is None
        assert root.get("viewBox")
        assert root.get("aria-label") == panel.alt
        assert all(e.get("id", panel.key).startswith(panel.key) for e in root.iter())


def test_every_reference_inside_a_picture_is_met(drawn: list[Figure]) -> None:
    for panel in (p for f in drawn for p in f.panels):
        ids = re.findall(r'\sid="([^"]*)"', panel.svg)
        assert len(ids) == len(set(ids))
        asked = re.findall(r'href="#([^"]*)"|url\(#([^)]*)\)', panel.svg)
        assert asked
        assert {a or b for a, b in asked} <= set(ids)


def test_pictures_fetch_nothing_and_weigh_little(drawn: list[Figure]) -> None:
    for panel in (p for f in drawn for p in f.panels):
        addresses = re.findall(r'([\w:]+)="https?://', panel.svg)
        assert all(name.startswith("xmlns") for name in addresses)
        assert "<metadata" not in panel.svg
        assert len(panel.svg) < 250_000


def test_settings_of_the_user_change_nothing(drawn: list[Figure]) -> None:
    """And the same document gives the same bytes."""
    import matplotlib as mpl

    with mpl.rc_context({"font.size": 30.0, "axes.facecolor": "red", "svg.fonttype": "none"}):
        assert list(figures(load("us")).values()) == drawn


def test_no_figures_for_a_refusal() -> None:
    assert figures(load("refused")) == {}


def test_no_figures_where_the_document_has_no_data() -> None:
    document = data("us")
    for key in ("runs", "draws", "prior", "known"):
        del document[key]
    assert figures(EstimateDocument.model_validate(document)) == {}


def test_many_runs_do_not_make_an_endless_page() -> None:
    document = load("us")
    document.runs = [document.runs[0]] * (MAX_RUNS + 1)
    document.draws = {}
    with without_pictures():
        keys = figures(document)
    assert f"run-{MAX_RUNS - 1}" in keys
    assert f"run-{MAX_RUNS}" not in keys


def test_gaps_and_flat_channels_are_drawn() -> None:
    document = data("us")
    run = document["runs"][0]
    for curve in run["chassis"].values():
        curve["measured"][5:20] = [None] * 15
        curve["whiteness_p"] = None
    run["wheels"]["rear_wheel"] = [0.0] * len(run["wheels"]["time"])
    run["wheels"]["front_wheel"] = [None] * len(run["wheels"]["time"])
    run["travel"]["rear"]["velocity"] = [0.0] * len(run["time"])
    run["chassis"]["rear_chassis"]["spectrum"]["residual"] = [0.0] * 64
    run["chassis"]["front_chassis"]["spectrum"]["measured"][3] = None
    document["draws"] = {}
    drawn = figures(EstimateDocument.model_validate(document))
    panels = {key: [p.key for p in figure.panels] for key, figure in drawn.items()}
    assert panels["suspension"] == ["velocity-front", "travel-front", "travel-rear"]
    assert panels["run-0"] == [
        "motion-front-0", "motion-rear-0", "wheels-0", "spectrum-front-0", "whiteness-0",
        "travel-0",
    ]  # fmt: skip
    spectrum = drawn["run-0"].panels[3]
    assert "front chassis" in spectrum.alt
    assert "rear chassis" not in spectrum.alt  # whose residual has no logarithm


def test_travel_without_limits_draws_no_limits() -> None:
    document = load("us")
    unlimited = document.vehicle.model_copy(update={"travel": None})
    with_limits, without = (
        {p.key: p for p in figures_of(travel.SECTION, one)["suspension"].panels}
        for one in (document, document.model_copy(update={"vehicle": unlimited}))
    )
    key = "travel-rear"
    assert (
        with_limits[key].svg.count("stroke-dasharray")
        == without[key].svg.count("stroke-dasharray") + 2
    )
    assert "bump stop at −" in with_limits[key].alt
    assert "stop" not in without[key].alt


def _run(time: Curve, velocity: Curve) -> Run:
    flat: Curve = [0.0] * len(time)
    front = TravelCurves(
        deflection=flat, band95=[flat, flat], velocity=velocity, largest_bump=0.0, largest_droop=0.0
    )
    return Run(
        source="run.csv", rate=400.0, seconds=1.0, unit="m/s^2", time=time, chassis={},
        wheels=WheelCurves(time=[], front_wheel=[], rear_wheel=[]),
        travel=Travel(unit="mm", front=front),
    )  # fmt: skip


def test_velocity_shares_follow_the_sign_convention() -> None:
    time = np.linspace(0.0, 1.0, 401)
    velocity = np.where(time < 0.25, -1.0, np.where(time < 0.75, 0.0, 2.0))
    run = _run(time.tolist(), velocity.tolist())
    compression, at_rest, rebound = velocity_shares([run], "front")
    assert compression == pytest.approx(0.25, abs=0.01)
    assert rebound == pytest.approx(0.25, abs=0.01)
    assert compression + at_rest + rebound == pytest.approx(1.0)
    assert velocity_shares([run], "rear") == (0.0, 1.0, 0.0)


def test_shares_do_not_depend_on_how_a_curve_was_thinned() -> None:
    def run(count: int, velocity: float) -> Run:
        return _run(np.linspace(0.0, 1.0, count).tolist(), [velocity] * count)

    compression, _, rebound = velocity_shares([run(1500, -1.0), run(100, 1.0)], "front")
    assert compression == pytest.approx(0.5)
    assert rebound == pytest.approx(0.5)


def test_prior_of_the_radius_follows_from_that_of_the_inertia() -> None:
    document = load("us")
    radius, front = log_normal_prior("k_g", document), log_normal_prior("c_f", document)
    assert radius is not None
    assert front is not None
    median, log_sd = radius
    assert median == pytest.approx(document.parameters["k_g"].nominal)
    assert log_sd == pytest.approx(0.5 * np.hypot(np.log(2.0), 0.01), rel=1e-6)
    assert front[0] == pytest.approx(7.2)


@pytest.mark.parametrize(
    ("value", "text"), [(1e4, "10⁴"), (1.0, "10⁰"), (1e-12, "10⁻¹²"), (0.0, "")]
)
def test_powers_of_ten(value: float, text: str) -> None:
    assert power_of_ten(value) == text


@given(
    st.floats(0.1, 1e4), st.floats(1e-4, 1.0), st.none() | st.floats(-5.0, 5.0),
)  # fmt: skip
def test_a_gauge_shows_its_interval_and_where_nominal_is(
    mean: float, share: float, away: float | None
) -> None:
    low, high = mean * (1.0 - 0.7 * share), mean * (1.0 + share)
    nominal = None if away is None else mean * (1.0 + away)
    picture = gauge("g", mean, low, high, nominal, "below")
    ((left, width),) = re.findall(r'<rect x="([^"]*)" y="18" width="([^"]*)"', picture.svg)
    for x in re.findall(r'\s(?:cx|x)="([^"]*)"', picture.svg):
        assert 0.0 <= float(x) <= 300.0
    assert float(left) + float(width) <= 300.0
    assert float(width) > 20.0  # a tenth of the scale, less its margins
    assert len(re.findall(r"<text", picture.svg)) >= 2 + (nominal is not None)
    assert ("nominal" in picture.svg) == (nominal is not None)
    if nominal is not None and "◂" in picture.svg:
        assert nominal < low
    if nominal is not None and "▸" in picture.svg:
        assert nominal > high


@pytest.mark.parametrize("places", [["front"], ["front", "rear"], ["a", "b", "c", "d"]])
def test_autocorrelations_begin_at_the_first_lag(places: list[str]) -> None:
    values = [0.5, -0.2, 0.1, 0.05]
    with style():
        axes = canvas().subplots()
        draw_autocorrelations(axes, [(place, place, values) for place in places], 0.1, 0.0025)
    assert "samples of 2.5 ms" in axes.get_xlabel()
    drawn = {str(line.get_label()): line.get_xydata() for line in axes.lines}
    for place in places:
        lags, heights = np.asarray(drawn[place]).T
        assert np.rint(lags).tolist() == [1, 2, 3, 4]
        assert heights.tolist() == values
        assert axes.get_xlim()[0] < lags[0] < lags[-1] < axes.get_xlim()[1]


def test_colours_follow_the_page(drawn: list[Figure]) -> None:
    svg = themed(drawn[-1].panels[0].svg)
    assert f"var(--front, {COLOURS['front']})" in svg
    assert svg.count(COLOURS["front"]) == svg.count("var(--front")


def test_importing_the_report_is_cheap() -> None:
    code = (
        "import sys, bayes_asv.report.render, bayes_asv.report.schema\n"
        "print([m for m in ('matplotlib', 'typst', 'jinja2', 'scipy') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
