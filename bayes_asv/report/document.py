"""The document an estimate is told in: plain data, in the vehicle's units, ready for JSON.

It is what ``--json`` writes and all that a report reads, so a report can be made again from
the file without sampling again.
"""

from __future__ import annotations

import math
import platform
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.estimation import ANSWERS, DERIVED, Estimate, RunFit
from bayes_asv.posterior.parameters import CAR
from bayes_asv.posterior.residual_ar import portmanteau
from bayes_asv.report.budget_document import width_document
from bayes_asv.report.consistency_document import agreement_document, checks_document
from bayes_asv.report.effect_document import effects_document

__all__ = ["SCHEMA", "estimate_document", "parameter_document"]

Array = NDArray[np.float64]
Document = dict[str, Any]

SCHEMA = "bayes_asv/estimate/1"

_CURVE = 1500  # points a curve keeps
_DRAWS = 1000  # draws a parameter keeps
_LAGS = 20

_PACKAGES = ("numpy", "scipy", "emcee", "numba", "arviz")


def estimate_document(result: Estimate) -> Document:
    """Tell an estimate as plain data.

    Parameters
    ----------
    result : Estimate
        From :func:`bayes_asv.estimation.estimate`.

    Returns
    -------
    dict
        Schema ``bayes_asv/estimate/1``: ``parameters``, ``diagnostics``, ``fit`` and the rest
        of the stable interface, and besides ``known``, ``width``, ``agreement``, ``noise``,
        ``runs`` (curves and checks), ``draws`` and ``provenance``. Numbers that do not exist are
        None.
    """
    vehicle = result.vehicle
    names = [n for n in (*ANSWERS, *DERIVED) if n in result.draws]
    document: Document = {
        "schema": SCHEMA,
        "verdict": result.verdict,
        "reasons": list(result.reasons),
        "warnings": list(result.warnings),
        "parameters": {n: parameter_document(n, result.draws[n], vehicle) for n in names},
        "known": {n: _known(n, result, vehicle) for n in ("m", "l", "wdf", "k_f", "k_r")},
        "prior": {n: _prior(n, result, vehicle) for n in ("c_f", "c_r", "i")} if names else {},
        "diagnostics": {
            "rhat_max": result.rhat_max,
            "ess_bulk_min": result.ess_bulk_min,
            "ess_tail_min": result.ess_tail_min,
            "acceptance": result.acceptance,
            "draws": result.count,
            "likelihood": result.likelihood,
            "band": None if result.below is None else [0.0, result.below],
            "sampler": "ensembles"
            if result.agreement is None or result.agreement.verdict != "disagree"
            else "random effects",
        },
        "width": None
        if result.width is None
        else width_document(result.width, result.draws, vehicle),
        "agreement": agreement_document(result),
        "effects": effects_document(result.effects, vehicle),
        "fit": _pooled_fit(result.runs),
        "fit_by_run": [{"source": r.line.source, **_pooled_fit((r,))} for r in result.runs],
        "noise": _noise(result, vehicle),
        "runs": [_run(r, vehicle) for r in result.runs],
        "draws": {n: _thinned(x, n, vehicle) for n, x in result.draws.items()},
        "vehicle": _vehicle(vehicle),
        "provenance": _provenance(result),
        "seconds": result.seconds,
        "version": __version__,
        "seed": result.seed,
    }
    cleaned = _clean(document)
    assert isinstance(cleaned, dict)
    return cleaned


def _unit(name: str, vehicle: Vehicle) -> str:
    return display_units(vehicle.units)[QUANTITIES[name][0]]


def _shown(value: Array | float, dimension: str, vehicle: Vehicle) -> Any:
    """Convert from SI to the vehicle's units."""
    unit = display_units(vehicle.units)[dimension]
    factor = from_si(1.0, unit, dimension)
    return value * factor


def _summary(draws: Array) -> Document:
    x = draws.ravel()
    low, median, high = np.quantile(x, [0.025, 0.5, 0.975])
    return {
        "mean": float(x.mean()),
        "median": float(median),
        "sd": float(x.std(ddof=1)),
        "eti95": [float(low), float(high)],
    }


def parameter_document(name: str, draws: Array, vehicle: Vehicle) -> Document:
    """Summarise the draws (N,) of one quantity, SI units, in the vehicle's units."""
    dimension, words = QUANTITIES[name]
    source = getattr(vehicle, name)
    nominal = float(source if isinstance(source, float) else source.value)
    return {
        "label": words,
        "unit": _unit(name, vehicle),
        **_summary(_shown(draws, dimension, vehicle)),
        "nominal": float(_shown(nominal, dimension, vehicle)),
        "p_below_nominal": float(np.mean(draws < nominal)),
        "si": {
            "unit": display_units("SI")[dimension],
            **_summary(draws),
            "nominal": nominal,
        },
    }


def _known(name: str, result: Estimate, vehicle: Vehicle) -> Document:
    dimension, words = QUANTITIES[name]
    given = getattr(vehicle, name)
    out: Document = {
        "label": words,
        "unit": _unit(name, vehicle),
        "value": float(_shown(given.value, dimension, vehicle)),
        "sd": float(_shown(given.sd, dimension, vehicle)),
    }
    if name in result.draws:
        out["posterior"] = _summary(_shown(result.draws[name], dimension, vehicle))
    return out


def _prior(name: str, result: Estimate, vehicle: Vehicle) -> Document:
    """Log-normal prior: median, factor at one deviation, 95 % interval."""
    assert result.space is not None
    mean, sd = result.space.log_prior_of(name)
    dimension = QUANTITIES[name][0]

    def at(z: float) -> float:
        return float(_shown(math.exp(mean + z * sd), dimension, vehicle))

    return {
        "kind": "log-normal",
        "median": at(0.0),
        "factor": math.exp(sd),
        "log_sd": sd,
        "eti95": [at(-1.959964), at(1.959964)],
    }


def _pooled_fit(runs: tuple[RunFit, ...]) -> Document:
    """Free-running simulation against measurement, pooled over runs."""
    out: Document = {}
    for axle, name in ((0, "front_chassis"), (1, "rear_chassis")):
        error, power = 0.0, 0.0
        for run in runs:
            use = run.line.kind[:, axle] == 1
            y = run.line.reading[use, axle]
            error += float(np.sum((y - run.free.output[use, axle]) ** 2))
            power += float(np.sum((y - y.mean()) ** 2))
        if power > 0.0:
            nrmse = 100.0 * math.sqrt(error / power)
            out[name] = {"nrmse_percent": nrmse, "fit_percent": 100.0 - nrmse}
    return out


def _noise(result: Estimate, vehicle: Vehicle) -> list[Document]:
    """Posterior of each run's noise deviations, and the share of it that is filtered."""
    out: list[Document] = []
    for run, fit in enumerate(result.runs):
        entry: Document = {"source": fit.line.source, "unit": _acceleration(vehicle)}
        for c, name in enumerate(CHANNELS):
            draws = result.nuisance.get(f"noise {name} {run}")
            if draws is not None:
                entry[name] = _summary(_shown(draws, "acceleration", vehicle))
                given = fit.line.noise[c]
                entry[name]["given"] = (
                    None if given is None else float(_shown(given, "acceleration", vehicle))
                )
        colour = result.nuisance.get(f"filtered share {run}")
        if colour is not None:
            entry["filtered_share"] = _summary(colour)
        entry["colour_order"] = fit.colour.order
        out.append(entry)
    return out


def _acceleration(vehicle: Vehicle) -> str:
    return display_units(vehicle.units)["acceleration"]


def _run(fit: RunFit, vehicle: Vehicle) -> Document:
    line, recording = fit.line, fit.recording
    both = line.pairs[np.all(line.pairs >= 0, axis=1)]
    both = both[np.unique(np.linspace(0, len(both) - 1, _CURVE).astype(int))]
    keep = both[:, 0]
    rows = np.unique(np.linspace(0, line.times.shape[1] - 1, _CURVE).astype(int))
    span = line.times[0, -1] - line.times[0, 0]
    step = float(np.median(np.diff(line.times[0])))
    curves: Document = {}
    spacing = line.reading_step
    for axle, name in ((0, "front_chassis"), (1, "rear_chassis")):
        there = line.kind[:, axle] == 1
        residual = line.reading[there, axle] - fit.free.output[there, axle]
        spread = np.sqrt(fit.ensemble[:, :, axle].var(axis=0) + np.mean(residual**2))
        simulated = fit.free.output[:, axle]
        measured = np.where(line.kind[:, axle] == 0, np.nan, line.reading[:, axle])
        curves[name] = {
            "measured": _curve(measured[both[:, axle]], vehicle),
            "simulated": _curve(simulated[both[:, axle]], vehicle),
            "band95": [
                _curve((simulated - 1.96 * spread)[both[:, axle]], vehicle),
                _curve((simulated + 1.96 * spread)[both[:, axle]], vehicle),
            ],
            **_whiteness(line.paired(fit.innovations)[:, axle], fit.colour.order, spacing),
            "spectrum": _spectrum(line.reading[there, axle], residual, spacing, vehicle),
        }  # fmt: skip
    travel: Document = {"unit": display_units(vehicle.units)["deflection"]}
    for axle, name in ((0, "front"), (1, "rear")):
        low, high = np.quantile(fit.travel[:, :, axle], [0.025, 0.975], axis=0)
        centre = fit.free.states[:, 2 * axle]
        velocity = fit.free.states[:, 2 * axle + 1]
        travel[name] = {
            "deflection": _rounded(_shown(centre[keep], "deflection", vehicle)),
            "band95": [
                _rounded(_shown(low[keep], "deflection", vehicle)),
                _rounded(_shown(high[keep], "deflection", vehicle)),
            ],
            "velocity": _rounded(_shown(velocity[keep], "velocity", vehicle)),
            "largest_bump": float(_shown(max(-centre.min(), 0.0), "deflection", vehicle)),
            "largest_droop": float(_shown(max(centre.max(), 0.0), "deflection", vehicle)),
        }
    travel["velocity_unit"] = display_units(vehicle.units)["velocity"]
    return {
        "source": line.source,
        "sha256": recording.sha256,
        "rate": 1.0 / step,
        "seconds": float(span),
        "rows": int(line.times.shape[1]),
        "missing": {n: int(np.sum(~np.isfinite(line.acceleration[c])))
                    for c, n in enumerate(CHANNELS)},
        "clipped": {n: int(line.clipped[c].sum()) for c, n in enumerate(CHANNELS)},
        "bias": {"unit": _acceleration(vehicle),
                 "front": float(_shown(fit.free.bias[0], "acceleration", vehicle)),
                 "rear": float(_shown(fit.free.bias[1], "acceleration", vehicle))},
        "unit": _acceleration(vehicle),
        "time": _rounded(line.instants[keep] - line.times[0, 0]),
        "chassis": curves,
        "wheels": {
            "time": _rounded(line.times[0, rows] - line.times[0, 0]),
            "front_wheel": _curve(line.acceleration[0, rows], vehicle),
            "rear_wheel": _curve(line.acceleration[2, rows], vehicle),
        },
        "travel": travel,
        "checks": checks_document(fit.checks, vehicle),
    }  # fmt: skip


def _curve(values: Array, vehicle: Vehicle) -> list[float | None]:
    return _rounded(_shown(values, "acceleration", vehicle))


def _rounded(values: Array) -> list[float | None]:
    """Six significant digits: a curve for the eye need not carry sixteen."""
    return [float(f"{v:.6g}") if math.isfinite(v) else None for v in values]


def _whiteness(innovations: Array, fitted: int, step: float) -> Document:
    """Autocorrelation of the innovations and the Ljung–Box probability of it.

    ``fitted`` lags were used to whiten them, so they do not count as evidence.
    """
    x = innovations[np.isfinite(innovations)]
    x = x - x.mean()
    power = float(x @ x) or 1.0
    return {
        "autocorrelation": [float(x[j:] @ x[: len(x) - j]) / power for j in range(_LAGS + 1)],
        "autocorrelation_band95": 1.96 / math.sqrt(max(len(x), 1)),
        "whiteness_p": portmanteau(x, _LAGS, fitted) if fitted < _LAGS else None,
        "lag_seconds": step,
    }


def _spectrum(signal: Array, residual: Array, step: float, vehicle: Vehicle) -> Document:
    """Power spectral densities of the reading and of what the simulation leaves (Welch)."""
    from scipy.signal import welch

    n = min(256, len(signal))
    factor = float(_shown(1.0, "acceleration", vehicle)) ** 2
    frequency, measured = welch(signal, 1.0 / step, nperseg=n)
    _, left = welch(residual, 1.0 / step, nperseg=n)
    return {
        "unit": f"({_acceleration(vehicle)})^2/Hz",
        "frequency": _rounded(frequency[1:]),
        "measured": _rounded(factor * measured[1:]),
        "residual": _rounded(factor * left[1:]),
    }


def _thinned(draws: Array, name: str, vehicle: Vehicle) -> list[float | None]:
    x = draws.ravel()
    pick = np.linspace(0, len(x) - 1, min(_DRAWS, len(x))).astype(int)
    return _rounded(_shown(x[pick], QUANTITIES[name][0], vehicle))


def _vehicle(vehicle: Vehicle) -> Document:
    travel = vehicle.travel
    out: Document = {
        "name": vehicle.name,
        "units": vehicle.units,
        "source": Path(vehicle.source).name,
        "sha256": vehicle.sha256,
        "travel": {"unit": display_units(vehicle.units)["deflection"]},
    }
    for name in ("front_bump", "front_droop", "rear_bump", "rear_droop"):
        value = getattr(travel, name)
        out["travel"][name] = None if value is None else float(_shown(value, "deflection", vehicle))
    return out


def _provenance(result: Estimate) -> Document:
    files = [{"file": Path(r.source).name, "sha256": r.sha256} for r in result.recordings]
    return {
        "recordings": files,
        "vehicle": {"file": Path(result.vehicle.source).name, "sha256": result.vehicle.sha256},
        "bayes_asv": __version__,
        "python": platform.python_version(),
        "packages": {name: metadata.version(name) for name in _PACKAGES},
        "seed": result.seed,
        "order": list(CAR),
    }


def _clean(value: Any) -> Any:
    """None for numbers that do not exist, since JSON has no word for them."""
    if isinstance(value, dict):
        return {k: _clean(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_clean(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
