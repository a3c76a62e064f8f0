"""The error budget of an estimate as tables."""

from __future__ import annotations

from typing import Any, Final

from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.report.budget_words import budgets, fault_words, sd_words, source_words
from bayes_asv.report.readable import number, percent
from bayes_asv.report.tables import table

__all__ = ["budget_table", "fault_table"]

Document = dict[str, Any]

_LEAST_SHARE: Final = 0.005  # of any variance, and
_LEAST_GAIN: Final = 0.02  # of any width, for a source to have a row


def budget_table(document: Document) -> Document | None:
    """Share of every source in each variance, and the width without it."""
    found = budgets(document)
    if not found:
        return None
    rows = [["As it is", *(f"({sd_words(b['sd_percent'])})" for b in found.values())]]
    for source in _sources(found):
        cells = [_cell(source, budget) for budget in found.values()]
        rows.append([_capital(source_words(source)), *cells])
    twice = [f"({sd_words(b['twice_the_runs_sd_percent'])})" for b in found.values()]
    rows.append(["Twice as many runs", *twice])
    return table(
        "What makes each answer as wide as it is",
        ["source", *(QUANTITIES[name][1] for name in found)],
        rows,
        "Share of the answer's variance (shares of a column add up to 100 %), and in brackets the "
        "deviation that would be left if this value were exact, the noise of this sensor half as "
        "large, the steps of its reading infinitely fine, or nothing lost. Shares tell what a "
        "small improvement is worth, brackets a large one. What matters nowhere is left out.",
    )


def _sources(found: dict[str, Document]) -> list[str]:
    """List sources that matter to any answer, in the order of the document."""
    order: dict[str, None] = {}
    for budget in found.values():
        data = budget["noises"] or {"data": budget["shares"].get("data", 0.0)}
        given = [s for s in budget["shares"] if s != "data"]
        order |= dict.fromkeys([*given, *data, *budget["better_sd_percent"]])
    return [s for s in order if any(_matters(s, budget) for budget in found.values())]


def _matters(source: str, budget: Document) -> bool:
    left = _left(source, budget)
    narrower = left is not None and left < (1.0 - _LEAST_GAIN) * budget["sd_percent"]
    return narrower or (_share(source, budget) or 0.0) >= _LEAST_SHARE


def _share(source: str, budget: Document) -> float | None:
    share = budget["noises"].get(source, budget["shares"].get(source))
    return None if share is None else float(share)


def _left(source: str, budget: Document) -> float | None:
    left = budget["exact_sd_percent"].get(source, budget["better_sd_percent"].get(source))
    return None if left is None else float(left)


def _cell(source: str, budget: Document) -> str:
    share, left = _share(source, budget), _left(source, budget)
    words = [] if share is None else [_share_words(share)]
    return " ".join([*words, *([] if left is None else [f"({sd_words(left)})"])]) or "–"


def _share_words(share: float) -> str:
    return "< 1 %" if share < 0.005 else percent(share)


def fault_table(document: Document) -> Document | None:
    """Return what each undeclared fault would do to each answer."""
    found = budgets(document)
    faults = (document.get("width") or {}).get("faults") or {}
    if not found or not faults:
        return None
    rows = []
    for fault in faults.values():
        words = fault_words(fault, document, brief=True)
        rows.append([_capital(words), *(_shift(fault["shift"][name]) for name in found)])
    return table(
        "What an undeclared fault would do",
        ["fault", *(QUANTITIES[name][1] for name in found)],
        rows,
        "How far the answer would come out too high or too low, and in brackets the same in "
        "deviations of the answer. Effects grow with the fault and turn with its sign; a sensor "
        "tilted by 8° reads 1 % too little. ≤: a larger fault leaves residuals that give it "
        "away, and noise is found above what is declared.",
    )


def _shift(shift: Document) -> str:
    sign = "−" if shift["percent"] < 0.0 else "+"
    small = abs(shift["percent"]) < 0.005
    size = "0.00 %" if small else sd_words(abs(shift["percent"]), sign)
    return f"{size} ({number(abs(shift['sd']), 1.0)} sd)"


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]
