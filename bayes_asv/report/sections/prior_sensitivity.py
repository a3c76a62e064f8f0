"""Sensitivity of the estimates to the priors and given values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import PriorSensitivity
from bayes_asv.report.sections.blocks import Block, Section, Table, Text
from bayes_asv.report.sections.parameters import answers
from bayes_asv.report.words import LABELS, MISSING, capitalized, enumerated, plain

__all__ = ["SECTION"]

# Thresholds of Kallioinen et al. (2024) and of Vehtari et al., Pareto smoothed importance
# sampling, Journal of Machine Learning Research 25:72 (2024).
_SENSITIVE: Final = 0.05
_RELIABLE: Final = 0.7

_NOTE: Final = (
    "Power-scaling sensitivity: the cumulative Jensen–Shannon distance by which the posterior "
    "moves per doubling of the exponent of the prior. Above 0.05 the answer depends on the prior "
    "or given value. Above a Pareto k̂ of 0.7 the row is not reliable."
)


def _content(document: EstimateDocument) -> Iterator[Block]:
    if not document.sensitivity:
        return
    names = answers(document.parameters)
    rows = [
        [
            capitalized(_label(prior, one)),
            *(_text(one.sensitivity.get(name)) for name in names),
            MISSING if one.pareto_k is None else f"{one.pareto_k:.2f}".replace("-", "−"),
        ]
        for prior, one in document.sensitivity.items()
    ]
    yield Text("", _lines(document, names))
    columns = ["prior of", *(LABELS[name] for name in names), "Pareto k̂"]
    yield Table("Power-scaling sensitivity", columns, rows, _NOTE)


SECTION: Final = Section(_content, title="Sensitivity to the priors")


def _label(prior: str, one: PriorSensitivity) -> str:
    return LABELS.get(prior) or plain(one.label or prior)


def _lines(document: EstimateDocument, names: list[str]) -> list[str]:
    """Say which estimates depend on which prior or given value, the strongest first."""
    strongest = {
        prior: max(one.sensitivity.get(name, 0.0) for name in names)
        for prior, one in document.sensitivity.items()
        if (one.pareto_k or 0.0) <= _RELIABLE
    }
    lines = []
    for prior in sorted(strongest, key=lambda p: -strongest[p]):
        one = document.sensitivity[prior]
        leaning = [n for n in names if one.sensitivity.get(n, 0.0) > _SENSITIVE]
        if leaning:
            source = "the prior of the" if prior in document.prior else "the given"
            answer = capitalized(enumerated([f"the {LABELS[name]}" for name in leaning]))
            verb = "depends" if len(leaning) == 1 else "depend"
            lines.append(f"{answer} {verb} on {source} {_label(prior, one)}.")
    return lines or ["No answer depends noticeably on a prior or on a given value."]


def _text(value: float | None) -> str:
    return MISSING if value is None else f"{value:.2f}"
