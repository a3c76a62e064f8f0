"""A model on its way through the workflow, with what was asked of it."""

from __future__ import annotations

from dataclasses import dataclass, replace

from bayes_asv.diagnosis.denoised_model import clear, on_quiet_wheels
from bayes_asv.diagnosis.free_force_test import with_pushes
from bayes_asv.diagnosis.max_score_test import family_p
from bayes_asv.diagnosis.results import Named
from bayes_asv.diagnosis.savage_dickey import as_slight
from bayes_asv.diagnosis.score_test import ScoreTest, signatures
from bayes_asv.diagnosis.tolerance_prior import ModelEvidence, allowed
from bayes_asv.models.effects import Site
from bayes_asv.posterior.effect_candidates import Candidate, candidates
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, base, foretold, refitted

__all__ = [
    "Model",
    "again",
    "asked",
    "elsewhere",
    "fewer",
    "pruned",
    "together",
    "upheld",
    "weighed",
    "without",
]

_NEEDLESS = 2.0  # nats below which a named effect is taken out again


@dataclass(frozen=True)
class Model:
    """A stage with what stands around it.

    Parameters
    ----------
    where : Dataset
        Recordings as they are; patterns stand on what the stage foretells.
    quiet : Dataset
        The same with quiet wheels.
    stage : FittedModel
        At its mode on quiet wheels.
    found : ScoreTest
        Of everything that may be missing.
    allowed : ModelEvidence
        The stage with a little of everything.
    p : float
        Of the test for a disagreement.
    """

    where: Dataset
    quiet: Dataset
    stage: FittedModel
    found: ScoreTest
    allowed: ModelEvidence
    p: float

    @property
    def as_read(self) -> FittedModel:
        """The stage on recordings as they are, where it has its mode on quiet wheels."""
        return replace(self.stage, target=self.where.target(self.stage.sites))


def again(stage: FittedModel, where: Dataset) -> FittedModel:
    """Fit the model of a stage to its recordings as they are now, or with more behind them."""
    return _to_others(stage, where, stage.sites)


def elsewhere(stage: FittedModel, where: Dataset) -> FittedModel:
    """Fit the model of a stage to other recordings; what acted in one run alone stays there."""
    return _to_others(stage, where, tuple(s for s in stage.sites if s.run is None))


def _to_others(stage: FittedModel, where: Dataset, sites: tuple[Site, ...]) -> FittedModel:
    where = foretold(where, refitted(where, stage, sites))
    return refitted(where, stage, sites)


def asked(where: Dataset, stage: FittedModel, seed: int) -> Model:
    """Ask a stage about everything that may be missing."""
    where, quiet, stage = _quiet(where, stage)
    asked_for = signatures(clear(quiet, stage), candidates(stage, where.vehicle))
    found = with_pushes(asked_for)
    p = family_p(asked_for, seed)
    return Model(where, quiet, stage, found, allowed(stage, found), p)


def together(model: Model, held: Dataset | None) -> tuple[Dataset, FittedModel, ModelEvidence]:
    """Fit a model to its own recordings and to those that were held out.

    Parameters
    ----------
    model : Model
        With everything named.
    held : Dataset or None
        What was held out; without it nothing changes.

    Returns
    -------
    Setting, Stage, Allowed
        All recordings with quiet wheels, the model there, and a little of everything with it.
    """
    own = model.where
    if held is None:
        return model.quiet, model.stage, model.allowed
    where = replace(own, lines=(*own.lines, *held.lines), patterns=(*own.patterns, *held.patterns))
    _, quiet, stage = _quiet(where, again(model.stage, where))
    return quiet, stage, weighed(quiet, stage)


def _quiet(where: Dataset, stage: FittedModel) -> tuple[Dataset, Dataset, FittedModel]:
    """Give recordings as they are and with quiet wheels, and a stage at its mode on those.

    Patterns stand on what it foretells.
    """
    rounds = 2 if any(site.effect.acts == "reading" for site in stage.sites) else 1
    for _ in range(rounds):
        stage = replace(stage, target=where.target(stage.sites))
        where = foretold(where, stage)
    return where, *on_quiet_wheels(where, replace(stage, target=where.target(stage.sites)))


def pruned(model: Model, named: list[Named], seed: int) -> tuple[Model, list[Named]]:
    """Take out what later effects made needless."""
    k = 0
    while len(named) > 1 and k < len(named):
        if _needed(model, (named[k].site,)) < _NEEDLESS:
            model, named = without(model, named, [named[k]], seed)
        else:
            k += 1
    return model, named


def upheld(model: Model, held: Dataset, named: list[Named]) -> bool:
    """Whether held-out recordings uphold effects: less than two nats of their evidence go there.

    Beside the gap, which is louder or less so by chance, it is their likelihood that says whether a
    name is wrong there (predictive evidence; Kass & Raftery 1995, J. Am. Stat. Assoc. 90, 773).

    Parameters
    ----------
    model : Model
        With everything named.
    held : Dataset
        What was held out.
    named : list of Named
        Of those, together.
    """
    quiet, stage, granted = together(model, held)
    own = len(model.where.lines)  # come first
    fit = replace(quiet, lines=quiet.lines[:own], patterns=quiet.patterns[:own])
    alone = refitted(fit, stage, stage.sites)
    sites = tuple(n.site for n in named)
    lost = _needed(replace(model, quiet=fit, stage=alone, allowed=weighed(fit, alone)), sites)
    lost -= _needed(replace(model, quiet=quiet, stage=stage, allowed=granted), sites)
    return not lost > _NEEDLESS


def _needed(model: Model, sites: tuple[Site, ...]) -> float:
    """Nats by which a model explains its very recordings better than without some effects."""
    less = fewer(model, tuple(s for s in model.stage.sites if s not in sites))
    little = _little(model.quiet, less)
    slight = as_slight(sites, model.stage, model.allowed, little)
    behind = max(_weighed(model.quiet, less, little).log_evidence, slight)
    return model.allowed.log_evidence - behind


def weighed(quiet: Dataset, stage: FittedModel) -> ModelEvidence:
    """Weigh a stage with a little of everything that it does not name, on quiet wheels."""
    return _weighed(quiet, stage, _little(quiet, stage))


def _weighed(quiet: Dataset, stage: FittedModel, little: list[Candidate]) -> ModelEvidence:
    return allowed(stage, signatures(clear(quiet, stage), little))


def _little(quiet: Dataset, stage: FittedModel) -> list[Candidate]:
    """List a little of everything that a stage does not name."""
    return [c for c in candidates(stage, quiet.vehicle) if c.tolerance]


def fewer(model: Model, sites: tuple[Site, ...]) -> FittedModel:
    """Fit some of a model's effects to its recordings with quiet wheels."""
    return refitted(model.quiet, model.stage, sites)


def without(
    model: Model, named: list[Named], failed: list[Named], seed: int
) -> tuple[Model, list[Named]]:
    """Take effects out of a model; without any it is the linear car, fitted as at the beginning."""
    kept = [n for n in named if n not in failed]
    if not kept:  # what effects had drawn the car to may be the slope of another hill
        return asked(model.where, base(model.where), seed), kept
    return asked(model.where, fewer(model, tuple(n.site for n in kept)), seed), kept
