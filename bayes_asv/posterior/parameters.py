"""What is sampled, in which coordinates, and what is believed of it beforehand.

Every positive quantity of the car has a log-normal prior.  The accelerations depend on the
ratios c/m, k/m and i/(m l²) alone: mass and wheel base scale the answer and cannot be seen.
So the logarithms, in units of their prior deviations, are turned into the directions that the
data can see and those they cannot; only the first are sampled, the others are drawn from the
prior afterwards, which is exact.  The weight share is normal, noise deviations log-normal and
the filtered share of the noise uniform.  Every coordinate is standard normal beforehand.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtr

from bayes_asv.domain.channels import CHANNELS
from bayes_asv.models.effects import AXLES, Scale, Site
from bayes_asv.posterior.effects import Values
from bayes_asv.posterior.priors import NOISE_GIVEN_SD, WORST
from bayes_asv.preprocessing.timeline import PreparedRecording

__all__ = ["CAR", "LOGS", "SEEN", "ParameterSpace"]

Array = NDArray[np.float64]

CAR = ("c_f", "c_r", "i", "m", "l", "wdf", "k_f", "k_r")  # the kernel's order

# Where a disagreement is looked for, noise must not swell until it has swallowed it: in no case to
# more than half as much again, or twice as much where none is given.
_NEAR_CAP, _UNKNOWN_CAP = 0.4, 0.7
_SHARE_HELD = 0.5  # filtered share of the noise where a colour takes over

LOGS = ("c_f", "c_r", "i", "m", "l", "k_f", "k_r")
# Rows: what the accelerations depend on, as exponents of the quantities above.
SEEN = np.array(
    [
        [1, 0, 0, -1, 0, 0, 0],
        [0, 1, 0, -1, 0, 0, 0],
        [0, 0, 1, -1, -2, 0, 0],
        [0, 0, 0, -1, 0, 1, 0],
        [0, 0, 0, -1, 0, 0, 1],
    ],
    dtype=float,
)


@dataclass(frozen=True)
class ParameterSpace:
    """Coordinates, all standard normal beforehand, and the way to the kernel's arguments.

    Parameters
    ----------
    names : tuple of str
        One a coordinate: ``car-0`` … for the directions of the car that data can see, ``wdf``,
        ``gain <channel>``, ``effect <site> <parameter>``, ``noise <channel> <run>``,
        ``filtered share <run>``.
    centre, scale : (D,) arrays
        A quantity other than a car direction is ``centre + scale z`` (a logarithm for noise, a
        probit for the filtered share).
    log_mean, log_sd : (7,) arrays
        Prior of the logarithms of c_f, c_r, i, m, l, k_f, k_r (SI units).
    seen, unseen : (7, r) and (7, 7 − r) arrays
        Orthonormal directions in units of the prior deviations.
    wdf : float
        Weight share where it is not sampled.
    timelines : tuple of PreparedRecording
        The recordings.
    likelihood : str
        ``innovations``, or ``output-error`` and ``coloured`` in which wheels have no noise.
    held : tuple of (4,) arrays
        Noise deviation of each channel of each run (m/s²) where it is not sampled.
    sites : tuple of Site
        Effects that the car and its sensors have.
    sizes : Scale or None
        What the effects' priors are given in.
    near : bool
        Noise levels stay near their prior's centre.
    """

    names: tuple[str, ...]
    centre: Array
    scale: Array
    log_mean: Array
    log_sd: Array
    seen: Array
    unseen: Array
    wdf: float
    timelines: tuple[PreparedRecording, ...]
    likelihood: str
    held: tuple[Array, ...]
    sites: tuple[Site, ...] = ()
    sizes: Scale | None = None
    near: bool = False

    @property
    def dimension(self) -> int:
        """Number of coordinates."""
        return len(self.names)

    @property
    def car_dimension(self) -> int:
        """Number of coordinates that describe the car; they come first."""
        return int(self.seen.shape[1]) + ("wdf" in self.names)

    @property
    def lasting_dimension(self) -> int:
        """Number of coordinates of the car, of gains and of effects, which come first."""
        return self.car_dimension + sum(
            name.startswith(("gain ", "effect ")) for name in self.names
        )

    def effects(self, z: Array) -> Values:
        """Values of the effects' parameters, SI units, at coordinates (D,)."""
        found = {}
        for site in self.sites:
            at = {p: self.names.index(site.coordinate_name(p)) for p in site.effect.parameters}
            assert self.sizes is not None
            found[site] = {p.name: float(p.value(z[k], self.sizes)) for p, k in at.items()}
        return found

    def effect_draws(self, z: Array) -> dict[Site, dict[str, Array]]:
        """Values (N,) of the effects' parameters that are reported, at coordinates (N, D)."""
        assert self.sizes is not None or not self.sites
        return {
            site: {
                p.name: p.value(z[:, self.names.index(site.coordinate_name(p))], self.sizes)
                for p in site.effect.parameters
                if not p.shape and self.sizes is not None
            }
            for site in self.sites
        }

    def _factor(self, z: Array, name: str, where: str) -> Array | float:
        """Factor (W,) that a car or gain effect puts on a value; one where there is none."""
        for site in self.sites:
            if site.effect.name == name and site.where == where:
                parameter = site.effect.parameters[0]
                assert self.sizes is not None
                k = self.names.index(site.coordinate_name(parameter))
                return parameter.value(z[:, k], self.sizes)
        return 1.0

    def cars(self, z: Array, unseen: Array | None = None) -> Array:
        """Map coordinates (W, D) to physical parameters (W, 8), SI units.

        Parameters
        ----------
        z : (W, D) array
            Coordinates.
        unseen : (W, 7 − r) array, optional
            Standard normal coordinates of what the data cannot see; zero by default.
        """
        r = self.seen.shape[1]
        turned = z[:, :r] @ self.seen.T
        if unseen is not None:
            turned = turned + unseen @ self.unseen.T
        value = np.exp(self.log_mean + self.log_sd * turned)
        out = np.empty((len(z), 8))
        for k, name in enumerate(LOGS):
            out[:, CAR.index(name)] = value[:, k]
        out[:, CAR.index("wdf")] = self._other(z, "wdf") if "wdf" in self.names else self.wdf
        if self.sites:
            out[:, CAR.index("k_f")] *= self._factor(z, "spring_rate", "front")
            out[:, CAR.index("k_r")] *= self._factor(z, "spring_rate", "rear")
            # on the given value: on what it is taken to be, the two would make a bent ridge
            factor = self._factor(z, "weight_distribution", "")
            out[:, CAR.index("wdf")] += self.wdf * (factor - 1.0)
        return out

    def quantities(self, z: Array, seed: int) -> dict[str, Array]:
        """Physical quantities of the car by name, SI units, for coordinates (N, D).

        Parameters
        ----------
        z : (N, D) array
            Coordinates.
        seed : int
            What the data cannot see keeps its prior, independently of everything else: it is
            drawn from this seed.

        Returns
        -------
        dict of str to (N,) array
            Whatever of c_f, c_r, i and the given values varies, and k_g, zeta_f, zeta_r.
        """
        rng = np.random.default_rng([seed, 2])
        car = self.cars(z, rng.normal(size=(len(z), self.unseen.shape[1]))).T
        value = dict(zip(CAR, car, strict=True))
        named = {name: x for name, x in value.items() if np.ptp(x) > 0.0}
        named["k_g"] = np.sqrt(value["i"] / value["m"])
        front, rear = value["wdf"] * value["m"], (1.0 - value["wdf"]) * value["m"]
        named["zeta_f"] = value["c_f"] / (2.0 * np.sqrt(value["k_f"] * front))
        named["zeta_r"] = value["c_r"] / (2.0 * np.sqrt(value["k_r"] * rear))
        return named

    def measured(self, z: Array, run: int) -> Array:
        """Cars (W, 12) as the kernels take them: with the gains of one run's sensors."""
        gains = np.ones((len(z), 4))
        for c, channel in enumerate(CHANNELS):
            name = f"gain {channel}"
            if name in self.names and self.timelines[run].scale_sd[c] > 0.0:
                gains[:, c] = np.exp(self._other(z, name))
            gains[:, c] *= self._factor(z, "sensor_gain", channel)
        return np.hstack([self.cars(z), gains])

    def noises(self, z: Array, run: int) -> Array:
        """Map coordinates (W, D) to the kernel's noise arguments (W, 12) of one run."""
        line = self.timelines[run]
        out = np.zeros((len(z), 12))
        share = self._share(z, run)
        for column, c in enumerate((0, 2, 1, 3)):  # wheels, then chassis
            name = f"noise {CHANNELS[c]} {run}"
            if name in self.names:
                variance = np.exp(2.0 * self._level(z, name))
            elif self.held[run][c] > 0.0:
                variance = np.full(len(z), self.held[run][c] ** 2)
            else:
                continue  # the white-residual form knows no noise of the wheel sensors
            out[:, column] = (1.0 - share) * variance + line.steps[c] ** 2 / 12.0
            out[:, 4 + column] = share * variance
            corner = self._factor(z, "sensor_bandwidth", CHANNELS[c])
            out[:, 8 + column] = line.poles[c] * corner  # its own noise passes the one it has
        return out

    def _level(self, z: Array, name: str) -> Array:
        """Logarithm of a noise level."""
        if not self.near:
            return self._other(z, name)
        d = self.names.index(name)
        cap = _NEAR_CAP if self.scale[d] < NOISE_GIVEN_SD else _UNKNOWN_CAP
        return np.asarray(self.centre[d] + cap * np.tanh(self.scale[d] * z[:, d] / cap))

    def _share(self, z: Array, run: int) -> Array | float:
        """Share of the noise that passed the sensor's filter."""
        name = f"filtered share {run}"
        if name in self.names:
            return np.asarray(ndtr(self._other(z, name)))
        filtered = self.likelihood == "innovations" and np.any(self.timelines[run].poles > 0.0)
        return _SHARE_HELD if filtered else 0.0

    def zeros(self, z: Array, run: int) -> Array:
        """Return what the wheels' sensors read at rest (2,), m/s², at coordinates (D,)."""
        at = [f"zero {axle} {run}" for axle in AXLES]
        known = [float(self._other(z[None], n)[0]) if n in self.names else 0.0 for n in at]
        return np.array(known)

    def nuisance(self, z: Array) -> dict[str, Array]:
        """Noise deviations (m/s²) and filtered shares by name, each (W,)."""
        out = {}
        for name in self.names[self.car_dimension :]:
            if name.startswith(("effect ", "zero ")):
                continue
            filtered = name.startswith("filtered")
            out[name] = ndtr(self._other(z, name)) if filtered else np.exp(self._level(z, name))
        return out

    def log_prior(self, z: Array) -> Array:
        """Log density (W,) of the prior; −inf where no car can be."""
        value = -0.5 * np.sum(z**2, axis=1) - 0.5 * z.shape[1] * math.log(2.0 * math.pi)
        bad = np.any(~(np.abs(z) < WORST), axis=1)
        if "wdf" in self.names:
            wdf = self._other(z, "wdf")
            bad |= (wdf <= 0.01) | (wdf >= 0.99)
        return np.where(bad, -np.inf, value)

    def seen_by(self, run: int) -> NDArray[np.int64]:
        """Coordinates that one run's likelihood depends on: the car and the run's own noise."""
        own = [
            k
            for k, name in enumerate(self.names)
            if name.endswith(f" {run}")
            or name.startswith("gain ")
            or (name.startswith("effect ") and not name[-1].isdigit())
        ]
        car = range(self.car_dimension)
        return np.array(sorted({*car, *own}), np.int64)

    def from_logs(self, shift: dict[str, float]) -> Array:
        """Coordinates (D,) of the prior's centre with some logarithms shifted."""
        z = np.zeros(self.dimension)
        moved = np.zeros(len(LOGS))
        for name, by in shift.items():
            k = LOGS.index(name)
            moved[k] = by / self.log_sd[k] if self.log_sd[k] > 0.0 else 0.0
        z[: self.seen.shape[1]] = moved @ self.seen
        return z

    def log_deviation(self, covariance: Array, name: str) -> float:
        """Posterior deviation of the logarithm of a quantity, from the coordinates' covariance."""
        k = LOGS.index(name)
        r = self.seen.shape[1]
        seen = self.seen[k] @ covariance[:r, :r] @ self.seen[k]
        return float(self.log_sd[k] * math.sqrt(seen + float(np.sum(self.unseen[k] ** 2))))

    def log_prior_of(self, name: str) -> tuple[float, float]:
        """Mean and deviation of the logarithm of a quantity beforehand."""
        k = LOGS.index(name)
        return float(self.log_mean[k]), float(self.log_sd[k])

    def _other(self, z: Array, name: str) -> Array:
        d = self.names.index(name)
        return np.asarray(self.centre[d] + self.scale[d] * z[:, d])
