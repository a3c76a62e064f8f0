"""The reproduction as plain data, ready for JSON."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from bayes_asv import __version__
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.models.modes import Mode
from bayes_asv.reference.errata import errata
from bayes_asv.reference.greybox import PointEstimate
from bayes_asv.reference.printed import TABLE_81, UNITS
from bayes_asv.reference.runs import Run
from bayes_asv.reference.spectral import CLOSE, Study, wilson
from bayes_asv.reference.tables import LABELS, Table

__all__ = [
    "GREYBOX_SCHEMA",
    "MODES_SCHEMA",
    "SCHEMA",
    "answers_document",
    "clean",
    "greybox_document",
    "mode_document",
    "reproduction_document",
    "study_document",
]

Document = dict[str, Any]

SCHEMA: Final = "bayes_asv/reproduce/1"
MODES_SCHEMA: Final = "bayes_asv/modes/1"
GREYBOX_SCHEMA: Final = "bayes_asv/greybox/1"


def mode_document(mode: Mode, labels: Sequence[str] = ("front", "rear")) -> Document:
    """Tell one mode: Hz, and the shape as size and phase in degrees."""
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


def study_document(study: Study) -> Document:
    """Tell how far modes can be read from a spectrum at one damping."""
    return {
        "damping": study.damping,
        "modes": [mode_document(m) for m in study.modes],
        "peaks_of_an_endless_record_hz": {
            "front": list(study.peaks[0]),
            "rear": list(study.peaks[1]),
        },
        "peaks_can_be_read": study.readable,
        "within_percent": 100.0 * CLOSE,
        "readings": [
            {
                "seconds": r.seconds,
                "records": r.runs,
                **{
                    name: {
                        "read": hits,
                        "share": hits / r.runs,
                        "interval95": list(wilson(hits, r.runs)),
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


def answers_document(estimate: PointEstimate, units: str) -> Document:
    """Tell the answers of a point estimate in the units of a vehicle."""
    out = {}
    for name, answer in estimate.answers.items():
        unit = display_units(units)[QUANTITIES[name][0]]
        factor = from_si(1.0, unit, QUANTITIES[name][0])
        out[name] = {"unit": unit, "value": factor * answer.value, "sd": factor * answer.sd}
    return out


def greybox_document(estimate: PointEstimate, units: str) -> Document:
    """Tell a point estimate.

    Parameters
    ----------
    estimate : PointEstimate
        From :mod:`bayes_asv.reference.greybox`.
    units : str
        ``US`` or ``SI``.

    Returns
    -------
    dict
        Not yet free of nan: see :func:`clean`.
    """
    fitted = estimate.fitted
    return {
        "verdict": estimate.verdict,
        "reasons": list(estimate.reasons),
        "warnings": list(estimate.warnings),
        "coordinates": estimate.coordinates,
        "initial": estimate.initial,
        "removed": estimate.removal,
        "between_samples": estimate.hold,
        "parameters": answers_document(estimate, units),
        "correlation": None if fitted is None else _correlation(fitted.covariance[:3, :3]),
        "fit_percent": dict(estimate.fit),
        "whiteness": {n: {"statistic": w.statistic, "p": w.p} for n, w in estimate.white.items()},
        "independence": [
            {"output": output, "input": wheel, "statistic": t.statistic, "p": t.p}
            for (output, wheel), t in estimate.independent.items()
        ],
        "log_likelihood": None if fitted is None else fitted.log_likelihood,
        "aic": None if fitted is None else fitted.aic,
        "bic": None if fitted is None else fitted.bic,
        "unknowns": None if fitted is None else fitted.unknowns,
        "rows": len(estimate.time),
    }


def reproduction_document(
    tables: Sequence[Table], studies: Sequence[Study], runs: Sequence[Run], seed: int,
    seconds: float,
) -> Document:  # fmt: skip
    """Tell the whole reproduction.

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
        "drift": [row for run in runs for row in drift_rows(run)],
        "greybox": {run.name: greybox_document(run.deflection, "US") for run in runs},
        "errata": [e._asdict() for e in errata()],
        "seconds": seconds,
        "seed": seed,
        "version": __version__,
    }  # fmt: skip
    cleaned = clean(document)
    assert isinstance(cleaned, dict)
    return cleaned


def table_81_document(runs: Sequence[Run]) -> Document:
    """Tell Table 8.1 in its form, with the same columns from our runs.

    The printed columns are of the reference's drives and ours of another car: no difference is
    taken between them, only from the truth of each of our runs.
    """
    rows = []
    for name, (at_400, at_800, car) in TABLE_81.items():
        unit, dimension = UNITS[name]

        def shown(value: float, unit: str = unit, dimension: str = dimension) -> float:
            return from_si(value, unit, dimension)

        ours = {}
        for run in runs:
            draws = run.posterior.draws.get(name)
            truth = run.truth[name]
            theirs, point = run.its_way[run.usual].answers[name], run.deflection.answers[name]
            ours[run.name] = {
                "truth": shown(truth),
                "its_way": shown(theirs.value),
                "its_way_sd": shown(theirs.sd),
                "its_way_error_percent": 100.0 * (theirs.value / truth - 1.0),
                "deflection": shown(point.value),
                "deflection_sd": shown(point.sd),
                "deflection_error_percent": 100.0 * (point.value / truth - 1.0),
                **_posterior(draws, truth, shown),
            }
        rows.append(
            {
                "name": name, "label": LABELS[name], "unit": unit,
                "printed": {"400 Hz": at_400, "800 Hz": at_800, "2008 Baja car": car},
                "ours": ours, "where": "Table 8.1",
            }
        )  # fmt: skip
    return {
        "title": "Grey-box estimates, and ours",
        "rows": rows,
        "notes": [
            "The reference's recordings are not public, so its columns cannot be computed again. "
            "Ours are simulated drives of one car over two parking stops; its truth is known.",
            "Its way: integrated twice, states as outputs, inputs held, at rest at first, the "
            "trend taken off at 400 Hz and a constant at 800 Hz, m, l, wdf and both springs "
            "as exact. Deflection: the same criterion, accelerations in and out. Posterior: mean "
            "and 95 % interval of bayes-asv estimate, which carries the uncertainty of what is "
            "given.",
        ],
    }


def drift_rows(run: Run) -> list[Document]:
    """Tell what each removal does to integrated travel and to the estimates."""
    rows = []
    for removal, point in run.its_way.items():
        front, rear = run.drifted(removal)
        rows.append(
            {
                "run": run.name,
                "removed": removal,
                "reference": removal == run.usual,
                "largest_deflection_in": {
                    "front": from_si(front, "in", "length"),
                    "rear": from_si(rear, "in", "length"),
                },
                "verdict": point.verdict,
                "parameters": answers_document(point, "US"),
                "error_percent": {
                    n: 100.0 * (point.answers[n].value / run.truth[n] - 1.0)
                    for n in ("c_f", "c_r", "i")
                },
            }
        )
    return rows


def _posterior(draws: Any, truth: float, shown: Any) -> Document:
    """Mean and interval; None throughout when the posterior was refused."""
    if draws is None:
        return {"posterior": None, "posterior_eti95": None, "posterior_covers": None}
    low, high = np.quantile(draws, [0.025, 0.975])
    return {
        "posterior": shown(float(np.mean(draws))),
        "posterior_eti95": [shown(float(low)), shown(float(high))],
        "posterior_covers": bool(low <= truth <= high),
    }


def _correlation(covariance: Any) -> list[list[float]]:
    sd = np.sqrt(np.diag(covariance))
    return [[float(v) for v in row] for row in covariance / np.outer(sd, sd)]


def clean(value: Any) -> Any:
    """None for numbers that do not exist, since JSON has no word for them."""
    if isinstance(value, dict):
        return {k: clean(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [clean(v) for v in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
