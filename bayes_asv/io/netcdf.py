"""Draws as ArviZ ``InferenceData``, a netCDF file that ArviZ 0.23 and 1.x both open."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bayes_asv import __version__
from bayes_asv.domain.files import write_atomically
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units

if TYPE_CHECKING:
    from bayes_asv.estimation import Estimate

__all__ = ["write_netcdf"]


def write_netcdf(result: Estimate, path: str | os.PathLike[str]) -> None:
    """Write posterior and sample statistics, one chain an ensemble.

    Parameters
    ----------
    result : Estimate
        With draws.
    path : path-like
        Written whole or not at all.  Groups ``posterior`` (SI units, named in each variable's
        ``units`` attribute) and ``sample_stats`` (``lp``, not normalised).

    Raises
    ------
    InputError
        When the file cannot be written.
    """
    import xarray as xr

    about = {"inference_library": "bayes_asv", "inference_library_version": __version__}
    si = display_units("SI")
    posterior = {}
    for name, draws in result.draws.items():
        unit = si[QUANTITIES[name][0]]
        posterior[name] = xr.DataArray(draws, dims=("chain", "draw"), attrs={"units": unit})
    for name, draws in result.nuisance.items():
        unit = si["acceleration"] if name.startswith("noise") else ""
        posterior[name.replace(" ", "_")] = xr.DataArray(
            draws, dims=("chain", "draw"), attrs={"units": unit}
        )
    chains, count = next(iter(result.draws.values())).shape
    axes = {"chain": np.arange(chains), "draw": np.arange(count)}
    groups = {
        "posterior": xr.Dataset(posterior, coords=axes, attrs=about),
        "sample_stats": xr.Dataset(
            {"lp": (("chain", "draw"), result.log_posterior)}, coords=axes, attrs=about
        ),
    }
    with tempfile.TemporaryDirectory() as folder:
        draft = Path(folder) / "draws.nc"
        for group, dataset in groups.items():
            first = group == "posterior"
            dataset.to_netcdf(draft, mode="w" if first else "a", group=group, engine="h5netcdf")
        write_atomically(path, draft.read_bytes())
