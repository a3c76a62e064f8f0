"""The spectrum of a recording, channel by channel."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.signal import find_peaks, welch

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.recording import Recording, accelerations, nominal_rate
from bayes_asv.domain.units import display_units, from_si
from bayes_asv.domain.vehicle import Vehicle

__all__ = ["spectrum_document"]

_TOP = 30.0  # Hz, beyond which the car itself does nothing
_PEAKS = 3
_FEWEST = 32


def spectrum_document(recording: Recording, vehicle: Vehicle) -> dict[str, Any]:
    """Spectral density of each channel by Welch's method, segments of two seconds at most.

    Parameters
    ----------
    recording, vehicle : Recording, Vehicle
        As read; missing readings are bridged by straight lines.

    Returns
    -------
    dict
        Per channel: ``frequency_hz``, ``density`` in the vehicle's units, and ``peaks_hz``, the
        highest peaks below 30 Hz.

    Raises
    ------
    InputError
        When a channel has fewer than 32 readings.
    """
    rate = nominal_rate(recording)
    unit = display_units(vehicle.units)["acceleration"]
    time, channels = recording.time, {}
    even = time[0] + np.arange(int((time[-1] - time[0]) * rate + 1e-6) + 1) / rate
    for name, values in zip(CHANNELS, accelerations(recording, vehicle), strict=True):
        there = np.isfinite(values)
        if np.count_nonzero(there) < _FEWEST or len(even) < _FEWEST:
            raise InputError(
                recording.source, f"{name} has fewer than {_FEWEST} readings", "record longer"
            )
        signal = from_si(1.0, unit, "acceleration") * np.interp(even, time[there], values[there])
        segment = min(len(even), int(2.0 * rate))
        frequency, density = welch(signal, rate, nperseg=segment)
        low = frequency <= _TOP
        at = find_peaks(density[low])[0]
        best = at[np.argsort(density[at])[::-1][:_PEAKS]]
        channels[name] = {
            "frequency_hz": frequency.tolist(),
            "density": density.tolist(),
            "peaks_hz": sorted(float(f) for f in frequency[best]),
        }
    return {
        "source": recording.source.replace("\\", "/").rpartition("/")[2],
        "unit": f"({unit})^2/Hz",
        "rate_hz": rate,
        "channels": channels,
    }
