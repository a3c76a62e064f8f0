"""Pushes from outside: all pairs of a beginning and an end, from forces that never end.

The innovations are linear in a force from outside, so that a push is the difference of two edges,
and a push on both axles the mean of one on either.  Hundreds of edges give thousands of pairs, each
of them a question: their p-value is that of the largest among them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bayes_asv.diagnosis.score_test import SILENT, ScoreTest
from bayes_asv.models.effects import AXLES
from bayes_asv.posterior.effect_candidates import Candidate

__all__ = ["RAREST", "push_p", "with_pushes"]

Array = NDArray[np.float64]

_DRAWS = 2000
_BATCH = 100
_ENOUGH = 50  # draws as large as what was seen, at which a p-value is known well enough
RAREST = 1.0 / (1 + _DRAWS)
"""Smallest p-value that :func:`push_p` has."""

_SHORTEST = 2  # edges between beginning and end
_SHARES = {"front": (1.0, 0.0), "rear": (0.0, 1.0), "both": (0.5, 0.5)}


@dataclass(frozen=True)
class _Place:
    """Edges of one run as a force at one place makes them.

    Parameters
    ----------
    where, run
        Place and run.
    mixed : (E, K) array
        Every edge in terms of all signatures.
    information : (E + 1, E + 1) array
        Of each beginning (row) and end (column), the last of which lies beyond the record; 0 where
        there is no push.
    """

    where: str
    run: int
    mixed: Array
    information: Array

    def largest(self, pull: NDArray[np.floating]) -> Array:
        """Largest squared score (S,) over all pushes, given pulls (S, K) of all signatures."""
        own = _ended(pull @ self.mixed.T.astype(pull.dtype))
        top = np.zeros(len(own), own.dtype)
        for begin, information in enumerate(self.information[:-_SHORTEST]):
            later = slice(begin + _SHORTEST, None)
            weights = np.zeros_like(information[later], own.dtype)
            np.divide(1.0, information[later], out=weights, where=information[later] > 0.0)
            square = (own[:, begin, None] - own[:, later]) ** 2
            square *= weights
            np.maximum(top, square.max(axis=1), out=top)
        return top

    def best(self, pull: Array) -> tuple[int, int]:
        """Beginning and end of the push with the largest squared score."""
        own = _ended((self.mixed @ pull)[None])[0]
        with np.errstate(divide="ignore", invalid="ignore"):
            square = (own[:, None] - own[None]) ** 2 / self.information
        square[self.information <= 0.0] = -1.0
        begin, end = np.unravel_index(int(np.argmax(square)), square.shape)
        return int(begin), int(end)


def push_p(found: ScoreTest, seed: int) -> float:
    """p-value of the push that the data ask for most.

    It is drawn, until as large a push was drawn 50 times or 2000 draws are done: the 50th of 140
    draws is a p-value of 50/140 (Besag & Clifford 1991).

    Parameters
    ----------
    found : ScoreTest
        With edges.
    seed : int
        Of the draws.
    """
    places = list(_places(found))
    if not places:
        return 1.0
    edges = np.flatnonzero([c.edge for c in found.candidates])
    eigen, vectors = np.linalg.eigh(found.gram[np.ix_(edges, edges)])
    root = (vectors * np.sqrt(np.maximum(eigen, 0.0))).astype(np.float32)
    seen = max(float(place.largest(found.pull[None])[0]) for place in places)
    rng = np.random.default_rng([seed, 23])
    drawn = np.zeros((_BATCH, len(found.pull)), np.float32)
    as_large = np.zeros(0, np.intp)
    for first in range(0, _DRAWS, _BATCH):
        drawn[:, edges] = rng.standard_normal((_BATCH, len(edges)), np.float32) @ root.T
        top = np.max([place.largest(drawn) for place in places], axis=0)
        as_large = np.append(as_large, 1 + first + np.flatnonzero(top >= seen))
        if len(as_large) >= _ENOUGH:
            return _ENOUGH / float(as_large[_ENOUGH - 1])
    return (1 + len(as_large)) / (1 + _DRAWS)


def with_pushes(found: ScoreTest) -> ScoreTest:
    """Replace edges by the push of each place and run that the data ask for most."""
    kept = [k for k, c in enumerate(found.candidates) if not c.edge]
    if len(kept) == len(found.candidates):
        return found
    wanted = [found.candidates[k] for k in kept]
    mixed = list(np.eye(len(found.candidates))[kept])
    for place in _places(found):
        begin, end = place.best(found.pull)
        row = place.mixed[begin] - (place.mixed[end] if end < len(place.mixed) else 0.0)
        wanted.append(_push(found, place, begin, end))
        mixed.append(row)
    mix = np.array(mixed)
    return replace(
        found,
        candidates=tuple(wanted),
        rows=mix @ found.rows,
        pull=mix @ found.pull,
        gram=mix @ found.gram @ mix.T,
    )


def _push(found: ScoreTest, place: _Place, begin: int, end: int) -> Candidate:
    """Return the push between two edges."""
    own = [c for c in found.candidates if c.edge and c.site.run == place.run]
    edges = [c for c in own if c.site.where == own[0].site.where]
    first = edges[begin]
    grid = edges[1].values["start"] - edges[0].values["start"]
    lasts = (end - begin) * grid
    site = replace(first.site, where=place.where)
    return replace(first, site=site, values={**first.values, "duration": lasts}, edge=False)


def _places(found: ScoreTest) -> Iterator[_Place]:
    """Every place of every run where a push may be."""
    raw = np.sum(found.rows**2, axis=1)
    for run in sorted({c.site.run for c in found.candidates if c.edge and c.site.run is not None}):
        at = [
            [k for k, c in enumerate(found.candidates) if c.edge and _is(c, axle, run)]
            for axle in AXLES
        ]
        for where, shares in _SHARES.items():
            edges = min(len(own) for own, share in zip(at, shares, strict=True) if share)
            if edges <= _SHORTEST:  # none where a push is named already
                continue
            mixed = np.zeros((edges, len(found.candidates)))
            for axle, share in enumerate(shares):
                if share:
                    mixed[np.arange(edges), at[axle]] = share
            gram = np.zeros((len(mixed) + 1, len(mixed) + 1))
            gram[:-1, :-1] = mixed @ found.gram @ mixed.T
            own = np.diag(gram)
            information = own[:, None] + own[None] - 2.0 * gram
            length = _ended((mixed @ raw)[None])[0]
            loud = information > SILENT * (length[:, None] + length[None])
            later = np.triu(np.ones_like(gram, bool), _SHORTEST)
            later[-1] = False
            yield _Place(where, run, mixed, np.where(loud & later, information, 0.0))


def _is(candidate: Candidate, axle: str, run: int) -> bool:
    return candidate.site.where == axle and candidate.site.run == run


def _ended(of_edges: NDArray[np.floating]) -> Array:
    """Append an end that lies beyond the record, where nothing is left: (S, E) to (S, E + 1)."""
    return np.concatenate([of_edges, np.zeros_like(of_edges[:, :1])], axis=1)
