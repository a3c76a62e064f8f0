"""The draws of an estimate as ArviZ inference data, SI units, one chain an ensemble."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.analysis.prior_sensitivity import log_priors
from bayes_asv.domain.channels import channel
from bayes_asv.domain.files import write_atomically
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units
from bayes_asv.estimate_result import EstimationResult
from bayes_asv.filters.kalman import VALUE
from bayes_asv.filters.noise_simulation import normals_needed, simulate_noise
from bayes_asv.library.extras import import_extra
from bayes_asv.models.effects import PlacedEffect
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.likelihood import Posterior, shared_work

__all__ = ["coordinates", "groups", "inference_data", "write_netcdf"]

Array = NDArray[np.float64]

_PRIOR_DRAWS = 1000
_PREDICTIVE_DRAWS = 200
_MAX_PREDICTIVE = 2_000_000  # readings in all: fewer draws of a long recording
_DIMS = ("chain", "draw")


def inference_data(result: EstimationResult) -> Any:
    """Convert an estimate with draws.

    Parameters
    ----------
    result : EstimationResult
        Of any car.

    Returns
    -------
    arviz.InferenceData or xarray.DataTree
        With the groups of :func:`groups`, in the class that the installed ArviZ uses.
    """
    arviz = import_extra("arviz", "to_inference_data()")
    datasets = groups(result)
    if int(arviz.__version__.split(".")[0]) < 1:
        return arviz.InferenceData(**datasets)
    return import_extra("xarray", "to_inference_data()").DataTree.from_dict(datasets)


def write_netcdf(result: EstimationResult, path: str | os.PathLike[str]) -> None:
    """Write the groups of :func:`groups` as netCDF, which ArviZ 0.23 and 1.x open.

    Parameters
    ----------
    result : EstimationResult
        Of any car, with draws.
    path : str or os.PathLike
        Written whole or not at all.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    import_extra("h5netcdf", "a netCDF file")
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "draws.nc"
        for n, (group, dataset) in enumerate(groups(result).items()):
            dataset.to_netcdf(draft, mode="a" if n else "w", group=group, engine="h5netcdf")
        write_atomically(path, draft.read_bytes())


def groups(result: EstimationResult) -> dict[str, Any]:
    """Make the datasets of an estimate.

    Parameters
    ----------
    result : EstimationResult
        Of any car, with draws.

    Returns
    -------
    dict of str to xarray.Dataset
        ``posterior``: the car's parameters, noise levels (by recording) and parameters of
        effects.  ``sample_stats``: ``lp``, the log posterior, not normalised.  ``prior``: draws of
        the same.  ``observed_data``: readings of the outputs by channel and recording.  Where the
        recordings are consistent and the model has no effects, besides: ``log_prior`` by variable
        (density of the logarithm of a positive one), ``log_likelihood`` by recording, and, unless
        residuals are modelled as autocorrelated, ``posterior_predictive``: readings as the
        simulation and the sensors' noise make them.
    """
    posterior = {**result.draws, **_nuisance(result.nuisance), **_effects(result.effects)}
    datasets = {
        "posterior": _dataset(posterior, _units(posterior, result.effects)),
        "sample_stats": _dataset({"lp": result.log_posterior}, {}),
        "prior": _prior(result),
        "observed_data": _readings(result, None),
    }
    z = coordinates(result)
    if z is not None:
        assert result.space is not None
        density = Posterior(result.space, tuple(run.residual_ar for run in result.runs))
        datasets["log_prior"] = _dataset(
            log_priors(result.space, result.draws, result.nuisance), {}
        )
        datasets["log_likelihood"] = _log_likelihood(density, z)
        # of several runs the estimate has it by an approximation
        likelihood = datasets["log_likelihood"]["recordings"].sum("recording").values
        prior = result.space.log_prior(z.reshape(-1, z.shape[-1])).reshape(z.shape[:2])
        datasets["sample_stats"] = _dataset({"lp": likelihood + prior}, {})
        if all(run.residual_ar.order == 0 for run in result.runs):
            datasets["posterior_predictive"] = _readings(result, _predicted(result, density, z))
    return datasets


def coordinates(result: EstimationResult) -> Array | None:
    """Coordinates (E, S, D) of the draws; None for a model with effects or runs that differ.

    The inverse of :meth:`bayes_asv.posterior.parameters.ParameterSpace.quantities`.
    """
    space = result.space
    if space is None or space.placed_effects or result.pooled_draws:
        return None
    car = space.car_coordinates(result.draws)
    if space.dimension == space.car_dimension:
        return car
    return np.concatenate([car, space.nuisance_coordinates(result.nuisance)], axis=-1)


def _nuisance(values: dict[str, Array]) -> dict[str, Array]:
    return {name.replace(" ", "_"): x for name, x in values.items()}


def _effects(values: dict[PlacedEffect, dict[str, Array]]) -> dict[str, Array]:
    return {
        _effect_label(placed, name): x
        for placed, parameters in values.items()
        for name, x in parameters.items()
    }


def _effect_label(placed: PlacedEffect, name: str) -> str:
    """Name a variable, ``<effect>_<where>_<parameter>``."""
    return f"{str(placed).replace('@', '_')}_{name}"


def _units(names: Iterable[str], placed_effects: Iterable[PlacedEffect]) -> dict[str, str]:
    """SI unit of each variable; empty for a number without one."""
    si = display_units("SI")
    units = {name: si[QUANTITIES[name][0]] for name in names if name in QUANTITIES}
    noises = {name: name.removeprefix("noise_").rpartition("_")[0] for name in names}
    units |= {n: channel(c).si_unit for n, c in noises.items() if n.startswith("noise_")}
    units |= {name: "s" for name in names if name.startswith("clock_offset_")}
    for placed in placed_effects:
        for parameter in placed.effect.parameters:
            # a share is of the declared bandwidth
            unit = "" if parameter.unit == "share" else parameter.unit
            units[_effect_label(placed, parameter.name)] = unit
    return units


def _dataset(values: dict[str, Array], units: dict[str, str]) -> Any:
    """Make a dataset of arrays (chain, draw)."""
    xarray = import_extra("xarray", "inference data")
    first = next(iter(values.values()))
    return xarray.Dataset(
        {name: (_DIMS, x, {"units": units.get(name, "")}) for name, x in values.items()},
        coords={name: np.arange(n) for name, n in zip(_DIMS, first.shape, strict=True)},
        attrs=_about(),
    )


def _about() -> dict[str, str]:
    return {"inference_library": "bayes_asv", "inference_library_version": __version__}


def _prior(result: EstimationResult) -> Any:
    """Draws of the prior, in one chain."""
    space = result.space
    assert space is not None
    rng = np.random.default_rng([result.seed, 10])
    z = rng.standard_normal((_PRIOR_DRAWS, space.dimension))
    values = {**space.quantities(z, result.seed), **_effects(space.effect_draws(z))}
    if not result.pooled_draws:  # of runs that differ, this space is that of the first alone
        values |= _nuisance(space.nuisance(z))
    return _dataset(
        {name: x[None] for name, x in values.items()}, _units(values, space.placed_effects)
    )


def _log_likelihood(density: Posterior, z: Array) -> Any:
    """Log likelihood of every recording at every draw."""
    xarray = import_extra("xarray", "inference data")
    with shared_work(density) as shared:
        values = shared.by_run(z.reshape(-1, z.shape[-1]))
    values = np.moveaxis(values.reshape(-1, *z.shape[:2]), 0, -1)
    sources = [recording.source for recording in density.space.recordings]
    return xarray.Dataset(
        {"recordings": ((*_DIMS, "recording"), values)},
        coords={
            **{name: np.arange(n) for name, n in zip(_DIMS, z.shape[:2], strict=True)},
            "recording": sources,
        },
        attrs=_about(),
    )


def _predicted(result: EstimationResult, density: Posterior, z: Array) -> list[Array]:
    """Draw outputs (S, E, ny) of every recording, as car and sensors make them."""
    out = []
    flat = z.reshape(-1, z.shape[-1])
    for n, recording in enumerate(density.space.recordings):
        count, ny = recording.kind.shape
        size = max(min(_PREDICTIVE_DRAWS, _MAX_PREDICTIVE // (ny * count)), 2)
        rng = np.random.default_rng([result.seed, n, 11])
        rows = np.empty((size, count, ny))
        for s, k in enumerate(np.linspace(0, len(flat) - 1, size).astype(int)):
            normals = rng.standard_normal((count, 1, normals_needed(len(recording.wheels), ny)))
            system = density.space.state_space(flat[k][None], n)
            noise = density.space.noises(flat[k][None], n)
            drawn = simulate_noise(system, noise, recording.measurements, normals)
            rows[s] = free_run(density, flat[k], n).output + drawn[:, 0]
        out.append(rows)
    return out


def _readings(result: EstimationResult, predicted: list[Array] | None) -> Any:
    """Return the outputs, SI units: as read, or predicted (S, E, ny) for every recording."""
    xarray = import_extra("xarray", "inference data")
    variables: dict[str, Any] = {}
    coords: dict[str, Any] = {}
    for n, run in enumerate(result.runs):
        for y, c in enumerate(run.prepared.outputs):
            output, there = run.prepared.channels[c], run.prepared.kind[:, y] == VALUE
            name, time = f"{output.name}_{n}", f"time_{output.name}_{n}"
            units = {"units": output.si_unit}
            coords[time] = run.prepared.instants[there]
            if predicted is None:
                variables[name] = ((time,), run.prepared.reading[there, y], units)
            else:
                shown = predicted[n][None, :, there, y]
                variables[name] = (("chain", "draw", time), shown, units)
    return xarray.Dataset(variables, coords=coords, attrs=_about())
