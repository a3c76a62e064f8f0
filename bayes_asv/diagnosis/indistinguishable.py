"""What these data cannot tell apart.

Two explanations are one class when either, fitted to what the other foretells without any noise,
comes so near that noise would hide the difference, or when both do about as well.
"""

from __future__ import annotations

from dataclasses import replace

from bayes_asv.diagnosis.model_comparison import Option
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, fitted
from bayes_asv.posterior.free_simulation import free_run

__all__ = ["APART", "distance", "same_class"]

APART = 10.0
"""Squared distance in deviations of the noise beyond which two explanations are told apart."""

_EVEN = 3.0  # nats: these very data do not prefer one to the other by twenty to one
_CLOSE = 25.0  # nats: what fits the data themselves so much worse is told apart by them
_MOST = 4


def distance(where: Dataset, one: FittedModel, other: FittedModel) -> float:
    """Squared whitened distance that is left when ``other`` is fitted to what ``one`` foretells.

    Noise levels are held at what is given, so that they cannot take the difference in.
    """
    lines = tuple(
        replace(line, reading=free_run(one.target, one.mode.z, run)[0])
        for run, line in enumerate(where.lines)
    )
    quiet = replace(where, lines=lines)
    reached = []
    for stage in (one, other):
        target = quiet.target(stage.sites, hold=True)
        reached.append(fitted(target, stage.carried_to(target.space)).mode)
    # The first is at home in these data; its own misfit is that of the start alone.
    return max(2.0 * (reached[0].log_posterior - reached[1].log_posterior), 0.0)


def same_class(where: Dataset, options: list[Option]) -> list[Option]:
    """Options that data cannot tell from the first one, that one included."""
    first = options[0]
    found = [first]
    for other in options[1 : 1 + _MOST]:
        behind = first.allowed.log_evidence - other.allowed.log_evidence
        if not behind < _CLOSE:
            continue
        if behind < _EVEN or distance(where, first.stage, other.stage) < APART:
            found.append(other)
    return found
