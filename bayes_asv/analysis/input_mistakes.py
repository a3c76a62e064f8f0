"""Comparison of mistakes in the input: exchanged columns, wrong units, lags, signs, values.

Each hypothesis describes a mistake of a person or a logger, and the correction that undoes it.  All
are fitted to the same rows: the stretch of the recording in which the wheels move most.  Each may
multiply all noise levels by a factor of at least one, so that a mistake has to explain more than a
larger noise level would.  With the log posterior ℓ at the mode, a hypothesis with prior probability
π has the weight

    π exp(ℓ / φ)

φ ≥ 1 is the long-run variance of the best hypothesis's normalised innovations, over the square of
its noise factor.  It is one if the innovations are white; autocorrelated residuals make φ large and
all comparisons cautious (a quasi-likelihood; McCullagh & Nelder 1989, ch. 9).

If front and rear are exchanged, the car is mirrored, which hardly changes the likelihood; but the
front wheels meet the road first.  Mistakes in nominal values do not change it, see
:mod:`.nominal_values`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar
from scipy.signal import correlate

from bayes_asv.analysis.input_hypotheses import (
    CORRECT,
    REPORTED,
    Hypothesis,
    Mistake,
    hypotheses,
    hypotheses_of_recording,
)
from bayes_asv.analysis.nominal_values import implausible_values, nominal_mistakes
from bayes_asv.analysis.screening_fit import (
    COARSE_STEPS,
    STEPS,
    ScreeningFit,
    holds_throughout,
    screening_fit,
)
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.recording import Recording
from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.models.car_model import CarModel
from bayes_asv.models.cars import car_model
from bayes_asv.preprocessing.activity import cut, most_active_rows, wheel_power
from bayes_asv.preprocessing.faulty_channels import noisy_channels, stuck_channels

__all__ = [
    "InputCheck",
    "Mistake",
    "check_input",
    "likely_mistakes",
    "rear_leads",
]

Array = NDArray[np.float64]
Corrected = tuple[Recording, Vehicle]

_SECONDS = 2.5  # length of the most active stretch, s: five periods of the slowest mode
_PRIOR = 0.1  # prior probability of a mistake in the input, shared equally by all hypotheses
_REFINED = 6  # number of the best hypotheses whose size is refined
_MAX_NAMED = 3  # largest number of mistakes in a message
_RUNS = 3  # largest number of recordings that are checked
# Shift of a given value, in prior sd, that contradicts it; its false-alarm rate is 1 in 370.
_CONTRADICTED = 3.0
_MAX_DISPERSION = 30.0  # dispersion above which a hypothesis explains too little to be named
# Standard deviation of the log error of rates if the model does not hold: a factor of 2 is rare.
_ERROR_OF_RATES = 0.5 * math.log(2.0)
_BACKWARDS = -8.0  # log prior odds of a drive in which the rear wheels lead
_ALIKE = 0.6  # correlation of front and rear wheels above which their order is significant
_AHEAD = 0.2  # difference of that correlation between the two orders that is significant


@dataclass(frozen=True)
class InputCheck:
    """Result of the input check: why an estimate supports no verdict on a damper.

    Parameters
    ----------
    mistakes : tuple of Mistake
        Mistakes in the input that explain the recordings, the most probable first.
    sentence : str
        Message: what is probably wrong, and what to do.
    model_holds : bool
        Whether the car as given explains the recordings to within the noise of the sensors.
    about : {'input', 'model'}
        Whether the message is about the input or about the model.
    """

    mistakes: tuple[Mistake, ...]
    sentence: str
    model_holds: bool = True
    about: str = "input"


def check_input(
    recordings: Sequence[Recording], vehicle: Vehicle, car: str = "half", refused: bool = False
) -> InputCheck | None:
    """Check the input of an estimate, and search for a mistake if something is wrong.

    Something is wrong if a channel is stuck or repeats another one, if the data move a given value
    by more than :data:`_CONTRADICTED` prior standard deviations, if the rear wheels lead, if the
    long-run variance of the innovations exceeds that of the declared noise, or if the fitted car is
    implausible.

    Parameters
    ----------
    recordings, vehicle, car
        As for :func:`likely_mistakes`.
    refused : bool
        Whether the recordings were refused.

    Returns
    -------
    InputCheck or None
        None if nothing argues against the estimate.
    """
    model = car_model(car, vehicle)
    recordings = recordings[:_RUNS]
    stuck = [sentence for one in recordings for sentence in stuck_channels(one, vehicle, model)]
    if stuck:
        parts = [sentence.partition("; ") for sentence in stuck]
        known = [Mistake(what, fix, 1.0, misread=True) for what, _, fix in parts]
        return InputCheck(tuple(known), "; ".join(stuck))
    fit = _fit_or_none(_most_active(recordings, recordings, vehicle), vehicle, car)
    contradicted = [] if fit is None else _contradicted_values(fit)
    holds = fit is not None and fit.holds
    if fit is not None and holds:
        holds = all(holds_throughout(fit, one, vehicle, car, _SECONDS) for one in recordings)
    mistakes: list[Mistake] = []
    if contradicted or not holds or rear_leads(recordings):
        mistakes = likely_mistakes(recordings, vehicle, car)
        mistakes = mistakes or _mistakes_of_one_recording(recordings, vehicle, car)
    if not mistakes and fit is not None and not refused:
        mistakes = implausible_values(model, fit.values)
        error = 0.0 if holds else _ERROR_OF_RATES
        mistakes = mistakes or nominal_mistakes(vehicle, model, fit.values, error)
    if mistakes:
        return InputCheck(tuple(mistakes), _sentence(mistakes), holds)
    if refused:
        return None  # a refusal states its own reasons
    # additional white noise keeps the long-run variance small, so that the fit passes
    noisy = [sentence for one in recordings for sentence in noisy_channels(one, vehicle, model)]
    if noisy:
        return InputCheck((), "; ".join(noisy), holds)
    if holds and not contradicted:
        return None
    if contradicted:
        assert fit is not None
        return InputCheck((), _contradiction(contradicted, fit.values, model), holds)
    return InputCheck(
        (),
        "the linear car does not explain the recording down to the noise of the sensors; run "
        "'bayes-asv diagnose' to find what is missing before any verdict on a damper",
        model_holds=False,
        about="model",
    )


def _contradicted_values(fit: ScreeningFit) -> list[str]:
    """Name the given values that a fit contradicts."""
    return [name for name, deviations in fit.moved.items() if abs(deviations) > _CONTRADICTED]


def _mistakes_of_one_recording(
    recordings: Sequence[Recording], vehicle: Vehicle, car: str
) -> list[Mistake]:
    """Find a mistake in one recording that contradicts the input while another one does not.

    If all of them do, the cause is common: a given value, or a deficiency of the model.
    """
    if len(recordings) == 1:
        return []
    fits = [_fit_or_none(_most_active([one], [one], vehicle), vehicle, car) for one in recordings]
    odd = [fit is None or not fit.holds or bool(_contradicted_values(fit)) for fit in fits]
    if all(odd):
        return []
    for one in (recording for recording, other in zip(recordings, odd, strict=True) if other):
        candidates = list(hypotheses_of_recording(one, vehicle, car_model(car, vehicle)))
        mistakes = _likeliest(candidates, [one], vehicle, car)
        if mistakes:
            source = Path(one.source).name
            return [replace(m, words=f"in {source} {m.words}") for m in mistakes]
    return []


def _contradiction(moved: Sequence[str], values: Mapping[str, float], model: CarModel) -> str:
    """Say which given values the recording contradicts, and by what factors."""
    given = {parameter.name: parameter.nominal for parameter in model.parameters}
    parts = []
    for name in moved:
        factor = given[name] / values[name]
        mass = f" (or the sprung mass, {1.0 / factor:.2f} times)" if name.startswith("k_") else ""
        parts.append(f"the {QUANTITIES[name][1]}, {factor:.2f} times what it shows{mass}")
    return (
        f"the recording contradicts what is given for {' and '.join(parts)}; check value, unit and "
        "sd of what is given (springs: at the wheel, both sides of an axle, so the rate of the "
        "spring times the square of the motion ratio; mass: sprung, with driver) before any "
        "verdict on a damper"
    )


def _sentence(mistakes: Sequence[Mistake]) -> str:
    first, *others = mistakes
    text = (
        f"the input is probably wrong: {first.words} (probability {100 * first.probability:.0f} %)"
    )
    for other in others[: _MAX_NAMED - 1]:
        text += f", or {other.words} ({100 * other.probability:.0f} %)"
    return f"{text}; {first.fix}"


def likely_mistakes(
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    car: str = "half",
    progress: Callable[[float], None] = lambda share: None,
) -> list[Mistake]:
    """Find mistakes that explain recordings better than the input as given.

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
        Mistakes with a probability above 5 %, the most probable first; empty if *no mistake* has
        more than half of the probability.
    """
    candidates = list(hypotheses(recordings[0], vehicle, car_model(car, vehicle)))
    return _likeliest(candidates, recordings, vehicle, car, progress)


def _likeliest(
    others: Sequence[Hypothesis],
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    car: str,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Mistake]:
    """Compare hypotheses; return the most probable mistakes, or none if the input is right."""
    all_hypotheses = [CORRECT, *others]
    share = math.log(_PRIOR / (len(all_hypotheses) - 1))
    # one recording rules out most hypotheses; the others are compared on all recordings
    most_active = [max(recordings, key=lambda one: float(np.mean(wheel_power(one, vehicle))))]
    ranked_coarsely: list[_Tried] = []
    for k, hypothesis in enumerate(all_hypotheses):
        sizes = _sizes(hypothesis, most_active, vehicle, car)
        each = [_evaluate(hypothesis, size, most_active, vehicle, car) for size in sizes]
        ranked_coarsely.append(max(each, key=lambda one: one.log_posterior + one.log_prior))
        progress((k + 1) / (len(all_hypotheses) + _REFINED))
    ranked_coarsely.sort(key=lambda one: -one.log_posterior)
    for k, one in enumerate(ranked_coarsely[:_REFINED]):
        ranked_coarsely[k] = _refine_size(one, most_active, vehicle, car)
    remaining = ranked_coarsely[: 2 * _REFINED]
    remaining += [one for one in ranked_coarsely[2 * _REFINED :] if one.hypothesis is CORRECT]
    tried = [
        _evaluate(one.hypothesis, one.size, recordings, vehicle, car, STEPS) for one in remaining
    ]
    tried = [one for one in tried if one.dispersion < _MAX_DISPERSION]
    if not tried:
        return []  # whatever is wrong, it is not in the list
    likeliest = max(tried, key=lambda one: one.log_posterior)
    dispersion = max(1.0, likeliest.dispersion / likeliest.noise_factor**2)
    logs = np.array(
        [
            one.log_posterior / dispersion
            + one.log_prior
            + (math.log(1.0 - _PRIOR) if one.hypothesis is CORRECT else share)
            for one in tried
        ]
    )
    weights = np.exp(logs - logs.max())
    weights /= weights.sum()
    ranked = sorted(zip(weights, tried, strict=True), key=lambda pair: -pair[0])
    if not any(one.hypothesis is CORRECT and weight > 0.5 for weight, one in ranked):
        return [
            Mistake(
                *one.hypothesis.words(one.size), float(weight), one.hypothesis.misread(one.size)
            )
            for weight, one in ranked
            if weight > REPORTED and one.hypothesis is not CORRECT
        ]
    return []


def _sizes(
    hypothesis: Hypothesis, recordings: Sequence[Recording], vehicle: Vehicle, car: str
) -> Sequence[float]:
    """List the sizes of a mistake that are tried: starting values, and the estimate of a fit."""
    sizes = hypothesis.sizes
    if hypothesis.freed is not None and hypothesis.size_of is not None:
        parts = _most_active(recordings, recordings, vehicle)
        fit = _fit_or_none(parts, hypothesis.freed(vehicle), car)
        if fit is not None:
            sizes = (*sizes, hypothesis.size_of(vehicle, fit.values))
    return sizes or (0.0,)


def _most_active(
    recordings: Sequence[Recording], given: Sequence[Recording], vehicle: Vehicle
) -> list[Recording]:
    """Cut recordings to the rows in which the wheels move most in the recordings as given.

    Thus every hypothesis is fitted to the same rows.
    """
    rows = [most_active_rows(one, vehicle, _SECONDS) for one in given]
    return [cut(one, active_rows) for one, active_rows in zip(recordings, rows, strict=True)]


def _fit_or_none(
    recordings: Sequence[Recording], vehicle: Vehicle, car: str, steps: int = STEPS
) -> ScreeningFit | None:
    """Compute a screening fit; None if the input cannot be fitted."""
    try:
        return screening_fit(recordings, vehicle, car, steps)
    except InputError:
        return None


class _Tried(NamedTuple):
    hypothesis: Hypothesis
    size: float
    log_posterior: float
    log_prior: float
    dispersion: float
    noise_factor: float


def _evaluate(
    hypothesis: Hypothesis,
    size: float,
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    car: str,
    steps: int = COARSE_STEPS,
) -> _Tried:
    """Fit with one mistake undone; the log posterior is −∞ if that cannot be fitted."""
    corrections = [hypothesis.undo(recording, vehicle, size) for recording in recordings]
    corrected = [recording for recording, _ in corrections]
    inputs = _most_active(corrected, recordings, vehicle)
    fit = _fit_or_none(inputs, corrections[0][1], car, steps)
    if fit is None:
        return _Tried(hypothesis, size, -math.inf, 0.0, math.inf, 1.0)
    volume = sum(
        log * np.count_nonzero(np.isfinite(recording.values[recording.channels.index(name)]))
        for recording in inputs
        for name, log in hypothesis.stretch(size).items()
        if not vehicle.channel(name).is_input  # the likelihood is conditional on inputs
    )
    prior = hypothesis.density(size) + (_BACKWARDS if rear_leads(corrected) else 0.0)
    return _Tried(
        hypothesis, size, fit.log_posterior + volume, prior, fit.dispersion, fit.noise_factor
    )


def _refine_size(
    one: _Tried, recordings: Sequence[Recording], vehicle: Vehicle, car: str
) -> _Tried:
    """Optimise the size of a mistake between the neighbours of its best starting value."""
    sizes = sorted({*one.hypothesis.sizes, 0.0})
    if one.hypothesis.exact or len(sizes) == 1 or not math.isfinite(one.log_posterior):
        return one
    k = sizes.index(one.size)
    low = sizes[k - 1] if k > 0 else 1.5 * one.size
    high = sizes[k + 1] if k + 1 < len(sizes) else 1.5 * one.size

    def loss(size: float) -> float:
        other = _evaluate(one.hypothesis, float(size), recordings, vehicle, car)
        return -max(other.log_posterior + other.log_prior, -1e300)

    optimum = minimize_scalar(
        loss, bounds=(low, high), method="bounded", options={"xatol": 5e-3 * (high - low)}
    )
    refined = _evaluate(one.hypothesis, float(optimum.x), recordings, vehicle, car)
    return max(one, refined, key=lambda other: other.log_posterior + other.log_prior)


def rear_leads(recordings: Sequence[Recording]) -> bool:
    """Whether the rear wheels meet the road before the front ones.

    The signals of both hubs are correlated for all shifts up to half the recording.  Their order is
    significant if they are similar in one order and clearly less so in the other.
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
