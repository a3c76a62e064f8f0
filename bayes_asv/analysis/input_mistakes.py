"""Mistakes in the input as hypotheses: exchanged columns, wrong units, lags, signs, values.

Each hypothesis says what a person or a logger may have got wrong, and how to undo it.  All are
fitted to the same rows: the stretch of the recording in which the wheels move most.  Each may
multiply the deviations of all noise by the factor that it needs, at least one; so a mistake has to
explain more than noise of unknown size does.  With the log posterior ℓ at the mode, a hypothesis
with prior probability π has the weight

    π exp(ℓ / φ)

φ ≥ 1 is the long-run variance of the best hypothesis's normalised innovations, over the square of
its noise factor.  It is one where the innovations are white; what is left makes φ large and all
comparisons cautious (a quasi-likelihood; McCullagh & Nelder 1989, ch. 9).

Front and rear exchanged make a mirrored car, which leaves little trace in the likelihood; but the
front wheels meet the road first.  Mistakes in nominal values leave none, see
:mod:`.input_hypotheses`.
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

_SECONDS = 2.5  # of the most lively stretch: five periods of the slowest mode
_PRIOR = 0.1  # probability that an input has one of the mistakes, shared equally by them
_REFINED = 6  # hypotheses with a size that are refined, the best ones
_TOLD = 3  # mistakes in a sentence
_RUNS = 3  # recordings that are looked at
_MOVED = 3.0  # deviations: once in 370 right inputs for each given value
_NEARLY_HOLDS = 30.0  # dispersion up to which a mistake explains enough to be named
_ERROR_OF_RATES = 0.5 * math.log(2.0)  # of a model that does not hold: a factor of two is rare
_BACKWARDS = -8.0  # log prior odds of a drive in which the rear wheels lead
_ALIKE = 0.6  # correlation of front and rear wheels from which on their order means something
_AHEAD = 0.2  # by which it has to be larger than with the other order


@dataclass(frozen=True)
class InputCheck:
    """Why no verdict on a damper may rest on an estimate.

    Parameters
    ----------
    mistakes : tuple of Mistake
        Mistakes in the input that explain the recordings, the likeliest first; empty where none
        does.
    sentence : str
        What is probably wrong and what to do.
    model_holds : bool
        Whether the car as given explains the recordings down to the noise of the sensors.
    about : {'input', 'model'}
        Whether the sentence speaks of an input or of the model.
    """

    mistakes: tuple[Mistake, ...]
    sentence: str
    model_holds: bool = True
    about: str = "input"


def check_input(
    recordings: Sequence[Recording], vehicle: Vehicle, car: str = "half", refused: bool = False
) -> InputCheck | None:
    """Check the input of an estimate and look for a mistake where something is wrong.

    Something is wrong where a channel holds its value or another one's, where the data move a given
    value by more than `_MOVED` of its deviations, where the rear wheels lead, where the innovations
    have a long-run variance that noise as declared cannot explain, or where the fitted car is none
    that anybody builds.

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
    model = car_model(car, vehicle)
    recordings = recordings[:_RUNS]
    stuck = [why for one in recordings for why in stuck_channels(one, vehicle, model)]
    if stuck:
        parts = [why.partition("; ") for why in stuck]
        known = [Mistake(what, fix, 1.0, misread=True) for what, _, fix in parts]
        return InputCheck(tuple(known), "; ".join(stuck))
    fit = _screened(_most_active(recordings, recordings, vehicle), vehicle, car)
    moved = [] if fit is None else _moved(fit)
    holds = fit is not None and fit.holds
    if fit is not None and holds:
        holds = all(holds_throughout(fit, one, vehicle, car, _SECONDS) for one in recordings)
    mistakes: list[Mistake] = []
    if moved or not holds or rear_leads(recordings):
        mistakes = likely_mistakes(recordings, vehicle, car)
        mistakes = mistakes or _of_one_recording(recordings, vehicle, car)
    if not mistakes and fit is not None and not refused:
        mistakes = implausible_values(model, fit.values)
        error = 0.0 if holds else _ERROR_OF_RATES
        mistakes = mistakes or nominal_mistakes(vehicle, model, fit.values, error)
    if mistakes:
        return InputCheck(tuple(mistakes), _sentence(mistakes), holds)
    if refused:
        return None  # a refusal has reasons of its own
    # White noise leaves the long-run variance small, so that a fit holds nevertheless.
    noisy = [why for one in recordings for why in noisy_channels(one, vehicle, model)]
    if noisy:
        return InputCheck((), "; ".join(noisy), holds)
    if holds and not moved:
        return None
    if moved:
        assert fit is not None
        return InputCheck((), _contradiction(moved, fit.values, vehicle), holds)
    return InputCheck(
        (),
        "the linear car does not explain the recording down to the noise of the sensors; run "
        "'bayes-asv diagnose' to find what is missing before any verdict on a damper",
        model_holds=False,
        about="model",
    )


def _moved(fit: ScreeningFit) -> list[str]:
    """Name the given values that a fit moves by more than is likely."""
    return [name for name, deviations in fit.moved.items() if abs(deviations) > _MOVED]


def _of_one_recording(recordings: Sequence[Recording], vehicle: Vehicle, car: str) -> list[Mistake]:
    """Find a mistake of a recording that does not agree with the input, while another one does.

    If none agrees, the cause is common to all: a given value, or what the model lacks.
    """
    if len(recordings) == 1:
        return []
    fits = [_screened(_most_active([one], [one], vehicle), vehicle, car) for one in recordings]
    odd = [fit is None or not fit.holds or bool(_moved(fit)) for fit in fits]
    if all(odd):
        return []
    for one in (recording for recording, other in zip(recordings, odd, strict=True) if other):
        every = list(hypotheses_of_recording(one, vehicle, car_model(car, vehicle)))
        found = _likeliest(every, [one], vehicle, car)
        if found:
            source = Path(one.source).name
            return [replace(m, words=f"in {source} {m.words}") for m in found]
    return []


def _contradiction(moved: Sequence[str], values: Mapping[str, float], vehicle: Vehicle) -> str:
    """Say which given values the recording contradicts, and by what factors."""
    parts = []
    for name in moved:
        if name not in QUANTITIES:
            continue
        factor = getattr(vehicle, name).value / values[name]
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
    for other in others[: _TOLD - 1]:
        text += f", or {other.words} ({100 * other.probability:.0f} %)"
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
    every = list(hypotheses(recordings[0], vehicle, car_model(car, vehicle)))
    return _likeliest(every, recordings, vehicle, car, progress)


def _likeliest(
    others: Sequence[Hypothesis],
    recordings: Sequence[Recording],
    vehicle: Vehicle,
    car: str,
    progress: Callable[[float], None] = lambda share: None,
) -> list[Mistake]:
    """Hold hypotheses against recordings; return the likeliest mistakes, unless there is none."""
    every = [CORRECT, *others]
    share = math.log(_PRIOR / (len(every) - 1))
    # One recording sorts out most of the mistakes; what is left is held against all of them.
    liveliest = [max(recordings, key=lambda one: float(np.mean(wheel_power(one, vehicle))))]
    sorted_out: list[_Tried] = []
    for k, hypothesis in enumerate(every):
        sizes = _sizes(hypothesis, liveliest, vehicle, car)
        each = [_evaluate(hypothesis, size, liveliest, vehicle, car) for size in sizes]
        sorted_out.append(max(each, key=lambda one: one.log_posterior + one.log_prior))
        progress((k + 1) / (len(every) + _REFINED))
    sorted_out.sort(key=lambda one: -one.log_posterior)
    for k, one in enumerate(sorted_out[:_REFINED]):
        sorted_out[k] = _refined(one, liveliest, vehicle, car)
    left = sorted_out[: 2 * _REFINED]
    left += [one for one in sorted_out[2 * _REFINED :] if one.hypothesis is CORRECT]
    tried = [_evaluate(one.hypothesis, one.size, recordings, vehicle, car, STEPS) for one in left]
    tried = [one for one in tried if one.dispersion < _NEARLY_HOLDS]
    if not tried:
        return []  # whatever is wrong is not in the list
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
    """Sizes that a mistake may have: where a search begins, and what a fit finds."""
    sizes = hypothesis.sizes
    if hypothesis.freed is not None and hypothesis.size_of is not None:
        parts = _most_active(recordings, recordings, vehicle)
        fit = _screened(parts, hypothesis.freed(vehicle), car)
        if fit is not None:
            sizes = (*sizes, hypothesis.size_of(vehicle, fit.values))
    return sizes or (0.0,)


def _most_active(
    recordings: Sequence[Recording], given: Sequence[Recording], vehicle: Vehicle
) -> list[Recording]:
    """Cut recordings to the rows in which the wheels move most, according to those as given.

    Every hypothesis so has the same rows to explain.
    """
    rows = [most_active_rows(one, vehicle, _SECONDS) for one in given]
    return [cut(one, own) for one, own in zip(recordings, rows, strict=True)]


def _screened(
    recordings: Sequence[Recording], vehicle: Vehicle, car: str, steps: int = STEPS
) -> ScreeningFit | None:
    """Fit quickly; None where an input cannot be fitted at all."""
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
    """Fit with one mistake undone; minus infinity where that leaves nothing to fit."""
    undone = [hypothesis.undo(recording, vehicle, size) for recording in recordings]
    whole = [recording for recording, _ in undone]
    inputs = _most_active(whole, recordings, vehicle)
    fit = _screened(inputs, undone[0][1], car, steps)
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
    if one.hypothesis.exact or len(sizes) == 1 or not math.isfinite(one.log_posterior):
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
