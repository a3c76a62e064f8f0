"""``asv.compare``: test whether a parameter changed between two sets of runs of one car.

Both posteriors speak of the car's coordinates θ through Gaussian likelihoods exp(hᵀθ − ½ θᵀHθ),
and the given values (mass, springs, weight share), of which neither knows the error, are the same::

    before: θ      after: θ + B u      θ ~ N(0, I)      u ~ N(0, 2 diag σ²)

u are the changes of log c_f, log c_r and log i, B the way from those to the coordinates, and σ the
prior standard deviations of the logarithms: a value before and one after, each with its own prior.
The posterior of u is normal, and an error of the given values, which enters both sides alike,
drops out of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from statistics import NormalDist
from typing import TYPE_CHECKING, Any, Final, overload

import numpy as np
from numpy.typing import NDArray

from bayes_asv import __version__
from bayes_asv.analysis.random_effects import RunLikelihood, contrast, likelihood_of_run
from bayes_asv.analysis.run_consistency import DISAGREE_BELOW
from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import PathLike, write_atomically
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.library.estimates import Estimate
from bayes_asv.library.extras import import_extra
from bayes_asv.library.result import html_table, json_text
from bayes_asv.posterior.parameters import ParameterSpace
from bayes_asv.report.words import capitalized, difference, p_value, plain, probability

if TYPE_CHECKING:
    import pandas as pd

    from bayes_asv.estimation import Estimate as EngineEstimate

__all__ = ["Change", "Comparison", "compare"]

Array = NDArray[np.float64]

_SCHEMA: Final = "bayes_asv/compare/1"


@dataclass(frozen=True)
class Change:
    """Posterior of the ratio of a parameter after to that before, log-normal.

    Parameters
    ----------
    name, label : str
        Such as ``c_f`` and ``front damping rate``.
    ratio : float
        Median.
    log_sd : float
        Standard deviation of its logarithm.
    p : float
        Of the test that the parameter is the same, with the others free to differ; nan where the
        recordings cannot show it.
    """

    name: str
    label: str
    ratio: float
    log_sd: float
    p: float

    def interval(self, probability: float = 0.95) -> tuple[float, float]:
        """Return the equal-tailed interval that holds the ratio with a probability."""
        if not 0.0 < probability < 1.0:
            raise InputError(
                f"interval({probability!r})", "is not a probability", "write interval(0.95)"
            )
        reach = math.exp(self.log_sd * NormalDist().inv_cdf(0.5 * (1.0 + probability)))
        return self.ratio / reach, self.ratio * reach

    @property
    def probability_lower(self) -> float:
        """Posterior probability that the parameter is lower after than before."""
        return NormalDist().cdf(-math.log(self.ratio) / self.log_sd)

    def __repr__(self) -> str:
        low, high = self.interval()
        return f"<{self.name} after/before: {self.ratio:.4g}, 95 %: {low:.4g} to {high:.4g}>"


class Comparison:
    """Two sets of runs of one car compared, from :func:`bayes_asv.compare`.

    ``verdict`` is ``"changed"`` if equal parameters would differ so much with a probability below
    1 %, ``"consistent"`` otherwise, and ``"refused"`` where nothing can be compared.
    ``result["c_f"]`` is a :class:`Change`.
    """

    def __init__(
        self,
        estimates: tuple[Estimate, Estimate],
        verdict: str,
        reasons: tuple[str, ...] = (),
        p: float = math.nan,
        changes: Mapping[str, Change] | None = None,
    ):
        self.verdict = verdict
        self.reasons = reasons
        self.warnings = tuple(dict.fromkeys(w for one in estimates for w in one.warnings))
        self.p = p
        self.changes = dict(changes or {})
        self._car = estimates[0].vehicle.name

    def __getitem__(self, name: str) -> Change:
        if name not in self.changes:
            why = "; ".join(self.reasons) or f"there are {', '.join(self.changes)}"
            raise KeyError(f"there is no change of {name}: {why}")
        return self.changes[name]

    def __contains__(self, name: object) -> bool:
        return name in self.changes

    def __iter__(self) -> Iterator[str]:
        return iter(self.changes)

    def summary(self) -> pd.DataFrame:
        """Return the ratios after/before as a table.

        Returns
        -------
        pandas.DataFrame
            One row a parameter: ``ratio`` (median), ``eti95_lb``, ``eti95_ub``, ``p_lower``, the
            probability that it is lower after, and ``p_value`` of the test that it is the same.
        """
        pandas = import_extra("pandas", "summary()")
        rows = [
            (c.ratio, *c.interval(), c.probability_lower, c.p) for c in self.changes.values()
        ]  # fmt: skip
        columns = ("ratio", "eti95_lb", "eti95_ub", "p_lower", "p_value")
        index = pandas.Index(list(self.changes), name="parameter")
        return pandas.DataFrame(rows, index=index, columns=columns)

    def to_dict(self) -> dict[str, Any]:
        """Return the comparison as plain data, schema ``bayes_asv/compare/1``."""
        return {
            "schema": _SCHEMA,
            "verdict": self.verdict,
            "reasons": list(self.reasons),
            "warnings": list(self.warnings),
            "p_value": _or_none(self.p),
            "changes": {
                name: {
                    "label": c.label,
                    "ratio": c.ratio,
                    "eti95": list(c.interval()),
                    "p_lower": c.probability_lower,
                    "p_value": _or_none(c.p),
                }
                for name, c in self.changes.items()
            },
            "version": __version__,
        }

    @overload
    def to_json(self, path: None = None) -> str: ...
    @overload
    def to_json(self, path: PathLike) -> None: ...
    def to_json(self, path: PathLike | None = None) -> str | None:
        """Write :meth:`to_dict` as JSON to a file, or return its text."""
        text = json_text(self.to_dict())
        if path is None:
            return text
        write_atomically(path, text.encode("utf-8", "replace"))
        return None

    def lines(self) -> list[str]:
        """State the comparison in sentences."""
        if self.verdict == "refused":
            return ["No answer.", *(f"Why: {plain(reason)}." for reason in self.reasons)]
        changed = [n for n, c in self.changes.items() if c.p < DISAGREE_BELOW]
        if self.verdict == "consistent":
            head = f"No change is found ({p_value(self.p)})."
        elif changed:
            head = f"Changed: {', '.join(QUANTITIES[n][1] for n in changed)} ({p_value(self.p)})."
        else:
            head = f"Something changed ({p_value(self.p)}), but not clearly one parameter."
        notes = [f"Note: {plain(warning)}." for warning in self.warnings]
        return [head, *(_sentence(c) for c in self.changes.values()), *notes]

    def __str__(self) -> str:
        return "\n".join(self.lines())

    def _repr_html_(self) -> str:
        rows = [
            (
                c.label, f"{c.ratio:.4f}", " to ".join(f"{x:.4f}" for x in c.interval()),
                probability(c.probability_lower), p_value(c.p),
            )
            for c in self.changes.values()
        ]  # fmt: skip
        title, *notes = self.lines()
        head = ("parameter", "ratio after/before", "95 %", "P(lower after)", "test of no change")
        return html_table(title, head, rows, notes[len(rows) :])

    def __repr__(self) -> str:
        about = ", ".join(f"{n} × {c.ratio:.3g}" for n, c in self.changes.items())
        about = about or "; ".join(self.reasons)[:160]
        return f"<Comparison {self.verdict!r} of {plain(self._car)[:60]}: {about}>"


def compare(before: Estimate, after: Estimate) -> Comparison:
    """Ask whether damping rates or pitch inertia changed between two sets of runs.

    The error of the given values (mass, springs, weight share) is common to both estimates and
    does not enter the ratios, which are therefore known better than the parameters.

    Parameters
    ----------
    before, after : Estimate
        Of the same car, from the same vehicle file.  Where runs of one estimate differ from each
        other, their spread is part of it; several runs on each side show that spread.

    Returns
    -------
    Comparison

    Raises
    ------
    TypeError
        If an argument is not an estimate.
    InputError
        If the estimates are of different vehicles, or one has effects.
    """
    for name, given in (("before", before), ("after", after)):
        if not isinstance(given, Estimate):
            raise TypeError(
                f"compare: {name} is a {type(given).__name__}; "
                "write asv.compare(asv.estimate(…), asv.estimate(…))"
            )
        if given.engine.effects:
            raise InputError(
                "compare", f"the estimate {name} has effects", "estimate without effects"
            )
    if before.vehicle != after.vehicle:
        raise InputError(
            "compare", "the estimates are of different vehicle files", "use one file for both"
        )
    reasons = tuple(
        f"the estimate {name} is {given.verdict.replace('_', ' ')}"
        + (f": {'; '.join(given.reasons)}" if given.reasons else "")
        for name, given in (("before", before), ("after", after))
        if given.verdict != "ok"
    )
    both = before, after
    if reasons:
        return Comparison(both, "refused", reasons)
    first, second = before.engine, after.engine
    space, other = first.space, second.space
    assert space is not None
    assert other is not None
    if space.car.name != other.car.name:
        raise InputError("compare", "the estimates are of different models", "use one for both")
    n = space.car_dimension
    way = np.stack([space.from_logs({name: 1.0})[:n] for name in space.car.estimated], axis=1)
    sites = [_site(first), _site(second)]
    whole = contrast(sites, way)
    if whole.freedom == 0:
        why = ("the recordings say nothing that could be compared",)
        return Comparison(both, "refused", why)
    mean, sd = _change(sites, way, space)
    changes = {
        name: Change(
            name, QUANTITIES[name][1], math.exp(mean[k]), float(sd[k]),
            contrast(sites, way, [k]).p,
        )
        for k, name in enumerate(space.car.estimated)
        if sd[k] > 0.0
    }  # fmt: skip
    verdict = "changed" if whole.p < DISAGREE_BELOW else "consistent"
    return Comparison(both, verdict, (), whole.p, changes)


def _site(result: EngineEstimate) -> RunLikelihood:
    """Gaussian likelihood over the car's coordinates, from the moments of the draws."""
    space = result.space
    assert space is not None
    z = space.car_coordinates(result.draws)
    flat = z.reshape(-1, z.shape[-1])
    return likelihood_of_run(flat.mean(axis=0), np.cov(flat, rowvar=False))


def _change(sites: list[RunLikelihood], way: Array, space: ParameterSpace) -> tuple[Array, Array]:
    """Mean and standard deviation (3,) of the changes u of the logarithms."""
    n, count = way.shape
    sigma = np.array([space.log_prior_of(name)[1] for name in space.car.estimated])
    free = np.flatnonzero(sigma > 0.0)
    B = way[:, free]
    (H1, h1), (H2, h2) = sites
    precision = np.zeros((n + len(free), n + len(free)))
    precision[:n, :n] = np.eye(n) + H1 + H2
    precision[:n, n:] = H2 @ B
    precision[n:, :n] = B.T @ H2
    precision[n:, n:] = B.T @ H2 @ B + np.diag(0.5 / sigma[free] ** 2)
    covariance = np.linalg.inv(precision)
    mean, sd = np.zeros(count), np.zeros(count)
    mean[free] = (covariance @ np.concatenate([h1 + h2, B.T @ h2]))[n:]
    sd[free] = np.sqrt(np.diag(covariance)[n:])
    return mean, sd


def _sentence(change: Change) -> str:
    low, high = (100.0 * (x - 1.0) for x in change.interval())
    share = change.ratio - 1.0
    p = change.probability_lower
    side = "lower" if p > 0.5 else "higher"
    return (
        f"{capitalized(change.label)}: {difference(share)} {side} after "
        f"(95 %: {low:+.1f} to {high:+.1f} %; probability that it is {side} "
        f"{probability(max(p, 1.0 - p))})."
    ).replace("-", "−")


def _or_none(value: float) -> float | None:
    return None if math.isnan(value) else value
