"""Parts that the diagnosis can be asked to do without, to see what each of them is good for.

Each stands in place of one function or number of :mod:`bayes_asv.diagnosis` while a case is
diagnosed; the package itself knows nothing of it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any, Final
from unittest.mock import patch

import numpy as np

from bayes_asv.diagnosis.misspecification_test import Unexplained
from bayes_asv.diagnosis.unlisted_faults_test import Nameless
from bayes_asv.domain.errors import InputError
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, fitted

__all__ = ["ABLATIONS", "Ablation", "known", "without"]


@dataclass(frozen=True)
class Ablation:
    """What is done without.

    Parameters
    ----------
    title : str
        In the page.
    replaced : mapping of str to object
        What stands there instead, by ``module.name`` below :mod:`bayes_asv.diagnosis`.
    """

    title: str
    replaced: Mapping[str, Any]


def known(name: str) -> Ablation:
    """Find a part that can be left out.

    Raises
    ------
    InputError
        When there is no such part.
    """
    if name not in ABLATIONS:
        names = ", ".join(ABLATIONS)
        raise InputError("--ablation", f"there is no part '{name}'", f"name one of {names}")
    return ABLATIONS[name]


@contextmanager
def without(name: str | None) -> Iterator[None]:
    """Diagnose without a part as long as this lasts; with all of them for None."""
    replaced = known(name).replaced if name else {}
    with ExitStack() as stack:
        for place, instead in replaced.items():
            stack.enter_context(patch(f"bayes_asv.diagnosis.{place}", instead))
        yield


def _on_wheels_as_read(where: Dataset, stage: FittedModel) -> tuple[Dataset, FittedModel]:
    return where, fitted(where.target(stage.sites), stage.mode.z)


def _all_explained(*_: Any) -> Unexplained:
    return Unexplained(score=0.0, axle="front", p_memory=1.0, swollen=())


ABLATIONS: Final[Mapping[str, Ablation]] = {
    "quiet_wheels": Ablation(
        "wheels as they are read",
        {"model.on_quiet_wheels": _on_wheels_as_read},
    ),
    "tolerances": Ablation(
        "nothing of everything else allowed for",
        {"tolerance.AMOUNTS": np.zeros(3)},
    ),
    "slack": Ablation(
        "not asked whether something has no name",
        {
            "workflow.unexplained": _all_explained,
            "proved.unexplained": _all_explained,
            "workflow.rival": lambda *_: (-np.inf, ""),
            "growing.without_a_name": lambda *_: Nameless(-np.inf, ""),
        },
    ),
    "held_out": Ablation(
        "names kept that make held-out runs worse",
        {"proved.failed": lambda *_: []},
    ),
}
