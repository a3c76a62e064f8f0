"""Where the reference disagrees with itself, and what is right."""

from __future__ import annotations

from typing import Final, NamedTuple

__all__ = ["Erratum", "errata"]


class Erratum(NamedTuple):
    """One place: as printed, what is right, and why."""

    where: str
    printed: str
    right: str
    why: str


_ERRATA: Final = (
    Erratum(
        "Section 2.2, chassis modes", "bounce, pitch, roll, warp", "bounce, pitch, roll",
        "a rigid chassis has three; in a warp front and rear wheels turn against each other",
    ),
    Erratum(
        "Fig. 3.2, F_r", "lever l_f", "lever l_r",
        "the rear axle is l_r from the centre of gravity; App. C.2 has it right",
    ),
    Erratum(
        "Fig. 3.2, eq. 3.1", "θ nose-down", "θ nose-up",
        "eq. 5.5 and 6.1 are nose-up: x_f = x + l_f θ, x_r = x − l_r θ, i θ̈ = l_f F_f − l_r F_r",
    ),
    Erratum(
        "Eq. 6.2", "(wdf x_f + (1−wdf) x_r) / l", "wdf x_f + (1−wdf) x_r",
        "a weighted mean of two displacements is a displacement",
    ),
    Erratum(
        "Table 4.2, natural frequencies", "1.23 and 1.85 Hz", "1.193 and 1.911 Hz",
        "App. C.1's mass matrix has m/4 whatever wdf says",
    ),
    Erratum(
        "Table 4.2, damped frequencies", "1.11 and 1.57 Hz", "1.187 and 1.891 Hz",
        "ω(1−ζ) instead of ω√(1−ζ²)",
    ),
    Erratum(
        "Chapter 4, 70 % damping", "second mode critically damped", "overdamped",
        "two real poles, at 1.51 and 2.35 Hz",
    ),
    Erratum(
        "Section 6.3.3, interval", "(OCR1A − 1) / f_timer", "(OCR1A + 1) / f_timer",
        "a timer that counts from zero to OCR1A takes OCR1A + 1 cycles",
    ),
    Erratum(
        "Section 6.3.3, channel offset", "well below 1 % of 1 ms", "0.675 ms",
        "App. C.2 puts the chassis channels 0.675 ms later, half a sample at 800 Hz",
    ),
    Erratum(
        "Section 8.1, 800 Hz data", "a constant chosen by hand", "a bias that is estimated",
        "a bias is a property of the sensor and belongs into the model with its uncertainty",
    ),
    Erratum(
        "Table A.1", "Audio, MAX9814L01, by Nordic", "nRF24L01 radio",
        "the part of that maker in section 6.2.3",
    ),
)  # fmt: skip


def errata() -> tuple[Erratum, ...]:
    """Return all places, in the order of the reference."""
    return _ERRATA
