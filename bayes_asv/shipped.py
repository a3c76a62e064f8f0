"""Vehicles and recordings that travel with the package."""

from __future__ import annotations

from pathlib import Path

__all__ = ["shipped"]


def shipped(*parts: str) -> Path:
    """Path of a shipped file, inside an installed wheel or in a source checkout.

    Parameters
    ----------
    *parts : str
        Below the data folder, such as ``("vehicles", "baja2008.toml")``.

    Returns
    -------
    Path

    Raises
    ------
    FileNotFoundError
        When the package was taken apart.
    """
    here = Path(__file__).resolve().parent
    for root in (here / "data", here.parent / "data"):
        path = root.joinpath(*parts)
        if path.exists():
            return path
    raise FileNotFoundError("/".join(("data", *parts)))
