"""Messages about unidentified parameters: before a fit, and at its mode."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bayes_asv.domain.channels import Channel
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarModel
from bayes_asv.posterior.information import (
    WIDE_PRIOR,
    fisher_information,
    make_parameter_prior,
    predicted_sd,
    unmeasured,
)
from bayes_asv.posterior.newton import PosteriorMode
from bayes_asv.posterior.parameters import ParameterSpace
from bayes_asv.preprocessing.prepared_recording import PreparedRecording

__all__ = [
    "sensor_for", "unidentified_after_fit", "unidentified_before_fit", "unidentified_sentence",
]  # fmt: skip


def unidentified_before_fit(
    recordings: tuple[PreparedRecording, ...], vehicle: Vehicle
) -> tuple[str, ...]:
    """Name, before any fit, the parameters that recordings cannot determine.

    Parameters
    ----------
    recordings : tuple of PreparedRecording
        Recordings that passed :func:`bayes_asv.preprocessing.run_preparation.prepare_runs`.
    vehicle : Vehicle
        Gives the priors, and the values at which the information is computed.

    Returns
    -------
    tuple of str
        A sentence for each parameter of interest about which the recordings have almost no Fisher
        information (:mod:`bayes_asv.posterior.information`).
    """
    outputs = tuple(
        dict.fromkeys(output for recording in recordings for output in recording.output_models)
    )
    parameter_prior = make_parameter_prior(recordings[0].car, outputs)
    information = sum(
        (fisher_information(recording, vehicle, parameter_prior) for recording in recordings),
        np.zeros((len(parameter_prior.names), len(parameter_prior.names))),
    )
    gradients = {
        name: parameter_prior.log_gradients[name] for name in parameter_prior.car.estimated
    }
    prior = {name: parameter_prior.sd(name) for name in gradients}
    after = predicted_sd(information, 1, parameter_prior, gradients)
    measured = [output.channel for output in outputs]
    return tuple(
        unidentified_sentence(parameter_prior.car, measured, name, prior[name])
        for name in unmeasured(prior, after)
    )


def unidentified_after_fit(
    parameter_space: ParameterSpace, mode: PosteriorMode
) -> tuple[list[str], list[str]]:
    """Refuse if the data add little to a wide prior; warn if the prior is informative."""
    prior = {name: parameter_space.log_prior_of(name)[1] for name in parameter_space.car.estimated}
    after = {name: parameter_space.log_deviation(mode.covariance, name) for name in prior}
    measured = [
        o.channel for recording in parameter_space.recordings for o in recording.output_models
    ]
    reasons: list[str] = []
    warnings: list[str] = []
    for name in unmeasured(prior, after):
        words = unidentified_sentence(parameter_space.car, measured, name, prior[name])
        (reasons if prior[name] > WIDE_PRIOR else warnings).append(words)
    return reasons, warnings


def unidentified_sentence(
    car: CarModel, measured: Sequence[Channel], name: str, prior: float
) -> str:
    """Say that data hardly constrain a parameter, and which measurement would.

    Parameters
    ----------
    car : CarModel
        The car.
    measured : sequence of Channel
        Its measured outputs.
    name : str
        The parameter.
    prior : float
        Prior standard deviation of its logarithm.
    """
    label = f"{QUANTITIES[name][1]} ({name})"
    fix = sensor_for(car, measured, name) or f"{_drive(car, name)}, faster or over a higher one"
    if prior > WIDE_PRIOR:
        return f"the recording hardly constrains the {label}: {fix}"
    return (
        f"the recording hardly improves on the given {label} and its sd, so its interval is "
        f"that of the vehicle file: {fix}"
    )


def sensor_for(car: CarModel, measured: Sequence[Channel], name: str) -> str | None:
    """Name the sensor that is missing for a parameter; None if there is one."""
    for element in car.elements:
        if element.damping == name:
            is_measured = any(
                c.axle == element.axle and c.side in (None, element.side)
                for c in measured
                if c.part in ("body", "suspension")
            )
            return (
                None
                if is_measured
                else f"measure the {element.words} suspension travel or the body above it as well"
            )
    axles = {c.axle for c in measured if c.axis is None}
    rotation = "roll" if name == "i_roll" else "pitch"
    if any(c.axis == rotation for c in measured) or len(axles) > 1:
        return None
    return "measure the body above the other axle or its pitch rate as well"


def _drive(car: CarModel, name: str) -> str:
    """Describe a drive that would determine a parameter."""
    for element in car.elements:
        if element.damping == name:
            wheels = f"{element.name.replace('_', ' ')} wheel" + (
                "s" if element.side is None else ""
            )
            return f"drive the {wheels} over a bump"
    if name == "i_roll":
        return "drive one side of the car over a bump"
    return "drive over a bump that pitches the car, such as a parking stop"
