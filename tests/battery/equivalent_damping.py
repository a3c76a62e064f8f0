"""Equivalent damping rate where the rig's force law and that of ``docs/interfaces.md`` differ.

A diagnosis fits F = -k delta - c v (...) in the forms of ``docs/interfaces.md``; the rig uses tanh,
sinh, softplus and exponential fading.  Along the fitted runs the form of ``docs/interfaces.md`` is
fitted to the rig's force, with c and the effect's own parameters free and k given.  Where that c
differs from the rig's, either may be called true: an interval is correct if it overlaps the span
between them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from tests.rig import RigRun

__all__ = ["Path", "equivalent", "paths"]

Array = NDArray[np.float64]
# from c over the rig's c, own parameters and path to the force beyond c v, over the rig's c
Form = Callable[[float, Array, "Path"], Array]

_DECIMATION = 40  # from the rig's 16 kHz to 400 Hz


@dataclass(frozen=True)
class Path:
    """Deflection (m), velocity (m/s), share of the run and force (N) of one axle, (n,)."""

    delta: Array
    rate: Array
    share: Array
    force: Array


def paths(runs: Sequence[RigRun], seconds: float) -> tuple[Path, Path]:
    """Return the paths of both axles over runs that kept their motion."""
    out = []
    for axle in range(2):
        rows: list[Array] = []
        for run in runs:
            assert run.motion is not None
            m = run.motion
            inside = (m.time >= 0.0) & (m.time <= seconds)
            whole = np.stack(
                [
                    m.deflection[axle],
                    m.deflection_rate[axle],
                    m.time / seconds,
                    m.suspension_force[axle],
                ]
            )
            rows.append(whole[:, inside][:, ::_DECIMATION])
        out.append(Path(*np.hstack(rows)))
    return out[0], out[1]


def _bound_rebound(c: float, p: Array, path: Path) -> Array:
    return np.asarray(p[0] * np.abs(path.rate))


def _digressive(c: float, p: Array, path: Path) -> Array:
    v = path.rate
    return np.asarray(c * v * (1.0 / np.sqrt(1.0 + (p[0] * v) ** 2) - 1.0))


def _coulomb(c: float, p: Array, path: Path) -> Array:
    return np.asarray(p[0] * np.sign(path.rate))


def _fade(c: float, p: Array, path: Path) -> Array:
    return np.asarray(-c * p[0] * path.share * path.rate)


def _cubic(c: float, p: Array, path: Path) -> Array:
    return np.asarray(p[0] * path.delta**3)


def _stop(sign: float) -> Form:
    def form(c: float, p: Array, path: Path) -> Array:
        beyond = np.maximum(sign * path.delta - abs(p[1]), 0.0)
        return np.asarray(sign * p[0] * beyond)

    return form


_FORMS: dict[str, Form] = {
    "bound_rebound": _bound_rebound,
    "digressive_damper": _digressive,
    "coulomb_friction": _coulomb,
    "damper_fade": _fade,
    "progressive_spring": _cubic,
    "bump_stop": _stop(-1.0),
    "droop_stop": _stop(1.0),
}


_GAPS = (0.3, 0.5, 0.7, 0.9)  # starting values of a stop's gap, over the travel in use


def _starts(name: str, path: Path) -> list[list[float]]:
    """Return starting values of an effect's own parameters."""
    if name == "digressive_damper":
        return [[1.0 / float(np.abs(path.rate).max())]]
    if name in ("bump_stop", "droop_stop"):
        far = float(-path.delta.min() if name == "bump_stop" else path.delta.max())
        fast = float(np.abs(path.rate).max())
        return [[fast / far, share * far] for share in _GAPS]
    return [[0.0]]


def equivalent(names: Sequence[str], path: Path, c: float, k: float) -> float:
    """Least-squares damping rate of the form of ``docs/interfaces.md`` for the rig's force, N s/m.

    Parameters
    ----------
    names : sequence of str
        Effects on this axle; those without a form in velocity or deflection add nothing.
    path : Path
        Of the fitted runs.
    c : float
        The rig's own rate, N s/m, as the starting value.
    k : float
        Spring rate, N/m, of both forms.

    Returns
    -------
    float
        Along the path.
    """
    # in units of the rig's damper, so that all parameters are of order one
    target = -(path.force + k * path.delta) / c
    known = [name for name in names if name in _FORMS]
    lengths = [len(_starts(name, path)[0]) for name in known]
    ends = np.cumsum([1, *lengths])

    def residual(p: Array) -> Array:
        value = p[0] * path.rate - target
        for name, begin, end in zip(known, ends, ends[1:], strict=False):
            value = value + _FORMS[name](float(p[0]), p[begin:end], path)
        return np.asarray(value)

    fits = [
        least_squares(
            residual, [1.0, *(v for own in start for v in own)], x_scale="jac", max_nfev=50
        )
        for start in product(*(_starts(name, path) for name in known))
    ]
    return float(min(fits, key=lambda fit: float(fit.cost)).x[0] * c)
