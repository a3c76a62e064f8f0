"""Mistakes in the input as hypotheses: exchanged columns, wrong units, lags, signs, values.

Each hypothesis says what a person or a logger may have got wrong, and how to undo it.  All are
fitted with the sensors' noise as declared, on the stretch of the recording in which the wheels move
most.
With the log posterior ℓ at the mode, a hypothesis with prior probability π has the weight

    π exp(ℓ / φ)

φ ≥ 1 is the long-run variance of the best hypothesis's normalised innovations.  It is one where
that hypothesis explains the recording down to the noise; what remains unexplained makes φ large and
all comparisons cautious (a quasi-likelihood; McCullagh & Nelder 1989, ch. 9).

Front and rear exchanged make a mirrored car, which leaves little trace in the likelihood; but the
front wheels meet the road first.  Mistakes in nominal values leave none, see
:mod:`.nominal_mistakes`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize_scalar
from scipy.signal import correlate

from bayes_asv.analysis.nominal_mistakes import Mistake, nominal_mistakes
from bayes_asv.domain.channels import Channel
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.recording import Recording, nominal_rate, timing
from bayes_asv.domain.units import STANDARD_GRAVITY, si_factor
from bayes_asv.domain.vehicle import Given, Nominal, Vehicle
from bayes_asv.filters.kalman import VALUE
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.cars import car_model
from bayes_asv.models.modes import nominal_modes
from bayes_asv.posterior.likelihood import WHITE, Posterior
from bayes_asv.posterior.parameters import space
from bayes_asv.posterior.residual_ar import long_run_variance
from bayes_asv.preprocessing.activity import cut, most_active_rows, wheel_power
from bayes_asv.preprocessing.data_checks import dead_channels, min_sampling_rate
from bayes_asv.preprocessing.timeline import PreparedRecording, prepare

__all__ = [
    "Doubt",
    "Fit",
    "Mistake",
    "check_input",
    "likely_mistakes",
    "rear_leads",
    "screening_fit",
]

Array = NDArray[np.float64]
Corrected = tuple[Recording, Vehicle]

_SECONDS = 2.5  # of the most lively stretch: five periods of the slowest mode
_STEPS, _COARSE_STEPS = 25, 6  # evaluations of the Jacobian at most; the right model needs six
_REPORTED = 0.05  # probability from which on a mistake is reported
_PRIOR = 0.1  # probability that an input has one of the mistakes, shared equally by them
_NAMED_FACTOR = 0.03  # how well a factor of units matches, as a standard deviation of its logarithm
_REFINED = 3  # hypotheses with a size that are refined, the best ones
_RUNS = 3  # recordings that are looked at
_MOVED = 3.0  # deviations: once in 370 right inputs for each given value
_HOLDS = 2.0  # dispersion, in units of that of noise that passed the sensor's filter
_NEARLY_HOLDS = 30.0  # dispersion up to which a mistake explains enough to be named
_MORE_NOISE = 1.2  # factor from which on the prior counts for enough more to fit again
_DEAD = 0.05  # gain below which a sensor is called dead
# Width of a size's posterior over that of its prior, as a logarithm: a size of unknown value is
# measured to a few hundredths of the range in which it may lie.
_OCCAM = -4.0
_BACKWARDS = -8.0  # log prior odds of a drive in which the rear wheels lead
_ALIKE = 0.6  # correlation of front and rear wheels from which on their order means something
_AHEAD = 0.2  # by which it has to be larger than with the other order

_N_PER_MM = si_factor("N/mm", "stiffness") / si_factor("lbf/in", "stiffness")
_LBF_S_PER_IN = si_factor("lbf*s/in", "damping")
_LB = si_factor("lbm", "mass")
_SPRING_FACTORS = {
    2.0: "one spring of an axle is given instead of both",
    0.5: "both sides are counted twice",
    _N_PER_MM: "a value in N/mm was given the unit lbf/in",
    1.0 / _N_PER_MM: "a value in lbf/in was given the unit N/mm",
}
_DAMPING_FACTORS = {
    12.0: "a value in lbf·s/in was given the unit lbf·s/ft",
    1.0 / 12.0: "a value in lbf·s/ft was given the unit lbf·s/in",
    _LBF_S_PER_IN: "a value in lbf·s/in was given the unit N·s/m",
    1.0 / _LBF_S_PER_IN: "a value in N·s/m was given the unit lbf·s/in",
    1e3: "a value in N·s/mm was given the unit N·s/m",
    1e-3: "a value in N·s/m was given the unit N·s/mm",
}
_MASS_FACTORS = {
    1.0 / _LB: "a value in kg was given the unit lb",
    _LB: "a value in lb was given the unit kg",
}
_INERTIA_UNITS = {
    "kg·m²": "kg*m^2", "lbf·s²·in": "lbf*s^2*in", "slug·ft²": "lbf*s^2*ft", "lb·ft²": "lbm*ft^2",
    "lb·in²": "lbm*in^2",
}  # fmt: skip
_INERTIA_FACTORS = {
    si_factor(true, "pitch_inertia") / si_factor(given, "pitch_inertia"): (
        f"a value in {true_name} was given the unit {given_name}"
    )
    for true_name, true in _INERTIA_UNITS.items()
    for given_name, given in _INERTIA_UNITS.items()
    if true != given
}
# Where the search for a size begins; between them the fit finds its way.
_TIME_FACTORS = (0.25, 0.4, 0.5, 0.7, 0.8, 1.25, 1.4, 2.0, 2.5, 4.0)
_GAINS = (1.0 / STANDARD_GRAVITY, 0.5, 0.85, 1.18, 2.0, STANDARD_GRAVITY)
_LAGS = (0.005, 0.02)  # s
_FACTORS = (0.45, 0.75, 1.35, 2.2)


class Fit(NamedTuple):
    """A fit with the noise as declared, and how likely it is with as much noise as it needs.

    Parameters
    ----------
    log_posterior : float
        At the mode, not normalised, with the deviations of all noise multiplied by one factor.
    noise_factor : float
        That factor, which makes the mean square of the normalised innovations one; at least one.
    dispersion : float
        Long-run variance of the innovations with the noise as declared, at least one.
    holds : bool
        Whether that is no more than noise makes of it.
    moved : dict of str to float
        Given values at the mode, in deviations from what was given.
    values : dict of str to float
        Parameters of the car at the mode, SI units.
    """

    log_posterior: float
    noise_factor: float
    dispersion: float
    holds: bool
    moved: dict[str, float]
    values: dict[str, float]


@dataclass(frozen=True)
class Doubt:
    """Why no verdict on a damper may rest on an estimate.

    Parameters
    ----------
    mistakes : tuple of Mistake
        Mistakes in the input that explain the recordings, the likeliest first; empty where none
        does.
    sentence : str
        What is probably wrong and what to do.
    """

    mistakes: tuple[Mistake, ...]
    sentence: str


@dataclass(frozen=True)
class _Hypothesis:
    """What may be wrong, and how to undo it.

    Parameters
    ----------
    words : callable
        From the size of the mistake to words and fix.
    undo : callable
        From recording, vehicle and size to those without the mistake.
    sizes : tuple of float
        Where the search for the size begins; empty for a mistake without one.
    density : callable
        From the size to the logarithm of its prior probability.
    stretch : callable
        From the size to the logarithms of the factors by which undoing it stretches the readings
        of channels, by name.
    """

    words: Callable[[float], tuple[str, str]]
    undo: Callable[[Recording, Vehicle, float], Corrected]
    sizes: tuple[float, ...] = ()
    density: Callable[[float], float] = lambda size: 0.0 if size == 0.0 else _OCCAM
    stretch: Callable[[float], dict[str, float]] = lambda size: {}


def screening_fit(
    recordings: Sequence[Recording], vehicle: Vehicle, car: str = "half", steps: int = _STEPS
) -> Fit | None:
    """Fit recordings with the sensors' noise as declared.

    Returns None where a channel is dead, or the car moves between the samples.

    Parameters
    ----------
    recordings : sequence of Recording
        Runs of one car.
    vehicle : Vehicle
        The car as given.
    car : str
        Name of the car model.
    steps : int
        Evaluations of the Jacobian at most.
    """
    model = car_model(car, vehicle)
    least = min_sampling_rate(nominal_modes(model))
    for recording in recordings:
        if nominal_rate(recording) < least or dead_channels(recording, vehicle, model):
            return None
    lines = tuple(prepare(one, vehicle, model) for one in recordings)
    target = Posterior(space(vehicle, lines), tuple(WHITE for _ in lines))
    n = target.space.shared_dimension
    dimension = target.space.dimension

    def at(car_part: Array) -> Array:
        z = np.zeros(dimension)
        z[:n] = car_part
        return z

    def residual(car_part: Array) -> Array:
        z = at(car_part)
        parts = [target.innovations(z, run).ravel() for run in range(len(lines))]
        every = np.concatenate([*parts, car_part])
        return np.asarray(np.nan_to_num(every, nan=1e6, posinf=1e6, neginf=-1e6))

    fit = least_squares(
        residual, np.zeros(n), bounds=(-20.0, 20.0), xtol=1e-4, ftol=1e-5, max_nfev=steps
    )
    z = at(fit.x)
    # With more noise the prior counts for more, so that another mode is the likeliest.
    noise_factor, noisy = _noise_factor(target, z), z
    if noise_factor > _MORE_NOISE and steps > _COARSE_STEPS:
        scale = np.append(np.full(fit.fun.size - n, noise_factor), np.ones(n))

        def scaled(car_part: Array) -> Array:
            return np.asarray(residual(car_part) / scale)

        again = least_squares(
            scaled, fit.x, bounds=(-20.0, 20.0), xtol=1e-4, ftol=1e-5, max_nfev=steps
        )
        noisy = at(again.x)
        noise_factor = _noise_factor(target, noisy)
    value = float(target.log_posterior(noisy[None])[0])
    if not math.isfinite(value):
        return None
    count, square = _innovations(target, noisy)
    value += 0.5 * square * (1.0 - noise_factor**-2) - count * math.log(noise_factor)
    values = {name: float(x[0]) for name, x in target.space.values(z[None]).items()}
    moved = {}
    for p in model.parameters:
        if p.kind == "fraction":
            sd = p.terms[0][2]
            moved[p.name] = (values[p.name] - p.nominal) / sd if sd > 0.0 else 0.0
        elif p.kind == "given":
            sd = math.sqrt(sum((c * sd) ** 2 for _, c, sd in p.terms))
            moved[p.name] = math.log(values[p.name] / p.nominal) / sd if sd > 0.0 else 0.0
    spread = [
        long_run_variance(target.innovations(z, run), line.kind == VALUE, line.instants)
        for run, line in enumerate(lines)
    ]
    dispersion = max(1.0, *spread)
    filtered = max(_of_filtered_noise(line) for line in lines)
    return Fit(value, noise_factor, dispersion, dispersion < _HOLDS * filtered, moved, values)


def _innovations(target: Posterior, z: Array) -> tuple[int, float]:
    """Count the normalised innovations of all runs, and sum their squares."""
    every = np.concatenate(
        [target.innovations(z, run).ravel() for run in range(len(target.space.timelines))]
    )
    there = np.isfinite(every) & (every != 0.0)
    return int(np.count_nonzero(there)), float(np.sum(every[there] ** 2))


def _noise_factor(target: Posterior, z: Array) -> float:
    """Root mean square of the normalised innovations, at least one."""
    count, square = _innovations(target, z)
    return math.sqrt(max(1.0, square / max(count, 1)))


def _of_filtered_noise(line: PreparedRecording) -> float:
    """Long-run variance of noise that passed the outputs' filters, over that of white noise."""
    step = float(np.median(np.diff(line.times[0])))
    poles = line.poles[list(line.outputs)]
    left = np.exp(-poles[poles > 0.0] * step)
    return float(np.max((1.0 + left) / (1.0 - left), initial=1.0))


def check_input(
    recordings: Sequence[Recording], vehicle: Vehicle, car: str = "half", refused: bool = False
) -> Doubt | None:
    """Check the input of an estimate and look for a mistake where something is wrong.

    Something is wrong where the data move a given value by more than `_MOVED` of its deviations,
    where the rear wheels lead, or where the innovations have a long-run variance that noise as
    declared cannot explain.

    Parameters
    ----------
    recordings, vehicle, car
        As for :func:`likely_mistakes`.
    refused : bool
        Whether the recordings were refused.

    Returns
    -------
    Doubt or None
        None where nothing speaks against the estimate.
    """
    recordings = recordings[:_RUNS]
    try:
        parts = [cut(one, most_active_rows(one, vehicle, _SECONDS)) for one in recordings]
        fit = screening_fit(parts, vehicle, car)
    except InputError:
        fit = None
    moved = [] if fit is None else [n for n, sd in fit.moved.items() if abs(sd) > _MOVED]
    holds = fit is not None and fit.holds
    mistakes: list[Mistake] = []
    if moved or not holds or rear_leads(recordings):
        mistakes = likely_mistakes(recordings, vehicle, car)
    if not mistakes and fit is not None and not refused:
        mistakes = nominal_mistakes(vehicle, car_model(car, vehicle), fit.values)
    if mistakes:
        return Doubt(tuple(mistakes), _sentence(mistakes))
    if refused:
        return None  # a refusal has reasons of its own
    if moved:
        names = " and ".join(QUANTITIES[name][1] for name in moved if name in QUANTITIES)
        text = f"the recording contradicts what is given for {names}"
        return Doubt((), f"{text}; check value, unit and its sd before any verdict on a damper")
    if holds:
        return None
    return Doubt(
        (),
        "the linear car does not explain the recording down to the noise of the sensors, so the "
        "intervals are too narrow for a verdict on a damper; bayes-asv diagnose says what is "
        "missing",
    )


def _sentence(mistakes: Sequence[Mistake]) -> str:
    first, *others = mistakes
    text = (
        f"the input is probably wrong: {first.words} (probability {100 * first.probability:.0f} %)"
    )
    if others:
        text += f", or {others[0].words} ({100 * others[0].probability:.0f} %)"
    return f"{text}; {first.fix}"


def likely_mistakes(
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    car: str = "half",
    progress: Callable[[float], None] = lambda share: None,
) -> list[Mistake]:
    """Find mistakes that explain recordings better than the input as it stands.

    Parameters
    ----------
    recordings : sequence of Recording
        Runs of one car.
    vehicle : Vehicle
        The car as given.
    car : str
        Name of the car model.
    progress : callable, optional
        Called with the share that is done.

    Returns
    -------
    list of Mistake
        Those of more than 5 %, the likeliest first; empty where no mistake is likelier than all.
    """
    model = car_model(car, vehicle)
    hypotheses = [_CORRECT, *_hypotheses(recordings[0], vehicle, model)]
    share = math.log(_PRIOR / (len(hypotheses) - 1))
    # One recording sorts out most of the mistakes; what is left is held against all of them.
    liveliest = [max(recordings, key=lambda one: float(np.mean(wheel_power(one, vehicle))))]
    sorted_out: list[_Tried] = []
    for k, hypothesis in enumerate(hypotheses):
        sizes = hypothesis.sizes or (0.0,)
        each = [_evaluate(hypothesis, size, liveliest, vehicle, car) for size in sizes]
        sorted_out.append(max(each, key=lambda one: one.log_posterior))
        progress((k + 1) / (len(hypotheses) + _REFINED))
    sorted_out.sort(key=lambda one: -one.log_posterior)
    for k, one in enumerate(sorted_out[:_REFINED]):
        sorted_out[k] = _refined(one, liveliest, vehicle, car)
    left = sorted_out[: 2 * _REFINED]
    left += [one for one in sorted_out[2 * _REFINED :] if one.hypothesis is _CORRECT]
    tried = [_evaluate(one.hypothesis, one.size, recordings, vehicle, car, _STEPS) for one in left]
    likeliest = max(tried, key=lambda one: one.log_posterior)
    if not likeliest.dispersion < _NEARLY_HOLDS:
        return []  # whatever is wrong is not in the list
    dispersion = max(1.0, likeliest.dispersion / likeliest.noise_factor**2)
    logs = np.array(
        [
            one.log_posterior / dispersion
            + one.log_prior
            + (math.log(1.0 - _PRIOR) if one.hypothesis is _CORRECT else share)
            for one in tried
        ]
    )
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    ranked = sorted(zip(weights, tried, strict=True), key=lambda pair: -pair[0])
    if not any(one.hypothesis is _CORRECT and weight > 0.5 for weight, one in ranked):
        return [
            Mistake(*one.hypothesis.words(one.size), probability=float(weight))
            for weight, one in ranked
            if weight > _REPORTED and one.hypothesis is not _CORRECT
        ]
    return []


class _Tried(NamedTuple):
    hypothesis: _Hypothesis
    size: float
    log_posterior: float
    log_prior: float
    dispersion: float
    noise_factor: float


def _evaluate(
    hypothesis: _Hypothesis,
    size: float,
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    car: str,
    steps: int = _COARSE_STEPS,
) -> _Tried:
    """Fit with one mistake undone; minus infinity where that leaves nothing to fit."""
    undone = [hypothesis.undo(recording, vehicle, size) for recording in recordings]
    whole = [recording for recording, _ in undone]
    # the same rows for every hypothesis: a time scale must not change what is explained
    inputs = [
        cut(one, most_active_rows(recording, vehicle, _SECONDS))
        for one, recording in zip(whole, recordings, strict=True)
    ]
    try:
        fit = screening_fit(inputs, undone[0][1], car, steps)
    except InputError:
        fit = None
    if fit is None:
        return _Tried(hypothesis, size, -math.inf, 0.0, math.inf, 1.0)
    volume = sum(
        log * np.count_nonzero(np.isfinite(recording.values[recording.channels.index(name)]))
        for recording in inputs
        for name, log in hypothesis.stretch(size).items()
        if not vehicle.channel(name).is_input  # on which the likelihood is conditioned
    )
    prior = hypothesis.density(size) + (_BACKWARDS if rear_leads(whole) else 0.0)
    return _Tried(
        hypothesis, size, fit.log_posterior + volume, prior, fit.dispersion, fit.noise_factor
    )


def _refined(one: _Tried, recordings: Sequence[Recording], vehicle: Vehicle, car: str) -> _Tried:
    """Search the size of a mistake between the neighbours of its best starting value."""
    sizes = sorted({*one.hypothesis.sizes, 0.0})
    if len(sizes) == 1 or not math.isfinite(one.log_posterior):
        return one
    k = sizes.index(one.size)
    low = sizes[k - 1] if k > 0 else 1.5 * one.size
    high = sizes[k + 1] if k + 1 < len(sizes) else 1.5 * one.size

    def loss(size: float) -> float:
        other = _evaluate(one.hypothesis, float(size), recordings, vehicle, car)
        return -max(other.log_posterior + other.log_prior, -1e300)

    found = minimize_scalar(
        loss, bounds=(low, high), method="bounded", options={"xatol": 5e-3 * (high - low)}
    )
    better = _evaluate(one.hypothesis, float(found.x), recordings, vehicle, car)
    return max(one, better, key=lambda other: other.log_posterior + other.log_prior)


def rear_leads(recordings: Sequence[Recording]) -> bool:
    """Whether the rear wheels meet the road before the front ones.

    The signals of both hubs are correlated at all shifts up to half the recording; the order
    counts where they are alike and clearly less so the other way round.
    """
    evidence = 0
    for recording in recordings:
        if not {"front_wheel", "rear_wheel"} <= set(recording.channels):
            continue
        rows = [recording.channels.index(name) for name in ("front_wheel", "rear_wheel")]
        front, rear = np.nan_to_num(
            recording.values[rows] - np.nanmean(recording.values[rows], 1, keepdims=True)
        )
        size = math.sqrt(float(front @ front) * float(rear @ rear))
        if size == 0.0:
            continue
        alike = correlate(rear, front) / size  # at shifts from 1 - n to n - 1
        middle, reach = len(front) - 1, len(front) // 2
        behind = float(alike[middle + 1 : middle + reach].max())
        ahead = float(alike[middle - reach + 1 : middle].max())
        if max(behind, ahead) > _ALIKE and abs(behind - ahead) > _AHEAD:
            evidence += 1 if ahead > behind else -1
    return evidence > 0


_CORRECT = _Hypothesis(lambda size: ("", ""), lambda recording, vehicle, size: (recording, vehicle))


def _hypotheses(recording: Recording, vehicle: Vehicle, car: CarModel) -> Iterator[_Hypothesis]:
    channels = [vehicle.channel(name) for name in recording.channels]
    channels = [channel for channel in channels if car.explains(channel)]
    yield from _of_columns(channels)
    yield from _of_readings(channels)
    yield from _of_given_values(vehicle, car)
    yield from _of_time()


def _of_columns(channels: Sequence[Channel]) -> Iterator[_Hypothesis]:
    """Columns that were exchanged."""
    names = {channel.name: channel for channel in channels}
    for one, other in combinations(channels, 2):
        if one.quantity == other.quantity:
            yield _exchange([(one.name, other.name)])
    mirrored = [(n, n.replace("front", "rear", 1)) for n in names if n.startswith("front")]
    mirrored = [pair for pair in mirrored if pair[1] in names]
    if len(mirrored) > 1:
        yield _exchange(mirrored)
    ends = [(n, n.replace("wheel", "chassis")) for n in names if n.endswith("wheel")]
    ends = [pair for pair in ends if pair[1] in names]
    if len(ends) > 1:
        yield _exchange(ends)


def _exchange(pairs: Sequence[tuple[str, str]]) -> _Hypothesis:
    partner = dict(pairs) | {b: a for a, b in pairs}
    text = ", and ".join(f"{_words(a)} and {_words(b)}" for a, b in pairs)

    def undo(recording: Recording, vehicle: Vehicle, size: float) -> Corrected:
        order = [recording.channels.index(partner.get(name, name)) for name in recording.channels]
        units = tuple(recording.units[k] for k in order)
        return replace(recording, values=recording.values[order], units=units), vehicle

    return _Hypothesis(
        lambda size: (f"the columns of {text} are exchanged", "exchange their names"), undo
    )


def _of_readings(channels: Sequence[Channel]) -> Iterator[_Hypothesis]:
    """Signs, gains and lags of channels."""
    outputs = tuple(channel.name for channel in channels if not channel.is_input)
    axles = [tuple(c.name for c in channels if c.axle == axle) for axle in ("front", "rear")]
    alone = [(channel.name,) for channel in channels]
    for names in [*alone, *([outputs] if len(outputs) > 1 else [])]:
        yield _inverted(names)
        yield _gain(names)
        yield _late(names)
    for names in axles:  # of one logger; a gain of both its sensors is another car
        if 1 < len(names) < len(channels):
            yield _late(names)


def _inverted(names: tuple[str, ...]) -> _Hypothesis:
    fix = "change the sign of the column, or of counts_scale in the vehicle file"
    return _Hypothesis(
        lambda size: (f"{_are(names)} upside down", fix),
        lambda recording, vehicle, size: _scaled(recording, vehicle, names, -1.0),
    )


def _gain(names: tuple[str, ...]) -> _Hypothesis:
    def words(size: float) -> tuple[str, str]:
        if size < math.log(_DEAD):
            return f"{_are(names)} dead or loose", "check sensor, wiring and mount"
        text = f"the readings of {_and(names)} are {_times(math.exp(size))} what they should be"
        for sign, reason in (
            (1.0, "m/s² was given the unit g"),
            (-1.0, "g was given the unit m/s²"),
        ):
            if abs(size - sign * math.log(STANDARD_GRAVITY)) < 3.0 * _NAMED_FACTOR:
                text += f": a column in {reason}"
        return text, "check unit, range and scale of the sensor"

    return _Hypothesis(
        words,
        lambda recording, vehicle, size: _scaled(recording, vehicle, names, math.exp(-size)),
        tuple(math.log(gain) for gain in _GAINS),
        stretch=lambda size: dict.fromkeys(names, -size),
    )


def _late(names: tuple[str, ...]) -> _Hypothesis:
    return _Hypothesis(
        lambda size: (
            f"{_are(names)} {abs(size) * 1e3:.1f} ms {'late' if size > 0.0 else 'early'}",
            f"give the delay of the sensor in the vehicle file, {-size:.4f} s more than now, or "
            "have it estimated: [clocks] in the vehicle file",
        ),
        lambda recording, vehicle, size: _shifted(recording, vehicle, names, -size),
        tuple(sorted(sign * lag for lag in _LAGS for sign in (1.0, -1.0))),
    )


def _scaled(
    recording: Recording, vehicle: Vehicle, names: Sequence[str], factor: float
) -> Corrected:
    """Multiply readings of some channels, and noise and range of their sensors, by a factor."""
    values = recording.values.copy()
    sensors = dict(vehicle.sensors)
    for name in names:
        c = recording.channels.index(name)
        sensor = vehicle.sensor(name)
        scale = sensor.counts_scale
        if recording.units[c] != "counts":
            values[c] *= factor
        elif scale is not None:
            scale *= factor
        ends = sorted((sensor.low * factor, sensor.high * factor))
        size = abs(factor)
        sensors[name] = replace(
            sensor, counts_scale=scale, low=ends[0], high=ends[1],
            noise=None if sensor.noise is None else sensor.noise * size,
            resolution=None if sensor.resolution is None else sensor.resolution * size,
        )  # fmt: skip
    return replace(recording, values=values), replace(vehicle, sensors=sensors)


def _shifted(
    recording: Recording, vehicle: Vehicle, names: Sequence[str], seconds: float
) -> Corrected:
    """Add to the delays of some channels."""
    declared = timing(recording).delay
    added = []
    for name in names:
        own = declared[recording.channels.index(name)]
        delay = vehicle.sensor(name).delay if own is None else own
        added.append((f"delay {name}", f"{delay + seconds:.9f} s"))
    return replace(recording, metadata=(*recording.metadata, *added)), vehicle


def _of_given_values(vehicle: Vehicle, car: CarModel) -> Iterator[_Hypothesis]:
    """Given values that are wrong by a factor."""
    springs = tuple(dict.fromkeys(element.spring for element in car.elements))
    given = [p.name for p in car.parameters if p.kind == "given" and hasattr(vehicle, p.name)]
    own = [name for name in springs if name in given]
    if len(own) > 1:
        yield _factor("the spring rates of all axles", own, _SPRING_FACTORS, _SPRING_FIX)
    for name in own:
        axle = next(e.axle for e in car.elements if e.spring == name)
        yield _factor(f"the {axle} spring rate", [name], _SPRING_FACTORS, _SPRING_FIX)
    dampers = list(dict.fromkeys(element.damping for element in car.elements))
    dampers = [name for name in dampers if hasattr(vehicle, name)]
    for names in [dampers, *([name] for name in dampers if len(dampers) > 1)]:
        subject = " and ".join(f"nominal {name}" for name in names)
        yield _factor(subject, names, _DAMPING_FACTORS, _DAMPING_FIX, ())
    if "i" in car.estimated:
        yield _factor("the nominal pitch inertia", ["i"], _INERTIA_FACTORS, _INERTIA_FIX, ())
    if "m" in given:
        yield _factor("the sprung mass", ["m"], _MASS_FACTORS, _MASS_FIX)
    if any(p.kind == "fraction" for p in car.parameters):
        share = vehicle.wdf.value
        yield _Hypothesis(
            lambda size: (
                f"the front weight fraction is that of the rear ({1.0 - share:.3f} would fit)",
                "give the front share of the sprung weight",
            ),
            lambda recording, vehicle, size: (recording, _with_share(vehicle, 1.0 - share)),
        )
        yield _Hypothesis(
            lambda size: (
                f"the front weight fraction is off ({share + size:.3f} would fit)",
                "weigh both axles",
            ),
            lambda recording, vehicle, size: (recording, _with_share(vehicle, share + size)),
            (-0.1, -0.05, 0.05, 0.1),
        )
    if {"k_f", "k_r"} <= set(given):
        yield _Hypothesis(
            lambda size: ("front and rear spring rate are exchanged", "exchange them"),
            lambda r, v, size: (r, replace(v, k_f=v.k_r, k_r=v.k_f)),
        )


def _with_share(vehicle: Vehicle, share: float) -> Vehicle:
    return replace(vehicle, wdf=replace(vehicle.wdf, value=float(np.clip(share, 0.05, 0.95))))


def _factor(
    subject: str,
    names: Sequence[str],
    named: dict[float, str],
    fix: str,
    others: Sequence[float] = _FACTORS,
) -> _Hypothesis:
    """Return that given values are too large by one factor; some factors are likelier."""

    def undo(recording: Recording, vehicle: Vehicle, size: float) -> Corrected:
        scale = math.exp(-size)
        changed = {}
        for name in names:
            old: Given | Nominal = getattr(vehicle, name)
            sds = {} if old.sd is None else {"sd": old.sd * scale}
            changed[name] = replace(old, value=old.value * scale, **sds)
        return recording, replace(vehicle, **changed)  # type: ignore[arg-type]

    def words(size: float) -> tuple[str, str]:
        plural = "are" if len(names) > 1 else "is"
        text = f"{subject} {plural} {_times(math.exp(size))} what the recording shows"
        for factor, reason in named.items():
            if abs(size + math.log(factor)) < 3.0 * _NAMED_FACTOR:
                return f"{text}: {reason}", fix
        return text, fix

    def density(size: float) -> float:
        nearest = min(abs(size + math.log(factor)) for factor in named) / _NAMED_FACTOR
        known = -math.log(2.0 * len(named)) - 0.5 * nearest**2
        return float(np.logaddexp(math.log(0.5) + _OCCAM, known)) if others else known

    logs = sorted({*(-math.log(f) for f in named), *map(math.log, others)})
    return _Hypothesis(words, undo, tuple(logs), density)


_SPRING_FIX = (
    "give the rate of both springs of an axle together at the wheel (spring rate times the square "
    "of the motion ratio), and check its unit"
)
_DAMPING_FIX = "give the rate of all dampers of an axle together, at the wheel, and check its unit"
_INERTIA_FIX = "give the pitch inertia of the sprung mass with driver, and check its unit"
_MASS_FIX = (
    "give the sprung mass with driver, without wheels, hubs and half of the links, and check its "
    "unit"
)


def _of_time() -> Iterator[_Hypothesis]:
    yield _Hypothesis(
        lambda size: (
            f"time runs {_times(math.exp(size))} as fast as it should: the sampling rate is wrong",
            "check the rate and the unit of the time column",
        ),
        lambda r, v, size: (replace(r, time=r.time[0] + (r.time - r.time[0]) * math.exp(size)), v),
        tuple(sorted(math.log(f) for f in _TIME_FACTORS)),
    )


def _words(name: str) -> str:
    return name.replace("_", " ")


def _and(names: Sequence[str]) -> str:
    return " and ".join(map(_words, names))


def _are(names: Sequence[str]) -> str:
    return f"{_and(names)} {'is' if len(names) == 1 else 'are'}"


def _times(factor: float) -> str:
    """Put a factor in words."""
    if factor >= 10.0:
        return f"{factor:.0f} times"
    return f"{factor:.2f} times" if factor >= 0.1 else f"{factor:.2g} times"
