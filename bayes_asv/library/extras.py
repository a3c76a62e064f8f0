"""Packages that only a part of the library needs, imported when that part is used."""

from __future__ import annotations

import importlib
from typing import Any

from bayes_asv.domain.errors import BayesAsvError

__all__ = ["MissingPackageError", "import_extra"]


class MissingPackageError(BayesAsvError, ImportError):
    """A package that a part of the library needs is not installed; the message says which."""


def import_extra(module: str, purpose: str, extra: str = "notebook") -> Any:
    """Import a package of an extra.

    Parameters
    ----------
    module : str
        Its name.
    purpose : str
        What needs it, for the message.
    extra : str
        Name of the extra.

    Raises
    ------
    MissingPackageError
        If it is not installed; the message says how to install it.
    """
    try:
        return importlib.import_module(module)
    except ImportError as fault:
        raise MissingPackageError(
            f"{purpose} needs {module}: run pip install 'bayes-asv[{extra}]'", name=module
        ) from fault
