"""Posterior predictive checks: whether the model would produce such recordings."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final

from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import Check, Run
from bayes_asv.report.sections.blocks import Block, Section, Table
from bayes_asv.report.words import number, p_value, plain, probability, readable_unit, two_digits

__all__ = ["SECTION"]

_SIGNIFICANT: Final = 0.01  # corrected p-value below which the first page reports a check

_BANDS: Final = {0.5: "body band", 5.0: "wheel-hop band", 15.0: "band above"}
_MARK: Final = "✱"
_ROWS: Final = 3  # of one run where there are several


def _content(document: EstimateDocument) -> Iterator[Block]:
    runs = [run for run in document.runs if run.checks]
    if runs:
        yield _check_table(runs)


def _check_limits(document: EstimateDocument) -> list[str]:
    """State where recordings hold more or less motion than the model and its sensors produce.

    Returns
    -------
    list of str
        At most one sentence a channel: about the residual, or about the reading where only that
        is significant.
    """
    sentences = []
    channels = dict.fromkeys(check.channel for run in document.runs for check in run.checks)
    for channel in channels:
        for of in ("residual", "reading"):
            significant = [
                (run, check)
                for run in document.runs
                for check in _significant(run)
                if check.channel == channel and check.of == of
            ]
            if significant:
                sentences.append(_sentence(significant, len(document.runs)))
                break
    return sentences


SECTION: Final = Section(
    _content, _check_limits, about="model", title="Posterior predictive checks"
)


def _band_text(check: Check) -> str:
    """Name the quantity of a check, ``rms, body band (0.5 to 5 Hz)``."""
    if check.quantity == "peak":
        return "peak"
    if check.band is None:
        return "rms"
    low, high = check.band
    name = _BANDS.get(low or 0.0, "band")
    end = f"{number(low)} Hz up" if high is None else f"{number(low)} to {two_digits(high)} Hz"
    return f"rms, {name} ({end})"


def _by_surprise(checks: Sequence[Check]) -> list[Check]:
    """Order checks by corrected p-value, then by the ratio of measured to replicated."""

    def key(check: Check) -> tuple[float, float]:
        usual = check.replicated.median
        if not usual > 0.0 or not check.observed > 0.0:
            return check.p_family, 0.0
        return check.p_family, -abs(math.log(check.observed / usual))

    return sorted(checks, key=key)


def _significant(run: Run) -> list[Check]:
    return _by_surprise([c for c in run.checks if c.p_family < _SIGNIFICANT])


def _sentence(significant: Sequence[tuple[Run, Check]], count: int) -> str:
    worst = _by_surprise([check for _, check in significant])[0]
    run = next(run for run, check in significant if check is worst)
    low, high = worst.replicated.eti95
    sd = 0.25 * (high - low)
    size = "more" if worst.observed > worst.replicated.median else "less"
    where = worst.channel.replace("_", " ")
    what = f"the {where} reading has {size} motion"
    if worst.of == "residual":
        what = f"the {where} residual is {'larger' if size == 'more' else 'smaller'}"
    sources = {run.source for run, _ in significant}
    some = f" in {len(sources)} of {count} recordings" if count > 1 else ""
    which = f" of {plain(run.source)}" if count > 1 else ""
    return (
        f"Posterior predictive check: {what}{some} than the model and its sensors produce, most "
        f"clearly in the {_band_text(worst).removeprefix('rms, ')}{which}: "
        f"{number(worst.observed, sd)} {readable_unit(worst.unit)} against {number(low, sd)} to "
        f"{number(high, sd)} ({p_value(worst.p_family)}, corrected for all checks of a run)."
    )


def _check_table(runs: Sequence[Run]) -> Table:
    """Measured beside replicated: all checks of one run, the most significant ones of several."""
    rows, several, unit = [], len(runs) > 1, readable_unit(runs[0].checks[0].unit)
    for run in runs:
        prefix = f"{plain(run.source)}: " if several else ""
        shown = run.checks
        if several:
            shown = _significant(run)[:_ROWS] or _by_surprise(run.checks)[:1]
        for check in shown:
            own = readable_unit(check.unit)
            label = _label(check) + (f" [{own}]" if own != unit else "")
            rows.append([f"{prefix}{label}", *_cells(check)])
    selection = (
        f"Of each run, up to {_ROWS} significant checks are shown, or else the one with the "
        "smallest p-value. "
    )
    return Table(
        "Posterior predictive checks",
        ["quantity", f"measured [{unit}]", f"replicated [{unit}]", "p"],
        rows,
        f"{selection if several else ''}Replicated recordings are simulated with draws of the "
        "posterior, the measured wheel accelerations and new sensor noise; initial state and "
        "biases are fitted to each recording alike. The range holds 95 % of them, and p is "
        f"two-sided. {_MARK} marks p below 1 % when corrected for all "
        f"{len(runs[0].checks)} checks of a run.",
    )


def _label(check: Check) -> str:
    name = check.channel.removesuffix("_chassis").replace("_", " ")
    return f"{name} {check.of}, {_band_text(check)}"


def _cells(check: Check) -> list[str]:
    low, high = check.replicated.eti95
    sd = 0.25 * (high - low)
    mark = f" {_MARK}" if check.p_family < _SIGNIFICANT else ""
    return [
        number(check.observed, sd),
        f"{number(low, sd)} to {number(high, sd)}",
        f"{probability(check.p)}{mark}",
    ]
