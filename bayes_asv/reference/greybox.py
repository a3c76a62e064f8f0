"""Grey-box point estimates, in the reference's integrated states and in deflections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.free_response import free_response
from bayes_asv.models.car_model import state_space
from bayes_asv.models.half_car_equations import HalfCar
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.resampling import at_own_rate
from bayes_asv.preprocessing.run_preparation import prepare_runs
from bayes_asv.reference.integrated import Integrated, integrate, simulate_states
from bayes_asv.reference.prediction_error import (
    IndependenceTest,
    PredictionErrorFit,
    WhitenessTest,
    fit_percent,
    independence_test,
    minimise,
    whiteness_test,
)

__all__ = [
    "COORDINATES",
    "HOLDS",
    "INITIAL",
    "ParameterEstimate",
    "PointEstimate",
    "fit_deflections",
    "fit_states",
    "grey_box",
]

Array = NDArray[np.float64]

COORDINATES: Final = ("deflection", "integrated")
INITIAL: Final = ("estimated", "zero")
HOLDS: Final = ("straight", "held")

_OUTPUTS: Final = {
    "deflection": ("front_chassis", "rear_chassis"),
    "integrated": ("pitch", "pitch_rate", "heave", "heave_rate"),
}
_INPUTS: Final = {
    "deflection": ("front_wheel", "rear_wheel"),
    "integrated": ("front_wheel", "rear_wheel"),
}


@dataclass(frozen=True)
class ParameterEstimate:
    """One estimated parameter, SI units, with its standard deviation from the curvature."""

    value: float
    sd: float


@dataclass(frozen=True)
class PointEstimate:
    """A prediction-error estimate with tests of its residuals.

    Parameters
    ----------
    verdict : str
        ``ok``, ``not_converged`` or ``refused``.
    reasons, warnings : tuple of str
        Reasons for a refusal, and warnings.
    coordinates, initial, detrending, hold : str
        Options of the method.
    parameters : dict of str to ParameterEstimate
        c_f, c_r, i and k_g; empty if refused.
    minimum : PredictionErrorFit or None
        The minimum of the criterion.
    time : (N,) array
        Times of the outputs, s.
    measured, simulated : (N, q) arrays
        Outputs; nan where a reading is missing.
    wheels : (N, 2) array
        Inputs of the independence tests.
    fit : dict of str to float
        Fit of each output, percent.
    whiteness : dict of str to WhitenessTest
        By output.
    independence : dict of (str, str) to IndependenceTest
        By output and input.
    travel : (N, 2) array
        Suspension deflection of the simulation, extension positive, m.
    """

    verdict: str
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    coordinates: str
    initial: str
    detrending: str
    hold: str
    parameters: dict[str, ParameterEstimate]
    minimum: PredictionErrorFit | None
    time: Array
    measured: Array
    simulated: Array
    wheels: Array
    fit: dict[str, float]
    whiteness: dict[str, WhitenessTest]
    independence: dict[tuple[str, str], IndependenceTest]
    travel: Array


def grey_box(
    recording: Recording,
    vehicle: Vehicle,
    *,
    coordinates: str = "deflection",
    initial: str = "estimated",
    detrending: str = "trend",
    hold: str = "held",
) -> PointEstimate:
    """Estimate c_f, c_r and i from one recording, with m, l, wdf, k_f and k_r exact.

    Parameters
    ----------
    recording, vehicle : Recording, Vehicle
        As read.
    coordinates : {'deflection', 'integrated'}
        Accelerations as inputs and outputs, or the reference's method: integrated twice, with the
        four states as outputs (eq. 5.6).
    initial : {'estimated', 'zero'}
        Initial state; zero in the reference (App. C.2).
    detrending : str
        One of :data:`bayes_asv.reference.integrated.DETRENDINGS`; not used in deflections, where
        a bias of each chassis channel is estimated.
    hold : {'held', 'straight'}
        Inputs between samples in the integrated states; in deflections they are a spline.

    Returns
    -------
    PointEstimate
        Its verdict reports a refusal or lack of convergence.

    Raises
    ------
    InputError
        If the units of the recording cannot be converted.
    ValueError
        If an option is unknown.
    """
    for value, known in ((coordinates, COORDINATES), (initial, INITIAL), (hold, HOLDS)):
        if value not in known:
            raise ValueError(f"{value!r} is none of {', '.join(known)}")
    recording = at_own_rate(recording)
    recordings, reasons, warnings = prepare_runs((recording,), vehicle)
    if reasons:
        nothing = np.zeros((0, 2))
        return PointEstimate(
            "refused", reasons, warnings, coordinates, initial, detrending, hold, {}, None,
            np.zeros(0), nothing, nothing, nothing, {}, {}, {}, nothing,
        )  # fmt: skip
    if coordinates == "deflection":
        return fit_deflections(recordings[0], vehicle, initial=initial, warnings=warnings)
    data = integrate(recording, vehicle, detrending)
    return fit_states(
        data.time, data.u, data.y, vehicle, initial=initial, hold=hold, detrending=detrending,
        wheels=data.acceleration[[0, 2]].T, warnings=warnings,
    )  # fmt: skip


def nominal_car(vehicle: Vehicle) -> HalfCar:
    """Return the nominal half car of a vehicle."""
    return HalfCar(*(getattr(vehicle, name).value for name in HalfCar._fields))


def fit_deflections(
    recording: PreparedRecording,
    vehicle: Vehicle,
    *,
    initial: str = "estimated",
    warnings: tuple[str, ...] = (),
) -> PointEstimate:
    """Fit a simulation from the wheel accelerations to the chassis accelerations.

    The biases of both chassis channels are estimated, and so are the initial deflections and their
    rates unless `initial` is zero.
    """
    nominal = nominal_car(vehicle)
    starts = np.eye(6)[: 4 if initial == "estimated" else 0]
    driven = recording.measurements
    still = driven._replace(moments=np.zeros_like(driven.moments))

    def run(theta: Array) -> tuple[Array, Array]:
        values = {n: np.array([x]) for n, x in _car(nominal, theta)._asdict().items()}
        system = state_space(recording.car, values, recording.output_models)
        responses = [free_response(system, driven, np.zeros((1, 6)))]
        if len(starts):
            responses.append(free_response(system, still, starts))
        outputs, states = (
            np.moveaxis(np.concatenate(x), 0, 2) for x in zip(*responses, strict=True)
        )
        return states, outputs

    def model(theta: Array) -> tuple[Array, Array]:
        outputs = run(theta)[1]
        paired = np.stack(
            [_paired(recording, outputs[:, :, c]) for c in range(outputs.shape[2])], axis=2
        )
        biases = np.zeros((len(paired), 2, 2))
        biases[:, 0, 0] = biases[:, 1, 1] = 1.0
        return paired[:, :, 0], np.concatenate([paired[:, :, 1:], biases], axis=2)

    measured = recording.paired(recording.reading)
    minimum = minimise(model, measured, _start(nominal))
    base, design = model(minimum.theta)
    states = run(minimum.theta)[0]
    free = states[:, :, 0] + states[:, :, 1:] @ minimum.beta[:-2]
    at = recording.group_instants.max(axis=1)
    time = recording.instants[at]
    return _point_estimate(
        minimum, nominal, ("deflection", initial, "bias estimated", "spline"), time, measured,
        base + design @ minimum.beta, _wheels(recording, time), free[at][:, [0, 2]], warnings,
    )  # fmt: skip


def fit_states(
    time: Array,
    u: Array,
    y: Array,
    vehicle: Vehicle,
    *,
    initial: str = "zero",
    hold: str = "held",
    detrending: str = "none",
    wheels: Array | None = None,
    warnings: tuple[str, ...] = (),
) -> PointEstimate:
    """Fit the reference's four states, with wheel positions and velocities as inputs.

    Parameters
    ----------
    time : (N,) array
        Evenly spaced times, s.
    u, y : (N, 4) arrays
        Inputs (eq. 5.4) and outputs (eq. 5.3), SI units.
    vehicle : Vehicle
        Known and nominal values.
    initial, hold, detrending : str
        As for :func:`grey_box`.
    wheels : (N, 2) array, optional
        Inputs of the independence tests; wheel velocities by default.
    warnings : tuple of str
        Included in the result.
    """
    nominal = nominal_car(vehicle)
    h = float(time[1] - time[0])

    def model(theta: Array) -> tuple[Array, Array]:
        return simulate_states(
            _car(nominal, theta), h, u, held=hold == "held", free=initial == "estimated"
        )

    minimum = minimise(model, y, _start(nominal))
    base, design = model(minimum.theta)
    simulated = base + design @ minimum.beta
    lever = np.array([nominal.l_f, -nominal.l_r])
    travel = simulated[:, 2:3] + simulated[:, :1] * lever - u[:, [0, 2]]
    return _point_estimate(
        minimum, nominal, ("integrated", initial, detrending, hold), time, y, simulated,
        u[:, [1, 3]] if wheels is None else wheels, travel, warnings,
    )  # fmt: skip


def largest_travel(data: Integrated) -> Array:
    """Return the largest absolute deflection (2,), front and rear, m: travel, or drift."""
    return np.asarray(np.abs(data.travel).max(axis=1))


def _car(nominal: HalfCar, theta: Array) -> HalfCar:
    c_f, c_r, i = np.exp(theta)
    return nominal._replace(c_f=float(c_f), c_r=float(c_r), i=float(i))


def _start(nominal: HalfCar) -> Array:
    return np.log([nominal.c_f, nominal.c_r, nominal.i])


def _paired(recording: PreparedRecording, values: Array) -> Array:
    """Arrange model outputs (E, 2) by pairs of readings; missing ones become zero."""
    return np.asarray(np.nan_to_num(recording.paired(values)))


def _wheels(recording: PreparedRecording, time: Array) -> Array:
    return np.stack([wheel.spline(time) for wheel in recording.wheels], axis=1)


def _point_estimate(
    minimum: PredictionErrorFit,
    nominal: HalfCar,
    options: tuple[str, str, str, str],
    time: Array,
    measured: Array,
    simulated: Array,
    wheels: Array,
    travel: Array,
    warnings: tuple[str, ...],
) -> PointEstimate:
    """Build the point estimate of a minimum, with its residual tests."""
    sd = np.sqrt(np.maximum(np.diag(minimum.covariance)[:3], 0.0))
    values = np.exp(minimum.theta)
    parameters = {
        name: ParameterEstimate(float(v), float(v * s))
        for name, v, s in zip(("c_f", "c_r", "i"), values, sd, strict=True)
    }
    k_g = float(np.sqrt(values[2] / nominal.m))
    parameters["k_g"] = ParameterEstimate(k_g, 0.5 * k_g * float(sd[2]))
    names = _OUTPUTS[options[0]]
    rows = np.all(np.isfinite(measured), axis=1)
    residual = (measured - simulated)[rows]
    inputs = wheels[rows] - wheels[rows].mean(axis=0)
    return PointEstimate(
        verdict="ok" if minimum.converged else "not_converged",
        reasons=(),
        warnings=warnings,
        coordinates=options[0],
        initial=options[1],
        detrending=options[2],
        hold=options[3],
        parameters=parameters,
        minimum=minimum,
        time=time,
        measured=measured,
        simulated=simulated,
        wheels=wheels,
        fit={n: fit_percent(measured[rows, k], simulated[rows, k]) for k, n in enumerate(names)},
        whiteness={n: whiteness_test(residual[:, k]) for k, n in enumerate(names)},
        independence={
            (n, w): independence_test(residual[:, k], inputs[:, j])
            for k, n in enumerate(names)
            for j, w in enumerate(_INPUTS[options[0]])
        },
        travel=travel,
    )
