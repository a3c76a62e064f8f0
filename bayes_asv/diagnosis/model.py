"""A model on its way through the workflow, with what was asked of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bayes_asv.diagnosis.clear import clear
from bayes_asv.diagnosis.family import family_p
from bayes_asv.diagnosis.pushes import with_pushes
from bayes_asv.diagnosis.results import Named
from bayes_asv.diagnosis.signatures import Signatures, signatures
from bayes_asv.diagnosis.tolerance import Allowed, allowed
from bayes_asv.inference.candidates import candidates
from bayes_asv.inference.stage import Setting, Stage, base, carried, fitted, foretold

__all__ = ["Model", "again", "asked", "pruned", "without"]

_NEEDLESS = 2.0  # nats below which a named effect is taken out again


@dataclass(frozen=True)
class Model:
    """A stage with what stands around it."""

    where: Setting
    stage: Stage
    found: Signatures
    allowed: Allowed
    p: float


def again(stage: Stage, where: Setting) -> Stage:
    """Fit the model of a stage to other recordings of the same drives."""
    target = where.target(stage.sites)
    start = carried(stage.space, stage.mode.z, target.space, None, {})
    where = foretold(where, fitted(where, stage.sites, target, start))
    target = where.target(stage.sites)
    return fitted(where, stage.sites, target, start)


def asked(where: Setting, stage: Stage, seed: int) -> Model:
    """Ask a stage about everything that may be missing."""
    where = foretold(where, stage)
    target = replace(stage.target, patterns=where.patterns)
    stage = replace(stage, target=target)
    asked_for = signatures(clear(where, stage), candidates(stage, where.vehicle))
    found = with_pushes(asked_for)
    p = family_p(asked_for, seed)
    return Model(where, stage, found, allowed(stage, found), p)


def pruned(model: Model, named: list[Named], seed: int) -> tuple[Model, list[Named]]:
    """Take out what later effects made needless."""
    k = 0
    while len(named) > 1 and k < len(named):
        less, fewer = without(model, named, [named[k]], seed)
        if model.allowed.log_evidence - less.allowed.log_evidence < _NEEDLESS:
            model, named = less, fewer
        else:
            k += 1
    return model, named


def without(
    model: Model, named: list[Named], failed: list[Named], seed: int
) -> tuple[Model, list[Named]]:
    """Take effects out of a model; without any it is the linear car, fitted as at the beginning."""
    kept = [n for n in named if n not in failed]
    if not kept:  # what effects had drawn the car to may be the slope of another hill
        return asked(model.where, base(model.where), seed), kept
    sites = tuple(n.site for n in kept)
    target = model.where.target(sites)
    start = carried(model.stage.space, model.stage.mode.z, target.space, None, {})
    return asked(model.where, fitted(model.where, sites, target, start), seed), kept
