"""What stands the proof, and another name for what does not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

from bayes_asv.diagnosis.engine_force import Engine
from bayes_asv.diagnosis.forward_selection import Selection, grow, reconsidered
from bayes_asv.diagnosis.holdout_validation import Recorded, failed, proof
from bayes_asv.diagnosis.misspecification_test import unexplained
from bayes_asv.diagnosis.model_averaging import told_by
from bayes_asv.diagnosis.model_search import Model, pruned, without
from bayes_asv.diagnosis.results import Named
from bayes_asv.diagnosis.simulation_error import Gap

__all__ = ["ValidatedSelection", "proved"]


@dataclass(frozen=True)
class ValidatedSelection:
    """What stood the proof.

    Parameters
    ----------
    grown : Selection
        What was named and did not fail, with its gaps.
    gaps : dict of str to Gap
        Of all of it.
    failed : tuple of str
        Sites that were named and made things worse on what was held out.
    nameless : bool
        Something without a name was found in growing, or when they failed.
    """

    grown: Selection
    gaps: dict[str, Gap]
    failed: tuple[str, ...] = ()
    nameless: bool = False


def proved(
    grown: Selection,
    given: Recorded,
    cut: Recorded,
    engine: Engine | None,
    seed: int,
    tell: Callable[[float, str], None],
) -> ValidatedSelection:
    """Take out what is needless or fails; where something failed, seek another name once.

    What failed stood in for something.  Where that has no name, as growing, slack or decoys have
    found, another would only stand in for it again.

    Parameters
    ----------
    grown : Selection
        What was named.
    given, cut, engine, seed
        As :func:`bayes_asv.diagnosis.holdout_validation.proof` takes them.
    tell : callable
        Told the share that is done, and what is going on.
    """

    def tried(grown: Selection, out: tuple[str, ...] = ()) -> ValidatedSelection:
        grown = _needed(grown, seed)
        other = reconsidered(grown, seed, tell, out)
        if other is not grown:
            grown = _needed(other, seed)
        model, named = grown.model, list(grown.named)
        tell(0.85, "proving it on what was held out")
        gaps, named, silent = proof(given, cut, model, named, engine, seed)
        nameless = bool(grown.nameless)
        while worse := failed(cut.holdout, model, named, silent, seed):
            out += tuple(str(n.site) for n in worse)
            nameless = nameless or unexplained(model.quiet, model.allowed, seed).found
            model, named = without(model, named, worse, seed)
            gaps, named, silent = proof(given, cut, model, named, engine, seed)
        return ValidatedSelection(_left(grown, model, named), gaps, out, nameless)

    found = tried(grown)
    if not found.failed or found.nameless:
        return found
    return tried(grow(found.grown, seed, tell, found.failed), found.failed)


def _needed(grown: Selection, seed: int) -> Selection:
    """Take out what later names made needless."""
    return _left(grown, *pruned(grown.model, list(grown.named), seed))


def _left(grown: Selection, model: Model, named: list[Named]) -> Selection:
    """Return what is left of a growth; with fewer names the model alone tells of the car."""
    fewer = len(named) < len(grown.named)
    told = told_by(model.stage, model.allowed) if fewer else grown.told
    return replace(grown, model=model, named=tuple(named), told=told)
