"""The document a track is told in: plain data, in the vehicle's units, ready for JSON."""

from __future__ import annotations

import math
import platform
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.report.trace import moments, shown
from bayes_asv.report.track_words import consistency_lines
from bayes_asv.tracking.consistency import LAGS, WINDOW
from bayes_asv.tracking.frames import PARAMETERS
from bayes_asv.tracking.track import Track

__all__ = ["SCHEMA", "track_document"]

Array = NDArray[np.float64]
Document = dict[str, Any]

SCHEMA = "bayes_asv/track/1"

_CURVE = 1500  # points a curve keeps
_NORMAL95 = 1.959964
_PACKAGES = ("numpy", "scipy", "numba", "filterpy")

# Each answer as a product of powers of the car's quantities.
_ANSWERS: dict[str, tuple[float, dict[str, float]]] = {
    "c_f": (0.0, {"c_f": 1.0}),
    "c_r": (0.0, {"c_r": 1.0}),
    "i": (0.0, {"i": 1.0}),
    "k_g": (0.0, {"i": 0.5, "m": -0.5}),
    "zeta_f": (-math.log(2.0), {"c_f": 1.0, "k_f": -0.5, "m": -0.5, "wdf": -0.5}),
    "zeta_r": (-math.log(2.0), {"c_r": 1.0, "k_r": -0.5, "m": -0.5, "1 - wdf": -0.5}),
}


def track_document(result: Track, trace: str | None = None, seed: int = 0) -> Document:
    """Tell a track as plain data.

    Parameters
    ----------
    result : Track
        From :func:`bayes_asv.tracking.track.track`.
    trace : str, optional
        File to which the trace was written.
    seed : int
        As given; the filter draws nothing.

    Returns
    -------
    dict
        Schema ``bayes_asv/track/1``: ``parameters`` at the last row, ``consistency`` and ``trace``
        of the stable interface, and besides ``known``, ``track`` (curves), ``noise`` and
        ``provenance``.
    """
    vehicle = result.vehicle
    answered = result.verdict == "ok"
    document: Document = {
        "schema": SCHEMA,
        "verdict": result.verdict,
        "reasons": list(result.reasons),
        "warnings": list(result.warnings),
        "parameters": {n: _parameter(n, result) for n in _ANSWERS} if answered else {},
        "consistency": _consistency(result),
        "known": {n: _known(n, result) for n in ("m", "l", "wdf", "k_f", "k_r")},
        "track": _track(result) if answered else None,
        "filter": {
            "engine": result.engine,
            "forget_seconds": result.forget,
            "rate": result.rate,
            "rows": result.rows,
            "seconds": max(result.end - result.begin, 0.0),
            "resets": list(result.resets),
        },
        "vehicle": {
            "name": vehicle.name,
            "units": vehicle.units,
            "source": Path(vehicle.source).name,
            "sha256": vehicle.sha256,
        },
        "provenance": {
            "recordings": [{"file": result.source, "sha256": result.sha256}],
            "vehicle": {"file": Path(vehicle.source).name, "sha256": vehicle.sha256},
            "bayes_asv": __version__,
            "python": platform.python_version(),
            "packages": {name: metadata.version(name) for name in _PACKAGES},
            "seed": seed,
        },
        "seconds": result.seconds,
        "version": __version__,
        "seed": seed,
    }
    if trace is not None:
        document["trace"] = trace
    document["consistency"]["words"] = consistency_lines(document)
    cleaned = _clean(document)
    assert isinstance(cleaned, dict)
    return cleaned


def _parameter(name: str, result: Track) -> Document:
    """One answer at the last row, log-normal."""
    vehicle = result.vehicle
    shift, weights = _ANSWERS[name]
    log_mean, log_sd = result.log_of(weights)
    log_mean += shift
    source = getattr(vehicle, name)
    nominal = float(source if isinstance(source, float) else source.value)
    z = (math.log(nominal) - log_mean) / max(log_sd, 1e-300)
    return {
        "label": QUANTITIES[name][1],
        **_summary(name, log_mean, log_sd, nominal, vehicle, vehicle.units),
        "p_below_nominal": 0.5 * math.erfc(-z / math.sqrt(2.0)),
        "si": _summary(name, log_mean, log_sd, nominal, vehicle, "SI"),
    }


def _summary(
    name: str, log_mean: float, log_sd: float, nominal: float, vehicle: Vehicle, units: str
) -> Document:
    mean, sd = moments(log_mean, log_sd)
    low, high = (math.exp(log_mean + side * _NORMAL95 * log_sd) for side in (-1.0, 1.0))
    values = np.array([float(mean), math.exp(log_mean), float(sd), low, high, nominal])
    mean, median, sd, low, high, nominal = shown(values, name, vehicle, units).tolist()
    return {
        "unit": display_units(units)[QUANTITIES[name][0]],
        "mean": mean,
        "median": median,
        "sd": sd,
        "eti95": [low, high],
        "nominal": nominal,
    }


def _known(name: str, result: Track) -> Document:
    """One given value, and what the readings made of it."""
    vehicle, where = result.vehicle, result.coordinates
    given = getattr(vehicle, name)
    value, sd = shown(np.array([given.value, given.sd]), name, vehicle).tolist()
    out: Document = {
        "label": QUANTITIES[name][1],
        "unit": display_units(vehicle.units)[QUANTITIES[name][0]],
        "value": value,
        "sd": sd,
    }
    if name in where.names and result.verdict == "ok":
        k = where.names.index(name)
        middle = where.centre[k] + where.scale[k] * float(result.mean[k])
        width = where.scale[k] * math.sqrt(result.covariance[k, k])
        mean, spread = moments(middle, width) if where.log[k] else (middle, width)
        ends = [middle + side * _NORMAL95 * width for side in (-1.0, 1.0)]
        low, high = np.exp(ends) if where.log[k] else ends
        numbers = shown(np.array([mean, spread, low, high]), name, vehicle).tolist()
        out["posterior"] = {"mean": numbers[0], "sd": numbers[1], "eti95": numbers[2:]}
    return out


def _consistency(result: Track) -> Document:
    found = result.consistency
    n = max(found.readings // 2, 1)
    return {
        "nis_mean": found.nis_mean,
        "nis_band95": list(found.nis_band95),
        "verdict": found.verdict,
        "faults": list(found.faults),
        "readings": found.readings,
        "share_of_time": found.share,
        "largest_noise_level": math.sqrt(found.level),
        "colour": found.colour,
        "autocorrelation": {
            "front": found.correlation[0].tolist(),
            "rear": found.correlation[1].tolist(),
            "band95": _NORMAL95 / math.sqrt(n),
            "lags": LAGS,
            "lag_seconds": 1.0 / result.rate,
        },
        "window_seconds": WINDOW,
    }


def _track(result: Track) -> Document:
    """Curves against time."""
    frames, vehicle = result.frames, result.vehicle
    keep = np.unique(np.linspace(0, len(frames) - 1, _CURVE).astype(int))
    since = np.append(0, keep[:-1] + 1)  # a doubt of a moment between two points is told as well
    out: Document = {"time": _rounded(frames.time[keep] - result.begin), "parameters": {}}
    for k, name in enumerate(PARAMETERS):
        median, sd = frames.median[keep, k], frames.log_sd[keep, k]
        out["parameters"][name] = {
            "unit": display_units(vehicle.units)[QUANTITIES[name][0]],
            "median": _rounded(shown(median, name, vehicle)),
            "band95": [
                _rounded(shown(median * np.exp(side * _NORMAL95 * sd), name, vehicle))
                for side in (-1.0, 1.0)
            ],
        }
    out["nis"] = {
        "mean": _rounded(frames.nis_mean[keep]),
        "band95": [_rounded(frames.nis_low[keep]), _rounded(frames.nis_high[keep])],
    }
    out["inflation"] = _rounded(np.maximum.reduceat(frames.inflation, since))
    out["consistent"] = np.logical_and.reduceat(frames.consistent, since).tolist()
    return out


def _rounded(values: Array) -> list[float | None]:
    """Six significant digits: a curve for the eye need not carry sixteen."""
    return [float(f"{v:.6g}") if math.isfinite(v) else None for v in values]


def _clean(value: Any) -> Any:
    """None for numbers that do not exist, since JSON has no word for them."""
    if isinstance(value, dict):
        return {k: _clean(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_clean(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
