"""Faults that are not in the list: what each would change in a recording, along the motion.

A damper in a rubber mount or with play, hysteresis, a damper that depends on travel or on the
square of its speed, a mass on a spring, a resonant sensor mount, a sensor at another position or
with a drifting clock.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter

from bayes_asv.domain.channels import Channel
from bayes_asv.filters.kalman import MISSING, ORDER
from bayes_asv.models.car_model import CarModel, Output, Values, state_space
from bayes_asv.models.effects import BOTH
from bayes_asv.posterior.fitted_model import Dataset
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.likelihood import Perturbation, Posterior
from bayes_asv.preprocessing.measured_inputs import denoise_wheel, denoised, sample_noise
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments

__all__ = ["PredictedMotion", "UnlistedFault", "predicted_motion", "unlisted_faults"]

Array = NDArray[np.float64]
ForceLaw = Callable[[Array, Array, Array], Array]
"""From time (s), deflection (m) and velocity (m/s) to a force on the chassis (N), all (E,)."""
Distortion = Callable[[Array, Array], Array]
"""From the times (s) and samples of a channel to a change of the samples, all (n,)."""

_MOUNT_TIME_CONSTANTS = (0.001, 0.004, 0.015)  # s, c/k of a damper's mount
_PLAY = (0.05, 0.2, 0.5)  # in rms deflections
_YIELD_TRAVEL = (0.05, 0.2, 0.6)  # in rms deflections, over which friction builds up
_SEAT_FREQUENCIES = (2.5, 3.0, 3.5, 4.2, 5.0, 6.0)  # Hz, a seat's resonance width apart
_SEAT_DAMPING = 0.2  # damping ratio
# Hz.  A mount whose resonance f₀ is above what the car excites still reads high by f²/f₀².
_MOUNT_FREQUENCIES = (15.0, 21.0, 30.0, 42.0, 60.0, 85.0, 120.0, 170.0, 240.0)
_MOUNT_DAMPING = 0.03  # damping ratio
_SUBSTEPS = 4  # steps of a linear system to one of its signal


class UnlistedFault(NamedTuple):
    """Perturbation of one run by an unlisted fault of arbitrary size.

    Parameters
    ----------
    description : str
        What the fault is.
    perturbation : Perturbation
        The change of the run.
    power, reference : float
        Mean square of the change, and of what it is to be a small share of.
    """

    description: str
    perturbation: Perturbation
    power: float
    reference: float


class PredictedMotion(NamedTuple):
    """Predicted motion of a car in one run.

    Parameters
    ----------
    readings : (E, ny) array
        What the outputs would read without noise, SI units.
    deflection, velocity : (E, ne) arrays
        Deflections (m) and their rates (m/s) of the elements before the sensors' filter.
    body : (E, ne) array
        Acceleration of the body above each element behind that filter, m/s²; as the sensor above it
        would read it, where there is one.
    """

    readings: Array
    deflection: Array
    velocity: Array
    body: Array


def predicted_motion(dataset: Dataset, posterior: Posterior, z: Array, run: int) -> PredictedMotion:
    """Predict the motion of a car in one run by its free simulation.

    The filtered states follow the readings and would share their noise.
    """
    recording = dataset.recordings[run]
    readings, states, _ = free_run(posterior, z, run)
    time = recording.instants - recording.instants[0]
    pole = posterior.patterns[run].pole
    of_elements = slice(2 * len(recording.car.elements))
    deflection, velocity = states[:, of_elements][:, 0::2], states[:, of_elements][:, 1::2]
    acceleration = np.empty_like(velocity)
    for e, c in enumerate(recording.inputs):
        derivative = CubicSpline(time, velocity[:, e])(time, 1)
        acceleration[:, e] = denoised(time, derivative, sample_noise(recording, c), None)
    return PredictedMotion(
        readings,
        deflection + velocity / pole,
        velocity + acceleration / pole,
        _body(recording, posterior.space.values(z[None]), readings, states),
    )


def _body(recording: PreparedRecording, values: Values, readings: Array, states: Array) -> Array:
    """Accelerations (E, ne) of the body above the elements, from the outputs or else the states."""
    tops = [
        Channel(element.name, "acceleration", "body", element.axle, element.side)
        for element in recording.car.elements
    ]
    system = state_space(recording.car, values, [Output(top) for top in tops])
    ne = len(tops)
    # states without an equation of their own among the tops are rates that nothing else follows
    moved = np.hstack([states[:, : 2 * ne], states[:, len(states[0]) - ne :]])
    out = moved @ np.hstack([system.C[0], system.G[0]]).T
    for y in recording.accelerations:
        place = recording.channels[recording.outputs[y]]
        for e, top in enumerate(tops):
            if (place.axle, place.side, place.position) == (top.axle, top.side, None):
                out[:, e] = readings[:, y]
    return np.asarray(out)


def unlisted_faults(
    dataset: Dataset,
    run: int,
    motion: PredictedMotion,
    car: CarModel,
    values: Values,
    travel: Array,
) -> Iterator[UnlistedFault]:
    """Yield every unlisted fault of one run; ``travel`` (ne,) are rms deflections over all runs."""
    recording = dataset.recordings[run]
    nothing = Perturbation(
        np.zeros_like(recording.moments),
        np.zeros_like(recording.reading),
        np.zeros_like(motion.deflection),
    )
    time = recording.instants - recording.instants[0]
    dampers = [
        float(values[element.damping][0] ** 2 * motion.velocity[:, e].var())
        for e, element in enumerate(car.elements)
    ]
    for e, element in enumerate(car.elements):
        for description, law in _force_laws(float(travel[e])):
            force = np.zeros_like(motion.deflection)
            force[:, e] = law(time, motion.deflection[:, e], motion.velocity[:, e])
            yield UnlistedFault(
                f"{description} at the {element.words}",
                nothing._replace(force=force),
                float(force[:, e].var()),
                dampers[e],
            )
    for frequency in _SEAT_FREQUENCIES:
        for place, shares in _seat_places(car).items():
            reaction = _oscillator(time, motion.body @ shares, frequency, _SEAT_DAMPING)
            yield UnlistedFault(
                f"a mass on a spring near {place}",
                nothing._replace(force=np.outer(reaction, shares)),
                float(reaction.var()),
                dampers[0],
            )
    for channel in dataset.channels:
        bandwidth = dataset.vehicle.sensor(channel.name).bandwidth
        for description, distortion in _distortions(recording, motion, channel):
            changed = nothing, 0.0, 0.0
            if channel in recording.channels:
                c = recording.channels.index(channel)
                changed = _distorted(nothing, recording, motion.readings, c, distortion, bandwidth)
            yield UnlistedFault(f"{description} ({channel.words})", *changed)


def _seat_places(car: CarModel) -> dict[str, Array]:
    """Places of a seat: above each axle, and in the middle of two; shares (ne,) of its force."""
    places = {f"the {axle}": car.shares(axle) for axle in car.axles}
    if len(places) < 2:
        return places
    front, *rear = places.items()
    return dict([front, ("the middle", car.shares(BOTH)), *rear])


def _force_laws(travel: float) -> Iterator[tuple[str, ForceLaw]]:
    """Yield unlisted force laws of a suspension element, for its rms deflection."""
    for time_constant in _MOUNT_TIME_CONSTANTS:
        yield "a damper in a soft mount", partial(_soft_mount, time_constant)
    for share in _PLAY:
        yield "a damper with play", partial(_play, share * travel)
    for share in _YIELD_TRAVEL:
        yield "hysteresis", partial(_hysteresis, share * travel)
    yield "a damper that depends on travel", lambda t, d, v: -v * d**2
    yield "a damper that depends on travel", lambda t, d, v: -v * d
    yield "a progressive damper", lambda t, d, v: -v * np.abs(v)
    yield "a progressive damper", lambda t, d, v: -(v**3)
    yield "an asymmetric spring", lambda t, d, v: -(d**2)
    yield "an asymmetric spring", lambda t, d, v: -d * np.abs(d)


def _filtered(time: Array, signal: Array, system: tuple[list[float], list[float]]) -> Array:
    """Pass a signal through a linear system that was in equilibrium.

    Between samples the signal is a spline: a straight line would be half a step late to what
    follows its slope.
    """
    even = np.linspace(time[0], time[-1], _SUBSTEPS * len(time))
    numerator, denominator = (np.array(part, np.float64) for part in system)
    b, a, _ = cont2discrete((numerator, denominator), even[1] - even[0], "foh")
    first = float(signal[0])
    equilibrium = first * system[0][-1] / system[1][-1]
    out = equilibrium + lfilter(np.ravel(b), a, CubicSpline(time, signal - first)(even))
    return np.interp(time, even, out)


def _soft_mount(time_constant: float, time: Array, deflection: Array, velocity: Array) -> Array:
    """Force that a damper in series with a spring lacks, per damping rate."""
    return velocity - _filtered(time, velocity, ([1.0], [time_constant, 1.0]))


def _play(gap: float, time: Array, deflection: Array, velocity: Array) -> Array:
    """Force that a damper with play lacks, per damping rate: its end waits until it is taken up."""
    end = float(deflection[0])
    transmitted = np.zeros_like(velocity)
    for k in range(len(deflection)):
        if deflection[k] > end + gap:
            end, transmitted[k] = float(deflection[k]) - gap, velocity[k]
        elif deflection[k] < end - gap:
            end, transmitted[k] = float(deflection[k]) + gap, velocity[k]
    return np.asarray(velocity - transmitted)


def _hysteresis(yield_travel: float, time: Array, deflection: Array, velocity: Array) -> Array:
    """Friction that builds up over a travel: an elastic-plastic element of unit force."""
    force = np.zeros_like(deflection)
    for k in range(1, len(deflection)):
        force[k] = np.clip(
            force[k - 1] - (deflection[k] - deflection[k - 1]) / yield_travel, -1.0, 1.0
        )
    return force


def _oscillator(time: Array, base: Array, frequency: float, damping_ratio: float) -> Array:
    """Force of a unit mass on a spring and damper, by the acceleration of its base."""
    w = 2.0 * np.pi * frequency
    # beyond a mass fixed to the base, −a, which belongs to the car's own mass
    return _filtered(time, base, ([1.0, 0.0, 0.0], [1.0, 2.0 * damping_ratio * w, w**2]))


def _distortions(
    recording: PreparedRecording, motion: PredictedMotion, channel: Channel
) -> Iterator[tuple[str, Distortion]]:
    """Yield distortions of one channel as functions of its times and samples."""
    accelerometer = channel.quantity == "acceleration"
    for frequency in _MOUNT_FREQUENCIES if accelerometer else ():
        resonance = partial(_oscillator, frequency=frequency, damping_ratio=_MOUNT_DAMPING)
        yield f"a sensor mount that resonates near {frequency:.0f} Hz", resonance
    yield "a sampling clock that drifts", _drifting_clock
    yield "a nonlinear sensor scale", lambda time, signal: signal**2
    yield "a nonlinear sensor scale", lambda time, signal: signal**3
    if not accelerometer or channel.is_input:
        return
    for e, element in enumerate(recording.car.elements):
        if (element.axle, element.side) != (channel.axle, channel.side):
            yield "a sensor at another position", partial(_displaced, recording, motion.body[:, e])


def _displaced(recording: PreparedRecording, there: Array, time: Array, signal: Array) -> Array:
    """How a reading differs from the acceleration of another place of the body (E,)."""
    return np.asarray(signal - np.interp(time, recording.instants, there))


def _drifting_clock(time: Array, signal: Array) -> Array:
    return np.asarray((time - time[0]) * CubicSpline(time, signal)(time, 1))


def _distorted(
    nothing: Perturbation,
    recording: PreparedRecording,
    readings: Array,
    c: int,
    distortion: Distortion,
    bandwidth: float | None,
) -> tuple[Perturbation, float, float]:
    """Perturbation of a run by the distortion of one channel; mean squares of change and signal."""
    if c in recording.inputs:
        u = recording.inputs.index(c)
        knots, samples = denoise_wheel(recording, u, bandwidth)
        change = distortion(knots, samples)
        signal = WheelSignal(CubicSpline(knots, change), knots, recording.wheels[u].deviation)
        driven = np.zeros_like(recording.moments)
        driven[:, u] = moments(signal, recording.instants, ORDER)
        return nothing._replace(moments=driven), float(change.var()), float(samples.var())
    y = recording.outputs.index(c)
    valid = recording.kind[:, y] != MISSING
    samples = readings[valid, y]
    change = distortion(recording.instants[valid], samples)
    reading = np.zeros_like(recording.reading)
    reading[valid, y] = change
    return nothing._replace(reading=reading), float(change.var()), float(samples.var())
