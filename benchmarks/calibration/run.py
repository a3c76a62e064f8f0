"""One run: drive or draw, lay out, fit, and see where the truth lies in the posterior."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.estimation import estimate
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.map_fit import MapFit, best_fit
from bayes_asv.posterior.sampler import sample_mcmc
from bayes_asv.preprocessing.run_preparation import prepare_runs
from benchmarks.calibration.bound import bounds
from benchmarks.calibration.cells import MODEL, NAMES, Cell
from benchmarks.calibration.model_draws import Drawn, draw_run
from benchmarks.calibration.posterior import place, posterior, spread
from benchmarks.calibration.quantities import Conditional, car_quantities, nuisance
from benchmarks.calibration.rig_runs import Case, drive_cell

__all__ = ["LOG_LIKELIHOOD", "NOT_CONVERGED", "Row", "one", "several"]

Array = NDArray[np.float64]

LOG_LIKELIHOOD = "log-likelihood"
NOT_CONVERGED = "the ensembles did not agree"
_MODEL_NAMES = (*NAMES, "m", "k_f", "k_r")


@dataclass(frozen=True)
class Row:
    """What one run showed.

    Parameters
    ----------
    run : int
        Its number.
    reasons : tuple of str
        Why it was refused; a run drawn from the model is judged nevertheless.
    places : dict of str to float
        Posterior probability below the truth, by quantity; empty when refused.
    widths, bounds : dict of str to float
        Relative deviation that the 95 % interval stands for, and the least there can be.
    effective : float
        Effective number of weighted draws.
    how : str
        Number of weighted draws, or ``ensembles``.
    colour : int
        Order of the colour found.
    clipped : int
        Readings at a rail.
    checked : dict of str to (float, float)
        Place and width by the product's own ensembles, where they ran.
    """

    run: int
    reasons: tuple[str, ...] = ()
    places: dict[str, float] = field(default_factory=dict)
    widths: dict[str, float] = field(default_factory=dict)
    bounds: dict[str, float] = field(default_factory=dict)
    effective: float = 0.0
    how: str = ""
    colour: int = 0
    clipped: int = 0
    checked: dict[str, tuple[float, float]] = field(default_factory=dict)


def one(cell: Cell, seed: int, run: int) -> Row:
    """Run ``run`` of a cell.

    Parameters
    ----------
    cell : Cell
        What kind of drive.
    seed : int
        Of the bench.
    run : int
        Which one; the same arguments give the same row.

    Returns
    -------
    Row
    """
    if cell.terrain == MODEL:
        return _from_the_model(cell, draw_run(cell, seed, run), run)
    return _from_the_rig(cell, drive_cell(cell, seed, run), run)


def _from_the_rig(cell: Cell, case: Case, run: int) -> Row:
    lines, reasons, _ = prepare_runs((case.recording,), case.vehicle)
    fit = None
    if not reasons:
        fit = best_fit(lines, case.vehicle)
        reasons = fit.reasons
    if reasons or fit is None:
        return Row(run, reasons=reasons, clipped=case.clipped)
    found = posterior(fit, run)
    if not found.converged:
        return Row(run, reasons=(NOT_CONVERGED,), how=found.how, clipped=case.clipped)
    z = found.draws.z
    judged = car_quantities(fit.space, z, case.car, NAMES)
    row = Row(
        run,
        places={name: place(found.draws, what) for name, what in judged.items()},
        widths={name: spread(found.draws, what) for name, what in judged.items()},
        bounds=bounds(case, fit.space, tuple(judged)),
        effective=found.draws.effective,
        how=found.how,
        colour=_order(fit.posterior),
        clipped=case.clipped,
    )
    if run >= cell.checked:
        return row
    product = estimate([case.recording], case.vehicle, seed=run)
    if product.verdict != "ok":
        return row
    logs = {
        name: (np.log(product.draws[name]).ravel(), what.truth) for name, what in judged.items()
    }
    return replace(row, checked={name: _by_counting(x, truth) for name, (x, truth) in logs.items()})


def _from_the_model(cell: Cell, drawn: Drawn, run: int) -> Row:
    """Judge every coordinate and the log-likelihood, whatever the product would refuse."""
    lines, reasons, _ = prepare_runs((drawn.recording,), drawn.vehicle)
    fit = best_fit(lines, drawn.vehicle)
    found = posterior(fit, run)
    judged = _everything(fit, found.draws.z, drawn)
    row = Row(
        run,
        reasons=reasons + fit.reasons,
        places={name: place(found.draws, what) for name, what in judged.items()},
        widths={name: spread(found.draws, judged[name]) for name in NAMES},
        effective=found.draws.effective,
        how=found.how,
        colour=_order(fit.posterior),
    )
    if run >= cell.checked:
        return row
    chains = sample_mcmc(fit.posterior, fit.mode, run)
    z = chains.draws.reshape(-1, fit.space.dimension)
    rng = np.random.default_rng([run, 3])
    logs = {
        name: (what.mean + what.sd * rng.standard_normal(len(z)), what.truth)
        for name, what in _everything(fit, z, drawn).items()
    }
    return replace(row, checked={name: _by_counting(x, truth) for name, (x, truth) in logs.items()})


def _everything(fit: MapFit, z: Array, drawn: Drawn) -> dict[str, Conditional]:
    # a fit that takes white noise for coloured may sample fewer coordinates than were drawn
    truth = np.array([drawn.z[drawn.names.index(name)] for name in fit.space.names])
    out = car_quantities(fit.space, z, drawn.car, _MODEL_NAMES) | nuisance(fit.space, z, truth)
    likely = float(fit.posterior.log_likelihood(truth[None])[0])
    out[LOG_LIKELIHOOD] = Conditional(fit.posterior.log_likelihood(z), 0.0, likely)
    return out


def _by_counting(x: Array, truth: float) -> tuple[float, float]:
    """Place and width from draws (S,) of equal weight."""
    low, high = np.quantile(x, [0.025, 0.975])
    return float(np.mean(x < truth)), float(high - low) / (2.0 * 1.959964)


def _order(posterior: Posterior) -> int:
    return max(colour.order for colour in posterior.residual_ars)


def several(cell: Cell, seed: int, runs: Sequence[int]) -> list[Row]:
    """Run several of a cell, one after the other; an error says which run it was."""
    rows = []
    for run in runs:
        try:
            rows.append(one(cell, seed, run))
        except Exception as exc:
            exc.add_note(f"in {cell.name}, run {run}, seed {seed}")
            raise
    return rows
