"""Can a recording of seven channels answer at all?  Reasons in words, before and after the fit."""

from __future__ import annotations

import math

import numpy as np

from bayes_asv.domain.channels import ROLL_CHANNELS
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.models.roll_car import RollCar
from bayes_asv.models.second_order import second_order_modes
from bayes_asv.posterior.roll.layout import RollLayout
from bayes_asv.posterior.roll.posterior import ROLL_ANSWERS, RollPosterior
from bayes_asv.preprocessing.data_checks import DOUBTFUL, clipping_limit
from bayes_asv.preprocessing.noise_level import quiet_level

__all__ = ["roll_preflight", "unexplained", "unmeasured"]

_FEWEST = 100  # rows
_SAMPLES_A_PERIOD = 12.0  # of the fastest mode
_MISSING = 0.2  # share of a channel's readings
_SHAKEN = 5.0  # wheel rms in units of its noise
_STILL = 0.05  # m/s², wheel rms below which nothing was driven over
_NOT_NARROWED = 0.7  # posterior over prior deviation
_NOT_EXPLAINED = 0.7  # share left over (rms)


def roll_preflight(car: RollCar, line: RollLayout) -> list[str]:
    """Say what would make an answer worthless.

    Parameters
    ----------
    car : RollCar
        Nominal car: its modes say how long and how fast one must measure.
    line : RollLayout
        One recording.

    Returns
    -------
    list of str
        Sentences; any means that the recording is refused.
    """
    found = [mode.natural for mode in second_order_modes(*car.system()[:3])]
    times = line.times[0]
    rows, duration = len(times), float(times[-1] - times[0])
    rate = 1.0 / float(np.median(np.diff(times)))
    reasons = []
    needed = max(1.0 / found[0], 0.3)
    if duration < needed or rows < _FEWEST:
        reasons.append(
            f"{line.source} is too short: {duration:.2f} s in {rows} rows, and this car needs at "
            f"least {needed:.2f} s and {_FEWEST} rows; record until it has stopped bouncing"
        )
    if rate < _SAMPLES_A_PERIOD * found[-1]:
        reasons.append(
            f"{line.source} was taken at {rate:.0f} Hz, too slow for this car, which moves at up "
            f"to {found[-1]:.1f} Hz; record at {_SAMPLES_A_PERIOD * found[-1]:.0f} Hz or more"
        )
    for c, name in enumerate(ROLL_CHANNELS):
        plain = name.replace("_", " ")
        clipped = int(np.count_nonzero(line.clipped[c]))
        if clipped > clipping_limit(rows):
            reasons.append(
                f"the {plain} sensor of {line.source} was at the end of its range in {clipped} of "
                f"{rows} samples; drive slower or use a sensor with a wider range"
            )
        there = np.isfinite(line.acceleration[c])
        if np.mean(there) < 1.0 - _MISSING:
            reasons.append(
                f"the {plain} sensor of {line.source} lacks {1.0 - np.mean(there):.0%} of its "
                "readings; check its wiring and the logger"
            )
        if c < 4:
            rms = float(np.std(line.acceleration[c, there]))
            if rms < max(_STILL, _SHAKEN * _level(line, c)):
                reasons.append(
                    f"the {plain} of {line.source} hardly moves (rms {rms:.2g} m/s²); drive its "
                    "wheel over something, or drive faster"
                )
    if not reasons and all(_alike(line, left) for left in (0, 2)):
        reasons.append(
            f"left and right wheels of {line.source} move alike, so nothing rolls the car; drive "
            "one side over something before the other, or leave out --car roll"
        )
    return reasons


def _level(line: RollLayout, c: int) -> float:
    """Noise of one sample of a channel with its steps, m/s²."""
    given, step = line.noise[c], float(line.steps[c])
    own = quiet_level(line.acceleration[c], step) if given is None else given
    return math.hypot(own, step / math.sqrt(12.0))


def _alike(line: RollLayout, left: int) -> bool:
    """Whether the two wheels of an axle differ by little more than their noise."""
    apart = line.acceleration[left] - line.acceleration[left + 1]
    rms = float(np.std(apart[np.isfinite(apart)]))
    return rms < _SHAKEN * math.hypot(_level(line, left), _level(line, left + 1))


def unmeasured(target: RollPosterior, log_sd: dict[str, float]) -> list[str]:
    """Say which answers the data leave nearly as wide as the prior.

    Parameters
    ----------
    target : RollPosterior
        Gives the priors.
    log_sd : dict
        Posterior deviations of the logarithms of the answers.
    """
    return [
        f"the {QUANTITIES[name][1]} is not measured by these data; drive the left and the right "
        "wheels over something at different times"
        for name in ROLL_ANSWERS
        if target.prior_sd(name) > 0.3 and log_sd[name] > _NOT_NARROWED * target.prior_sd(name)
    ]


def unexplained(left: dict[str, float], source: str) -> tuple[list[str], list[str]]:
    """Judge what the fitted car leaves of each chassis channel.

    Parameters
    ----------
    left : dict
        Rms of what is left over that of the channel.
    source : str
        The recording.

    Returns
    -------
    reasons, warnings : lists of str
        A channel of which too much is left refuses the recording; some is a warning.
    """
    reasons, warnings = [], []
    for name, share in left.items():
        plain = name.replace("_", " ")
        explained = max(1.0 - share**2, 0.0)
        if not math.isfinite(share) or share > _NOT_EXPLAINED:
            reasons.append(
                f"this car explains {explained:.0%} of the {plain} motion of {source}; check "
                "channels, signs, units and the vehicle file"
            )
        elif share > DOUBTFUL:
            warnings.append(
                f"this car explains {explained:.0%} of the {plain} motion of {source}; the "
                "intervals are too narrow for what is left"
            )
    return reasons, warnings
