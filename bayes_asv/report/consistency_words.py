"""What is said of one run against another, and of recordings that the model would not make."""

from __future__ import annotations

import math
from typing import Any, Final

from bayes_asv.report.readable import number, plain, probability, readable_unit

__all__ = [
    "UNLIKELY",
    "agreement_headline",
    "agreement_lines",
    "agreement_steps",
    "band_words",
    "by_distance",
    "check_limits",
    "independent_lines",
    "spread_words",
    "unlikely_checks",
]

Document = dict[str, Any]

UNLIKELY: Final = 0.01  # corrected probability below which a check is told on the first page

_BANDS: Final = {0.5: "body band", 5.0: "wheel-hop band", 15.0: "band above"}


def agreement_headline(document: Document) -> str:
    """Sentence that belongs to the headline when runs disagree, or nothing."""
    found = document.get("agreement") or {}
    if document["verdict"] != "ok" or found.get("verdict") != "disagree":
        return ""
    return "The runs do not agree."


def agreement_lines(document: Document) -> list[str]:
    """Say how the runs stand to each other; what disagrees is told by a warning already.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1``.

    Returns
    -------
    list of str
        One sentence or none.
    """
    found = document.get("agreement") or {}
    p = found.get("p")
    if document["verdict"] == "refused" or not found:
        return []
    if found["verdict"] == "agree" and p is not None:
        return [
            f"The {len(found['runs'])} runs agree: of runs of an unchanged car, "
            f"{probability(p)} would differ more than these do."
        ]
    if found["verdict"] == "unknown":
        return [
            "Whether the runs agree cannot be told: one of them alone says too little, or "
            "something too far from a normal distribution, to be compared."
        ]
    return []


def agreement_steps(document: Document) -> list[str]:
    """Say what to do about runs that disagree; nothing otherwise."""
    if not agreement_headline(document):
        return []
    return [
        "Find out what changed between the runs (adjuster, load, heat, tyre pressure, road) and "
        "give the runs of one setting to the command by themselves; further runs of the same "
        "setting narrow the interval."
    ]


def independent_lines(diagnostics: Document) -> list[str]:
    """Say how the draws came about where runs disagree; nothing otherwise."""
    if diagnostics.get("sampler") != "random effects":
        return []
    return [
        f"The runs disagree, so the {diagnostics.get('draws', 0)} draws are of a mean car with a "
        "spread from run to run. They are independent, the spread integrated on a grid; each "
        "run enters by mean and covariance of its own posterior."
    ]


def spread_words(spread: Document) -> str:
    """Write a spread from run to run, ``3.9 % (1.5 to 23 %)``."""
    low, high = (_two(v) for v in spread["eti95"])
    return f"{_two(spread['median'])} % ({low} to {high} %)"


def band_words(check: Document) -> str:
    """Name what a check looks at, ``rms, body band (0.5 to 5 Hz)``."""
    if check["quantity"] == "peak":
        return "peak"
    band = check.get("band")
    if band is None:
        return "rms"
    words = _BANDS.get(band[0], "band")
    return f"rms, {words} ({number(band[0])} to {_two(band[1])} Hz)"


def by_distance(checks: list[Document]) -> list[Document]:
    """Order checks by their corrected probability, then by how many times too much there is."""

    def far(check: Document) -> tuple[float, float]:
        usual = check["replicated"]["median"]
        if not usual > 0.0 or not check["observed"] > 0.0:
            return float(check["p_family"]), 0.0
        return float(check["p_family"]), -abs(math.log(check["observed"] / usual))

    return sorted(checks, key=far)


def unlikely_checks(run: Document) -> list[Document]:
    """Pick checks that the model would hardly pass, the farthest out first."""
    return by_distance([c for c in run.get("checks") or [] if c["p_family"] < UNLIKELY])


def check_limits(document: Document) -> list[str]:
    """Say where recordings hold more or less motion than the half car and its sensors make.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1``.

    Returns
    -------
    list of str
        At most one sentence a channel: about what the simulation leaves, or about the reading
        where only that is out of the ordinary.
    """
    runs = document.get("runs") or []
    out = []
    for channel in ("front_chassis", "rear_chassis"):
        for of in ("residual", "reading"):
            mine = [
                (run, check)
                for run in runs
                for check in unlikely_checks(run)
                if check["channel"] == channel and check["of"] == of
            ]
            if mine:
                out.append(_sentence(mine, len(runs)))
                break
    return out


def _sentence(found: list[tuple[Document, Document]], count: int) -> str:
    sources = {run["source"] for run, _ in found}
    worst = by_distance([check for _, check in found])[0]
    run = next(run for run, check in found if check is worst)
    low, high = worst["replicated"]["eti95"]
    sd = 0.25 * (high - low)
    size = "more" if worst["observed"] > worst["replicated"]["median"] else "less"
    where = worst["channel"].replace("_", " ")
    what = (
        f"{size} of the {where}' motion is left unexplained"
        if worst["of"] == "residual"
        else f"{size} was measured at the {where}"
    )
    some = f" in {len(sources)} of {count} recordings" if count > 1 else ""
    which = f" in {plain(run['source'])}" if count > 1 else ""
    clearest = band_words(worst).removeprefix("rms, ")
    return (
        f"Predictive check: {what}{some} than the half car and its sensors would make, most "
        f"clearly in the {clearest}{which}: "
        f"{number(worst['observed'], sd)} {readable_unit(worst['unit'])} against "
        f"{number(low, sd)} to {number(high, sd)} "
        f"(probability {probability(worst['p_family'])}, all checks of a run counted)."
    )


def _two(value: float) -> str:
    """Two significant digits, and no zeros that say nothing."""
    return number(float(f"{value:.2g}"))
