"""How well faults that are not in the list explain the residuals of a model.

There are three kinds: faults of known direction (below); a free force at an axle,
as short pulses that follow each other through every run, whose amplitude is integrated out over a
few sizes, so that the number of pulses costs what it should; and time stamps that jitter.

A model that allows any force finds only what is large.  A test along the direction of a known fault
finds a hundredth of it: a damper in a rubber mount or with play, hysteresis, a damper that depends
on travel or on the square of its speed, a mass on a spring, a resonant sensor mount, a sensor at
another position or with a drifting clock.  Each is computed along the motion that the model
predicts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter
from scipy.special import logsumexp

from bayes_asv.diagnosis.denoised_model import DenoisedModel, denoised_model
from bayes_asv.diagnosis.residual_tests import jitter_log_likelihood_ratio
from bayes_asv.diagnosis.score_test import NuisanceProjection
from bayes_asv.diagnosis.thresholds import MIN_INFORMATION_SHARE, UNKNOWN_SIZE_COST
from bayes_asv.diagnosis.tolerance_prior import ModelEvidence, projection_with_tolerances
from bayes_asv.domain.channels import Channel
from bayes_asv.filters.force_laws import OUTSIDE, excess_many
from bayes_asv.filters.kalman import MISSING, ORDER
from bayes_asv.models.car_model import CarModel, Output, Values, state_space
from bayes_asv.models.effects import BOTH
from bayes_asv.models.effects.damper_curve import KNOTS as DAMPER_KNOTS
from bayes_asv.models.effects.spring_curve import KNOTS as SPRING_KNOTS
from bayes_asv.posterior.fitted_model import Dataset
from bayes_asv.posterior.free_simulation import free_run
from bayes_asv.posterior.likelihood import Perturbation, Posterior, shared_work
from bayes_asv.preprocessing.measured_inputs import denoise_wheel, denoised, sample_noise
from bayes_asv.preprocessing.timeline import PreparedRecording
from bayes_asv.preprocessing.wheel_spline import WheelSignal, moments

__all__ = [
    "PARTS",
    "FreeLaw",
    "Part",
    "UnlistedExplanation",
    "UnlistedFaultScores",
    "best_unlisted_explanation",
    "free_force_evidence",
    "free_law_evidence",
    "free_laws",
    "pulse_sensitivities",
    "unlisted_fault_scores",
    "unlisted_fault_sensitivities",
]

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
Part = Literal["damper", "spring"]
"""What of a suspension a free law is of."""
PARTS: tuple[Part, ...] = ("damper", "spring")

_LAGS = ("hysteresis", "a damper in a soft mount")  # faults by which force lags velocity
_SMALL = 0.01  # size of a perturbation, of the damper's rms force or of a channel's rms


class _Fault(NamedTuple):
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


class _Motion(NamedTuple):
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


def unlisted_fault_sensitivities(model: DenoisedModel) -> tuple[Array, tuple[str, ...]]:
    """Sensitivities (K, N) along unlisted faults, and a description of each.

    Parameters
    ----------
    model : DenoisedModel
        A model at its mode.
    """
    dataset, posterior, z = model.dataset, model.filters[0].posterior, model.model.mode.z
    runs = range(len(dataset.lines))
    motions = [_motion(dataset, posterior, z, run) for run in runs]
    travel = np.sqrt(np.mean([m.deflection.var(axis=0) for m in motions], axis=0))
    car, values = posterior.space.car, posterior.space.values(z[None])

    def of_run(run: int) -> list[_Fault]:
        return list(_faults(dataset, run, motions[run], car, values, travel))

    def sensitivity(k: int) -> Array:
        # One coefficient for all runs: in each the change is as large as the motion makes it.
        power = sum(by_run[k].power for by_run in faults)
        size = _SMALL * math.sqrt(sum(by_run[k].reference for by_run in faults))
        factor = size / math.sqrt(max(power, 1e-24))
        changes = [
            Perturbation(*(factor * part for part in by_run[k].perturbation)) for by_run in faults
        ]
        return model.concatenate({run: model.filters[run].response(changes[run]) for run in runs})

    with shared_work(posterior) as shared:
        assert shared.pool is not None
        faults = list(shared.pool.map(of_run, runs))
        descriptions = tuple(fault.description for fault in faults[0])
        out = np.array(list(shared.pool.map(sensitivity, range(len(descriptions)))))
    return out, descriptions


def _motion(dataset: Dataset, posterior: Posterior, z: Array, run: int) -> _Motion:
    # The filtered states follow the readings and would share their noise: a free simulation.
    recording = dataset.lines[run]
    readings, states, _ = free_run(posterior, z, run)
    time = recording.instants - recording.instants[0]
    pole = posterior.patterns[run].pole
    of_elements = slice(2 * len(recording.car.elements))
    deflection, velocity = states[:, of_elements][:, 0::2], states[:, of_elements][:, 1::2]
    acceleration = np.empty_like(velocity)
    for e, c in enumerate(recording.inputs):
        derivative = CubicSpline(time, velocity[:, e])(time, 1)
        acceleration[:, e] = denoised(time, derivative, sample_noise(recording, c), None)
    return _Motion(
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


def _faults(
    dataset: Dataset, run: int, motion: _Motion, car: CarModel, values: Values, travel: Array
) -> Iterator[_Fault]:
    """Yield every unlisted fault of one run; ``travel`` (ne,) are rms deflections over all runs."""
    recording = dataset.lines[run]
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
            yield _Fault(
                f"{description} at the {element.words}",
                nothing._replace(force=force),
                float(force[:, e].var()),
                dampers[e],
            )
    for frequency in _SEAT_FREQUENCIES:
        for place, shares in _seat_places(car).items():
            reaction = _oscillator(time, motion.body @ shares, frequency, _SEAT_DAMPING)
            yield _Fault(
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
            yield _Fault(f"{description} ({channel.words})", *changed)


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
    recording: PreparedRecording, motion: _Motion, channel: Channel
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


# Share of the jitter's gain that counts against one named effect: a variance that varies covers
# what several effects would have to share.
_JITTER_SHARE = 0.5
_PULSE_SPACING = 0.04  # s
_PULSE_FORCE = 0.01  # of an element's load
_AMPLITUDES = np.array([0.1, 0.3, 1.0, 3.0, 10.0])  # prior standard deviations, in pulse forces


class UnlistedFaultScores(NamedTuple):
    """Scores of K unlisted faults next to a model.

    Parameters
    ----------
    gradient : (K,) array
        Gradient of the log-likelihood along each, nuisance directions projected out.
    information : (K, K) array
        Its covariance under the model.
    sensitivities : (K, N) array
        Changes of the predictions, in standard deviations.
    descriptions : tuple of str
        What each fault is.
    """

    gradient: Array
    information: Array
    sensitivities: Array
    descriptions: tuple[str, ...]

    @property
    def raw_information(self) -> Array:
        """Information (K,) before nuisance directions were projected out."""
        return np.asarray(np.sum(self.sensitivities**2, axis=1))

    @property
    def gains(self) -> Array:
        """Log-likelihood (K,) that each gains at its most probable size, nats."""
        own = np.diag(self.information)
        informative = own > MIN_INFORMATION_SHARE * self.raw_information
        return np.where(informative, 0.5 * self.gradient**2 / np.maximum(own, 1e-30), 0.0)


class UnlistedExplanation(NamedTuple):
    """The best explanation by something that is not in the list.

    Parameters
    ----------
    log_evidence : float
        Log evidence of the model with it.
    description : str
        What it is.
    """

    log_evidence: float
    description: str


def unlisted_fault_scores(
    model: DenoisedModel, projection: NuisanceProjection
) -> UnlistedFaultScores:
    """Score the unlisted faults of known direction.

    Parameters
    ----------
    model : DenoisedModel
        The model at its mode.
    projection : NuisanceProjection
        What it can reproduce.
    """
    sensitivities, descriptions = unlisted_fault_sensitivities(model)
    gradient, information = projection.project_out(sensitivities)
    return UnlistedFaultScores(gradient, information, sensitivities, descriptions)


def free_force_evidence(model: DenoisedModel, projection: NuisanceProjection) -> tuple[float, str]:
    """Log Bayes factor (nats) of a free force against none, and the axle at which it is largest.

    Parameters
    ----------
    model, projection
        As :func:`unlisted_fault_scores` takes them.
    """
    by_axle = {
        axle: _log_bayes_factor(*projection.project_out(pulse_sensitivities(model, axle)))
        for axle in model.model.space.car.axles
    }
    axle = max(by_axle, key=lambda name: by_axle[name])
    return by_axle[axle], axle


def free_law_evidence(
    model: DenoisedModel,
    projection: NuisanceProjection,
    scores: UnlistedFaultScores,
    part: Part,
) -> tuple[float, str]:
    """Log Bayes factor (nats) of a free law against none, and the axle where it is largest.

    To first order a damper law adds a force that is any piecewise linear function of the rate of
    deflection, and the unlisted faults by which force lags velocity; a spring law adds a force that
    is any piecewise linear function of deflection.

    Parameters
    ----------
    model, projection
        As :func:`unlisted_fault_scores` takes them.
    scores : UnlistedFaultScores
        Of the same model.
    part : {'damper', 'spring'}
        Whose law.
    """
    posterior, z = model.filters[0].posterior, model.model.mode.z
    motions = [_motion(model.dataset, posterior, z, k) for k in range(len(model.dataset.lines))]
    car, values = posterior.space.car, posterior.space.values(z[None])
    knots = DAMPER_KNOTS if part == "damper" else SPRING_KNOTS
    by_axle = {}
    for axle in car.axles:
        own = [e for e, element in enumerate(car.elements) if element.axle == axle]
        if part == "damper":
            driven = [motion.velocity[:, own].T for motion in motions]
            names = [car.elements[e].damping for e in own]
        else:
            driven = [motion.deflection[:, own].T for motion in motions]
            names = [car.elements[e].spring for e in own]
        spread = float(np.std(np.concatenate(driven, axis=1)))
        size = _SMALL * spread * float(np.mean([values[name][0] for name in names]))
        hats = size * np.delete(np.eye(len(knots)), len(knots) // 2, axis=0)  # no force at rest
        changes = [[np.interp(x, knots, hat) for x in driven] for hat in hats]
        along = _force_sensitivities(model, own, changes)
        if part == "damper":
            places = tuple(f"at the {car.elements[e].words}" for e in own)
            lags = [d.startswith(_LAGS) and d.endswith(places) for d in scores.descriptions]
            along = np.concatenate([along, scores.sensitivities[lags]])
        by_axle[axle] = _log_bayes_factor(*projection.project_out(along))
    axle = max(by_axle, key=lambda name: by_axle[name])
    return by_axle[axle], axle


def _force_sensitivities(
    model: DenoisedModel, elements: list[int], changes: list[list[Array]]
) -> Array:
    """Sensitivities (K, N) along forces (elements, E) of K kinds in every run."""

    def sensitivity(by_run: list[Array]) -> Array:
        responses = {}
        for run, forces in enumerate(by_run):
            line = model.dataset.lines[run]
            force = np.zeros((len(line.elapsed), len(line.car.elements)))
            force[:, elements] = forces.T
            nudge = Perturbation(np.zeros_like(line.moments), np.zeros_like(line.reading), force)
            responses[run] = model.filters[run].response(nudge)
        return model.concatenate(responses)

    with shared_work(model.model.target) as shared:
        assert shared.pool is not None
        return np.array(list(shared.pool.map(sensitivity, changes)))


def pulse_sensitivities(model: DenoisedModel, axle: str) -> Array:
    """Sensitivities (K, N) along short force pulses at one axle, in succession through every run.

    The elements of the axle share the force.  A pulse rises for as long as the next one takes to
    begin, so that equal pulses add up to a constant force.  They are added to the model, a named
    pulse in the same run included.
    """
    size = _PULSE_FORCE * model.model.space.sizes.load
    shares = model.model.space.car.shares(axle)
    runs = [(run, recording.elapsed) for run, recording in enumerate(model.dataset.lines)]
    starts = [
        (run, start) for run, time in runs for start in np.arange(time[0], time[-1], _PULSE_SPACING)
    ]

    def sensitivity(at: tuple[int, float]) -> Array:
        run, start = at
        recording = model.dataset.lines[run]
        pulse = np.array([[0, OUTSIDE, size, start, _PULSE_SPACING, _PULSE_SPACING]])
        time = recording.elapsed
        rest = np.zeros(len(time))
        force = excess_many(pulse, 0, 0.0, 0.0, rest, rest, time, time[-1])[:, 0]
        perturbation = Perturbation(
            np.zeros_like(recording.moments),
            np.zeros_like(recording.reading),
            np.outer(force, shares),
        )
        return model.concatenate({run: model.filters[run].response(perturbation)})

    with shared_work(model.model.target) as shared:
        assert shared.pool is not None
        return np.array(list(shared.pool.map(sensitivity, starts)))


def _log_bayes_factor(gradient: Array, information: Array) -> float:
    """Log Bayes factor of normal amplitudes against none, averaged over their prior sizes.

    At a prior standard deviation s it is ½ Σ (s² u² / (1 + s² λ) − log(1 + s² λ)), with eigenvalues
    λ of the information and u the gradient along its eigenvectors.
    """
    if not np.all(np.isfinite(information)):  # a pulse that makes the model diverge
        return -math.inf
    eigenvalues, vectors = np.linalg.eigh(information)
    eigenvalues = np.maximum(eigenvalues, 0.0)
    squares = (vectors.T @ gradient) ** 2
    gains = [
        0.5
        * float(np.sum(squares * s**2 / (1.0 + s**2 * eigenvalues) - np.log1p(s**2 * eigenvalues)))
        for s in _AMPLITUDES
    ]
    return float(logsumexp(gains) - math.log(len(gains)))


def best_unlisted_explanation(dataset: Dataset, evidence: ModelEvidence) -> UnlistedExplanation:
    """Find the unlisted explanation of most evidence next to a model, to first order.

    Parameters
    ----------
    dataset : Dataset
        Recordings with denoised inputs.
    evidence : ModelEvidence
        The model under the tolerance prior of all other effects.
    """
    denoised = denoised_model(dataset, evidence.model)
    projection = projection_with_tolerances(denoised.derivatives, evidence)
    scores = unlisted_fault_scores(denoised, projection)
    return _best_explanation(dataset, evidence, denoised, projection, scores)


class FreeLaw(NamedTuple):
    """A damper or spring law of any form next to a model, to first order.

    Parameters
    ----------
    part : {'damper', 'spring'}
        Whose law.
    axle : str
        Where it gains most.
    gain : float
        Log evidence (nats) that it gains there.
    best_gain : float
        The same of the best unlisted explanation.
    """

    part: Part
    axle: str
    gain: float
    best_gain: float


def free_laws(
    dataset: Dataset, evidence: ModelEvidence, parts: Sequence[Part] = PARTS
) -> list[FreeLaw]:
    """Compare free laws with the best unlisted explanation; the one that gains most comes first.

    Parameters
    ----------
    dataset, evidence
        As :func:`best_unlisted_explanation` takes them.
    parts : sequence of {'damper', 'spring'}
        Whose laws.
    """
    denoised = denoised_model(dataset, evidence.model)
    projection = projection_with_tolerances(denoised.derivatives, evidence)
    scores = unlisted_fault_scores(denoised, projection)
    best = _best_explanation(dataset, evidence, denoised, projection, scores)
    best_gain = best.log_evidence - evidence.log_evidence
    laws = []
    for part in parts:
        gain, axle = free_law_evidence(denoised, projection, scores, part)
        laws.append(FreeLaw(part, axle, gain, best_gain))
    return sorted(laws, key=lambda law: -law.gain)


def _best_explanation(
    dataset: Dataset,
    evidence: ModelEvidence,
    denoised: DenoisedModel,
    projection: NuisanceProjection,
    scores: UnlistedFaultScores,
) -> UnlistedExplanation:
    best = int(np.argmax(scores.gains))
    gain = float(scores.gains[best])
    jitter, channel = jitter_log_likelihood_ratio(dataset, evidence.model, denoised.settled)
    force, axle = free_force_evidence(denoised, projection)
    base = evidence.log_evidence
    return max(
        UnlistedExplanation(
            base + gain - UNKNOWN_SIZE_COST - math.log(len(scores.descriptions)),
            scores.descriptions[best],
        ),
        UnlistedExplanation(
            base + force - math.log(len(evidence.model.space.car.axles)),
            f"an unknown force at the {axle} axle",
        ),
        UnlistedExplanation(
            base + _JITTER_SHARE * jitter - UNKNOWN_SIZE_COST - math.log(len(dataset.channels)),
            f"jittering time stamps ({channel.replace('_', ' ')})",
        ),
    )
