"""Uncertainty budget: sources of the variance of each estimate, and what would halve it."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import from_si, to_si
from bayes_asv.report import svg
from bayes_asv.report.schema import EstimateDocument
from bayes_asv.report.schema.estimate import Measure, ParameterBudget, UncertaintyBudget
from bayes_asv.report.sections.blocks import Block, Figure, Section, Table, Text
from bayes_asv.report.words import (
    LABELS,
    MISSING,
    capitalized,
    enumerated,
    percent,
    plain,
    readable_unit,
    two_digits,
)

__all__ = [
    "SECTION",
    "answers_text",
    "budget_steps",
    "remedy_sentence",
    "sd_text",
    "usable_budgets",
]

# Beyond this ratio between the standard deviations of the draws and of the linearised posterior,
# the posterior is too far from normal for a budget.
_MAX_RATIO: Final = 1.25
_ADVICE_FROM: Final = 0.5  # percent: smaller standard deviations get no advice on the first page
_MIN_SHARE: Final = 0.005  # of a variance, and
_MIN_GAIN: Final = 0.02  # of a standard deviation, for a source to have a row or a bar
_MOST_LISTED: Final = 2  # damping rates that are named one by one
_MIN_WRITTEN: Final = 0.07  # share whose number is written over its bar

_MEASURES: Final = {
    "m": "weigh the car to",
    "wdf": "weigh both axles, so that the front weight fraction is known to",
}
_COUNTS: Final = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")
_SOURCES: Final = {
    "prior": "prior",
    "data": "recordings",
    "between samples": "motion between samples",
    "start": "initial state",
    "lost readings": "clipped or missing readings",
}
_KINDS: Final = {"noise": "noise", "steps": "resolution", "gain": "scale"}
# Parts of a bar in their order: name, colour, hatch.
_BARS: Final = {
    "m": (LABELS["m"], "above", ""),
    "l": (LABELS["l"], "below", ""),
    "wdf": (LABELS["wdf"], "good", ""),
    "k_f": (LABELS["k_f"], "front", ""),
    "k_r": (LABELS["k_r"], "rear", ""),
    "given": ("other given values", "grid", "////"),
    "prior": ("prior", "prior", ""),
    "wheel": ("wheel sensors", "muted", ""),
    "chassis": ("chassis sensors", "muted", "////"),
    "sensors": ("other sensors", "muted", "...."),
    "other": ("other, in the recordings", "grid", ""),
}

_BUDGET_NOTE: Final = (
    "Share of the variance of the answer (a column adds up to 100 %), and in brackets the standard "
    "deviation if this value were exact, this sensor's noise halved, its resolution perfect, or no "
    "reading lost. The share shows the effect of a small improvement, the bracket that of a large "
    "one. Sources that matter to no answer are left out."
)
_BARS_CAPTION: Final = (
    "The longest piece of a bar is the source whose improvement narrows the answer most. The "
    "standard deviation of the answer is on the right."
)


def _content(document: EstimateDocument) -> Iterator[Block]:
    budgets = usable_budgets(document.width)
    if budgets:
        yield Text("How to halve each uncertainty", _halving_lines(document))
        yield Figure("width", "Sources of uncertainty", _BARS_CAPTION, (_budget_bars(budgets),))
        yield _budget_table(budgets)


def _budget_limits(document: EstimateDocument) -> list[str]:
    """State the main cause of uncertainty, once for parameters with the same cause."""
    if document.verdict != "ok" or document.width is None:
        return []
    budgets = usable_budgets(document.width)
    groups: dict[tuple[str, str], list[str]] = {}
    for name, budget in budgets.items():
        source = max(budget.shares, key=lambda s: budget.shares[s])
        sensors = _by_sensor(budget.noises) if source == "data" else {}
        largest = max(sensors, key=lambda c: sensors[c]) if sensors else ""
        groups.setdefault((source, largest), []).append(name)
    lines = [_cause_sentence(*key, names, budgets, document) for key, names in groups.items()]
    unusable = [name for name in _all_budgets(document.width) if name not in budgets]
    if unusable:
        lines.append(
            f"The uncertainty of {answers_text(unusable)} cannot be divided among its sources: the "
            "posterior is too far from a normal distribution."
        )
    return lines


SECTION: Final = Section(_content, _budget_limits, title="Uncertainty budget")


def usable_budgets(width: UncertaintyBudget | None) -> dict[str, ParameterBudget]:
    """Budgets of the parameters whose posterior is nearly normal, by name."""
    return {
        name: budget
        for name, budget in _all_budgets(width).items()
        if 1.0 / _MAX_RATIO < (budget.posterior_sd_percent or budget.sd_percent) / budget.sd_percent
        < _MAX_RATIO
    }  # fmt: skip


def _all_budgets(width: UncertaintyBudget | None) -> dict[str, ParameterBudget]:
    budgets = {} if width is None else width.entries
    return {name: budget for name, budget in budgets.items() if budget.sd_percent > 0.0}


def sd_text(value: float, sign: str = "±") -> str:
    """Write a standard deviation in percent with two digits, ``±0.97 %``."""
    return f"{sign}{two_digits(value)} %"


def answers_text(names: Sequence[str]) -> str:
    """Enumerate parameters, ``the front damping rate and the pitch inertia``."""
    rates = [name for name in names if QUANTITIES[name][0] == "damping"]
    if len(rates) <= _MOST_LISTED:
        return enumerated([f"the {LABELS[name]}" for name in names])
    places = enumerated([LABELS[name].removesuffix(" damping rate") for name in rates])
    others = [f"the {LABELS[name]}" for name in names if name not in rates]
    return enumerated([f"the {places} damping rates", *others])


def _sds_text(values: Sequence[float]) -> str:
    """Write standard deviations in percent, their range where there are many."""
    if len(values) <= _MOST_LISTED + 1:  # with the inertia
        return enumerated([sd_text(value) for value in values])
    low, high = sd_text(min(values)), sd_text(max(values))
    return low if low == high else f"{low.removesuffix(' %')} to {high}"


def _source_name(source: str) -> str:
    """Name a source of variance."""
    kind, _, channel = source.partition(" ")
    if kind in _KINDS and channel:
        return plain(f"{channel.replace('_', ' ')}: {_KINDS[kind]}")
    return LABELS.get(source) or _SOURCES.get(source) or plain(source)


def remedy_sentence(measures: Sequence[Measure], names: Sequence[str], runs: int) -> str:
    """Say what halves the uncertainty of some parameters.

    Parameters
    ----------
    measures : sequence of Measure
        Measures of one remedy.
    names : sequence of str
        Names of the parameters.
    runs : int
        Number of runs in the estimate.
    """
    text = enumerated([_measure_text(measure, runs) for measure in measures])
    return f"{capitalized(text)}: this halves the uncertainty of {answers_text(names)}."


def _measure_text(measure: Measure, runs: int) -> str:
    if measure.what == "runs":
        n = measure.further
        count = _COUNTS[n] if n < len(_COUNTS) else str(n)
        kind = "like this one" if runs == 1 else "like these"
        return f"record {count} more run{'' if n == 1 else 's'} {kind}"
    unit, needed = measure.unit, measure.needed_sd
    if unit == "lbf*s^2/in":  # no scale shows it
        needed, unit = from_si(to_si(needed, unit, "mass"), "lbm", "mass"), "lbm"
    size = f"±{two_digits(needed)} {readable_unit(unit)}; " if unit else ""
    kind, _, channel = measure.what.partition(" ")
    what = (
        f"calibrate the {channel.replace('_', ' ')} sensor to"
        if kind == "gain"
        else _MEASURES.get(measure.what, f"measure the {LABELS[measure.what]} to")
    )
    return (
        f"{what} {sd_text(measure.needed_sd_percent)} ({size}now {sd_text(measure.now_sd_percent)})"
    )


def budget_steps(document: EstimateDocument) -> list[str]:
    """Say what to weigh, measure or record next to halve the largest uncertainties.

    Returns
    -------
    list of str
        One sentence a remedy.  Answers that the same remedy halves are in one sentence, with the
        tightest requirement of them.
    """
    best: dict[tuple[str, ...], tuple[list[Measure], list[str]]] = {}
    for name, budget in usable_budgets(document.width).items():
        if budget.sd_percent < _ADVICE_FROM or not budget.halve:
            continue
        measures = budget.halve[0].measures
        key = tuple(m.what for m in measures)
        before, names = best.get(key, (measures, []))
        best[key] = (list(map(_tighter, before, measures)), [*names, name])
    runs = document.width.runs if document.width is not None else 0
    return [remedy_sentence(measures, names, runs) for measures, names in best.values()]


def _tighter(one: Measure, other: Measure) -> Measure:
    if one.what == "runs":
        return max(one, other, key=lambda m: m.further)
    return min(one, other, key=lambda m: m.needed_sd)


def _halving_lines(document: EstimateDocument) -> list[str]:
    """Say for every parameter what would halve its uncertainty, the least demanding first."""
    lines = []
    runs = document.width.runs if document.width is not None else 0
    for name, budget in usable_budgets(document.width).items():
        ways = [enumerated([_measure_text(m, runs) for m in r.measures]) for r in budget.halve]
        start = f"{capitalized(LABELS[name])}, now {sd_text(budget.sd_percent)}"
        if not ways:
            lines.append(f"{start}: no measurement and no number of further runs is enough.")
            continue
        text = f"{start}: {'; or '.join(ways[:3])}."
        if len(budget.halve[0].measures) > 1:
            text += " No single measure is enough."
        elif all(remedy.measures[0].what == "runs" for remedy in budget.halve):
            text += " No measurement of a given value is enough."
        elif budget.runs_to_halve is None:
            text += " No number of further runs is enough."
        lines.append(text)
    return lines


def _cause_sentence(
    source: str,
    sensor: str,
    names: Sequence[str],
    budgets: Mapping[str, ParameterBudget],
    document: EstimateDocument,
) -> str:
    """One sentence about parameters whose uncertainty has the same main cause."""
    much = _range_text([budgets[name].shares[source] for name in names])
    variance = f"{much} of the variance of {answers_text(names)}"
    if source == "data":
        if document.width is not None and not document.width.white:
            return f"Motion that the model does not explain causes {variance}."
        if not sensor:
            return f"Noise in the recordings causes {variance}."
        parts = [_by_sensor(budgets[n].noises)[sensor] / budgets[n].shares["data"] for n in names]
        return (
            f"Noise in the recordings causes {variance}; the largest part, {_range_text(parts)}, "
            f"is from the {sensor.replace('_', ' ')} sensor."
        )
    if source == "prior":
        return f"The prior causes {variance}: the recordings say little."
    known = document.known.get(source)
    given = ""
    if known is not None and known.sd and known.value:
        given = f", given to {sd_text(100.0 * known.sd / abs(known.value))},"
    exact = [budgets[n].exact_sd_percent.get(source) for n in names]
    left = [value for value in exact if value is not None]
    if len(left) < len(names):
        return f"The {_source_name(source)}{given} causes {variance}."
    now = _sds_text([budgets[n].sd_percent for n in names])
    they = "it" if len(names) == 1 else "they"
    return (
        f"The {_source_name(source)}{given} causes {variance}: if it were exact, {they} would be "
        f"known to {_sds_text(left)} instead of {now}."
    )


def _range_text(shares: Sequence[float]) -> str:
    low, high = percent(min(shares)), percent(max(shares))
    return low if low == high else f"{low.removesuffix(' %')} to {high}"


def _by_sensor(noises: Mapping[str, float]) -> dict[str, float]:
    """Noise and resolution of each sensor together."""
    out: dict[str, float] = {}
    for name, share in noises.items():
        kind, _, channel = name.partition(" ")
        if kind in ("noise", "steps"):
            out[channel] = out.get(channel, 0.0) + share
    return out


def _budget_table(budgets: Mapping[str, ParameterBudget]) -> Table:
    """Share of every source in each variance, and the standard deviation without it."""
    rows = [["Standard deviation", *(f"({sd_text(b.sd_percent)})" for b in budgets.values())]]
    for source in _sources(budgets):
        cells = [_cell(source, budget) for budget in budgets.values()]
        rows.append([capitalized(_source_name(source)), *cells])
    twice = [f"({sd_text(b.twice_the_runs_sd_percent)})" for b in budgets.values()]
    rows.append(["Twice as many runs", *twice])
    columns = ["source", *(LABELS[name] for name in budgets)]
    return Table("Uncertainty budget", columns, rows, _BUDGET_NOTE)


def _sources(budgets: Mapping[str, ParameterBudget]) -> list[str]:
    """List the sources that matter to any parameter, in the order of the document."""
    order: dict[str, None] = {}
    for budget in budgets.values():
        given = [s for s in budget.shares if s != "data"]
        order |= dict.fromkeys([*given, *(budget.noises or ["data"]), *budget.better_sd_percent])
    return [s for s in order if any(_matters(s, budget) for budget in budgets.values())]


def _matters(source: str, budget: ParameterBudget) -> bool:
    improved = _improved(source, budget)
    narrower = improved is not None and improved < (1.0 - _MIN_GAIN) * budget.sd_percent
    return narrower or (_share(source, budget) or 0.0) >= _MIN_SHARE


def _share(source: str, budget: ParameterBudget) -> float | None:
    return budget.noises.get(source, budget.shares.get(source))


def _improved(source: str, budget: ParameterBudget) -> float | None:
    return budget.exact_sd_percent.get(source, budget.better_sd_percent.get(source))


def _cell(source: str, budget: ParameterBudget) -> str:
    share, improved = _share(source, budget), _improved(source, budget)
    parts = []
    if share is not None:
        parts.append("< 1 %" if share < _MIN_SHARE else percent(share))
    if improved is not None:
        parts.append(f"({sd_text(improved)})")
    return " ".join(parts) or MISSING


def _budget_bars(budgets: Mapping[str, ParameterBudget]) -> svg.Panel:
    """Draw a bar for each parameter, divided into the shares of its variance."""
    names = list(budgets)
    parts = {name: _bar_parts(budget) for name, budget in budgets.items()}
    figure = svg.canvas(6.6, 0.55 * len(names) + 1.0)
    axes = figure.subplots()
    drawn = [p for p in _BARS if any(parts[n].get(p, 0.0) >= _MIN_SHARE for n in names)]
    for row, name in enumerate(names):
        start = 0.0
        for part in drawn:
            share = parts[name].get(part, 0.0)
            share = share if share >= _MIN_SHARE else 0.0
            label, colour, hatch = _BARS[part]
            axes.barh(
                row, share, left=start, height=0.46, color=svg.COLOURS[colour],
                alpha=0.55 if hatch else 1.0, hatch=hatch, linewidth=0,
                label=label if row == 0 else None,
            )  # fmt: skip
            if share >= _MIN_WRITTEN:
                axes.text(
                    start + 0.5 * share, row - 0.27, percent(share),
                    ha="center", va="bottom", fontsize=8.5, color=svg.COLOURS["ink"],
                )  # fmt: skip
            start += share
        axes.text(
            1.02, row, sd_text(budgets[name].sd_percent), va="center",
            fontsize=9, color=svg.COLOURS["ink"],
        )  # fmt: skip
    svg.label_rows(figure, axes, [LABELS[n] for n in names], 4)
    axes.set(xlim=(0.0, 1.0), ylim=(len(names) - 0.6, -0.75), xlabel="share of the variance")
    axes.xaxis.set_major_formatter(lambda value, _: percent(value))
    axes.grid(visible=False)
    axes.spines["left"].set_visible(False)
    return svg.panel(figure, "width", "sources of the variance of each answer", wide=True)


def _bar_parts(budget: ParameterBudget) -> dict[str, float]:
    parts = dict.fromkeys(("given", "wheel", "chassis", "sensors"), 0.0)
    for name, share in budget.shares.items():
        if name != "data":
            part = name if name in _BARS else "given"
            parts[part] = parts.get(part, 0.0) + share
    for name, share in budget.noises.items():
        if name.partition(" ")[0] in ("noise", "steps"):
            place = name.rpartition("_")[2]
            parts[place if place in ("wheel", "chassis") else "sensors"] += share
    sensors = sum(parts[place] for place in ("wheel", "chassis", "sensors"))
    parts["other"] = max(budget.shares.get("data", 0.0) - sensors, 0.0)
    return parts
