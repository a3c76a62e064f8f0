"""Effects are added one by one, the most probable first, until nothing is gained."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial

from bayes_asv.diagnosis.answer import Told, told_by
from bayes_asv.diagnosis.classes import same_class
from bayes_asv.diagnosis.model import Model, asked
from bayes_asv.diagnosis.naming import divided, probabilities, weigh
from bayes_asv.diagnosis.results import Named

__all__ = ["LEVEL", "Grown", "begun", "grow"]

LEVEL = 0.05
"""Family-wise level of the test for a disagreement."""

_MOST = 4  # effects that are named
_GAIN = 5.0  # nats that a second effect has to bring
_BARELY = 0.1  # probability below which a name is not worth its mention


@dataclass(frozen=True)
class Grown:
    """A model with what was added to it.

    Parameters
    ----------
    model : Model
        With everything named.
    named : tuple of Named
        In order.
    told : list of Told
        What the explanations of the last step say of the car, by their shares.
    none : float
        Probability that nothing beyond tolerances is missing, before the first was named.
    """

    model: Model
    named: tuple[Named, ...]
    told: list[Told]
    none: float


def begun(model: Model) -> Grown:
    """Return a model to which nothing was added."""
    return Grown(model, (), told_by(model.stage, model.allowed), 1.0)


def grow(
    grown: Grown, seed: int, tell: Callable[[float, str], None], failed: Collection[str] = ()
) -> Grown:
    """Name what is missing and add it, as long as something is.

    Parameters
    ----------
    grown : Grown
        From :func:`begun`, or of an earlier growth.
    seed : int
        Of the tests.
    tell : callable
        Told the share that is done, and what is going on.
    failed : collection of str
        Sites that made things worse on what was held out; they are not named again.
    """
    model, named, told, none = grown.model, list(grown.named), grown.told, grown.none
    while len(named) < _MOST and model.p < (LEVEL if not named else 0.2 * LEVEL):
        share_done = 0.1 + 0.2 * len(named)
        tell(share_done, "asking what is missing")
        trying = partial(_trying, tell, share_done)
        options = weigh(model.quiet, model.stage, model.found, trying, failed)
        if not options:
            break
        options[0] = best = divided(model.quiet, options[0], model.found, _GAIN)
        sites = len({str(c.site) for c in model.found.candidates})
        nothing, share = probabilities(model.allowed.log_evidence, options, sites)
        none = nothing if not named else none
        told = [
            *told_by(model.stage, model.allowed, nothing),
            *(
                one
                for option, part in zip(options, share, strict=True)
                for one in told_by(option.stage, option.allowed, part)
            ),
        ]
        gain = best.allowed.log_evidence - model.allowed.log_evidence
        if gain < (_GAIN if named else 0.0):
            break
        tell(share_done + 0.15, "asking what cannot be told apart")
        members = same_class(model.quiet, options)
        probability = sum(share[options.index(m)] for m in members)
        if probability < _BARELY:
            break
        new = best.stage.sites[len(model.stage.sites) :]
        named += [Named(site, min(float(probability), 1.0), tuple(members[1:]), {}) for site in new]
        model = asked(model.where, best.stage, seed)
        if nothing > 0.5:  # a little of everything explains it as well: no second name on top
            break
    return Grown(model, tuple(named), told, none)


def _trying(tell: Callable[[float, str], None], share: float, words: str) -> None:
    tell(share + 0.05, f"trying {words}")
