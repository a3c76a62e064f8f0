"""The page: ``docs/calibration.md`` with its pictures, from the results alone."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bayes_asv.domain.errors import InputError
from bayes_asv.domain.files import write_atomically
from benchmarks.calibration import pictures
from benchmarks.calibration.cells import (
    CELLS,
    DECLARED_400,
    DECLARED_800,
    EXACT_400,
    EXACT_800,
    GROUPS,
    MODEL,
    TERRAIN_NAMES,
    Cell,
    Group,
)
from benchmarks.calibration.page_words import (
    BOUND,
    HOW,
    INTRODUCTION,
    LIMITS,
    MODEL_DRAWS,
    SOURCES,
)
from benchmarks.calibration.store import Results, load, pack
from benchmarks.calibration.summary import Summary, agreement, judged, places, summaries, verdicts
from benchmarks.calibration.tables import (
    conditions_table,
    csv,
    deviating,
    full_table,
    model_table,
    verdict_table,
)
from benchmarks.freshness import RESULTS

__all__ = ["write_page"]

Array = NDArray[np.float64]

_ALPHA = 0.05
_IN_FULL = {
    (DECLARED_400, DECLARED_800): "places.png",
    (EXACT_400, EXACT_800): "places-exact.png",
}


def write_page(folder: Path, docs: Path) -> None:
    """Write the page, its pictures and the table of all counts.

    Parameters
    ----------
    folder : Path
        Results; they are packed.
    docs : Path
        Where ``calibration.md`` and ``calibration/`` go.

    Raises
    ------
    InputError
        When there are no results.
    """
    results = load(folder)
    found = summaries(results)
    if not found and not any(cell.name in results for cell in _model_cells()):
        raise InputError(str(folder), "holds no runs", "run python -m benchmarks.calibration first")
    pack(folder)
    beside = docs / "calibration"
    beside.mkdir(parents=True, exist_ok=True)
    with pictures.look():
        parts = [INTRODUCTION, *_rig_parts(found, results, beside)]
        parts += _model_parts(results, beside)
    parts += [BOUND, HOW + _sampling(found, results)]
    parts += ["## Limitations\n\n" + _falls_short(found) + LIMITS, _origin(results)]
    write_atomically(str(docs / "calibration.md"), "\n".join(parts).encode("utf-8"))
    write_atomically(str(folder / "coverage.csv"), csv(found).encode("utf-8"))


def _rig_parts(found: dict[str, Summary], results: dict[str, Results], beside: Path) -> list[str]:
    if not found:
        return []
    held = verdicts(found)
    settled = [v for v in held if v.settled]
    met = sum(v.met for v in settled)
    words = f"{met} of the {len(settled)} criteria that can be judged are met."
    if len(settled) < len(held):
        words += f" {len(held) - len(settled)} others have too few runs for a verdict."
    parts = [f"## Summary\n\n{_age(results)}\n\n{words}\n\n" + verdict_table(held)]
    pictures.save(pictures.coverage_picture(found, 0.95), beside / "coverage.png")
    parts.append("![Coverage of 95 % intervals by condition, terrain and quantity]"
                 "(calibration/coverage.png)\n")  # fmt: skip
    for groups, name in _IN_FULL.items():
        parts += _in_full(found, results, groups, beside / name)
    whole = {group for groups in _IN_FULL for group in groups}
    there = dict.fromkeys(s.cell.group for s in found.values())
    rest = [group for group in GROUPS if group in there and group not in whole]
    if rest:
        parts.append(
            "## Other conditions\n\nCoverage of 95 % intervals; the ratio is that of the widest "
            "quantity. `benchmarks/results/calibration/coverage.csv` has all levels.\n\n"
            + conditions_table(found, rest)
        )
    return parts


def _in_full(
    found: dict[str, Summary], results: dict[str, Results], groups: tuple[Group, ...], file: Path
) -> list[str]:
    """Return tables of all levels, and a figure of the distribution of posterior probabilities."""
    there = {name: s for name, s in found.items() if s.cell.group in groups}
    parts = [
        f"## {group.title}\n\n" + full_table(found, group)
        for group in groups
        if any(s.cell.group == group for s in there.values())
    ]
    panels = {
        f"{s.cell.terrain}, {s.cell.rate:g} Hz": places(results[name].rows, judged(s.cell))
        for name, s in there.items()
    }
    if panels:
        alpha = _ALPHA / max(len(curves) for curves in panels.values())
        picture = pictures.curves(panels, len(TERRAIN_NAMES), alpha, legend=True)
        pictures.save(picture, file)
        parts.append(
            "All levels: each curve is the empirical distribution function of the posterior "
            "probability below the true value, minus the uniform one. Within the grey band of a "
            "panel the coverage of every level is consistent with its nominal value.\n\n"
            "![Distribution of the posterior probability below the true value]"
            f"(calibration/{file.name})\n"
        )
    return parts


def _model_cells() -> list[Cell]:
    return [cell for cell in CELLS if cell.terrain == MODEL]


def _model_parts(results: dict[str, Results], beside: Path) -> list[str]:
    parts: list[str] = []
    for cell in _model_cells():
        there = results.get(cell.name)
        if there is None:
            continue
        every = places(there.rows)
        share = _ALPHA / len(every)
        curve = pictures.curves({n: {n: x} for n, x in every.items()}, 5, share, legend=False)
        pictures.save(curve, beside / f"{cell.name}-places.png")
        pictures.save(pictures.ranks(every, 5, share), beside / f"{cell.name}-ranks.png")
        refused = sum(bool(row.reasons) for row in there.rows)
        coloured = sum(row.colour > 0 for row in there.rows)
        parts.append(
            f"{MODEL_DRAWS}\n{len(there.rows)} draws at {cell.rate:g} Hz, a quarter on the wheels "
            f"of each terrain. The estimator would have refused {refused} of them, and fitted "
            f"coloured residuals in {coloured}.\n\n" + model_table(cell, there)
        )
        parts.append(
            "![Posterior probabilities, distribution functions]"
            f"(calibration/{cell.name}-places.png)\n\n![Posterior probabilities, histograms]"
            f"(calibration/{cell.name}-ranks.png)\n"
        )
    return parts


def _sampling(found: dict[str, Summary], results: dict[str, Results]) -> str:
    how = Counter(row.how for one in results.values() for row in one.rows if row.places)
    total = sum(how.values())
    by = ", ".join(
        f"{count} {'from the ensembles' if key == 'ensembles' else f'with {key} draws'}"
        for key, count in sorted(how.items(), key=lambda item: -item[1])
    )
    middle = float(np.median([s.effective for s in found.values()])) if found else 0.0
    text = f"\nOf {total} posteriors, {by}; median effective number {middle:.0f}.\n"
    same = agreement(results)
    if same is not None:
        text += (
            f"\n{same.runs} recordings were also sampled by the estimator's ensembles. The "
            f"posterior probabilities differ by {same.place:.3f} (root mean square, largest "
            f"{same.largest:.3f}), the widths by {100 * same.width:.1f} % (median).\n"
        )
    return text


def _falls_short(found: dict[str, Summary]) -> str:
    lines = [f"- {sentence}.\n" for sentence in deviating(found)]
    missed = [v for v in verdicts(found) if v.settled and not v.met]
    lines += [f"- Not met: {v.group.title}: {v.asked}; found {v.found}.\n" for v in missed]
    fewer = [name for name, s in found.items() if s.runs < s.cell.runs]
    if fewer:
        lines.append(
            f"- {len(fewer)} cells have fewer runs than the full benchmark requires; a coverage "
            "that their tests do not reject may still be off by several per cent.\n"
        )
    return "".join(lines)


def _age(results: dict[str, Results]) -> str:
    """State the versions that the figures belong to."""
    about = dict.fromkeys(one for there in results.values() for one in there.about)
    versions = " and ".join(f"commit {one.commit} (seed {one.seed})" for one in about)
    return (
        f"The figures on this page belong to {versions}; [Evidence](evidence.md) says whether the "
        "code has changed since."
    )


def _origin(results: dict[str, Results]) -> str:
    about = dict.fromkeys(one for there in results.values() for one in there.about)
    lines = [
        f"- seed {one.seed}, commit {one.commit}, {one.versions}" for one in about
    ]  # several lines if cells were repeated later
    return (
        "## Reproduce\n\n```sh\n"
        + "".join(f"python -m {words}\n" for words in RESULTS["calibration"].commands)
        + "```\n\nIt goes on where it was stopped. "
        "`--list` lists the cells, `--cells engine --runs 100 --out FOLDER` runs some of them. "
        "The same seed draws the same runs.\n\n" + "\n".join(lines) + "\n" + SOURCES
    )
