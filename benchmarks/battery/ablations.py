"""Ablations: parts of the diagnosis that are left out, to measure what each contributes.

Each replaces functions or constants of :mod:`bayes_asv.diagnosis` while a case is diagnosed; the
package itself has no switch for it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any, Final
from unittest.mock import patch

import numpy as np

from bayes_asv.diagnosis.misspecification_test import MisspecificationResult
from bayes_asv.diagnosis.unlisted_faults import UnlistedExplanation
from bayes_asv.domain.errors import InputError
from bayes_asv.posterior.fitted_model import Dataset, FittedModel, fit_model

__all__ = ["ABLATIONS", "Ablation", "known", "without"]


@dataclass(frozen=True)
class Ablation:
    """A part of the diagnosis that is left out.

    Parameters
    ----------
    title : str
        On the page.
    replaced : mapping of str to object
        Replacements by ``module.name`` within :mod:`bayes_asv.diagnosis`.
    """

    title: str
    replaced: Mapping[str, Any]


def known(name: str) -> Ablation:
    """Return an ablation by its name.

    Raises
    ------
    InputError
        If there is none of that name.
    """
    if name not in ABLATIONS:
        names = ", ".join(ABLATIONS)
        raise InputError("--ablation", f"there is no part '{name}'", f"name one of {names}")
    return ABLATIONS[name]


@contextmanager
def without(name: str | None) -> Iterator[None]:
    """Leave a part of the diagnosis out within the context; none for None."""
    replaced = known(name).replaced if name else {}
    with ExitStack() as stack:
        for place, replacement in replaced.items():
            stack.enter_context(patch(f"bayes_asv.diagnosis.{place}", replacement))
        yield


def _on_inputs_as_read(dataset: Dataset, model: FittedModel) -> tuple[Dataset, FittedModel]:
    return dataset, fit_model(dataset.posterior(model.placed_effects), model.mode.z)


def _all_explained(*_: Any) -> MisspecificationResult:
    return MisspecificationResult(score=0.0, axle="front", p_whiteness=1.0, excess_noise=())


ABLATIONS: Final[Mapping[str, Ablation]] = {
    "denoising": Ablation(
        "without denoised wheel inputs",
        {"model_assessment.fit_denoised": _on_inputs_as_read},
    ),
    "tolerances": Ablation(
        "without the tolerance prior",
        {"tolerance_prior.TOLERANCE_SCALES": np.zeros(3)},
    ),
    "unlisted_faults": Ablation(
        "without tests for unlisted faults",
        {
            "workflow.misspecification_tests": _all_explained,
            "holdout_validation.misspecification_tests": _all_explained,
            "workflow.best_alternative": lambda *_: (-np.inf, ""),
            "forward_selection.best_unlisted_explanation": (
                lambda *_: UnlistedExplanation(-np.inf, "")
            ),
        },
    ),
    "holdout": Ablation(
        "without removing effects that fail on held-out runs",
        {"holdout_validation.failed_effects": lambda *_: []},
    ),
}
