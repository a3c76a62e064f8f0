import math

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from bayes_asv.report.schema.compare import ParameterChange
from bayes_asv.report.schema.parts import Parameter
from bayes_asv.report.sections.compare import change_sentence
from bayes_asv.report.sections.sampling import sampling_lines
from bayes_asv.report.sections.verdict import headline, next_steps, split_reason, verdict_lines
from bayes_asv.report.words import (
    compare_parameter,
    decimals_for,
    likelihood_words,
    number,
    p_value,
    parameter_sentence,
    percent,
    plain,
    probability,
    readable_unit,
)
from tests.report.conftest import load

ORDER = [
    "exceptionally unlikely",
    "extremely unlikely",
    "very unlikely",
    "unlikely",
    "about as likely as not",
    "likely",
    "very likely",
    "extremely likely",
    "virtually certain",
]

values = st.floats(-1e6, 1e6, allow_nan=False)
deviations = st.floats(1e-5, 1e5)
shares = st.floats(0.0, 1.0)


def value_of(text: str) -> float:
    return float(text.replace("−", "-"))


@given(values, deviations, st.integers(1, 3))
def test_rounding_costs_little_against_the_deviation(value: float, sd: float, digits: int) -> None:
    # d significant digits of the deviation: at most half a unit of its last digit is lost.
    assert abs(value_of(number(value, sd, digits)) - value) <= 0.51 * sd * 10.0 ** (1 - digits)


@given(values, deviations)
def test_a_number_has_no_more_digits_than_its_deviation(value: float, sd: float) -> None:
    text = number(value, sd)
    places = len(text.partition(".")[2])
    assert places == max(decimals_for(sd), 0)


@given(st.floats(-1e300, 1e300) | st.just(math.nan) | st.just(math.inf), st.none() | st.floats())
def test_any_float_becomes_a_short_text(value: float, sd: float | None) -> None:
    text = number(value, sd)
    assert text == "–" or math.isfinite(value_of(text))
    assert len(text) < 25
    assert "-0" != text != "−0"


@pytest.mark.parametrize(
    ("value", "sd", "text"),
    [
        (7.8994, 0.0761, "7.899"),
        (7.8994, 0.0996, "7.90"),
        (699.94, 6.7, "699.9"),
        (1383.39, 13.3, "1383"),
        (56789.0, 1300.0, "56800"),
        (-0.0004, 0.1, "0.00"),
        (-1.5, 0.1, "−1.50"),
        (7.199999999999998, None, "7.2"),
        (99.99999999999999, None, "100"),
        (1751.268, None, "1751"),
        (53211.0, 0.0, "53210"),
        (None, None, "–"),
    ],
)
def test_numbers(value: float | None, sd: float | None, text: str) -> None:
    assert number(value, sd) == text


@pytest.mark.parametrize(
    ("unit", "text"),
    [
        ("lbf*s/in", "lbf·s/in"),
        ("lbf*s^2*in", "lbf·s²·in"),
        ("(in/s^2)^2/Hz", "(in/s²)²/Hz"),
        ("kg*m^2", "kg·m²"),
        ("", ""),
    ],
)
def test_units_are_readable(unit: str, text: str) -> None:
    assert readable_unit(unit) == text


@given(shares, shares)
def test_words_for_probability_never_fall_as_it_rises(p: float, q: float) -> None:
    low, high = sorted((p, q))
    assert ORDER.index(likelihood_words(low)) <= ORDER.index(likelihood_words(high))


@given(shares)
def test_words_for_probability_are_symmetrical(p: float) -> None:
    # The scale says 33 and 66 %, so it is symmetrical but for a percent at its bounds.
    assume(all(abs(p - bound) > 0.011 for bound in (0.33, 0.34, 0.66, 0.67)))
    assume(all(abs(p - bound) > 1e-9 for bound in (0.01, 0.05, 0.1, 0.9, 0.95, 0.99)))
    here, there = ORDER.index(likelihood_words(p)), ORDER.index(likelihood_words(1.0 - p))
    assert here + there == len(ORDER) - 1


@pytest.mark.parametrize(
    ("p", "words"),
    [
        (1.0, "virtually certain"),
        (0.97, "extremely likely"),
        (0.91, "very likely"),
        (0.7, "likely"),
        (0.5, "about as likely as not"),
        (0.2, "unlikely"),
        (0.0, "exceptionally unlikely"),
    ],
)
def test_scale_of_the_guidance_note(p: float, words: str) -> None:
    assert likelihood_words(p) == words


@pytest.mark.parametrize("p", [-0.1, 1.1, math.nan])
def test_what_is_no_probability_is_refused(p: float) -> None:
    with pytest.raises(ValueError, match="not a probability"):
        likelihood_words(p)


def test_a_counted_probability_is_never_quite_certain() -> None:
    assert probability(0.0) == "< 0.1 %"
    assert probability(1.0) == "> 99.9 %"
    assert probability(0.9942) == "99.4 %"
    assert probability(0.82) == "82 %"
    assert probability(None) == "–"
    assert percent(-0.001) == "0 %"


@given(st.text())
def test_foreign_text_stays_on_one_line(text: str) -> None:
    out = plain(text)
    assert out == "" or out.isprintable()
    assert "\n" not in out
    assert len(out) <= 500
    out.encode("utf-8")


def test_p_values() -> None:
    assert p_value(0.7712) == "p = 0.77"
    assert p_value(0.00125) == "p = 0.0013"
    assert p_value(0.0001) == "p < 0.001"


def parameter(mean: float, sd: float, nominal: float | None, p_below: float | None) -> Parameter:
    return Parameter(
        mean=mean, sd=sd, eti95=[mean - 1.96 * sd, mean + 1.96 * sd], nominal=nominal,
        p_below_nominal=p_below, unit="lbf*s/in",
    )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "mean", "sd", "p", "sense", "words"),
    [
        ("c_f", 8.0, 0.1, 1.0, "below", "20 % softer than nominal"),
        ("c_r", 12.0, 0.1, 0.0, "above", "20 % stiffer than nominal"),
        ("c_r", 9.7, 0.05, 1.0, "below", "slightly softer than nominal (3 %)"),
        ("c_r", 9.97, 0.01, 0.999, "below", "slightly softer than nominal (less than 1 %)"),
        ("i", 12.0, 0.1, 0.0, "above", "20 % larger than nominal"),
        ("i", 8.0, 0.1, 1.0, "below", "20 % smaller than nominal"),
        ("c_f", 10.1, 0.2, 0.3, "agrees", "agrees with nominal"),
        ("c_f", 9.0, 4.0, 0.6, "unclear", "too uncertain to compare with nominal"),
    ],
)
def test_comparison_with_nominal(
    name: str, mean: float, sd: float, p: float, sense: str, words: str
) -> None:
    found = compare_parameter(name, parameter(mean, sd, 10.0, p))
    assert found is not None
    assert (found.sense, found.words) == (sense, words)


def test_without_nominal_there_is_no_comparison() -> None:
    assert compare_parameter("c_f", parameter(8.0, 0.1, None, 1.0)) is None
    assert compare_parameter("c_f", parameter(8.0, 0.1, 10.0, None)) is None


def test_sentence_says_value_interval_difference_and_probability() -> None:
    text = parameter_sentence("c_f", parameter(7.9, 0.1, 7.2, 0.0))
    assert text == (
        "The front damping rate is 7.9 lbf·s/in (95 %: 7.7 to 8.1), 10 % above the nominal 7.2; "
        "it is virtually certain (> 99.9 %) that it is above nominal."
    )
    text = parameter_sentence("c_r", parameter(10.05, 0.1, 10.0, 0.3))
    assert "agrees with the nominal 10" in text
    assert "likely (70 %) that it is above nominal" in text


def test_sentence_without_nominal_leaves_it_out() -> None:
    text = parameter_sentence("c_f", parameter(7.9, 0.1, None, 0.0))
    assert text == "The front damping rate is 7.9 lbf·s/in (95 %: 7.7 to 8.1)."


@pytest.mark.parametrize(
    ("front", "rear", "text"),
    [
        ((8, 0.1, 1), (9, 0.1, 1), "Both dampers are softer than nominal: front 20 %, rear 10 %."),
        ((12, 0.1, 0), (11, 0.1, 0),
         "Both dampers are stiffer than nominal: front 20 %, rear 10 %."),
        ((10, 0.1, 0.5), (10, 0.1, 0.5), "Both dampers agree with nominal."),
        ((12, 0.1, 0), (9, 0.1, 1),
         "Rear damper: 10 % softer than nominal. Front damper: 20 % stiffer than nominal."),
        ((10, 0.1, 0.5), (9, 0.1, 1),
         "Rear damper: 10 % softer than nominal. Front damper: agrees with nominal."),
        ((10, 5, 0.5), (10, 5, 0.5),
         "Both dampers are too uncertain to compare with nominal."),
    ],
)  # fmt: skip
def test_headline_names_the_softer_damper_first(
    front: tuple[float, float, float], rear: tuple[float, float, float], text: str
) -> None:
    document = load("us")
    for name, (mean, sd, p) in (("c_f", front), ("c_r", rear)):
        document.parameters[name] = parameter(mean, sd, 10.0, p)
    assert headline(document) == text


@pytest.mark.parametrize(
    ("ratio", "eti95", "p", "text"),
    [
        (0.90, (0.87, 0.93), 1.0, "10 % softer (95 %: 7 to 13 %)"),
        (1.10, (1.07, 1.13), 1.0, "10 % stiffer (95 %: 7 to 13 %)"),
        (0.97, (0.94, 1.00), 0.8, "probably 3 % softer (95 %: −6 to 0 %)"),
        (1.00, (0.97, 1.03), 0.1, "no change found (95 %: −3 to +3 %)"),
    ],
)
def test_the_interval_of_a_change_begins_with_its_smaller_end(
    ratio: float, eti95: tuple[float, float], p: float, text: str
) -> None:
    change = ParameterChange(
        label="front damping rate", ratio=ratio, eti95=list(eti95), log_sd=0.015, p_changed=p,
        p_lower=p, p_higher=0.0, p_value=None,
    )  # fmt: skip
    assert change_sentence("c_f", change).startswith(f"Front damper: {text}; probability of")


def test_lines_of_an_answer() -> None:
    lines = verdict_lines(load("us"))
    assert lines[0] == headline(load("us"))
    assert lines[1].startswith("The front damping rate is 7.90 lbf·s/in")
    assert [line.split()[0] for line in lines[1:5]] == ["The"] * 4
    assert lines[5].startswith("Next: Inspect the rear damper first")


def test_lines_of_a_refusal_say_why_and_what_to_do() -> None:
    document = load("refused")
    text = "\n".join(verdict_lines(document))
    assert text.startswith("No answer: the suspension parameters cannot be determined from this ")
    for reason in document.reasons:
        assert f"Why: {reason}." in text
    steps = next_steps(document)
    assert any("bump" in step for step in steps)
    assert len(steps) == len(set(steps))


def test_an_unconverged_estimate_is_marked_as_unreliable() -> None:
    document = load("not_converged")
    lines = verdict_lines(document)
    assert lines[0] == "No reliable answer: the sampling did not converge."
    assert all(line.startswith("Not to be relied on: ") for line in lines[1:5])
    assert any(line.startswith("Note: the ensembles had not agreed") for line in lines)
    text = " ".join(sampling_lines(document.diagnostics))
    assert "do not agree" in text
    assert "too small" in text


def test_a_wide_answer_asks_for_another_recording() -> None:
    document = load("us")
    document.parameters["c_f"] = parameter(7.0, 2.0, 7.2, 0.5)
    assert any("known only to ±29 %" in step for step in next_steps(document))


def test_convergence_says_nothing_where_nothing_was_sampled() -> None:
    assert sampling_lines(load("refused").diagnostics) == []


@pytest.mark.parametrize(
    ("reason", "what", "fix"),
    [
        ("x is too short; record longer", "x is too short", "record longer"),
        ("next to nothing about i (i): drive over a bump",
         "next to nothing about i (i)", "drive over a bump"),
        ("bad", "bad", ""),
    ],
)  # fmt: skip
def test_a_reason_splits_into_fault_and_fix(reason: str, what: str, fix: str) -> None:
    assert split_reason(reason) == (what, fix)


def test_control_characters_do_not_reach_the_terminal() -> None:
    assert all(line.isprintable() for line in verdict_lines(load("hostile")))
