"""What c means where the rig's law and that of ``docs/interfaces.md`` are not the same function.

A diagnosis fits F = -k delta - c v (...) in the forms of ``docs/interfaces.md``; the rig moves by
tanh, sinh, softplus and an exponential fading.  Along the fitted runs the written form is fitted
to the rig's force, c and the effect's own parameters free, k as it is.  Where that c is not the
rig's c, either may be called true: an interval is right that reaches the span between them.
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
# what an effect adds to c v, over the rig's c: form(c over the rig's c, own parameters, path)
Form = Callable[[float, Array, "Path"], Array]

_EVERY = 40  # internal steps: the rig's 16 kHz down to 400 Hz


@dataclass(frozen=True)
class Path:
    """Deflection (m), rate (m/s), share of the run and the law's force (N) of one axle, (n,)."""

    delta: Array
    rate: Array
    share: Array
    force: Array


def paths(runs: Sequence[RigRun], seconds: float) -> tuple[Path, Path]:
    """What both axles went through in some runs, which kept their motion."""
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
            rows.append(whole[:, inside][:, ::_EVERY])
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


_GAPS = (0.3, 0.5, 0.7, 0.9)  # of the travel seen, from which a stop is looked for


def _starts(name: str, path: Path) -> list[list[float]]:
    """Where to begin with an effect's own parameters."""
    if name == "digressive_damper":
        return [[1.0 / float(np.abs(path.rate).max())]]
    if name in ("bump_stop", "droop_stop"):
        far = float(-path.delta.min() if name == "bump_stop" else path.delta.max())
        fast = float(np.abs(path.rate).max())
        return [[fast / far, share * far] for share in _GAPS]
    return [[0.0]]


def equivalent(names: Sequence[str], path: Path, c: float, k: float) -> float:
    """Damping rate of the written form that comes nearest to the rig's force, N s/m.

    Parameters
    ----------
    names : sequence of str
        Effects on this axle; those without a form in rate or deflection add nothing.
    path : Path
        Where the fitted runs went.
    c : float
        The rig's own rate, N s/m, to begin from.
    k : float
        Spring rate, N/m, that the written form has as well.

    Returns
    -------
    float
        Least squares along the path.
    """
    # everything in units of the rig's damper, so that all parameters are of order one
    held = -(path.force + k * path.delta) / c
    there = [name for name in names if name in _FORMS]
    lengths = [len(_starts(name, path)[0]) for name in there]
    ends = np.cumsum([1, *lengths])

    def left(p: Array) -> Array:
        value = p[0] * path.rate - held
        for name, begin, end in zip(there, ends, ends[1:], strict=False):
            value = value + _FORMS[name](float(p[0]), p[begin:end], path)
        return np.asarray(value)

    fits = [
        least_squares(left, [1.0, *(v for own in start for v in own)], x_scale="jac", max_nfev=50)
        for start in product(*(_starts(name, path) for name in there))
    ]
    return float(min(fits, key=lambda fit: float(fit.cost)).x[0] * c)
