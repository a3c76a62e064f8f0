"""The problem that all peers get: one shipped recording, its model, priors and noise.

What a peer needs is written to one file, so that it runs in an environment of its own.  The car's
parameters are exp(first + slopes z), the weight fraction first + slopes z, of standard normal
coordinates z.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.vehicle import read_vehicle
from bayes_asv.io import read_recording
from bayes_asv.posterior.likelihood import Posterior
from bayes_asv.posterior.map_fit import MapFit, best_fit
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.shipped import shipped

__all__ = ["CAR", "Problem", "make_problem"]

Array = NDArray[np.float64]

CAR = ("m", "l", "wdf", "k_f", "k_r", "c_f", "c_r", "i")
"""Parameters of the half car, SI units."""
_POINTS = 256  # where log posteriors are compared


class Problem(NamedTuple):
    """A posterior and what peers are told of it.

    Parameters
    ----------
    posterior : Posterior
        Of the recording.
    fit : MapFit
        Its mode.
    points : (W, D) array
        Coordinates around the mode.
    """

    posterior: Posterior
    fit: MapFit
    points: Array

    def data(self) -> dict[str, Any]:
        """Return arrays for :func:`numpy.savez`."""
        space, recording = self.posterior.space, self.posterior.space.recordings[0]
        d = space.dimension
        here = _logs(space.values(np.zeros((1, d))))
        there = _logs(space.values(np.eye(d)))
        levels = [space.index[f"noise {recording.channels[c].name} 0"] for c in recording.order]
        share = space.coordinates[space.index["filtered share 0"]]
        noisy = [space.coordinates[k] for k in levels]
        m = recording.measurements
        return {
            "first": here[0], "slopes": there - here, "levels": levels,
            "level_centre": [one.centre for one in noisy],
            "level_scale": [one.scale for one in noisy],
            "share": space.index["filtered share 0"],
            "share_centre": share.centre, "share_scale": share.scale,
            "poles": recording.poles[list(recording.order)],
            "steps": recording.quantization_steps[list(recording.order)],
            "step": m.step, "moments": m.moments, "spread": m.process_noise, "kind": m.kind,
            "reading": m.reading, "extra": m.extra_variance, "start": m.initial_covariance,
            "mode": self.fit.mode.z, "covariance": self.fit.mode.covariance,
            "points": self.points, "values": self.posterior.log_posterior(self.points),
            "time": recording.times[recording.outputs[0]],
            "wheels": recording.values[list(recording.inputs)],
            "chassis": recording.values[list(recording.outputs)],
        }  # fmt: skip


def _logs(values: dict[str, Array]) -> Array:
    """Return the car's parameters (W, 8), logarithms of all but the weight fraction."""
    return np.stack([values[n] if n == "wdf" else np.log(values[n]) for n in CAR], axis=1)


def make_problem(seed: int) -> Problem:
    """Prepare the shipped drive over parking stops and find its mode."""
    vehicle = read_vehicle(Path(shipped("vehicles", "baja2008.toml")))
    recording = read_recording(Path(shipped("recordings", "stops-400hz.csv")))
    lines, reasons, _ = prepare_runs([recording], vehicle)
    assert not reasons
    fit = best_fit(lines, vehicle)
    rng = np.random.default_rng(seed)
    root = np.linalg.cholesky(fit.mode.covariance)
    points = fit.mode.z + rng.normal(size=(_POINTS, len(fit.mode.z))) @ root.T
    return Problem(fit.posterior, fit, points)
