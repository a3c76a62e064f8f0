"""Effects are added one by one, the most probable first, until nothing is gained."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.indistinguishable import same_class
from bayes_asv.diagnosis.model_averaging import Told, told_by
from bayes_asv.diagnosis.model_comparison import Option, as_it_is, divided, probabilities, weigh
from bayes_asv.diagnosis.model_search import Model, asked, weighed, without
from bayes_asv.diagnosis.results import Named
from bayes_asv.diagnosis.thresholds import ENOUGH, LEVEL, SHORT
from bayes_asv.diagnosis.unlisted_faults_test import without_a_name
from bayes_asv.posterior.fitted_model import refitted

__all__ = ["Selection", "begun", "grow", "reconsidered"]

Array = NDArray[np.float64]

_MOST = 4  # effects that are named
_APART = 5.0  # nats that values of its own for each axle have to bring
_STANDS_IN = 0.5  # probability from which on a little of everything may be all there is
_TINY = 1e-12  # probability that stands for none
_BARELY = 0.1  # probability below which a name is not worth its mention


@dataclass(frozen=True)
class Selection:
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
    beside : bool
        Something was found that is no effect of the model: whatever is named is a further effect.
    nameless : str
        What explained more than any name where growing ended; empty where nothing did.
    """

    model: Model
    named: tuple[Named, ...]
    told: list[Told]
    none: float
    beside: bool = False
    nameless: str = ""


class _Step(NamedTuple):
    """What may come next.

    Parameters
    ----------
    options : list of Option
        The most probable first.
    share : (K,) array
        Their probabilities.
    nothing : float
        Probability that nothing is missing.
    gain : float
        Nats that the first is better than nothing.
    told : list of Told
        What the explanations say of the car, by their probabilities.
    nameless : str
        What explains more than any of them without a name.
    """

    options: list[Option]
    share: Array
    nothing: float
    gain: float
    told: list[Told]
    nameless: str


def begun(model: Model, *, beside: bool = False) -> Selection:
    """Return a model to which nothing was added."""
    return Selection(model, (), told_by(model.stage, model.allowed), 1.0, beside)


def grow(
    grown: Selection,
    seed: int,
    tell: Callable[[float, str], None],
    failed: Collection[str] = (),
    most: int = _MOST,
) -> Selection:
    """Name what is missing and add it, as long as something is, and has a name.

    What is in the list stands in for what is not, one after the other and each for a part of it:
    four names for one hysteresis, none of them true.  Where something without a name explains more
    than the best of them, nothing more is named.

    Parameters
    ----------
    grown : Selection
        From :func:`begun`, or of an earlier growth.
    seed : int
        Of the tests.
    tell : callable
        Told the share that is done, and what is going on.
    failed : collection of str
        Sites that made things worse on what was held out; they are not named again.
    most : int
        How many effects are named in all.
    """
    now = kept = replace(grown, nameless="")
    doubt = 0.0  # that a little of everything is there, and not what was named first
    while len(now.named) < most:
        model = now.model
        further = bool(now.named) or now.beside
        if model.p >= (0.2 * LEVEL if further else LEVEL):
            break
        share_done = 0.1 + 0.2 * len(now.named)
        tell(share_done, "asking what is missing")
        step = _next(model, partial(_trying, tell, share_done), failed, beside=further)
        if step is None:
            break
        none = now.none if now.named else step.nothing
        sure = 1.0  # that what is named already is there
        if step.nameless:  # what is on trial is none the more probable for it
            ended = kept if doubt > 0.0 else replace(now, told=step.told, none=none)
            return replace(ended, nameless=step.nameless)
        if doubt > 0.0:
            left = _doubt(doubt, step.nothing)
            if left > _STANDS_IN:
                break
            now = _believed(now, (1.0 - left) / (1.0 - doubt), left)
            doubt, none, sure = 0.0, left, 1.0 - left
        now = replace(now, told=step.told, none=none)
        tell(share_done + 0.15, "asking what cannot be told apart")
        best, *others = members = same_class(model.quiet, step.options)
        probability = sure * float(sum(step.share[step.options.index(m)] for m in members))
        likely = sure * (1.0 - step.nothing) >= 1.0 - _STANDS_IN
        named_for_itself = step.gain >= 0.0 and probability >= _BARELY and (likely or not further)
        on_trial = not likely and not further
        if not (named_for_itself or on_trial):
            break
        before, new = now, best.stage.sites[len(model.stage.sites) :]
        added = [Named(site, min(probability, 1.0), tuple(others), {}) for site in new]
        now = replace(
            now, model=asked(model.where, best.stage, seed), named=(*now.named, *added)
        )  # fmt: skip
        if on_trial:
            doubt, kept = step.nothing, now if named_for_itself else before
    return kept if doubt > 0.0 else now


def _next(
    model: Model, trying: Callable[[str], None], failed: Collection[str], *, beside: bool
) -> _Step | None:
    """Weigh everything that a model may be lacking; none where nothing can be fitted."""
    options = weigh(model.quiet, model.stage, model.found, trying, failed, beside=beside)
    if not options:
        return None
    options[0] = best = divided(model.quiet, options[0], model.found, _APART)
    as_is, stage, granted = as_it_is((model.stage, model.allowed), options, model.found)
    nothing, share = probabilities(as_is, options, model.found.sites)
    gain = best.allowed.log_evidence - as_is
    nameless = _without_a_name(model, best, as_is)
    if nameless:
        told = told_by(model.stage, model.allowed)
    else:
        told = told_by(stage, granted, nothing)
        for option, part in zip(options, share, strict=True):
            told += told_by(option.stage, option.allowed, part)
    return _Step(options, share, nothing, gain, told, nameless)


def _without_a_name(model: Model, best: Option, as_is: float) -> str:
    """Say what explains clearly more than the best of the list, and has no name there.

    Parameters
    ----------
    model : Model
        So far.
    best : Option
        Of the list.
    as_is : float
        Log evidence of the model as it is, with a little of everything.

    Returns
    -------
    str
        Nothing where a name, or a little of everything, does.
    """
    other = without_a_name(model.quiet, model.allowed)
    known = max(best.allowed.log_evidence, as_is)
    short = SHORT * (known - model.allowed.log_evidence)
    return other.words if other.log_evidence > known + ENOUGH + short else ""


def _believed(grown: Selection, times: float, none: float) -> Selection:
    """Return what was named first with so many times its probability, each axle's part alike."""
    named = tuple(replace(n, probability=min(n.probability * times, 1.0)) for n in grown.named)
    return replace(grown, named=named, none=none)


def _doubt(before: float, nothing: float) -> float:
    """Probability that a little of everything is there, and not what was named, once more is known.

    Where two faults are there, either of them alone leaves too much, and a little of everything
    explains both: two dampers' of noncentrality 4000 each were 0.11 probable one by one.  The next
    step compares the first alone with both; by as much as both are more probable the odds of the
    first rise.  Where there really is a little of everything no second fault helps the first.

    Parameters
    ----------
    before : float
        That probability when the first was named.
    nothing : float
        Probability that nothing is missing beside the first.
    """
    odds = (1.0 - before) / before / max(nothing, _TINY)
    return 1.0 / (1.0 + odds)


def reconsidered(
    grown: Selection, seed: int, tell: Callable[[float, str], None], failed: Collection[str] = ()
) -> Selection:
    """Ask again without pushes that were named before something else was.

    A push of any course fits a part of most things, and best while others are missing: with a
    sensor's drift to come, a push was 87 nats before a droop stop that it stood in for.  A push
    that is named again before anything else stays, and so does everything where as much was named
    as may be: what asks for so many names has none, and would ask for as many others.

    Parameters
    ----------
    grown, seed, tell, failed
        As :func:`grow` takes and returns them.
    """
    pushes = [n for n in grown.named if n.site.run is not None]
    order = [n.site.run is not None for n in grown.named]
    followed = any(push and not other for push, other in pairwise(order))
    if not followed or len(order) >= _MOST:
        return grown
    tell(0.8, "asking again without pushes")
    model, kept = without(grown.model, list(grown.named), pushes, seed)
    told = told_by(model.stage, model.allowed)
    begin = replace(grown, model=model, named=tuple(kept), told=told)
    other = grow(begin, seed, tell, failed, most=len(kept) + 1)
    if any(n.site.key == push.site.key for n in other.named for push in pushes):
        return grown
    if len(other.named) > len(kept):
        other = grow(other, seed, tell, failed)
    if {n.site.key for n in other.named} == {n.site.key for n in grown.named}:
        return grown
    # evidence is comparable on the same quiet recordings alone
    quiet, old = other.model.quiet, grown.model.stage
    behind = weighed(quiet, refitted(quiet, old, old.sites)).log_evidence
    return other if other.model.allowed.log_evidence > behind else grown


def _trying(tell: Callable[[float, str], None], share: float, words: str) -> None:
    tell(share + 0.05, f"trying {words}")
