"""Models of faults that are not in the list: the change of a recording along its motion.

They are a damper with play, hysteresis, an inertia between wheel and body, a damper that depends on
travel or on the square of its speed, a mass on a spring, a resonant sensor mount, a sensor at
another position or with a drifting clock.  A damper in a soft mount is in the list
(``damper_hysteresis``); its model serves only where the law of a damper is free.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter

from bayes_asv.domain.channels import Channel
from bayes_asv.filters.kalman import MISSING, ORDER
from bayes_asv.models.car_model import CarModel, Output, Values, state_space
from bayes_asv.models.effects import BOTH, PlacedEffect
from bayes_asv.posterior.fitted_model import Dataset
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.likelihood import Perturbation, Posterior, shared_work
from bayes_asv.preprocessing.measured_inputs import denoise_wheel, denoised, sample_noise
from bayes_asv.preprocessing.prepared_recording import PreparedRecording
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments

__all__ = [
    "UNIT_SHARE",
    "FaultKind",
    "FaultTerm",
    "PredictedMotion",
    "UnlistedFault",
    "UnnamedCause",
    "fault_terms",
    "lag_terms",
    "predicted_motions",
    "rms_travel",
    "unit_size",
]

Array = NDArray[np.float64]
Form = tuple[float, ...]
"""Constants of a fault, or the order of a term of a series."""
ForceLaw = Callable[[Form, Array, Array, Array], Array]
"""From form, time (s), deflection (m) and velocity (m/s) to a force on the chassis, N, (E,)."""
Distortion = Callable[[Form, "PredictedMotion", Array, Array], Array]
"""From form, motion, and times (s) and samples of a channel to a change of the samples, (n,)."""

UNIT_SHARE = 0.01
"""Unit size of a fault, as a share of the damper's rms force or of a channel's rms reading."""

_MOUNT_TIME_CONSTANTS = (0.001, 0.004, 0.015)  # c/k of a damper's mount, s
_PLAY = (0.05, 0.2, 0.5)  # play of a damper, in rms deflections
_YIELD_TRAVEL = (0.05, 0.2, 0.6)  # travel over which friction builds up, in rms deflections
_SEAT_FREQUENCIES = (2.5, 3.0, 3.5, 4.2, 5.0, 6.0)  # resonances of a seat, Hz, one width apart
_SEAT_DAMPING = 0.2  # damping ratio of a seat
# Resonances f₀ of a sensor mount, Hz.  One above the frequencies f that the car excites still
# amplifies the reading by f²/f₀².
_MOUNT_FREQUENCIES = (15.0, 21.0, 30.0, 42.0, 60.0, 85.0, 120.0, 170.0, 240.0)
_RESONANCE = "a sensor mount that resonates"
# Standard deviation of the size of a resonance, as a share of the motion of its base: all of it on
# a bracket, less on a panel.
_RESONANCE_SIZE = 1.0
_MOUNT_DAMPING = 0.03  # damping ratio of a sensor mount
# Powers in a sensor's nonlinear scale: asymmetry, and the first two terms of a saturation.
_POWERS = (2, 3, 5)
_SUBSTEPS = 4  # steps of a linear system per sample of its signal


class UnlistedFault(NamedTuple):
    """Perturbation of one run by an unlisted fault.

    Parameters
    ----------
    perturbation : Perturbation
        Perturbation of the run.
    change : (E,) array
        The change: a force (N), or a change of a channel's reading.
    along : (E,) array
        Variable on which it depends: a rate of deflection, an acceleration of the body, or the
        reading.
    reference : float
        Mean square of the quantity to which the change is compared: damper force or reading.
    """

    perturbation: Perturbation
    change: Array
    along: Array
    reference: float


@dataclass(frozen=True)
class FaultKind:
    """A kind of unlisted fault at one place.

    Parameters
    ----------
    name, place : str
        Name and place.
    forms : tuple of tuple of float
        Values of its constants that are tried, or orders of the terms of a series.
    continuous : bool
        Whether any values in between are possible; orders of terms are not continuous.
    dimensions : (str, str)
        Physical dimensions of the change, and of the variable on which it depends.
    change : callable
        Function of recording, motion and form that returns the fault.
    usual : float
        Prior standard deviation of its size; infinite without a limit.
    opposite : str or None
        Name of a fault that is in the list, of which it is the opposite.
    element : str or None
        Suspension element of which it is a force.
    part : str or None
        Part of a suspension element, a damper or spring, whose free law contains this force.
    """

    name: str
    place: str
    forms: tuple[Form, ...]
    continuous: bool
    dimensions: tuple[str, str]
    change: Callable[[PreparedRecording, PredictedMotion, Form], UnlistedFault]
    usual: float = math.inf
    opposite: str | None = None
    element: str | None = None
    part: str | None = None

    def within(self, placed: PlacedEffect, car: CarModel) -> bool:
        """Whether the free law of an effect contains this force."""
        effect = placed.effect
        elements = [car.elements[e].name for e in placed.elements(car)]
        part = "damper" if effect.on_damper else "spring"
        return effect.free_form and part == self.part and self.element in elements


class FaultTerm(NamedTuple):
    """A kind of unlisted fault in one of its forms.

    Parameters
    ----------
    kind : FaultKind
        The kind.
    form : tuple of float
        The form.
    """

    kind: FaultKind
    form: Form

    @property
    def fault(self) -> tuple[str, str]:
        """Name and place; kinds with the same ones are the same fault."""
        return self.kind.name, self.kind.place

    @property
    def description(self) -> str:
        """Description by name and place, and for a resonance by its frequency."""
        frequency = self.kind.name == _RESONANCE and self.kind.continuous
        detail = f" near {self.form[0]:.0f} Hz" if frequency else ""
        return f"{self.kind.name}{detail} {self.kind.place}"

    def faults(
        self, dataset: Dataset, motions: Sequence[PredictedMotion]
    ) -> tuple[UnlistedFault, ...]:
        """Return the fault in each run, with the same size; its change depends on the motion."""
        return tuple(
            self.kind.change(recording, motion, self.form)
            for recording, motion in zip(dataset.recordings, motions, strict=True)
        )


@dataclass(frozen=True)
class UnnamedCause:
    """An unlisted fault that was added to the model, since no listed effect explains the data.

    Parameters
    ----------
    kind, place : str
        Kind of fault, and its place.
    share : float
        Its share of the squared change of the predictions.
    dimensions : (str, str)
        Physical dimensions of ``changes`` and of ``along``.
    changes, along : tuple of (E,) arrays
        For each fitted run, the change (a force on the body, or an addition to a reading) and the
        variable on which it depends (rate of deflection, acceleration or reading), SI units.
    element : str or None
        Suspension element of which it is a force.
    """

    kind: str
    place: str
    share: float
    dimensions: tuple[str, str]
    changes: tuple[Array, ...]
    along: tuple[Array, ...]
    element: str | None

    @property
    def equal_power(self) -> float:
        """Rate of the linear damper that takes the power of an element's force, N·s/m."""
        power = -sum(float(f @ v) for f, v in zip(self.changes, self.along, strict=True))
        return power / sum(float(v @ v) for v in self.along)


class PredictedMotion(NamedTuple):
    """Predicted motion of a car in one run.

    Parameters
    ----------
    instants : (E,) array
        Times of the readings, s.
    inputs : tuple of ((K,) array, (K,) array)
        Knots (s) of each measured input, and its readings there with most of the noise removed.
    readings : (E, ny) array
        Noise-free readings of the outputs, SI units.
    deflection, velocity : (E, ne) arrays
        Deflections (m) and their rates (m/s) of the elements, before the sensors' filter.
    damping_force : (E, ne) array
        Forces of the linear dampers, N.
    body : (E, ne) array
        Acceleration of the body above each element after that filter, m/s²; the noise-free reading
        of the sensor there, if there is one.
    """

    instants: Array
    inputs: tuple[tuple[Array, Array], ...]
    readings: Array
    deflection: Array
    velocity: Array
    damping_force: Array
    body: Array


def predicted_motions(
    dataset: Dataset, posterior: Posterior, z: Array
) -> tuple[PredictedMotion, ...]:
    """Predict the motion of a car in each run by its free simulation.

    Filtered states would share the noise of the readings.
    """
    with shared_work(posterior) as shared:
        assert shared.pool is not None
        runs = range(len(dataset.recordings))
        return tuple(shared.pool.map(partial(_predicted_motion, dataset, posterior, z), runs))


def rms_travel(motions: Sequence[PredictedMotion]) -> Array:
    """Root mean square of the deflections (ne,) over all runs, m."""
    mean_square = np.mean([motion.deflection.var(axis=0) for motion in motions], axis=0)
    return np.asarray(np.sqrt(mean_square))


def unit_size(faults: Sequence[UnlistedFault]) -> float:
    """Factor that scales a fault to unit size (:data:`UNIT_SHARE`), the same for all runs."""
    power = sum(float(one.change.var()) for one in faults)
    whole = sum(one.reference for one in faults)
    return UNIT_SHARE * math.sqrt(whole / max(power, 1e-24))


def _predicted_motion(
    dataset: Dataset,
    posterior: Posterior,
    z: Array,
    run: int,
) -> PredictedMotion:
    recording = dataset.recordings[run]
    readings, states, _ = free_run(posterior, z, run)
    states = np.nan_to_num(states, posinf=0.0, neginf=0.0)  # the simulation may diverge
    for known in posterior.perturbations[run : run + 1]:
        readings = readings + known.reading
    inputs = []
    for u, c in enumerate(recording.inputs):
        bandwidth = dataset.vehicle.sensor(recording.channels[c].name).bandwidth
        inputs.append(denoise_wheel(recording, u, bandwidth))
    time = recording.instants - recording.instants[0]
    pole = posterior.sensor_corrections[run].pole
    of_elements = slice(2 * len(recording.car.elements))
    deflection, velocity = states[:, of_elements][:, 0::2], states[:, of_elements][:, 1::2]
    acceleration = np.empty_like(velocity)
    for e, c in enumerate(recording.inputs):
        derivative = CubicSpline(time, velocity[:, e])(time, 1)
        acceleration[:, e] = denoised(time, derivative, sample_noise(recording, c), None)
    values = posterior.space.values(z[None])
    before_filter = velocity + acceleration / pole
    rates = np.array([values[element.damping][0] for element in recording.car.elements])
    return PredictedMotion(
        recording.instants,
        tuple(inputs),
        readings,
        deflection + velocity / pole,
        before_filter,
        before_filter * rates,
        _body_accelerations(recording, values, readings, states),
    )


def _body_accelerations(
    recording: PreparedRecording, values: Values, readings: Array, states: Array
) -> Array:
    """Accelerations (E, ne) of the body above the elements, from outputs or else from states."""
    tops = [
        Channel(element.name, "acceleration", "body", element.axle, element.side)
        for element in recording.car.elements
    ]
    system = state_space(recording.car, values, [Output(top) for top in tops])
    ne = len(tops)
    # deflections, their rates and excess forces; accelerations do not depend on body rates
    states_and_forces = np.hstack([states[:, : 2 * ne], states[:, len(states[0]) - ne :]])
    out = states_and_forces @ np.hstack([system.C[0], system.G[0]]).T
    for y in recording.accelerations:
        place = recording.channels[recording.outputs[y]]
        for e, top in enumerate(tops):
            if (place.axle, place.side, place.position) == (top.axle, top.side, None):
                out[:, e] = readings[:, y]
    return np.asarray(out)


def fault_terms(dataset: Dataset, travel: Array) -> tuple[FaultTerm, ...]:
    """Return every unlisted fault in every form; ``travel`` (ne,) contains the rms deflections."""
    kinds = _fault_kinds(dataset, dataset.recordings[0].car, travel)
    return tuple(FaultTerm(kind, form) for kind in kinds for form in kind.forms)


def lag_terms(dataset: Dataset, travel: Array, elements: Sequence[int]) -> tuple[FaultTerm, ...]:
    """Return the faults of some elements by which force lags velocity, in every form."""
    car = dataset.recordings[0].car
    return tuple(
        FaultTerm(kind, form)
        for e in elements
        for kind in _element_kinds(car, e, (_hysteresis_law(float(travel[e])), _SOFT_MOUNT))
        for form in kind.forms
    )


def _fault_kinds(dataset: Dataset, car: CarModel, travel: Array) -> Iterator[FaultKind]:
    for e in range(len(car.elements)):
        yield from _element_kinds(car, e, _force_laws(float(travel[e])))
    for place, shares in _seat_places(car).items():
        change = partial(_seat_fault, shares)
        resonances = tuple((f, _SEAT_DAMPING) for f in _SEAT_FREQUENCIES)
        dimensions = "force", "acceleration"
        yield FaultKind("a mass on a spring", f"near {place}", resonances, True, dimensions, change)
    for channel in dataset.channels:
        place, dimensions = f"({channel.words})", (channel.dimension, channel.dimension)
        for name, forms, continuous, distortion in _distortions(car, channel):
            change = partial(_channel_fault, channel, distortion)
            usual = _RESONANCE_SIZE if continuous else math.inf
            yield FaultKind(name, place, forms, continuous, dimensions, change, usual)


def _element_kinds(car: CarModel, e: int, laws: Iterable[_ElementLaw]) -> Iterator[FaultKind]:
    """Yield the faults of one suspension element."""
    for law in laws:
        yield FaultKind(
            law.name,
            f"at the {car.elements[e].words}",
            law.forms,
            law.continuous,
            ("force", "velocity"),
            partial(_element_fault, e, law.force),
            opposite=law.opposite,
            element=car.elements[e].name,
            part=law.part,
        )


def _no_perturbation(recording: PreparedRecording) -> Perturbation:
    return Perturbation(
        np.zeros_like(recording.moments),
        np.zeros_like(recording.reading),
        np.zeros((len(recording.elapsed), len(recording.car.elements))),
    )


def _element_fault(
    e: int, law: ForceLaw, recording: PreparedRecording, motion: PredictedMotion, form: Form
) -> UnlistedFault:
    """Fault force of one suspension element, relative to its damper's."""
    time = recording.instants - recording.instants[0]
    perturbation = _no_perturbation(recording)
    force = law(form, time, motion.deflection[:, e], motion.velocity[:, e])
    perturbation.force[:, e] = force
    reference = float(motion.damping_force[:, e].var())
    return UnlistedFault(perturbation, force, motion.velocity[:, e], reference)


def _seat_fault(
    shares: Array, recording: PreparedRecording, motion: PredictedMotion, form: Form
) -> UnlistedFault:
    """Force of a mass on a spring, shared by the elements."""
    time = recording.instants - recording.instants[0]
    body = motion.body @ shares
    reaction = _oscillator(time, body, *form)
    perturbation = _no_perturbation(recording)._replace(force=np.outer(reaction, shares))
    reference = float(motion.damping_force[:, 0].var())
    return UnlistedFault(perturbation, reaction, body, reference)


def _seat_places(car: CarModel) -> dict[str, Array]:
    """Places of a seat (above each axle, and in the middle), with shares (ne,) of its force."""
    places = {f"the {axle}": car.shares(axle) for axle in car.axles}
    if len(places) < 2:
        return places
    front, *rear = places.items()
    return dict([front, ("the middle", car.shares(BOTH)), *rear])


class _ElementLaw(NamedTuple):
    """A force of a suspension element; see :class:`FaultKind`."""

    name: str
    forms: tuple[Form, ...]
    continuous: bool
    force: ForceLaw
    opposite: str | None = None
    part: str | None = None


def _force_laws(travel: float) -> Iterator[_ElementLaw]:
    """Yield unlisted force laws of a suspension element, given its rms deflection."""
    yield _ElementLaw(
        "an inertia in the suspension",
        _each(_MOUNT_TIME_CONSTANTS),
        True,
        _inertia,
        opposite=_SOFT_MOUNT.name,
    )
    forms = _each(share * travel for share in _PLAY)
    yield _ElementLaw("a damper with play", forms, True, _force_with_play)
    yield _hysteresis_law(travel)
    yield _ElementLaw("a damper that depends on travel", _each((1, 2)), False, _damper_by_travel)
    yield _ElementLaw(
        "a progressive damper",
        _each((2, 3)),
        False,
        _damper_by_speed,
        opposite="a digressive damper",
        part="damper",
    )
    forms = ((2.0, 1.0), (2.0, 0.0))
    yield _ElementLaw("an asymmetric spring", forms, False, _spring_by_travel, part="spring")


def _hysteresis_law(travel: float) -> _ElementLaw:
    forms = _each(share * travel for share in _YIELD_TRAVEL)
    return _ElementLaw("hysteresis", forms, True, _hysteresis)


def _each(values: Iterable[float]) -> tuple[Form, ...]:
    return tuple((float(value),) for value in values)


def _damper_by_travel(form: Form, time: Array, deflection: Array, velocity: Array) -> Array:
    return np.asarray(-velocity * deflection ** form[0])


def _damper_by_speed(form: Form, time: Array, deflection: Array, velocity: Array) -> Array:
    return np.asarray(-velocity * np.abs(velocity) ** (form[0] - 1.0))


def _spring_by_travel(form: Form, time: Array, deflection: Array, velocity: Array) -> Array:
    """Return a power of deflection, signed if the second constant is zero."""
    sign = 1.0 if form[1] else np.sign(deflection)
    return np.asarray(-sign * np.abs(deflection) ** form[0])


def _pass_through(time: Array, signal: Array, system: tuple[list[float], list[float]]) -> Array:
    """Pass a signal through a linear system that starts in equilibrium.

    The signal is interpolated by a spline: linear interpolation would delay its slope by half a
    step.
    """
    even = np.linspace(time[0], time[-1], _SUBSTEPS * len(time))
    numerator, denominator = (np.array(part, np.float64) for part in system)
    b, a, _ = cont2discrete((numerator, denominator), even[1] - even[0], "foh")
    first = float(signal[0])
    equilibrium = first * system[0][-1] / system[1][-1]
    out = equilibrium + lfilter(np.ravel(b), a, CubicSpline(time, signal - first)(even))
    return np.interp(time, even, out)


def _soft_mount(form: Form, time: Array, deflection: Array, velocity: Array) -> Array:
    """Deficit of the force of a damper in series with a spring, per damping rate; c/k in s."""
    return velocity - _pass_through(time, velocity, ([1.0], [form[0], 1.0]))


_SOFT_MOUNT = _ElementLaw(
    "a damper in a soft mount", _each(_MOUNT_TIME_CONSTANTS), True, _soft_mount
)


def _inertia(form: Form, time: Array, deflection: Array, velocity: Array) -> Array:
    """Force against the acceleration of deflection below a corner frequency, by its c/k in s."""
    return -_soft_mount(form, time, deflection, velocity)


def _force_with_play(form: Form, time: Array, deflection: Array, velocity: Array) -> Array:
    """Deficit of the force of a damper with play, per damping rate: no force within the play."""
    gap, end = form[0], float(deflection[0])
    transmitted = np.zeros_like(velocity)
    for k in range(len(deflection)):
        if deflection[k] > end + gap:
            end, transmitted[k] = float(deflection[k]) - gap, velocity[k]
        elif deflection[k] < end - gap:
            end, transmitted[k] = float(deflection[k]) + gap, velocity[k]
    return np.asarray(velocity - transmitted)


def _hysteresis(form: Form, time: Array, deflection: Array, velocity: Array) -> Array:
    """Friction that builds up over a travel (m): an elastic-plastic element of unit force."""
    force, steps = np.zeros_like(deflection), np.diff(deflection, prepend=deflection[0]) / form[0]
    for k in range(1, len(deflection)):
        force[k] = min(max(force[k - 1] - steps[k], -1.0), 1.0)
    return force


def _oscillator(time: Array, base: Array, frequency: float, damping_ratio: float) -> Array:
    """Force of a unit mass on a spring and damper, due to the acceleration of its base."""
    w = 2.0 * np.pi * frequency
    # relative to a mass fixed to the base, −a, which belongs to the car's own mass
    return _pass_through(time, base, ([1.0, 0.0, 0.0], [1.0, 2.0 * damping_ratio * w, w**2]))


def _distortions(
    car: CarModel, channel: Channel
) -> Iterator[tuple[str, tuple[Form, ...], bool, Distortion]]:
    """Yield name, forms and law of the distortions of one channel.

    An output is distorted as its sensor does it.  For an input, the inverse is applied to the
    reading: the inverse of a power series is a power series of the reading, and that of a resonance
    with little damping is a share of the reading's second derivative.
    """
    accelerometer = channel.quantity == "acceleration"
    if accelerometer:
        resonance = tuple((f, _MOUNT_DAMPING) for f in _MOUNT_FREQUENCIES)
        yield _RESONANCE, resonance, True, _resonance
        yield _RESONANCE, _each((2,)), False, _derivative
    yield "a sampling clock that drifts", _each((1,)), False, _drifting_clock
    yield "a nonlinear sensor scale", _each(_POWERS), False, _power
    if not accelerometer or channel.is_input:
        return
    for e, element in enumerate(car.elements):
        if (element.axle, element.side) != (channel.axle, channel.side):
            yield "a sensor at another position", _each((e,)), False, _displaced


def _resonance(form: Form, motion: PredictedMotion, time: Array, signal: Array) -> Array:
    return _oscillator(time, signal, *form)


def _derivative(form: Form, motion: PredictedMotion, time: Array, signal: Array) -> Array:
    return np.asarray(CubicSpline(time, signal)(time, int(form[0])))


def _drifting_clock(form: Form, motion: PredictedMotion, time: Array, signal: Array) -> Array:
    return np.asarray((time - time[0]) * CubicSpline(time, signal)(time, 1))


def _power(form: Form, motion: PredictedMotion, time: Array, signal: Array) -> Array:
    return np.asarray(signal ** int(form[0]))


def _displaced(form: Form, motion: PredictedMotion, time: Array, signal: Array) -> Array:
    """Return the difference of a reading from the acceleration at another place of the body."""
    acceleration = motion.body[:, int(form[0])]
    return np.asarray(signal - np.interp(time, motion.instants, acceleration))


def _channel_fault(
    channel: Channel,
    distortion: Distortion,
    recording: PreparedRecording,
    motion: PredictedMotion,
    form: Form,
) -> UnlistedFault:
    """Distortion of one channel of a run."""
    perturbation, instants = _no_perturbation(recording), recording.instants
    if channel not in recording.channels:
        return UnlistedFault(perturbation, np.zeros(len(instants)), np.zeros(len(instants)), 0.0)
    c = recording.channels.index(channel)
    if c in recording.inputs:
        u = recording.inputs.index(c)
        time, samples = motion.inputs[u]
        change = distortion(form, motion, time, samples)
        signal = WheelSignal(CubicSpline(time, change), time, recording.wheels[u].sd)
        perturbation.moments[:, u] = moments(signal, instants, ORDER)
    else:
        y = recording.outputs.index(c)
        valid = recording.kind[:, y] != MISSING
        time, samples = instants[valid], motion.readings[valid, y]
        change = distortion(form, motion, time, samples)
        perturbation.reading[valid, y] = change
    change, along = np.interp(instants, time, change), np.interp(instants, time, samples)
    return UnlistedFault(perturbation, change, along, float(samples.var()))
