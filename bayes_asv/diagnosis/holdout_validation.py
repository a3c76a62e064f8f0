"""The proof: gaps before and after, on what was fitted and on what was held out."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

from bayes_asv.diagnosis.engine_force import Engine
from bayes_asv.diagnosis.model_search import Model, fewer, upheld
from bayes_asv.diagnosis.results import Named
from bayes_asv.diagnosis.simulation_error import Gap, before_and_after, left_over
from bayes_asv.posterior.fitted_model import Dataset, FittedModel

__all__ = ["HoldoutValidation", "Recorded", "failed", "proof"]

_NOISE = 1.03  # times the floor: a gap that a floor estimated from so many readings may have


class Recorded(NamedTuple):
    """Recordings, and the linear car there.

    Parameters
    ----------
    fit : Dataset
        What was fitted.
    holdout : Dataset or None
        What was held out.
    linear : FittedModel
        Fitted to the first.
    """

    fit: Dataset
    holdout: Dataset | None
    linear: FittedModel


class HoldoutValidation(NamedTuple):
    """Gaps before and after.

    Parameters
    ----------
    gaps : dict of str to Gap
        ``fit`` and, where there is one, ``holdout``, from the linear car to the finished model; an
        engine is in what was before.
    named : list of Named
        Each with its own gaps.
    silent : Gap or None
        On what was held out, no engine's tones in it before or after.
    """

    gaps: dict[str, Gap]
    named: list[Named]
    silent: Gap | None


def failed(
    held: Dataset | None, model: Model, named: list[Named], whole: Gap | None, seed: int
) -> list[Named]:
    """Effects that made things worse on what was held out when they came, and would be better away.

    When it comes, an effect can also be worse because of another that is still missing.  What
    acts in one run alone has nothing to say on others, and where all that is left is noise, or
    the likelihood of what was held out has nothing against it, nothing went wrong: a spring 2.5
    times as stiff as it was given, worth 150 nats, left a gap that was nearly all noise and grew
    by a part in two hundred.  Where all of them together made it worse and none is to blame alone,
    all have failed: they stand in for something that has no name, and so may a push in one run,
    which draws the car's own values after it.

    Parameters
    ----------
    held : Dataset or None
        What was held out.
    model : Model
        With everything named.
    named : list of Named
        With their gaps.
    whole : Gap or None
        Of all of them, on what was held out without an engine's tones: cut out, those leave less
        than there was whatever names do.
    seed : int
        Of the bootstrap.
    """
    if held is None:
        return []
    out = []
    for one in named:
        if one.site.run is not None or not _worse(one.gaps["holdout"]):
            continue
        rest = tuple(n.site for n in named if n is not one)
        less = fewer(model, rest)
        worse = before_and_after(held, less, model.stage, seed).worse
        if worse and not upheld(model, held, [one]):
            out.append(one)
    if not out and whole is not None and _worse(whole) and not upheld(model, held, named):
        return named
    return out


def _worse(gap: Gap) -> bool:
    """Whether a gap grew beyond what noise leaves."""
    return gap.worse and gap.after > _NOISE * gap.floor


def proof(
    given: Recorded,
    cut: Recorded,
    model: Model,
    named: list[Named],
    engine: Engine | None,
    seed: int,
) -> HoldoutValidation:
    """Work out gaps of the whole way and of each effect, on the fit and on what was held out.

    Parameters
    ----------
    given, cut : Recorded
        As they were given, and without an engine's tones.
    model : Model
        With everything named.
    named : list of Named
        In order.
    engine : Engine or None
        Whose tones were cut out.
    seed : int
        Of the bootstrap.
    """
    stages = [cut.linear]
    for k in range(1, len(named)):
        stages.append(fewer(model, tuple(n.site for n in named[:k])))
    if named:
        stages.append(model.stage)
    gaps: dict[str, Gap] = {}
    silent: dict[str, Gap] = {}
    told = [dict(n.gaps) for n in named]
    kinds = (("fit", cut.fit, given.fit), ("holdout", cut.holdout, given.holdout))
    for name, where, whole in kinds:
        if where is None or whole is None:
            continue
        own = name == "fit"
        silent[name] = gap = before_and_after(where, stages[0], stages[-1], seed, own=own)
        if engine is not None:
            before = left_over(whole, given.linear, seed).rms
            gap = replace(gap, before=before, worse=gap.after > before)
        gaps[name] = gap
        for j in range(len(named)):
            told[j][name] = before_and_after(where, stages[j], stages[j + 1], seed, own=own)
    named = [replace(n, gaps=g) for n, g in zip(named, told, strict=True)]
    return HoldoutValidation(gaps, named, silent.get("holdout"))
