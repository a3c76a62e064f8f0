"""Packages that only a part of the library needs, imported when that part is used."""

from __future__ import annotations

import importlib
from typing import Any, Final

from bayes_asv.domain.errors import BayesAsvError

__all__ = ["MissingPackageError", "import_extra"]

_EXTRA: Final = "notebook"


class MissingPackageError(BayesAsvError, ImportError):
    """A package that a part of the library needs is not installed; the message says which."""


def import_extra(module: str, purpose: str) -> Any:
    """Import a package of the extra ``notebook``.

    Parameters
    ----------
    module : str
        Its name.
    purpose : str
        What needs it, for the message.

    Raises
    ------
    MissingPackageError
        If it is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as fault:
        raise MissingPackageError(
            f"{purpose} needs {module}: run pip install 'bayes-asv[{_EXTRA}]'", name=module
        ) from fault
