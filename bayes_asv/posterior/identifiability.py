"""Which answers recordings can give, in sentences: before a fit, and at its mode."""

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
    """Say, before anything is fitted, which answers recordings cannot give.

    Parameters
    ----------
    recordings : tuple of PreparedRecording
        Recordings that passed :func:`bayes_asv.preprocessing.run_preparation.prepare_runs`.
    vehicle : Vehicle
        Gives the priors, and the values at which the information is computed.

    Returns
    -------
    tuple of str
        A sentence for each answer of which the recordings say next to nothing by their Fisher
        information (:mod:`bayes_asv.posterior.information`).
    """
    outputs = tuple(
        dict.fromkeys(output for recording in recordings for output in recording.output_models)
    )
    about = make_parameter_prior(recordings[0].car, outputs)
    information = sum(
        (fisher_information(recording, vehicle, about) for recording in recordings),
        np.zeros((len(about.names), len(about.names))),
    )
    asked = {name: about.log_gradients[name] for name in about.car.estimated}
    prior = {name: about.sd(name) for name in asked}
    after = predicted_sd(information, 1, about, asked)
    measured = [output.channel for output in outputs]
    return tuple(
        unidentified_sentence(about.car, measured, name, prior[name])
        for name in unmeasured(prior, after)
    )


def unidentified_after_fit(
    parameter_space: ParameterSpace, mode: PosteriorMode
) -> tuple[list[str], list[str]]:
    """Refuse when the drive taught next to nothing about an answer; warn where a prior is one."""
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
    """Say that data tell next to nothing about a parameter, and what would.

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
    """Say which sensor is missing for a parameter; None where its place is measured."""
    for element in car.elements:
        if element.damping == name:
            near = any(
                c.axle == element.axle and c.side in (None, element.side)
                for c in measured
                if c.part in ("body", "suspension")
            )
            return (
                None
                if near
                else f"measure the {element.words} suspension travel or the body above it as well"
            )
    axles = {c.axle for c in measured if c.axis is None}
    turning = "roll" if name == "i_roll" else "pitch"
    if any(c.axis == turning for c in measured) or len(axles) > 1:
        return None
    return "measure the body above the other axle or its pitch rate as well"


def _drive(car: CarModel, name: str) -> str:
    """Say what drive would show a parameter."""
    for element in car.elements:
        if element.damping == name:
            wheels = f"{element.name.replace('_', ' ')} wheel" + (
                "s" if element.side is None else ""
            )
            return f"drive the {wheels} over a bump"
    if name == "i_roll":
        return "drive one side of the car over a bump"
    return "drive over a bump that pitches the car, such as a parking stop"
