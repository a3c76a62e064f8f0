"""Vehicles and recordings shipped with the package."""

from __future__ import annotations

from pathlib import Path

__all__ = ["shipped"]


def shipped(*parts: str) -> Path:
    """Return the path of a shipped file, in an installed wheel or in a source checkout.

    Parameters
    ----------
    *parts : str
        Path below the data folder, such as ``("vehicles", "baja2008.toml")``.

    Returns
    -------
    Path

    Raises
    ------
    FileNotFoundError
        If the file is not in the installation.
    """
    here = Path(__file__).resolve().parent
    for root in (here / "data", here.parent / "data"):
        path = root.joinpath(*parts)
        if path.exists():
            return path
    raise FileNotFoundError("/".join(("data", *parts)))
