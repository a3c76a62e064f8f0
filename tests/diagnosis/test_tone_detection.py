"""Detection of tones that wander, in white noise and among other disturbances."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

from bayes_asv.diagnosis.tone_detection import DetectedTones, detect_tones
from bayes_asv.preprocessing.tone_removal import Notch

Array = NDArray[np.float64]

_T = np.arange(1000) / 400.0


def _detected(
    rng: np.random.Generator, draw: Callable[[], Array], energy: float, alarm: float
) -> tuple[Notch, ...]:
    """Tones detected in two white runs with a signal of some energy, half of it in each."""
    runs = []
    for _ in range(2):
        signal = draw()
        nu = rng.normal(size=(len(_T), 2))
        runs.append(nu + signal[:, None] * math.sqrt(0.25 * energy / float(signal @ signal)))
    return detect_tones(runs, 400.0, 10.0, alarm).tones


def test_white_noise_seldom_has_tones() -> None:
    """400 pairs of runs, seed 1, 2 % false alarms accepted: at most 4 %, three deviations more."""
    rng = np.random.default_rng(1)
    false_alarms = sum(
        bool(
            detect_tones(
                [rng.normal(size=(1000, 2)), rng.normal(size=(900, 2))], 400.0, 10.0, 0.02
            ).tones
        )
        for _ in range(400)
    )
    assert false_alarms <= 16


def test_a_weak_tone_that_wanders_is_detected_at_its_frequency() -> None:
    """A tone that wanders by 3 %, whose energy in two runs is 120: 20 draws, seed 2."""
    rng = np.random.default_rng(2)

    def tone() -> Array:
        drift = 1.0 + 0.03 * np.sin(2.0 * math.pi * (0.4 * _T + rng.random()))
        return np.sin(2.0 * math.pi * np.cumsum(31.0 * drift) / 400.0 + 6.28 * rng.random())

    detected = [_detected(rng, tone, 120.0, 2e-3) for _ in range(20)]
    assert sum(bool(t) and abs(t[0].frequency - 31.0) < 2.5 for t in detected) >= 12


def test_a_shock_that_rings_is_no_engine() -> None:
    """Bursts at 12 Hz, a tenth of a second long, of energy 80 a run: 20 draws, seed 3."""
    rng = np.random.default_rng(3)
    burst = np.exp(-(((_T - 1.6) / 0.1) ** 2)) * np.sin(2.0 * math.pi * 12.0 * (_T - 1.6))
    assert sum(bool(_detected(rng, lambda: burst, 160.0, 0.05)) for _ in range(20)) <= 2


def test_a_strong_engine_that_wanders_is_detected() -> None:
    """Tones at 16, 32 and 64 Hz that wander by 3 %, of energy 40 000: 10 draws, seed 5."""
    rng = np.random.default_rng(5)

    def engine() -> Array:
        drift = 1.0 + 0.03 * np.sin(2.0 * math.pi * (0.4 * _T + rng.random()))
        turns = np.cumsum(32.0 * drift) / 400.0
        parts = ((0.5, 0.25), (1.0, 1.0), (2.0, 0.35))
        return sum(
            (a * np.sin(2.0 * math.pi * (k * turns + rng.random())) for k, a in parts),
            start=np.zeros(len(_T)),
        )

    for _ in range(10):
        detected = [n.frequency for n in _detected(rng, engine, 4e4, 0.05)]
        for order in (0.5, 1.0, 2.0):
            assert any(abs(f / order - 32.0) < 2.5 for f in detected)


def test_constant_tones_are_detected_and_weak_shocks_are_not() -> None:
    """Energy 40 in two runs of a tone at 33.2 Hz, and 160 of bursts: 30 draws, seed 6."""
    rng = np.random.default_rng(6)

    def tone() -> Array:
        return np.sin(2.0 * math.pi * (33.2 * _T + rng.random()))

    def burst() -> Array:
        since = _T - rng.uniform(0.5, 2.0)
        return np.exp(-((since / 0.1) ** 2)) * np.sin(2.0 * math.pi * 14.0 * since)

    assert sum(bool(_detected(rng, tone, 40.0, 5e-3)) for _ in range(30)) >= 12
    assert sum(bool(_detected(rng, burst, 160.0, 5e-3)) for _ in range(30)) <= 2


def test_the_strongest_of_constant_tones_comes_first_in_long_runs() -> None:
    """Tones at 16, 32 and 64 Hz in 60 s of white noise, seed 7: each takes one band."""
    rng = np.random.default_rng(7)
    t = np.arange(24_000) / 400.0
    parts = ((16.0, 0.25), (32.0, 1.0), (64.0, 0.35))
    tones = sum((a * np.sin(2.0 * math.pi * f * t) for f, a in parts), start=np.zeros(len(t)))
    for size in (0.3, 0.65, 2.0):
        detected = detect_tones(
            [rng.normal(size=(len(t), 2)) + size * tones[:, None]], 400.0, 10.0, 0.05
        )
        assert [n.frequency for n in detected.tones] == pytest.approx([32.0, 64.0, 16.0], abs=0.3)


def test_a_line_below_the_lowest_frequency_is_no_tone() -> None:
    """9 Hz, of energy 400 in two runs of 20 s, searched from 10 Hz: 10 draws, seed 8."""
    rng = np.random.default_rng(8)
    t = np.arange(8000) / 400.0
    line = math.sqrt(200.0 / 8000.0) * np.sin(2.0 * math.pi * 9.0 * t)
    for _ in range(10):
        runs = [rng.normal(size=(len(t), 2)) + line[:, None] for _ in range(2)]
        assert all(
            abs(n.frequency - 9.0) > 4.0 for n in detect_tones(runs, 400.0, 10.0, 0.05).tones
        )


def test_runs_of_any_length_are_searched() -> None:
    rng = np.random.default_rng(9)
    t = np.arange(4000) / 400.0
    strong = rng.normal(size=(len(t), 2)) + np.sin(2.0 * math.pi * 30.0 * t)[:, None]
    for short in (np.zeros((0, 2)), strong[:1], strong[:120], strong[:999]):
        assert abs(detect_tones([short, strong], 400.0, 10.0, 0.01).tones[0].frequency - 30.0) < 0.3
    assert detect_tones([np.zeros((0, 2))], 400.0, 10.0, 0.05) == DetectedTones()


def test_vibration_in_a_wide_band_is_no_engine() -> None:
    """White noise from 12 to 24 Hz, ten times the rest, for 20 s: 10 draws, seed 4."""
    rng = np.random.default_rng(4)
    band = butter(4, (12.0, 24.0), "bandpass", fs=120.0, output="sos")
    for _ in range(10):
        nu = rng.normal(size=(2400, 2)) + 10.0 * sosfilt(band, rng.normal(size=(2400, 2)), axis=0)
        assert len(detect_tones([nu], 120.0, 10.0, 0.05, engine=False).tones) > 4
        assert detect_tones([nu], 120.0, 10.0, 0.05) == DetectedTones()
