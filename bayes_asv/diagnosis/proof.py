"""The proof: gaps before and after, on what was fitted and on what was held out."""

from __future__ import annotations

from dataclasses import replace

from bayes_asv.diagnosis.engine import Engine
from bayes_asv.diagnosis.gap import Gap, before_and_after
from bayes_asv.diagnosis.model import Model
from bayes_asv.diagnosis.results import Named
from bayes_asv.inference.stage import Setting, Stage, carried, fitted
from bayes_asv.model.effects import Site

__all__ = ["failed", "proof"]

_NOISE = 1.03  # times the floor: a gap that a floor estimated from so many readings may have


def failed(held: Setting | None, model: Model, named: list[Named], seed: int) -> list[Named]:
    """Effects that made things worse on what was held out when they came, and would be better away.

    When it comes, an effect can also be worse because of another that is still missing.  What
    acts in one run alone has nothing to say on others, and where all that is left is noise,
    nothing went wrong.

    Parameters
    ----------
    held : Setting or None
        What was held out.
    model : Model
        With everything named.
    named : list of Named
        With their gaps.
    seed : int
        Of the bootstrap.
    """
    if held is None:
        return []
    out = []
    for one in named:
        gap = one.gaps["holdout"]
        if one.site.run is not None or not gap.worse or gap.after < _NOISE * gap.floor:
            continue
        rest = tuple(n.site for n in named if n is not one)
        less = _with(model, rest)
        if before_and_after(held, less, model.stage, seed)[0].worse:
            out.append(one)
    return out


def _with(model: Model, sites: tuple[Site, ...]) -> Stage:
    """Fit some of a model's effects."""
    target = model.where.target(sites)
    start = carried(model.stage.space, model.stage.mode.z, target.space, None, {})
    return fitted(model.where, sites, target, start)


def proof(
    first: tuple[Setting, Setting | None, Stage],
    cut: tuple[Setting, Setting | None, Stage],
    model: Model,
    named: list[Named],
    engine: Engine | None,
    seed: int,
) -> tuple[dict[str, Gap], list[Named]]:
    """Gaps of the whole way and of each effect, on the fit and on what was held out."""
    gaps: dict[str, Gap] = {}
    told = [dict(n.gaps) for n in named]
    stages = [cut[2]]
    for k in range(1, len(named)):
        stages.append(_with(model, tuple(n.site for n in named[:k])))
    stages.append(model.stage)
    kinds = (("fit", model.where, first[0]), ("holdout", cut[1], first[1]))
    for name, where, whole in kinds:
        if where is None or whole is None:
            continue
        gap, _, _ = before_and_after(where, cut[2], model.stage, seed)
        if engine is not None:
            raw, _, _ = before_and_after(whole, first[2], first[2], seed)
            gap = replace(gap, before=raw.before, worse=gap.after > raw.before)
        gaps[name] = gap
        for j in range(len(named)):
            told[j][name], _, _ = before_and_after(where, stages[j], stages[j + 1], seed)
    return gaps, [replace(n, gaps=g) for n, g in zip(named, told, strict=True)]
