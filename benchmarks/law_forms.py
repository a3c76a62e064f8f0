"""How much the parameters of a law change with the formula that nature chose.

A damper that flattens out, dry friction or a stop has no formula, but its reported parameters are
those of one.  Here the laws of the package are fitted to laws of other forms with the same meaning,
over random motion, and the spread of fitted over true value is the standard deviation by which a
report widens the interval of that parameter.  ``python -m benchmarks.law_forms`` writes
``benchmarks/results/law_forms.json``; a test holds the effects' constants against it.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from bayes_asv.models.effects import EFFECTS
from bayes_asv.models.effects.base import Scale
from benchmarks.provenance import current_commit, keep

__all__ = ["FORMS", "main", "spreads"]

Array = NDArray[np.float64]
Law = Callable[[Array, Array, Array], Array]

RESULTS = Path(__file__).parent / "results" / "law_forms.json"
RUNS = 300
_POINTS = 400  # instants of a motion
_RESOLUTION = 0.01  # of a force, over its root mean square
_SCALE = Scale(load=700.0, spring=18000.0)
_C, _K = 1500.0, 18000.0
_TRAVEL, _SPEED = 0.02, 0.15  # root mean squares of deflection (m) and rate (m/s)


class Motion(NamedTuple):
    """Deflection (m), its rate (m/s) and time over that of the run, each (N,)."""

    delta: Array
    rate: Array
    share: Array


class Form(NamedTuple):
    """A law of another form: its force (N,), and its parameters in the meaning of the effect."""

    force: Array
    values: Mapping[str, float]


def _motion(rng: np.random.Generator) -> Motion:
    size = np.exp(rng.uniform(np.log(0.5), np.log(2.0), 2))
    delta, rate = (
        scale * factor * rng.standard_normal(_POINTS)
        for scale, factor in zip((_TRAVEL, _SPEED), size, strict=True)
    )
    return Motion(delta, rate, np.sort(rng.uniform(0.0, 1.0, _POINTS)))


def _uniform_log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _unequal_sides(rng: np.random.Generator, at: Motion) -> Form:
    """Draw two slopes with a sharp or a soft transition, or sides that part as a hyperbola."""
    ratio = _uniform_log(rng, 1.2, 3.0) ** rng.choice([-1.0, 1.0])
    share, width = (ratio - 1.0) / (ratio + 1.0), _uniform_log(rng, 0.003, 0.05)
    x = at.rate / width
    more = [
        np.abs(x), x * np.tanh(x), np.abs(x) * -np.expm1(-np.abs(x)), np.hypot(x, 1.0) - 1.0
    ][rng.integers(4)]  # fmt: skip
    return Form(-_C * (at.rate + share * width * more), {"ratio": float(ratio)})


def _flattening(rng: np.random.Generator, at: Motion) -> Form:
    """Draw a hyperbolic tangent, an arc tangent, a square root, or an exponential, and a slope."""
    knee = float(np.std(at.rate)) * _uniform_log(rng, 0.5, 3.0)
    x = at.rate / knee
    bent = [
        np.tanh(x),
        (2.0 / np.pi) * np.arctan(0.5 * np.pi * x),
        x / np.sqrt(1.0 + x**2),
        np.sign(x) * -np.expm1(-np.abs(x)),
    ][rng.integers(4)]
    lost = rng.uniform(0.3, 1.0)
    return Form(-_C * ((1.0 - lost) * at.rate + lost * knee * bent), {"knee": knee})


def _friction(rng: np.random.Generator, at: Motion) -> Form:
    """Draw sharp, hyperbolic-tangent or arc-tangent friction, or a Stribeck curve."""
    force = _SCALE.load * _uniform_log(rng, 0.02, 0.15)
    x = at.rate / _uniform_log(rng, 0.002, 0.02)
    shape = [
        np.sign(x),
        np.tanh(x),
        (2.0 / np.pi) * np.arctan(0.5 * np.pi * x),
        np.tanh(x) * (1.0 + rng.uniform(0.1, 0.4) * np.exp(-((at.rate / 0.03) ** 2))),
    ][rng.integers(4)]
    return Form(-_C * at.rate - force * shape, {"force": force})


def _stiffening(rng: np.random.Generator, at: Motion) -> Form:
    """Draw a cubic, a hyperbolic sine, a tangent, or a spring that goes solid."""
    kappa = _uniform_log(rng, 0.05, 0.6) / float(np.max(np.abs(at.delta))) ** 2
    x = at.delta
    root = np.sqrt(kappa)
    shape = [
        x * (1.0 + kappa * x**2),
        np.sinh(np.sqrt(6.0) * root * x) / (np.sqrt(6.0) * root),
        np.tan(np.clip(np.sqrt(3.0) * root * x, -1.4, 1.4)) / (np.sqrt(3.0) * root),
        x / (1.0 - np.clip(kappa * x**2, 0.0, 0.8)),
    ][rng.integers(4)]
    return Form(-_K * shape, {"kappa": float(kappa)})


def _stop(sign: float) -> Callable[[np.random.Generator, Motion], Form]:
    def form(rng: np.random.Generator, at: Motion) -> Form:
        """Draw a corner, a soft corner, a square, or rubber of the exponent 1.5, beyond a gap."""
        deepest = float(np.max(sign * at.delta))
        gap = deepest * rng.uniform(0.4, 0.9)
        rate = _SCALE.spring * _uniform_log(rng, 2.0, 12.0)
        beyond = sign * at.delta - gap
        deep = np.maximum(beyond, 0.0)
        soft = _uniform_log(rng, 0.0003, 0.003)
        most = deepest - gap
        kind = rng.integers(4)
        shape = [
            deep,
            soft * np.logaddexp(0.0, beyond / soft),
            deep**2 / (2.0 * most),
            deep * np.sqrt(deep / most) / 1.5,
        ][kind]
        single = {"rate": rate} if kind < 2 else {}  # the others have no single rate
        return Form(-_K * at.delta - sign * rate * shape, {"gap": gap, **single})

    return form


def _fading(rng: np.random.Generator, at: Motion) -> Form:
    """Draw a loss that is linear in time, saturates, speeds up, or grows as a logarithm."""
    loss, s = _uniform_log(rng, 0.05, 0.5), at.share
    bend = rng.uniform(0.5, 3.0)
    course = [
        s,
        np.expm1(-bend * s) / np.expm1(-bend),
        s**1.5,
        np.sin(0.5 * np.pi * s),
        np.log1p(bend * s) / np.log1p(bend),
    ][rng.integers(5)]
    return Form(-_C * at.rate * (1.0 - loss * course), {"loss": loss})


FORMS: dict[str, Callable[[np.random.Generator, Motion], Form]] = {
    "bound_rebound": _unequal_sides,
    "digressive_damper": _flattening,
    "coulomb_friction": _friction,
    "progressive_spring": _stiffening,
    "bump_stop": _stop(-1.0),
    "droop_stop": _stop(1.0),
    "damper_fade": _fading,
}


def _fitted(name: str, at: Motion, wanted: Form) -> dict[str, float]:
    """Parameters of the package's law, fitted to a law of another form."""
    effect = EFFECTS[name]
    force = effect.force
    assert force is not None
    on_spring = effect.on_spring or bool(effect.stops)
    resolution = _RESOLUTION * float(np.std(wanted.force))

    def values(z: Array) -> dict[str, float]:
        pairs = zip(effect.parameters, z[1:], strict=True)
        return {p.name: float(p.value(np.asarray(x), _SCALE)) for p, x in pairs}

    def residual(z: Array) -> Array:
        c, k = _C * np.exp(0.3 * z[0] * (not on_spring)), _K * np.exp(0.05 * z[0] * on_spring)
        linear = -k * at.delta if on_spring else -c * at.rate
        own = linear + force(values(z), c, k, at.delta, at.rate, at.share)
        return np.concatenate([(own - wanted.force) / resolution, z])

    starts = []
    for shape in (-1.0, 0.0, 1.0):
        start = np.full(1 + len(effect.parameters), shape)
        start[0] = 0.0
        for k, p in enumerate(effect.parameters, 1):
            if p.name in wanted.values:
                start[k] = p.coordinate(wanted.values[p.name], _SCALE)
        starts.append(least_squares(residual, start, x_scale="jac"))
    return values(min(starts, key=lambda fit: float(fit.cost)).x)


def spreads(runs: int = RUNS, seed: int = 1) -> dict[str, dict[str, float]]:
    """Return the spread of fitted over true value, as a standard deviation of the logarithm.

    For a ratio, which is one without the effect, value means its logarithm.

    Parameters
    ----------
    runs : int
        Laws of another form for each effect.
    seed : int
        Seed of laws and motions.

    Returns
    -------
    dict of str to dict of str to float
        By effect and parameter: the 95 % quantile of ``|ln(fitted/true)|`` over 1.96.
    """
    out: dict[str, dict[str, float]] = {}
    for place, (name, form) in enumerate(FORMS.items()):
        ratios: dict[str, list[float]] = {}
        for run in range(runs):
            rng = np.random.default_rng([seed, place, run])
            at = _motion(rng)
            wanted = form(rng, at)
            found = _fitted(name, at, wanted)
            for p in EFFECTS[name].parameters:
                if p.name in wanted.values:
                    here, there = found[p.name], wanted.values[p.name]
                    if p.is_ratio:
                        here, there = np.log(here), np.log(there)
                    ratios.setdefault(p.name, []).append(float(np.log(max(here / there, 1e-9))))
        out[name] = {
            key: float(np.quantile(np.abs(logs), 0.95)) / 1.96 for key, logs in ratios.items()
        }
    return out


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return the exit status."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.law_forms", description=__doc__)
    parser.add_argument("--runs", type=int, default=RUNS)
    given = parser.parse_args(arguments)
    found = spreads(given.runs)
    keep(RESULTS, {"commit": current_commit(), "seed": 1, "runs": given.runs, "spreads": found})
    for name, parameters in found.items():
        print(name, {key: round(value, 3) for key, value in parameters.items()})
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
