"""Find, name, add, prove: the workflow from recordings to what was missing.

1. Pre-flight, and a fit of the linear half car with noise levels near what is given.
2. An engine's tones are recognised by their lines and cut out; where they may be another fault's,
   only once that has a name.
3. Is there a disagreement?  One test over all candidates.
4. Names with probabilities; the best is added, everything is fitted again, and so on until nothing
   is gained; what turned out needless is taken out again.
5. The gap on recordings that the fit has not seen, with everything frozen; a name that makes it
   worse goes, and another is sought in its place.
6. Slack models ask, of all recordings together, whether something without a name is left.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.alternative_comparison import rival
from bayes_asv.diagnosis.engine_force import without_engine
from bayes_asv.diagnosis.equivalent_models import with_twins
from bayes_asv.diagnosis.forward_selection import begun, grow
from bayes_asv.diagnosis.holdout_validation import Recorded
from bayes_asv.diagnosis.localization import disagreement
from bayes_asv.diagnosis.max_score_test import one_sided
from bayes_asv.diagnosis.misspecification_test import unexplained
from bayes_asv.diagnosis.model_averaging import draws, effect_draws
from bayes_asv.diagnosis.model_search import Model, again, asked, elsewhere, together
from bayes_asv.diagnosis.recording_faults import found_before
from bayes_asv.diagnosis.results import Diagnosis, Named
from bayes_asv.diagnosis.thresholds import AS_WELL, LEVEL
from bayes_asv.diagnosis.validated_selection import proved
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.effects import Site
from bayes_asv.posterior.fitted_model import base, setting
from bayes_asv.posterior.map_fit import lay_out

__all__ = ["Diagnosis", "Named", "diagnose", "named_in"]

Array = NDArray[np.float64]
Progress = Callable[[float, str], None]

# A car that is missing something has lines in its innovations as well, near its own frequencies or
# those of a washboard.  An engine alone gives candidates little (8 of noncentrality 400 and 4000: a
# squared score of 23 at most): where tones hold less than ten times the best one's, that is first.
_CLEARLY = 10.0
_RESIDUE = 0.03  # of the best before names, that tones hold after them: forms are only near
_EXCITED = 0.3  # of a recording's wheel power that its held-out half must have


def diagnose(
    recordings: Sequence[Recording],
    holdout: Sequence[Recording],
    vehicle: Vehicle,
    seed: int = 0,
    progress: Progress | None = None,
) -> Diagnosis:
    """Find where simulation and measurement disagree, and what is missing.

    Parameters
    ----------
    recordings : sequence of Recording
        Runs to fit.
    holdout : sequence of Recording
        Runs to prove it on; without any a part of the others is held out.
    vehicle : Vehicle
        As given.
    seed : int
        Of everything that is drawn.
    progress : callable, optional
        Told the share that is done, and what is going on.

    Returns
    -------
    Diagnosis
    """
    clock = time.perf_counter()
    tell = progress or (lambda share, words: None)
    tell(0.0, "laying the recordings out")
    fit_runs, held_runs, notes = _held_out(recordings, holdout, vehicle)
    lines, reasons, warnings = lay_out(fit_runs, vehicle)
    if reasons:
        return Diagnosis("refused", reasons, warnings, (), vehicle, seed)
    held, why_not, _ = lay_out(held_runs, vehicle) if held_runs else ((), (), ())
    if why_not:
        notes.append("the held-out recordings cannot be used: " + "; ".join(why_not))
        held = ()
    tell(0.05, "fitting the linear half car")
    where = setting(vehicle, lines)
    plain = linear = base(where)
    first_where, first_held = where, setting(vehicle, held) if held else None
    first = asked(where, plain, seed)
    known = _explained(first)
    where, linear, engine, held = without_engine(where, plain, held, base, base, _CLEARLY * known)
    if engine is not None:
        first = asked(where, linear, seed)
    grown = grow(begun(first, beside=engine is not None), seed, tell)
    if engine is None:
        # What is missing may have hidden an engine.
        model = grown.model
        known = max(_explained(model), _RESIDUE * known)
        fits = partial(again, model.stage), partial(elsewhere, model.stage)
        silent, stage, engine, held = without_engine(model.where, model.as_read, held, *fits, known)
        if engine is not None:
            where = silent
            linear = base(where)
            model = asked(where, stage, seed)
            grown = grow(replace(grown, model=model, beside=True), seed, tell)
    seen = disagreement(where, linear)
    held_where = first_held if engine is None or not held else setting(vehicle, held)
    given = Recorded(first_where, first_held, plain)
    proven = proved(grown, given, Recorded(where, held_where, linear), engine, seed, tell)
    grown, model, named = proven.grown, proven.grown.model, proven.grown.named
    tell(0.9, "asking what has no name")
    quiet, stage, granted = together(model, held_where)
    left = unexplained(quiet, granted, seed)
    left = replace(left, failed=proven.failed, ended=grown.nameless)
    if named and not left.present:
        better, words = rival(quiet, stage, len(named), first.found.sites)
        left = replace(left, rival=better, like=words if better > AS_WELL else left.like)
    tell(0.95, "asking what else it may have been")
    named = with_twins(model, named)
    disagrees = first.p < LEVEL or left.present or engine is not None
    verdict = "agreement"
    if disagrees:
        verdict = "named" if named or engine is not None else "unexplained"
    return Diagnosis(
        verdict=verdict,
        reasons=(),
        warnings=(*warnings, *notes),
        preflight=found_before(lines),
        vehicle=vehicle,
        seed=seed,
        p=first.p,
        named=named,
        engine=engine,
        none=grown.none,
        left=left,
        seen=seen,
        gaps=proven.gaps,
        fit=lines,
        holdout=held,
        base=linear,
        final=model.as_read,
        before=draws([(1.0, plain, plain.mode.z, plain.mode.covariance)], seed),
        after=draws(grown.told, seed),
        effects=effect_draws(model.stage, model.allowed, seed),
        seconds=time.perf_counter() - clock,
    )


def _explained(model: Model) -> float:
    """Energy of innovations that the best candidate explains, or a little of everything."""
    little = model.allowed.by_amount
    best = float(one_sided(model.found.score, model.found).max())
    return max(best, 2.0 * float(little.max() - little[0]))


def named_in(
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[Site, ...]:
    """Effects that are more likely than not to be in these recordings."""
    found = diagnose(recordings, (), vehicle, seed, progress)
    return tuple(n.site for n in found.named if found.believed(n) > 0.5)


def _held_out(
    recordings: Sequence[Recording], holdout: Sequence[Recording], vehicle: Vehicle
) -> tuple[list[Recording], list[Recording], list[str]]:
    """Choose what is fitted and what is held out."""
    if holdout:
        return list(recordings), list(holdout), []
    if len(recordings) > 1:
        last = recordings[-1]
        return list(recordings[:-1]), [last], [f"{last.source} was held out to prove it on"]
    whole = recordings[0]
    name = whole.source or "the recording"
    half = len(whole.time) // 2
    begin, end = (
        replace(whole, time=whole.time[part], values=whole.values[:, part])
        for part in (slice(0, half), slice(half, None))
    )
    power = [float(np.nanvar(part.values[[0, 2]], axis=1).sum()) for part in (begin, end)]
    usable = half >= 200 and not any(lay_out([part], vehicle)[1] for part in (begin, end))
    if power[1] > _EXCITED * power[0] and usable:
        return [begin], [end], [f"the second half of {name} was held out to prove it on"]
    return [whole], [], [f"nothing of {name} could be held out: give a second drive"]
