"""The reference's method, a grey-box point estimate, in its coordinates and in deflections."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.filters.free_response import free_run
from bayes_asv.models.half_car import HalfCar, deflection_form
from bayes_asv.posterior.map_fit import lay_out
from bayes_asv.preprocessing.timeline import PreparedRecording
from bayes_asv.reference.integrated import Integrated, integrate, simulate_states
from bayes_asv.reference.prediction_error import Fitted, minimise
from bayes_asv.reference.residuals import (
    Independence,
    Whiteness,
    fit_percent,
    independence,
    whiteness,
)

__all__ = [
    "COORDINATES",
    "HOLDS",
    "INITIAL",
    "Answer",
    "PointEstimate",
    "estimate_states",
    "grey_box",
    "in_deflections",
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
class Answer:
    """One estimated parameter, SI units, with the deviation that the curvature claims."""

    value: float
    sd: float


@dataclass(frozen=True)
class PointEstimate:
    """A prediction-error estimate and what it leaves.

    Parameters
    ----------
    verdict : str
        ``ok``, ``not_converged`` or ``refused``.
    reasons, warnings : tuple of str
        Why it was refused; what to know otherwise.
    coordinates, initial, removal, hold : str
        How it was made.
    answers : dict of str to Answer
        c_f, c_r, i and k_g; empty when refused.
    fitted : Fitted or None
        The minimum.
    time : (N,) array
        Instants of the outputs, s.
    measured, simulated : (N, q) arrays
        Outputs; nan where there was no reading.
    wheels : (N, 2) array
        Inputs that the residuals are held against.
    fit : dict of str to float
        Percentage of each output explained.
    white : dict of str to Whiteness
    independent : dict of (output, input) to Independence
    travel : (N, 2) array
        Suspension deflection of the simulation, extension positive, m.
    """

    verdict: str
    reasons: tuple[str, ...]
    warnings: tuple[str, ...]
    coordinates: str
    initial: str
    removal: str
    hold: str
    answers: dict[str, Answer]
    fitted: Fitted | None
    time: Array
    measured: Array
    simulated: Array
    wheels: Array
    fit: dict[str, float]
    white: dict[str, Whiteness]
    independent: dict[tuple[str, str], Independence]
    travel: Array


def grey_box(
    recording: Recording,
    vehicle: Vehicle,
    *,
    coordinates: str = "deflection",
    initial: str = "estimated",
    removal: str = "trend",
    hold: str = "held",
) -> PointEstimate:
    """Point estimate of c_f, c_r and i from one recording, m, l, wdf, k_f and k_r taken as exact.

    Parameters
    ----------
    recording, vehicle : Recording, Vehicle
        As read.
    coordinates : {'deflection', 'integrated'}
        Accelerations in and out, or the reference's way: everything integrated twice, the four
        states as outputs (eq. 5.6).
    initial : {'estimated', 'zero'}
        Initial state, the reference has zero (App. C.2).
    removal : str
        One of :data:`bayes_asv.reference.integrated.REMOVALS`; without meaning in deflections,
        where a bias of each chassis channel is estimated.
    hold : {'held', 'straight'}
        Inputs between samples in the integrated way; in deflections they are a spline.

    Returns
    -------
    PointEstimate
        Refusal and lack of convergence are verdicts in it.

    Raises
    ------
    InputError
        When the recording cannot be brought into units.
    ValueError
        For an unknown way.
    """
    for value, known in ((coordinates, COORDINATES), (initial, INITIAL), (hold, HOLDS)):
        if value not in known:
            raise ValueError(f"{value!r} is none of {', '.join(known)}")
    lines, reasons, warnings = lay_out((recording,), vehicle)
    if reasons:
        nothing = np.zeros((0, 2))
        return PointEstimate(
            "refused", reasons, warnings, coordinates, initial, removal, hold, {}, None,
            np.zeros(0), nothing, nothing, nothing, {}, {}, {}, nothing,
        )  # fmt: skip
    if coordinates == "deflection":
        return in_deflections(lines[0], vehicle, initial=initial, warnings=warnings)
    data = integrate(recording, vehicle, removal)
    return estimate_states(
        data.time, data.u, data.y, vehicle, initial=initial, hold=hold, removal=removal,
        wheels=data.acceleration[[0, 2]].T, warnings=warnings,
    )  # fmt: skip


def nominal_car(vehicle: Vehicle) -> HalfCar:
    """Return the nominal half car of a vehicle."""
    return HalfCar(*(getattr(vehicle, name).value for name in HalfCar._fields))


def in_deflections(
    line: PreparedRecording,
    vehicle: Vehicle,
    *,
    initial: str = "estimated",
    warnings: tuple[str, ...] = (),
) -> PointEstimate:
    """Fit chassis accelerations to a free run from the wheel accelerations.

    Biases of both chassis channels are estimated, for an accelerometer has one; the initial
    deflection and its rate are unknown too unless they are said to be zero.
    """
    nominal = nominal_car(vehicle)
    start = np.zeros((4, 5 if initial == "estimated" else 1))
    start[:, 1:] = np.eye(4)[:, : start.shape[1] - 1]
    driven = np.zeros(start.shape[1])
    driven[0] = 1.0

    def run(theta: Array) -> tuple[Array, Array]:
        system = deflection_form(_car(nominal, theta))
        states = np.empty((len(line.step), 4, start.shape[1]))
        free_run(system.A, line.step, line.moments, start, driven, states)
        return states, np.einsum("oa,nac->noc", system.C, states)

    def model(theta: Array) -> tuple[Array, Array]:
        outputs = run(theta)[1]
        paired = np.stack(
            [_paired(line, outputs[:, :, c]) for c in range(outputs.shape[2])], axis=2
        )
        biases = np.zeros((len(paired), 2, 2))
        biases[:, 0, 0] = biases[:, 1, 1] = 1.0
        return paired[:, :, 0], np.concatenate([paired[:, :, 1:], biases], axis=2)

    measured = line.paired(line.reading)
    fitted = minimise(model, measured, _start(nominal))
    base, design = model(fitted.theta)
    states = run(fitted.theta)[0]
    free = states[:, :, 0] + states[:, :, 1:] @ fitted.beta[:-2]
    at = line.pairs.max(axis=1)
    time = line.instants[at]
    return _told(
        fitted, nominal, ("deflection", initial, "bias estimated", "spline"), time, measured,
        base + design @ fitted.beta, _wheels(line, time), free[at][:, [0, 2]], warnings,
    )  # fmt: skip


def estimate_states(
    time: Array,
    u: Array,
    y: Array,
    vehicle: Vehicle,
    *,
    initial: str = "zero",
    hold: str = "held",
    removal: str = "none",
    wheels: Array | None = None,
    warnings: tuple[str, ...] = (),
) -> PointEstimate:
    """Fit the reference's four states to inputs of positions and velocities.

    Parameters
    ----------
    time : (N,) array
        Even instants, s.
    u, y : (N, 4) arrays
        Inputs (eq. 5.4) and outputs (eq. 5.3), SI units.
    vehicle : Vehicle
        Known and nominal values.
    initial, hold, removal : str
        As for :func:`grey_box`.
    wheels : (N, 2) array, optional
        What residuals are held against; wheel velocities by default.
    warnings : tuple of str
        Passed on.
    """
    nominal = nominal_car(vehicle)
    h = float(time[1] - time[0])

    def model(theta: Array) -> tuple[Array, Array]:
        return simulate_states(
            _car(nominal, theta), h, u, held=hold == "held", free=initial == "estimated"
        )

    fitted = minimise(model, y, _start(nominal))
    base, design = model(fitted.theta)
    simulated = base + design @ fitted.beta
    lever = np.array([nominal.l_f, -nominal.l_r])
    travel = simulated[:, 2:3] + simulated[:, :1] * lever - u[:, [0, 2]]
    return _told(
        fitted, nominal, ("integrated", initial, removal, hold), time, y, simulated,
        u[:, [1, 3]] if wheels is None else wheels, travel, warnings,
    )  # fmt: skip


def drift(data: Integrated) -> Array:
    """Largest distance (2,) between chassis and wheel, front and rear, m: travel, or drift."""
    return np.asarray(np.abs(data.travel).max(axis=1))


def _car(nominal: HalfCar, theta: Array) -> HalfCar:
    c_f, c_r, i = np.exp(theta)
    return nominal._replace(c_f=float(c_f), c_r=float(c_r), i=float(i))


def _start(nominal: HalfCar) -> Array:
    return np.log([nominal.c_f, nominal.c_r, nominal.i])


def _paired(line: PreparedRecording, values: Array) -> Array:
    """Model outputs (E, 2) by pairs of readings; what was not read is not needed."""
    return np.asarray(np.nan_to_num(line.paired(values)))


def _wheels(line: PreparedRecording, time: Array) -> Array:
    return np.stack([wheel.spline(time) for wheel in line.wheels], axis=1)


def _told(
    fitted: Fitted,
    nominal: HalfCar,
    ways: tuple[str, str, str, str],
    time: Array,
    measured: Array,
    simulated: Array,
    wheels: Array,
    travel: Array,
    warnings: tuple[str, ...],
) -> PointEstimate:
    """Put a minimum into words and tests."""
    sd = np.sqrt(np.maximum(np.diag(fitted.covariance)[:3], 0.0))
    values = np.exp(fitted.theta)
    answers = {
        name: Answer(float(v), float(v * s))
        for name, v, s in zip(("c_f", "c_r", "i"), values, sd, strict=True)
    }
    k_g = float(np.sqrt(values[2] / nominal.m))
    answers["k_g"] = Answer(k_g, 0.5 * k_g * float(sd[2]))
    names = _OUTPUTS[ways[0]]
    rows = np.all(np.isfinite(measured), axis=1)
    left = (measured - simulated)[rows]
    inputs = wheels[rows] - wheels[rows].mean(axis=0)
    return PointEstimate(
        verdict="ok" if fitted.converged else "not_converged",
        reasons=(),
        warnings=warnings,
        coordinates=ways[0],
        initial=ways[1],
        removal=ways[2],
        hold=ways[3],
        answers=answers,
        fitted=fitted,
        time=time,
        measured=measured,
        simulated=simulated,
        wheels=wheels,
        fit={n: fit_percent(measured[rows, k], simulated[rows, k]) for k, n in enumerate(names)},
        white={n: whiteness(left[:, k]) for k, n in enumerate(names)},
        independent={
            (n, w): independence(left[:, k], inputs[:, j])
            for k, n in enumerate(names)
            for j, w in enumerate(_INPUTS[ways[0]])
        },
        travel=travel,
    )
