"""The named model on all recordings together, those that were held out among them.

What was named was proved on held-out recordings with everything frozen.  Whether something without
a name is left is asked of all that there is: a name that stands in for another thing follows it in
the recordings that it was found in, and less so in others.
"""

from __future__ import annotations

from dataclasses import replace

from bayes_asv.diagnosis.clear import clear, on_quiet_wheels
from bayes_asv.diagnosis.model import Model, again
from bayes_asv.diagnosis.signatures import signatures
from bayes_asv.diagnosis.tolerance import allowed
from bayes_asv.inference.candidates import candidates
from bayes_asv.inference.stage import Setting, foretold

__all__ = ["together"]


def together(model: Model, held: Setting | None) -> Model:
    """Fit a model to its own recordings and to those that were held out.

    Parameters
    ----------
    model : Model
        With everything named.
    held : Setting or None
        What was held out; without it the model stays what it is.
    """
    if held is None:
        return model
    own = model.where
    where = replace(own, lines=(*own.lines, *held.lines), patterns=(*own.patterns, *held.patterns))
    stage = again(model.stage, where)
    where = foretold(where, stage)
    quiet, stage = on_quiet_wheels(where, stage)
    little = [c for c in candidates(stage, where.vehicle) if c.tolerance]
    found = signatures(clear(quiet, stage), little)
    return Model(where, quiet, stage, found, allowed(stage, found), model.p)
