"""What a finished model could have named in place of each of its effects.

While something else is still missing, it sets explanations apart that the same data cannot tell
apart once it is there: beside dampers that differ in bound and rebound the drift of a wheel's
sensor stood 78 nats behind that of its chassis, and level with it when they had been added.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.indistinguishable import APART, same_class
from bayes_asv.diagnosis.model_comparison import Option
from bayes_asv.diagnosis.model_search import Model, fewer, weighed
from bayes_asv.diagnosis.nuisance_projection import imitation
from bayes_asv.diagnosis.results import Named
from bayes_asv.posterior.effect_candidates import Candidate
from bayes_asv.posterior.effect_fit import added
from bayes_asv.posterior.fitted_model import FittedModel

__all__ = ["alike", "with_twins"]

Array = NDArray[np.float64]

_MOST = 2  # that are fitted for each effect


def with_twins(model: Model, named: tuple[Named, ...]) -> tuple[Named, ...]:
    """List with each effect what these data cannot tell from it next to all others.

    Parameters
    ----------
    model : Model
        With everything named.
    named : tuple of Named
        Two or more; a single one was held against others in the model that it is in.
    """
    if len(named) < 2:
        return named
    return tuple(_with_twins(model, one) for one in named)


def _with_twins(model: Model, one: Named) -> Named:
    groups = alike(model, one)
    if not groups:
        return one
    rest = fewer(model, tuple(s for s in model.stage.sites if s != one.site))
    options = [Option(one.site, model.stage, model.allowed)]
    options += [_option(model, rest, group) for group in groups[:_MOST]]
    known = {str(other.site) for other in one.others}
    found = [o for o in same_class(model.quiet, options)[1:] if str(o.site) not in known]
    return replace(one, others=(*one.others, *found))


def alike(model: Model, one: Named) -> list[list[Candidate]]:
    """Candidates, by site, that do nearly what an effect does: to first order, the nearest first.

    Parameters
    ----------
    model : Model
        With everything named.
    one : Named
        Of those.
    """
    stage, found = model.stage, model.found
    names = [one.site.coordinate_name(p) for p in one.site.effect.parameters]
    own = np.array([name in names for name in stage.space.names])
    here = found.slopes
    done = stage.mode.z[own] @ here.means[own]
    known = imitation(here.only(~own), stage.mode.z[~own], found.feigned)
    _, gram = known.beyond(np.vstack([done, found.rows]))
    across, size = gram[0, 1:], np.diag(gram)[1:]
    left = gram[0, 0] - across**2 / np.maximum(size, 1e-12)
    groups: dict[tuple[str, int | None], list[Candidate]] = {}
    for k in np.argsort(left):
        candidate = found.candidates[k]
        if left[k] < APART and not one.site.meets(candidate.site):
            groups.setdefault(candidate.site.key, []).append(candidate)
    return list(groups.values())


def _option(model: Model, rest: FittedModel, group: list[Candidate]) -> Option:
    """Fit and weigh another effect in the place of one."""
    stage = added(model.quiet, rest, group)
    return Option(group[0].site, stage, weighed(model.quiet, stage))
