"""A whole car on four tyres over two tracks, with seven accelerometers, in absolute coordinates.

Seven degrees of freedom: heave z, pitch theta (nose up) and roll phi (left side up) of the body,
and the height of each wheel; order front left, front right, rear left, rear right.  Newton's
equations are written out wheel by wheel and integrated by Runge and Kutta's method; tyres may lift.
Neither matrices nor deflection coordinates of the package are used.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import numpy.typing as npt
from scipy.signal import lfilter

from .compiled import compiled
from .motion import lagrange
from .road import lay
from .sensors import low_pass
from .terrain import Terrain
from .units import INCH, LBF_PER_INCH, LBF_S2_INCH, LBF_S2_PER_INCH, STANDARD_GRAVITY

__all__ = [
    "WIDE_CHANNELS",
    "WideCar",
    "WideRun",
    "draw_wide",
    "shifted",
    "wide_baja",
    "wide_drive",
    "wide_motion",
    "wide_toml",
]

Reals = npt.NDArray[np.float64]
Four = tuple[float, float, float, float]

WIDE_CHANNELS: Final = (
    "front_left_wheel", "front_right_wheel", "rear_left_wheel", "rear_right_wheel",
    "front_left_chassis", "front_right_chassis", "rear_chassis",
)  # fmt: skip
_RATE: Final = 8000.0  # steps a second
_BANDWIDTH: Final = 50.0  # Hz
_DELAY: Final = (0.0,) * 4 + (0.000675,) * 3
_NOISE: Final = (1.6 * INCH,) * 4 + (0.9 * INCH,) * 3
_STEP: Final = (5.945 * INCH,) * 4 + (2.470 * INCH,) * 3  # of a 10-bit converter


@dataclass(frozen=True)
class WideCar:
    """A car with a left and a right side, SI; corners front left, front right, rear left, right.

    Attributes
    ----------
    m, i, i_roll : float
        Sprung mass and its inertias in pitch and roll.
    l, wdf, t_f, t_r : float
        Wheelbase, front share of the weight, tracks.
    k, c, m_u, k_t, c_t : tuple of 4 float
        Suspension's rates, unsprung mass and tyre's rates of each corner.
    """

    m: float
    i: float
    i_roll: float
    l: float
    wdf: float
    t_f: float
    t_r: float
    k: Four
    c: Four
    m_u: Four
    k_t: Four
    c_t: Four

    @property
    def l_f(self) -> float:
        """Centre of gravity to front axle, m."""
        return self.l * (1.0 - self.wdf)

    @property
    def l_r(self) -> float:
        """Centre of gravity to rear axle, m."""
        return self.l * self.wdf

    @property
    def loads(self) -> Reals:
        """Static forces (4,) of the tyres, N."""
        share = 0.5 * np.array([self.wdf, self.wdf, 1.0 - self.wdf, 1.0 - self.wdf])
        return np.asarray((share * self.m + np.array(self.m_u)) * STANDARD_GRAVITY)


def wide_baja() -> WideCar:
    """Return the car of Table 7.1 with two sides.

    The reference gives no track and no roll inertia: 52 and 50 in, and a radius of gyration in roll
    of 14 in, are a small off-road car's.  Unsprung masses and tyres as in ``baja()``.
    """
    m = 1.294 * LBF_S2_PER_INCH
    half = 0.5 * LBF_PER_INCH
    return WideCar(
        m=m,
        i=626.0 * LBF_S2_INCH,
        i_roll=m * (14.0 * INCH) ** 2,
        l=68.0 * INCH,
        wdf=0.47,
        t_f=52.0 * INCH,
        t_r=50.0 * INCH,
        k=(100.0 * half,) * 4,
        c=(7.2 * half, 7.2 * half, 10.0 * half, 10.0 * half),
        m_u=(0.065 * m, 0.065 * m, 0.08 * m, 0.08 * m),
        k_t=(300.0 * half,) * 4,
        c_t=(1.0 * half,) * 4,
    )


def draw_wide(car: WideCar, rng: np.random.Generator) -> WideCar:
    """Draw a true car: known values as the file's deviations say, what is asked for more widely."""

    def spread(values: Four, sd: float) -> Four:
        a, b, c, d = (v * math.exp(sd * rng.standard_normal()) for v in values)
        return (a, b, c, d)

    common = [math.exp(0.05 * rng.standard_normal()) for _ in range(2)]
    split = [math.exp(0.05 * rng.standard_normal()) for _ in range(2)]
    k = car.k
    return replace(
        car,
        m=car.m * (1.0 + 0.01 * rng.standard_normal()),
        wdf=car.wdf * (1.0 + 0.01 * rng.standard_normal()),
        i=car.i * math.exp(0.2 * rng.standard_normal()),
        i_roll=car.i_roll * math.exp(0.2 * rng.standard_normal()),
        c=spread(car.c, 0.3),
        k=(
            k[0] * common[0] * split[0],
            k[1] * common[0] / split[0],
            k[2] * common[1] * split[1],
            k[3] * common[1] / split[1],
        ),
    )


def shifted(terrain: Terrain, by: float) -> Terrain:
    """Return a terrain that begins ``by`` m later."""
    return replace(
        terrain, features=tuple((place + by, shape) for place, shape in terrain.features)
    )


@compiled
def _rates(
    state: Reals, road: Reals, road_rate: Reals, body: Reals, wheel: Reals, place: Reals, out: Reals
) -> None:
    """Fill ``out`` (14,) with the rates of ``state`` (14,): seven positions, seven velocities."""
    lift = 0.0
    pitching = 0.0
    rolling = 0.0
    for j in range(4):
        x, y = place[j, 0], place[j, 1]
        stretch = state[0] + x * state[1] + y * state[2] - state[3 + j]
        speed = state[7] + x * state[8] + y * state[9] - state[10 + j]
        force = -wheel[j, 0] * stretch - wheel[j, 1] * speed  # on the body, above rest
        tyre = wheel[j, 3] * (road[j] - state[3 + j]) + wheel[j, 4] * (road_rate[j] - state[10 + j])
        if tyre < -wheel[j, 5]:  # it has left the ground and cannot pull
            tyre = -wheel[j, 5]
        lift += force
        pitching += x * force
        rolling += y * force
        out[10 + j] = (tyre - force) / wheel[j, 2]
    for j in range(7):
        out[j] = state[7 + j]
    out[7] = lift / body[0]
    out[8] = pitching / body[1]
    out[9] = rolling / body[2]


@compiled
def _integrate(
    road: Reals, road_rate: Reals, step: float, start: Reals, body: Reals, wheel: Reals,
    place: Reals, states: Reals, rates: Reals,
) -> None:  # fmt: skip
    """Fill ``states`` and ``rates`` (N, 14); ``road`` and its rate (2 N − 1, 4) at half steps."""
    n = states.shape[0]
    k1 = np.empty(14)
    k2 = np.empty(14)
    k3 = np.empty(14)
    k4 = np.empty(14)
    states[0] = start
    for s in range(n):
        _rates(states[s], road[2 * s], road_rate[2 * s], body, wheel, place, k1)
        rates[s] = k1
        if s == n - 1:
            break
        a, b = 2 * s + 1, 2 * s + 2
        _rates(states[s] + 0.5 * step * k1, road[a], road_rate[a], body, wheel, place, k2)
        _rates(states[s] + 0.5 * step * k2, road[a], road_rate[a], body, wheel, place, k3)
        _rates(states[s] + step * k3, road[b], road_rate[b], body, wheel, place, k4)
        states[s + 1] = states[s] + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)


def wide_motion(
    car: WideCar, road: Reals, road_rate: Reals, step: float, start: Reals | None = None
) -> tuple[Reals, Reals]:
    """States and their rates (N, 14) on a grid, from the road under the wheels at half steps.

    ``road`` and ``road_rate`` are (2 N − 1, 4), m and m/s; at rest at first unless a start (14,) is
    given.
    """
    place = np.array(
        [
            [car.l_f, 0.5 * car.t_f], [car.l_f, -0.5 * car.t_f],
            [-car.l_r, 0.5 * car.t_r], [-car.l_r, -0.5 * car.t_r],
        ]
    )  # fmt: skip
    wheel = np.column_stack([car.k, car.c, car.m_u, car.k_t, car.c_t, car.loads])
    n = (len(road) + 1) // 2
    states, rates = np.empty((n, 14)), np.empty((n, 14))
    body = np.array([car.m, car.i, car.i_roll])
    first = np.zeros(14) if start is None else start
    _integrate(road, road_rate, step, first, body, wheel, place, states, rates)
    return states, rates


@dataclass(frozen=True)
class WideRun:
    """Stamps (N,), readings (7, N) in m/s², true accelerations behind the same filters, flight."""

    time: Reals
    channels: Reals
    clean: Reals
    lifted: bool


def wide_drive(
    car: WideCar,
    tracks: tuple[Terrain, Terrain],
    speed: float,
    rate: float,
    seconds: float,
    seed: int,
    quiet: bool = False,
) -> WideRun:
    """Drive the left and the right wheels over a track each, and record.

    Parameters
    ----------
    car : WideCar
        Truth.
    tracks : pair of Terrain
        Under the left and the right wheels; the first's lead-in is both's.
    speed, rate, seconds : float
        m/s, rows a second and length.
    seed : int
        Of biases (4 in/s² rms) and noise.
    quiet : bool
        No bias, no noise and no steps.
    """
    rng = np.random.default_rng(seed)
    before = 0.25
    half = 0.5 / _RATE
    n = round((seconds + before + 0.02) * _RATE) + 1
    t = -before + half * np.arange(2 * n - 1)
    road, road_rate = np.empty((2 * n - 1, 4)), np.empty((2 * n - 1, 4))
    for j in range(4):
        x = speed * (t - tracks[0].lead_in) - (car.l if j > 1 else 0.0)
        laid = lay(tracks[j % 2], math.floor(x[0]), math.ceil(x[-1]), 11.0 * INCH, 12.0 * INCH)
        at = (x - laid.start) / laid.grid
        piece = np.floor(at).astype(np.int64)
        a, b, c, d = laid.coefficients[piece].T
        r = (at - piece) * laid.grid
        road[:, j] = a + r * (b + r * (c + r * d))
        road_rate[:, j] = speed * (b + r * (2.0 * c + r * 3.0 * d))
    level = road[0].mean()
    road -= level
    states, rates = wide_motion(car, road, road_rate, 2.0 * half)
    heave, pitch, roll = rates[:, 7], rates[:, 8], rates[:, 9]
    over = heave + car.l_f * pitch
    true = np.vstack(
        [rates[:, 10:14].T, over + 0.5 * car.t_f * roll, over - 0.5 * car.t_f * roll,
         heave - car.l_r * pitch]
    )  # fmt: skip
    rows = np.arange(round(seconds * rate)) / rate
    clean, channels = np.empty((7, len(rows))), np.empty((7, len(rows)))
    memory = math.exp(-2.0 * math.pi * _BANDWIDTH / rate)
    for j in range(7):
        filtered = low_pass(true[j], 2.0 * half, _BANDWIDTH)[None]
        clean[j] = lagrange(filtered, (rows + _DELAY[j] + before) / (2.0 * half))[0]
        fresh = rng.standard_normal(len(rows))
        fresh[1:] *= math.sqrt(1.0 - memory**2)
        noise = _NOISE[j] * lfilter([1.0], [1.0, -memory], fresh)
        noisy = clean[j] + 4.0 * INCH * rng.standard_normal() + noise
        channels[j] = clean[j] if quiet else np.rint(noisy / _STEP[j]) * _STEP[j]
    pressed = car.loads + np.array(car.k_t) * (road[::2] - states[:, 3:7])
    return WideRun(rows, channels, clean, bool(pressed.min() <= 0.0))


def wide_toml(
    car: WideCar, sds: Mapping[str, float] | None = None, more: str = "", noise: bool = True
) -> str:
    """Write a vehicle file of a nominal car, both sides of an axle together where it wants it."""
    known = {"m": 0.01, "wdf": 0.01, "k": 0.05} if sds is None else sds

    def entry(key: str, value: float, unit: str, sd: float = 0.0) -> str:
        parts = [f"value = {value:.12g}"] + ([f'unit = "{unit}"'] if unit else [])
        parts += [f'sd = "{100.0 * sd:g} %"'] if sd else []
        return f"{key} = {{ {', '.join(parts)} }}"

    lines = [
        'name = "wide"', 'units = "US"', "[known]",
        entry("sprung_mass", car.m, "kg", known.get("m", 0.0)),
        entry("wheelbase", car.l, "m"),
        entry("front_weight_fraction", car.wdf, "", known.get("wdf", 0.0)),
        entry("front_spring_rate", car.k[0] + car.k[1], "N/m", known.get("k", 0.0)),
        entry("rear_spring_rate", car.k[2] + car.k[3], "N/m", known.get("k", 0.0)),
        "[nominal]",
        entry("front_damping", car.c[0] + car.c[1], "N*s/m"),
        entry("rear_damping", car.c[2] + car.c[3], "N*s/m"),
        entry("pitch_inertia", car.i, "kg*m^2"),
        "[unsprung]",
        entry("front_mass", car.m_u[0] + car.m_u[1], "kg"),
        entry("rear_mass", car.m_u[2] + car.m_u[3], "kg"),
        entry("front_tyre_rate", car.k_t[0] + car.k_t[1], "N/m"),
        entry("rear_tyre_rate", car.k_t[2] + car.k_t[3], "N/m"),
        entry("front_tyre_damping", car.c_t[0] + car.c_t[1], "N*s/m"),
        entry("rear_tyre_damping", car.c_t[2] + car.c_t[3], "N*s/m"),
        "[roll]",
        entry("front_track", car.t_f, "m"),
        entry("rear_track", car.t_r, "m"),
        entry("inertia", car.i_roll, "kg*m^2"),
        more,
    ]  # fmt: skip
    for j, name in enumerate(WIDE_CHANNELS):
        lines += [f"[sensors.{name}]", f'bandwidth = "{_BANDWIDTH} Hz"', f'delay = "{_DELAY[j]} s"']
        if noise:
            lines += [f'noise = "{_NOISE[j]} m/s^2"', f'resolution = "{_STEP[j]} m/s^2"']
    return "\n".join(lines) + "\n"
