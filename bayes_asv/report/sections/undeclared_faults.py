"""Bias of the estimates by faults that the vehicle file does not declare."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from bayes_asv.domain.units import INCH
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import Fault, ParameterBudget, Shift
from bayes_asv.report.sections.blocks import Block, Section, Table
from bayes_asv.report.sections.uncertainty_budget import answers_text, sd_text, usable_budgets
from bayes_asv.report.words import LABELS, capitalized, number, two_digits

__all__ = ["SECTION", "fault_text"]

_MIN_SHIFT: Final = 0.1  # least bias by a fault that is mentioned, posterior standard deviations

_NOTE: Final = (
    "How far the answer would be too high or too low, and in brackets the same in its standard "
    "deviations. The shift is proportional to the fault and changes sign with it; a sensor tilted "
    "by 8° reads 1 % too little. ≤: a larger fault would show in the residuals, as noise above the "
    "declared level."
)


def _content(document: EstimateDocument) -> Iterator[Block]:
    budgets = usable_budgets(document.width)
    if budgets and document.width is not None and document.width.faults:
        yield _fault_table(document.width.faults, budgets, document.vehicle.units)


def _fault_limits(document: EstimateDocument) -> list[str]:
    """State the most harmful error of a value given as exact, and the most harmful sensor fault."""
    if document.verdict != "ok" or document.width is None:
        return []
    lines = []
    faults, budgets = document.width.faults, usable_budgets(document.width)
    for given in (True, False):
        shifts = [
            (abs(fault.shift[name].sd), key, name)
            for key, fault in faults.items()
            if (fault.kind == "given") == given
            for name in document.prior  # what was asked for
            if name in budgets and name in fault.shift
        ]
        deviations, key, name = max(shifts, default=(0.0, "", ""))
        if deviations < _MIN_SHIFT:
            continue
        fault, shift = faults[key], faults[key].shift[name]
        size = f"{sd_text(abs(shift.percent), '')} too {'high' if shift.percent > 0.0 else 'low'}"
        answer = f"{answers_text([name])} would be {size} ({number(deviations, 1.0)} sd)"
        what = fault_text(fault, document.vehicle.units)
        lines.append(
            f"The {LABELS[fault.where]} is given as exact: if it were {what}, {answer}."
            if given
            else f"Of the sensor faults that the residuals would not show, {what} matters most: "
            f"{answer}."
        )
    return lines


SECTION: Final = Section(_content, _fault_limits, title="Undeclared faults")


def fault_text(fault: Fault, units: str, *, brief: bool = False) -> str:
    """Describe a fault.

    Parameters
    ----------
    fault : Fault
        From the document.
    units : {'US', 'SI'}
        System of units for lengths.
    brief : bool
        ``front wheel: 1 % too much`` instead of ``a front wheel sensor that reads 1 % too much``.
    """
    at_most = "≤ " if fault.larger_shows and brief else ""
    share = at_most + sd_text(100.0 * fault.size, "")
    if fault.kind == "given":
        return f"{LABELS[fault.where]}: {share} larger" if brief else f"{share} larger"
    place = fault.where.replace("_", " ")
    sensor = f"{place}:" if brief else f"a {place} sensor"
    if fault.kind == "gain":
        return f"{sensor} {share} too much" if brief else f"{sensor} that reads {share} too much"
    if fault.kind == "delay":
        delay = f"{at_most}{two_digits(1e3 * fault.size)} ms later"
        return f"{sensor} {delay}" if brief else f"{sensor} sampled {delay}"
    if fault.kind == "bandwidth":
        return f"{sensor} {'' if brief else 'with '}{share} more bandwidth"
    length = (
        f"{two_digits(fault.size / INCH)} in"
        if units == "US"
        else f"{two_digits(1e3 * fault.size)} mm"
    )
    return f"{sensor} {at_most}{length} ahead of {'' if brief else 'its '}axle"


def _fault_table(
    faults: Mapping[str, Fault], budgets: Mapping[str, ParameterBudget], units: str
) -> Table:
    """Bias of each estimate by each fault."""
    rows = [
        [
            capitalized(fault_text(fault, units, brief=True)),
            *(_shift_text(fault.shift[name]) for name in budgets),
        ]
        for fault in faults.values()
    ]
    columns = ["fault", *(LABELS[name] for name in budgets)]
    return Table("Effect of undeclared faults", columns, rows, _NOTE)


def _shift_text(shift: Shift) -> str:
    sign = "−" if shift.percent < 0.0 else "+"
    small = abs(shift.percent) < 0.005
    size = "0.00 %" if small else sd_text(abs(shift.percent), sign)
    return f"{size} ({number(abs(shift.sd), 1.0)} sd)"
