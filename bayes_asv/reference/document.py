"""The reproduction as a document, ready for JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from bayes_asv import __version__
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.models.modes import VibrationMode
from bayes_asv.reference.experiments import Run
from bayes_asv.reference.greybox import PointEstimate
from bayes_asv.reference.printed import TABLE_81, UNITS, errata
from bayes_asv.reference.spectral import TOLERANCE, SpectralStudy, wilson_interval
from bayes_asv.reference.tables import LABELS, Table

__all__ = [
    "GREYBOX_SCHEMA",
    "MODES_SCHEMA",
    "SCHEMA",
    "greybox_document",
    "mode_document",
    "nan_to_none",
    "parameters_document",
    "reproduction_document",
    "study_document",
]

Document = dict[str, Any]

SCHEMA: Final = "bayes_asv/reproduce/1"
MODES_SCHEMA: Final = "bayes_asv/modes/1"
GREYBOX_SCHEMA: Final = "bayes_asv/greybox/1"


def mode_document(mode: VibrationMode, labels: Sequence[str] = ("front", "rear")) -> Document:
    """Convert a mode: frequencies in Hz, shape as magnitude and phase in degrees."""
    return {
        "natural_hz": mode.natural,
        "damped_hz": mode.damped,
        "ratio": mode.ratio,
        "oscillates": mode.damped > 0.0,
        "shape": {
            name: {"size": float(abs(v)), "phase_deg": float(np.degrees(np.angle(v)))}
            for name, v in zip(labels, mode.shape, strict=True)
        },
    }


def study_document(study: SpectralStudy) -> Document:
    """Convert a spectral study at one damping."""
    return {
        "damping": study.damping,
        "modes": [mode_document(m) for m in study.modes],
        "peaks_of_an_endless_record_hz": {
            "front": list(study.peaks[0]),
            "rear": list(study.peaks[1]),
        },
        "peaks_can_be_read": study.peaks_visible,
        "within_percent": 100.0 * TOLERANCE,
        "readings": [
            {
                "seconds": r.seconds,
                "records": r.runs,
                **{
                    name: {
                        "read": hits,
                        "share": hits / r.runs,
                        "interval95": list(wilson_interval(hits, r.runs)),
                    }
                    for name, hits in (("peaks", r.peaks), ("subspace", r.subspace))
                },
                "slow_mode_by_subspace": {
                    "natural_hz": dict(zip(("median", "q05", "q95"), r.natural, strict=True)),
                    "ratio": dict(zip(("median", "q05", "q95"), r.ratio, strict=True)),
                },
            }
            for r in study.readings
        ],
    }


def parameters_document(estimate: PointEstimate, units: str) -> Document:
    """Convert the parameters of a point estimate to a system of units."""
    out = {}
    for name, parameter in estimate.parameters.items():
        unit = display_units(units)[QUANTITIES[name][0]]
        factor = from_si(1.0, unit, QUANTITIES[name][0])
        out[name] = {"unit": unit, "value": factor * parameter.value, "sd": factor * parameter.sd}
    return out


def greybox_document(estimate: PointEstimate, units: str) -> Document:
    """Convert a point estimate.

    Parameters
    ----------
    estimate : PointEstimate
        From :mod:`bayes_asv.reference.greybox`.
    units : str
        ``US`` or ``SI``.

    Returns
    -------
    dict
        It may contain nan; see :func:`nan_to_none`.
    """
    minimum = estimate.minimum
    return {
        "verdict": estimate.verdict,
        "reasons": list(estimate.reasons),
        "warnings": list(estimate.warnings),
        "coordinates": estimate.coordinates,
        "initial": estimate.initial,
        "removed": estimate.detrending,
        "between_samples": estimate.hold,
        "parameters": parameters_document(estimate, units),
        "correlation": None if minimum is None else _correlation(minimum.covariance[:3, :3]),
        "fit_percent": dict(estimate.fit),
        "whiteness": {
            n: {"statistic": w.statistic, "p": w.p} for n, w in estimate.whiteness.items()
        },
        "independence": [
            {"output": output, "input": wheel, "statistic": t.statistic, "p": t.p}
            for (output, wheel), t in estimate.independence.items()
        ],
        "log_likelihood": None if minimum is None else minimum.log_likelihood,
        "aic": None if minimum is None else minimum.aic,
        "bic": None if minimum is None else minimum.bic,
        "unknowns": None if minimum is None else minimum.unknowns,
        "rows": len(estimate.time),
    }


def reproduction_document(
    tables: Sequence[Table], studies: Sequence[SpectralStudy], runs: Sequence[Run], seed: int,
    seconds: float,
) -> Document:  # fmt: skip
    """Convert the whole reproduction.

    Returns
    -------
    dict
        Schema ``bayes_asv/reproduce/1``: ``tables`` by number, ``spectral``, ``drift``, ``errata``.
    """
    verdicts = {run.posterior.verdict for run in runs}
    document = {
        "schema": SCHEMA,
        "verdict": next((v for v in ("refused", "not_converged") if v in verdicts), "ok"),
        "tables": {
            **{
                t.key: {
                    "title": t.title, "rows": [r.plain() for r in t.rows], "notes": list(t.notes)
                }
                for t in tables
            },
            "8.1": table_81_document(runs),
        },
        "spectral": [study_document(s) for s in studies],
        "drift": [row for run in runs for row in detrending_rows(run)],
        "greybox": {run.name: greybox_document(run.deflection, "US") for run in runs},
        "errata": [e._asdict() for e in errata()],
        "seconds": seconds,
        "seed": seed,
        "version": __version__,
    }  # fmt: skip
    cleaned = nan_to_none(document)
    assert isinstance(cleaned, dict)
    return cleaned


def table_81_document(runs: Sequence[Run]) -> Document:
    """Build Table 8.1 with the same columns from our runs.

    The printed columns are from the reference's drives and ours from another car, so our estimates
    are compared with the true values of our runs only.
    """
    rows = []
    for name, (at_400, at_800, car) in TABLE_81.items():
        unit, dimension = UNITS[name]

        def converted(value: float, unit: str = unit, dimension: str = dimension) -> float:
            return from_si(value, unit, dimension)

        ours = {}
        for run in runs:
            draws = run.posterior.draws.get(name)
            truth = run.truth[name]
            integrated = run.reference_fits[run.reference_detrending].parameters[name]
            deflection = run.deflection.parameters[name]
            ours[run.name] = {
                "truth": converted(truth),
                "its_way": converted(integrated.value),
                "its_way_sd": converted(integrated.sd),
                "its_way_error_percent": 100.0 * (integrated.value / truth - 1.0),
                "deflection": converted(deflection.value),
                "deflection_sd": converted(deflection.sd),
                "deflection_error_percent": 100.0 * (deflection.value / truth - 1.0),
                **_posterior(draws, truth, converted),
            }
        rows.append(
            {
                "name": name, "label": LABELS[name], "unit": unit,
                "printed": {"400 Hz": at_400, "800 Hz": at_800, "2008 Baja car": car},
                "ours": ours, "where": "Table 8.1",
            }
        )  # fmt: skip
    return {
        "title": "Grey-box estimates, printed and ours",
        "rows": rows,
        "notes": [
            "The reference's recordings are not public, so its columns cannot be computed again. "
            "Ours are simulated drives of one car over two parking stops with known true values.",
            "Reference's method: integrated twice, states as outputs, inputs held, initially at "
            "rest, linear trend removed at 400 Hz and a constant at 800 Hz, m, l, wdf and both "
            "springs exact. Deflection: the same criterion with accelerations as inputs and "
            "outputs. Posterior: mean and 95 % interval of bayes-asv estimate, which includes the "
            "uncertainty of the given values.",
        ],
    }


def detrending_rows(run: Run) -> list[Document]:
    """Describe the effect of each kind of detrending on integrated travel and estimates."""
    rows = []
    for detrending, fit in run.reference_fits.items():
        front, rear = run.largest_travel(detrending)
        rows.append(
            {
                "run": run.name,
                "removed": detrending,
                "reference": detrending == run.reference_detrending,
                "largest_deflection_in": {
                    "front": from_si(front, "in", "length"),
                    "rear": from_si(rear, "in", "length"),
                },
                "verdict": fit.verdict,
                "parameters": parameters_document(fit, "US"),
                "error_percent": {
                    n: 100.0 * (fit.parameters[n].value / run.truth[n] - 1.0)
                    for n in ("c_f", "c_r", "i")
                },
            }
        )
    return rows


def _posterior(draws: Any, truth: float, converted: Any) -> Document:
    """Return mean and interval, or None if the posterior was refused."""
    if draws is None:
        return {"posterior": None, "posterior_eti95": None, "posterior_covers": None}
    low, high = np.quantile(draws, [0.025, 0.975])
    return {
        "posterior": converted(float(np.mean(draws))),
        "posterior_eti95": [converted(float(low)), converted(float(high))],
        "posterior_covers": bool(low <= truth <= high),
    }


def _correlation(covariance: Any) -> list[list[float]]:
    sd = np.sqrt(np.diag(covariance))
    return [[float(v) for v in row] for row in covariance / np.outer(sd, sd)]


def nan_to_none(value: Any) -> Any:
    """Replace nan and infinity by None, since JSON cannot represent them."""
    if isinstance(value, dict):
        return {k: nan_to_none(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [nan_to_none(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
