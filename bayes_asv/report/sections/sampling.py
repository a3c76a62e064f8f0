"""Convergence of the sampler in sentences."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from bayes_asv.posterior.convergence import ESS_WANTED, RHAT_WANTED
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import Diagnostics
from bayes_asv.report.sections.blocks import Block, Section, Text
from bayes_asv.report.words import percent

__all__ = ["SECTION", "sampling_lines"]

_USUAL_ACCEPTANCE: Final = (0.1, 0.9)


def _content(document: EstimateDocument) -> Iterator[Block]:
    lines = sampling_lines(document.diagnostics)
    if lines:
        yield Text("", [" ".join(lines)])


SECTION: Final = Section(_content, title="Convergence of the sampler")


def sampling_lines(diagnostics: Diagnostics) -> list[str]:
    """State whether the draws are good enough to quote; empty where nothing was sampled."""
    draws = diagnostics.draws or 0
    if diagnostics.sampler == "random effects":
        return [
            f"The runs are not consistent, so the {draws} draws are of a mean car with a spread "
            "from run to run. They are independent: the spread is integrated on a grid, and each "
            "run enters with mean and covariance of its own posterior."
        ]
    lines = []
    if diagnostics.sampler == "weighted draws":
        lines.append(
            f"The {draws} draws are independent: they come from a Student t shaped like the "
            "posterior and were weighted by it, which the tail of their weights allows."
        )
    rhat, acceptance = diagnostics.rhat_max, diagnostics.acceptance
    if rhat is not None:
        good = rhat < RHAT_WANTED
        lines.append(
            f"The independent ensembles {'agree' if good else 'do not agree'}: the largest R̂ is "
            f"{rhat:.3f} and should be below {RHAT_WANTED}."
        )
    bulk, tail = diagnostics.ess_bulk_min, diagnostics.ess_tail_min
    if bulk is not None and tail is not None:
        good = min(bulk, tail) >= ESS_WANTED
        lines.append(
            f"The effective sample size of the {draws} draws is {bulk:.0f} in the bulk and "
            f"{tail:.0f} in the tails: {'enough' if good else 'too small'}, it should be at least "
            f"{ESS_WANTED:.0f}."
        )
    if acceptance is not None:
        low, high = _USUAL_ACCEPTANCE
        usual = "as usual" if low <= acceptance <= high else "which is unusual"
        lines.append(f"{percent(acceptance)} of the proposals were accepted, {usual}.")
    return lines
