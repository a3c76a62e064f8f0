"""Checks after the fit: whether the model explains a recording, and the noise is plausible."""

from __future__ import annotations

import numpy as np

from bayes_asv.models.modes import nominal_modes
from bayes_asv.posterior.free_simulation import FreeRun, unexplained_in_band
from bayes_asv.preprocessing.data_checks import MAX_UNEXPLAINED, suggest_band
from bayes_asv.preprocessing.prepared_recording import PreparedRecording

__all__ = ["band_advice", "excess_noise_sentence", "explained_power_findings", "model_bandwidth"]

# Bandwidth in which the car has to explain the readings, in frequencies of its fastest mode.
_BAND = 2.5
_MAX_RESIDUAL_SHARE = 0.7  # unexplained share (rms) above which the estimate is refused
_MAX_TRAVEL = 0.4  # suspension travel that no small car has, m
_EXCESS_NOISE = 3.0  # estimated over declared noise level above which a warning is given


def explained_power_findings(
    recording: PreparedRecording, free: FreeRun, widened: bool = False
) -> tuple[list[str], list[str]]:
    """Check that the fitted car explains the motion in its band.

    Parameters
    ----------
    recording, free : PreparedRecording and FreeRun
        One recording and its best simulation.
    widened : bool
        Whether the intervals account for the residuals.

    Returns
    -------
    reasons, warnings : lists of str
    """
    reasons: list[str] = []
    warnings: list[str] = []
    top = model_bandwidth(recording)
    for c, residual_share in zip(
        recording.outputs, unexplained_in_band(recording, free, top), strict=True
    ):
        share = 100.0 * max(1.0 - float(residual_share) ** 2, 0.0)
        words = (
            f"the fitted {recording.car.name} car explains only {share:.0f} % of the "
            f"{recording.channels[c].words} signal below {top:.0f} Hz in {recording.source}"
        )
        if residual_share > _MAX_RESIDUAL_SHARE:
            reasons.append(
                f"{words}, too little to trust any answer; check channels, signs, units and "
                "clocks, and that the sensors sit on hubs and frame above the axles; if all that "
                "is right, this car does something that the linear model cannot"
            )
        elif residual_share > MAX_UNEXPLAINED:
            words += "; something that it does not know is at work"
            warnings.append(
                words if widened else f"{words}, and the intervals do not account for it"
            )
    travel = float(np.max(np.abs(free.states[:, 0 : 2 * len(recording.car.elements) : 2])))
    if travel > _MAX_TRAVEL:
        warnings.append(
            f"{recording.source} would mean {travel:.1f} m of suspension travel; check the units "
            "and scales of the sensors"
        )
    return reasons, warnings


def band_advice(recording: PreparedRecording, simulated: FreeRun) -> list[str]:
    """Recommend a band in which the wheels explain more; see :func:`suggest_band`."""
    if recording.below is not None:
        return []
    top = model_bandwidth(recording)
    return suggest_band(recording, unexplained_in_band(recording, simulated, top) ** 2, top)


def model_bandwidth(recording: PreparedRecording) -> float:
    """Frequency (Hz) up to which the car has to explain a recording."""
    top = _BAND * nominal_modes(recording.car)[-1].natural
    return top if recording.below is None else min(top, recording.below)


def excess_noise_sentence(
    recording: PreparedRecording, found: dict[str, float], run: int
) -> list[str]:
    """Warn if an estimated noise level is far above the declared one.

    Parameters
    ----------
    recording : PreparedRecording
        One recording.
    found : dict of str to float
        Estimated noise levels (standard deviations) by name, SI units.
    run : int
        Which recording.

    Returns
    -------
    list of str
    """
    out = []
    for c, channel in enumerate(recording.channels):
        given = recording.noise[c]
        level = found.get(f"noise {channel.name} {run}")
        if given is not None and level is not None and level > _EXCESS_NOISE * given:
            out.append(
                f"the noise of the {channel.words} sensor in {recording.source} came out "
                f"{level / given:.0f} times what the vehicle file says: a value that it gives as "
                "exact is wrong, or the model lacks some motion; give mass, springs and weight "
                "fraction an sd"
            )
    return out
