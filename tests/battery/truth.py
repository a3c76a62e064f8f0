"""The answer of a case, and its plain form for a sealed file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from tests.battery.vehicles import Fleet

__all__ = ["TrueEffect", "Truth", "as_plain", "from_plain"]


@dataclass(frozen=True)
class TrueEffect:
    """What is wrong.

    Parameters
    ----------
    name, where : str
        As a diagnosis should say; ``where`` empty where there is no place.
    parameters : dict of str to float
        In the words of ``docs/interfaces.md``, SI; of the front where both axles have it.
    size, tolerance : float
        In the effect's own measure, and what a data sheet leaves open at one deviation (0: none).
    noncentrality : float
        In the runs to be fitted, the effect alone.
    held_out : float
        Whitened distance that the linear car of those runs leaves in the held-out run because of
        it: what a given value has to be bent for is no gap.
    run : int or None
        The fitted run that has it, where it comes once; all runs have it otherwise.
    """

    name: str
    where: str
    parameters: dict[str, float]
    size: float
    tolerance: float
    noncentrality: float
    held_out: float
    run: int | None = None


@dataclass(frozen=True)
class Truth:
    """The answer of a case.

    Parameters
    ----------
    name, seed, number, fleet
        Arguments of :func:`tests.battery.cases.case`.
    kind : str
        ``null``, ``lifting``, ``clutter``, ``single``, ``pair`` or ``outside``.
    modifier : str
        ``clutter``, ``noisier``, ``quieter`` or empty.
    strength : float
        Noncentrality asked for.
    effects : tuple of TrueEffect
        What is wrong.
    car : dict of str to float
        True c_f, c_r, i and given values, SI, without the effects.
    meant : dict of str to (float, float)
        What c_f, c_r and i mean to a diagnosis, lowest and highest: two values where the rig's
        form and that of ``docs/interfaces.md`` are not the same; see :mod:`tests.battery.meaning`.
    terrain, held_out : str
        What the fitted and the held-out run go over.
    family : str
        Of the car.
    noise : float
        Factor on the usual noise of all sensors, declared.
    clipped : int
        Readings at a rail in all runs.
    lifted : bool
        A tyre left the ground in some run.
    """

    name: str
    seed: int
    number: int
    fleet: Fleet
    kind: str
    modifier: str
    strength: float
    effects: tuple[TrueEffect, ...]
    car: dict[str, float]
    meant: dict[str, tuple[float, float]]
    terrain: str
    held_out: str
    family: str
    noise: float
    clipped: int
    lifted: bool


def as_plain(truth: Truth) -> dict[str, Any]:
    """Return a truth as JSON takes it."""
    return asdict(truth)


def from_plain(plain: Mapping[str, Any]) -> Truth:
    """Read what :func:`as_plain` gave, before or after JSON.

    Raises
    ------
    TypeError, KeyError, ValueError
        When it is none.
    """
    effects = tuple(TrueEffect(**one) for one in plain["effects"])
    meant = {key: (float(low), float(high)) for key, (low, high) in plain["meant"].items()}
    return Truth(**{**plain, "effects": effects, "meant": meant})
