"""True faults of a case, and their form in a sealed file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any

from tests.battery.vehicles import Fleet

__all__ = ["TrueEffect", "Truth", "from_dict", "to_dict"]


@dataclass(frozen=True)
class TrueEffect:
    """A fault of a case.

    Parameters
    ----------
    name, where : str
        As a diagnosis should name it; ``where`` is empty if it has no place.
    parameters : dict of str to float
        Named as in ``docs/interfaces.md``, SI; those of the front if both axles have it.
    size, tolerance : float
        Size in the effect's own measure, and one standard deviation of what data sheets allow (0:
        none).
    noncentrality : float
        Of the effect alone, in the fitted runs.
    held_out : float
        Whitened distance that it leaves in the held-out run with the linear car of the fitted runs:
        an error that a given value can take up is none there.
    run : int or None
        The only fitted run with the effect; None if all runs have it.
    spans : dict of str to (float, float)
        Ends of what a parameter may rightly be said to be, where the law of the simulator has
        another form and does not determine it; SI.
    """

    name: str
    where: str
    parameters: dict[str, float]
    size: float
    tolerance: float
    noncentrality: float
    held_out: float
    run: int | None = None
    spans: dict[str, tuple[float, float]] = field(default_factory=dict)

    def span(self, parameter: str) -> tuple[float, float] | None:
        """Return the ends of the true value of a parameter; None if the fault has none."""
        if parameter in self.spans:
            return self.spans[parameter]
        value = self.parameters.get(parameter)
        return None if value is None else (value, value)


@dataclass(frozen=True)
class Truth:
    """Truth of a case.

    Parameters
    ----------
    name, seed, number, fleet
        Arguments of :func:`tests.battery.cases.case`.
    kind : str
        ``null``, ``lifting``, ``clutter``, ``single``, ``pair`` or ``outside``.
    modifier : str
        ``clutter``, ``noisier``, ``quieter`` or empty.
    strength : float
        Intended noncentrality.
    effects : tuple of TrueEffect
        Its faults.
    car : dict of str to float
        True c_f, c_r, i and given values without the effects, SI.
    meant : dict of str to (float, float)
        Spans of the true c_f, c_r and i for a diagnosis: two values where the functional form of
        the rig and that of ``docs/interfaces.md`` differ; see
        :mod:`tests.battery.equivalent_damping`.
    terrain, held_out : str
        Terrain of the fitted and of the held-out runs.
    family : str
        Family of the car.
    noise : float
        Declared noise of all sensors over the usual one.
    clipped : int
        Clipped readings in all runs.
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


def to_dict(truth: Truth) -> dict[str, Any]:
    """Return a truth as a dict for JSON."""
    return asdict(truth)


def from_dict(plain: Mapping[str, Any]) -> Truth:
    """Return the truth of :func:`to_dict`, before or after JSON.

    Raises
    ------
    TypeError, KeyError, ValueError
        If it is invalid.
    """
    effects = tuple(
        TrueEffect(**{**one, "spans": {k: (a, b) for k, (a, b) in one.get("spans", {}).items()}})
        for one in plain["effects"]
    )
    meant = {key: (float(low), float(high)) for key, (low, high) in plain["meant"].items()}
    return Truth(**{**plain, "effects": effects, "meant": meant})
