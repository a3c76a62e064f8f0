"""From what a drive says to how wide the answers would be, given what is known of the car.

The drive speaks about logarithms of c/m, k/m, i/(m l²) and of the weight share; the vehicle file
gives each quantity a prior.  In logarithms of all eight quantities the posterior's precision is

    P(n) = diag(1/σ²) + n Sᵀ J S,

with J the information of one pass (:mod:`bayes_asv.planning.information`), n passes, σ the
prior deviations and S the map (ln c − ln m, ln i − ln m − 2 ln l, ln k − ln m, ln w).  Exact
quantities are left out.  With k_g² = i/m, ln k_g is half of ln i − ln m.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.vehicle import Vehicle
from bayes_asv.planning.information import SEEN
from bayes_asv.posterior.parameters import space

__all__ = ["ANSWERS", "GIVEN", "MOST_PASSES", "Known", "floors", "known", "passes_needed", "widths"]

Array = NDArray[np.float64]

ANSWERS = ("c_f", "c_r", "i", "k_g")
"""Parameters that a plan promises widths for."""

GIVEN = ("m", "l", "wdf", "k_f", "k_r")
"""Values that a person weighs and measures."""

MOST_PASSES = 1000
"""Beyond so many passes nobody goes on driving."""

_ALL = (*SEEN, "m", "l")


def _ratios() -> Array:
    """S (6, 8): what the accelerations depend on, as exponents of all quantities."""
    out = np.zeros((len(SEEN), len(_ALL)))
    out[:, : len(SEEN)] = np.eye(len(SEEN))
    for row, name in enumerate(SEEN):
        if name != "wdf":
            out[row, _ALL.index("m")] = -1.0
    out[SEEN.index("i"), _ALL.index("l")] = -2.0
    return out


def _directions() -> Array:
    """Each answer's logarithm as a combination of all quantities' (4, 8)."""
    out = np.zeros((len(ANSWERS), len(_ALL)))
    for row, name in enumerate(ANSWERS[:3]):
        out[row, _ALL.index(name)] = 1.0
    out[3, _ALL.index("i")], out[3, _ALL.index("m")] = 0.5, -0.5
    return out


_RATIOS, _DIRECTIONS = _ratios(), _directions()


@dataclass(frozen=True)
class Known:
    """Deviations of the logarithms beforehand.

    Parameters
    ----------
    log_sd : Mapping of str to float
        Of c_f, c_r, i, k_f, k_r, wdf, m and l; zero where a value is exact.
    """

    log_sd: Mapping[str, float]

    def but(self, **log_sd: float) -> Known:
        """Return the same with other deviations."""
        return Known({**self.log_sd, **log_sd})

    def exactly(self) -> Known:
        """Return the same with every weighed and measured value exact."""
        return self.but(**dict.fromkeys(GIVEN, 0.0))


def known(vehicle: Vehicle) -> Known:
    """Take from a vehicle file what is known of each quantity, as the estimator does."""
    where = space(vehicle, ())
    log_sd = {name: where.log_prior_of(name)[1] for name in _ALL if name != "wdf"}
    log_sd["wdf"] = vehicle.wdf.sd / vehicle.wdf.value
    return Known(log_sd)


def widths(information: Array, passes: float, before: Known) -> Array:
    """Promised widths of the answers.

    Parameters
    ----------
    information : (6, 6) array
        Of one pass.
    passes : float
        Number of passes.
    before : Known
        Deviations beforehand.

    Returns
    -------
    (4,) array
        One posterior deviation over the value, a share of one, of :data:`ANSWERS`.  A
        deviation s of the logarithm is √(exp s² − 1) of the value, as for a log-normal.
    """
    sd = np.array([before.log_sd[name] for name in _ALL])
    free = sd > 0.0
    # in units of the prior deviations, where the precision is the unit matrix and more
    turned = _RATIOS[:, free] * sd[free]
    precision = np.eye(int(free.sum())) + passes * turned.T @ information @ turned
    answer = _DIRECTIONS[:, free] * sd[free]
    variance = np.sum(answer * np.linalg.solve(precision, answer.T).T, axis=1)
    return np.asarray(np.sqrt(np.expm1(np.minimum(variance, 50.0))))


def floors(before: Known) -> Array:
    """Widths (4,) that no amount of driving gets below: what accelerations cannot see.

    The directions along which all ratios stay as they are keep their prior.  A mass known to
    1 % leaves 1 % in every rate; springs known to 5 % say a little about the mass, too.
    """
    sd = np.array([before.log_sd[name] for name in _ALL])
    free = sd > 0.0
    _, strength, turns = np.linalg.svd(_RATIOS[:, free] * sd[free])
    rank = int(np.count_nonzero(strength > 1e-9 * strength[0])) if strength.size else 0
    unseen = (_DIRECTIONS[:, free] * sd[free]) @ turns[rank:].T
    variance = np.sum(unseen**2, axis=1)
    variance[variance < 1e-24] = 0.0  # what rounding leaves of a direction that is seen
    return np.asarray(np.sqrt(np.expm1(variance)))


def passes_needed(information: Array, before: Known, want: Array) -> tuple[int | None, ...]:
    """Fewest passes that bring each answer to its wanted width.

    Parameters
    ----------
    information : (6, 6) array
        Of one pass.
    before : Known
        Deviations beforehand.
    want : (4,) array
        Wanted widths, shares of one.

    Returns
    -------
    tuple of 4 int or None
        None where :data:`MOST_PASSES` do not suffice.
    """
    found: list[int | None] = []
    for k in range(len(ANSWERS)):

        def enough(n: int, k: int = k) -> bool:
            return bool(widths(information, n, before)[k] <= want[k])

        if not enough(MOST_PASSES):
            found.append(None)
            continue
        low, high = 0, 1  # low is never enough, unless the prior is
        while not enough(high):
            low, high = high, min(2 * high, MOST_PASSES)
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if enough(middle) else (middle, high)
        found.append(high)
    return tuple(found)
