"""A model on its way through the workflow, with what was asked of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bayes_asv.diagnosis.clear import clear, on_quiet_wheels
from bayes_asv.diagnosis.family import family_p
from bayes_asv.diagnosis.pushes import with_pushes
from bayes_asv.diagnosis.results import Named
from bayes_asv.diagnosis.signatures import Signatures, signatures
from bayes_asv.diagnosis.tolerance import Allowed, allowed
from bayes_asv.inference.candidates import candidates
from bayes_asv.inference.stage import Setting, Stage, base, carried, fitted, foretold
from bayes_asv.model.effects import Site

__all__ = ["Model", "again", "asked", "evidence", "fewer", "pruned", "without"]

_NEEDLESS = 2.0  # nats below which a named effect is taken out again


@dataclass(frozen=True)
class Model:
    """A stage with what stands around it.

    Parameters
    ----------
    where : Setting
        Recordings as they are; patterns stand on what the stage foretells.
    quiet : Setting
        The same with quiet wheels.
    stage : Stage
        At its mode on quiet wheels.
    found : Signatures
        Of everything that may be missing.
    allowed : Allowed
        The stage with a little of everything.
    p : float
        Of the test for a disagreement.
    """

    where: Setting
    quiet: Setting
    stage: Stage
    found: Signatures
    allowed: Allowed
    p: float

    @property
    def as_read(self) -> Stage:
        """The stage on recordings as they are, where it has its mode on quiet wheels."""
        return replace(self.stage, target=self.where.target(self.stage.sites))


def again(stage: Stage, where: Setting) -> Stage:
    """Fit the model of a stage to other recordings of the same drives."""
    target = where.target(stage.sites)
    start = carried(stage.space, stage.mode.z, target.space, None, {})
    where = foretold(where, fitted(target, start))
    target = where.target(stage.sites)
    return fitted(target, start)


def asked(where: Setting, stage: Stage, seed: int) -> Model:
    """Ask a stage about everything that may be missing."""
    where, read = _as_read(where, stage)
    quiet, stage = on_quiet_wheels(where, read)
    asked_for = signatures(clear(quiet, stage), candidates(stage, where.vehicle))
    found = with_pushes(asked_for)
    p = family_p(asked_for, seed)
    return Model(where, quiet, stage, found, allowed(stage, found), p)


def _as_read(where: Setting, stage: Stage) -> tuple[Setting, Stage]:
    """Carry a stage to recordings as they are, with patterns that stand on what it foretells."""
    rounds = 2 if any(site.effect.acts == "reading" for site in stage.sites) else 1
    for _ in range(rounds):
        stage = replace(stage, target=where.target(stage.sites))
        where = foretold(where, stage)
    return where, replace(stage, target=where.target(stage.sites))


def pruned(model: Model, named: list[Named], seed: int) -> tuple[Model, list[Named]]:
    """Take out what later effects made needless."""
    k = 0
    while len(named) > 1 and k < len(named):
        if model.allowed.log_evidence - _evidence_without(model, named[k]) < _NEEDLESS:
            model, named = without(model, named, [named[k]], seed)
        else:
            k += 1
    return model, named


def _evidence_without(model: Model, one: Named) -> float:
    """Log evidence of the model less one effect, on the very recordings of the model."""
    return _weighed(model, fewer(model, tuple(s for s in model.stage.sites if s != one.site)))


def evidence(model: Model, stage: Stage) -> float:
    """Log evidence of another stage, a little of everything in it, on a model's quiet wheels."""
    target = model.quiet.target(stage.sites)
    start = carried(stage.space, stage.mode.z, target.space, None, {})
    return _weighed(model, fitted(target, start))


def _weighed(model: Model, stage: Stage) -> float:
    little = [c for c in candidates(stage, model.where.vehicle) if c.tolerance]
    return allowed(stage, signatures(clear(model.quiet, stage), little)).log_evidence


def fewer(model: Model, sites: tuple[Site, ...]) -> Stage:
    """Fit some of a model's effects to its recordings with quiet wheels."""
    target = model.quiet.target(sites)
    start = carried(model.stage.space, model.stage.mode.z, target.space, None, {})
    return fitted(target, start)


def without(
    model: Model, named: list[Named], failed: list[Named], seed: int
) -> tuple[Model, list[Named]]:
    """Take effects out of a model; without any it is the linear car, fitted as at the beginning."""
    kept = [n for n in named if n not in failed]
    if not kept:  # what effects had drawn the car to may be the slope of another hill
        return asked(model.where, base(model.where), seed), kept
    return asked(model.where, fewer(model, tuple(n.site for n in kept)), seed), kept
