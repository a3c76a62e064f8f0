"""What a finished model could have named in place of each of its effects.

While something else is still missing, it sets explanations apart that the same data cannot tell
apart once it is there: beside dampers that differ in bound and rebound the drift of a wheel's
sensor stood 78 nats behind that of its chassis, and level with it when they had been added.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.classes import APART, same_class
from bayes_asv.diagnosis.clear import clear
from bayes_asv.diagnosis.imitation import imitation
from bayes_asv.diagnosis.model import Model, fewer
from bayes_asv.diagnosis.naming import Option
from bayes_asv.diagnosis.results import Named
from bayes_asv.diagnosis.signatures import signatures
from bayes_asv.diagnosis.tolerance import allowed
from bayes_asv.inference.adding import added
from bayes_asv.inference.candidates import Candidate
from bayes_asv.inference.stage import Stage
from bayes_asv.model.effects import Site

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
    rest = fewer(model, tuple(s for s in model.stage.sites if s not in _own(model, one)))
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
    names = [s.coordinate_name(p) for s in _own(model, one) for p in s.effect.parameters]
    own = np.array([name in names for name in stage.space.names])
    here = found.slopes
    done = stage.mode.z[own] @ here.means[own]
    kept = replace(
        here, means=here.means[~own], scales=here.scales[~own], given_back=here.given_back[~own]
    )
    known = imitation(kept, stage.mode.z[~own], found.feigned)
    _, gram = known.beyond(np.vstack([done, found.rows]))
    across, size = gram[0, 1:], np.diag(gram)[1:]
    left = gram[0, 0] - across**2 / np.maximum(size, 1e-12)
    groups: dict[str, list[Candidate]] = {}
    for k in np.argsort(left):
        candidate = found.candidates[k]
        key = f"{candidate.site} {candidate.site.run}"
        if left[k] < APART and not candidate.edge and not one.site.meets(candidate.site):
            groups.setdefault(key, []).append(candidate)
    return list(groups.values())


def _own(model: Model, one: Named) -> tuple[Site, ...]:
    """Return sites of the model that stand for an effect; each axle may have its own values."""
    return tuple(s for s in model.stage.sites if one.site.meets(s) and s.run == one.site.run)


def _option(model: Model, rest: Stage, group: list[Candidate]) -> Option:
    """Fit and weigh another effect in the place of one."""
    site = group[0].site
    stage = added(model.quiet, rest, group)
    little = [c for c in model.found.candidates if c.tolerance and not site.meets(c.site)]
    return Option(site, stage, allowed(stage, signatures(clear(model.quiet, stage), little)))
