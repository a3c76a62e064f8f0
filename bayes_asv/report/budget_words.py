"""What limits an answer and what would halve its width, in words: functions of a document."""

from __future__ import annotations

from typing import Any, Final

from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import from_si, to_si
from bayes_asv.report.readable import number, percent, plain, readable_unit

__all__ = [
    "budgets",
    "fault_words",
    "halving_lines",
    "remedy_sentence",
    "sd_words",
    "source_words",
    "width_limits",
    "width_steps",
]

Document = dict[str, Any]

_ANSWERS: Final = ("c_f", "c_r", "i", "k_g")
_SPOKEN: Final = ("c_f", "c_r", "i")  # of which faults are told in words
# Beyond such a factor between budget and draws the posterior is not normal enough for one.
_APART: Final = 1.25
_WORTH: Final = 0.5  # percent: a narrower answer needs no advice on the first page
_FELT: Final = 0.1  # deviations that an undeclared fault must move to be spoken of

_MEASURES: Final = {
    "m": "weigh the car to",
    "l": "measure the wheelbase to",
    "wdf": "weigh both axles, so that the front weight fraction is known to",
    "k_f": "measure the front spring rate to",
    "k_r": "measure the rear spring rate to",
}
_NUMBERS: Final = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine")


def budgets(document: Document) -> dict[str, Document]:
    """Error budgets by answer, of those whose posterior is near enough to normal for one.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1``; without ``width`` there are none.
    """
    return {name: budget for name, (budget, apart) in _all(document).items() if apart < _APART}


def _all(document: Document) -> dict[str, tuple[Document, float]]:
    """Every budget, with the factor between its deviation and that of the draws."""
    width = document.get("width") or {}
    found = {}
    for name in _ANSWERS:
        budget = width.get(name)
        if budget and budget["sd_percent"] > 0.0:
            drawn = budget.get("posterior_sd_percent") or budget["sd_percent"]
            ratio = drawn / budget["sd_percent"]
            found[name] = (budget, max(ratio, 1.0 / ratio))
    return found


def sd_words(value: float, sign: str = "±") -> str:
    """Write a deviation in percent with two digits, ``±0.97 %``."""
    return f"{sign}{_two(value)} %"


def _two(value: float) -> str:
    """Two significant digits, and no zeros that say nothing."""
    return number(float(f"{value:.2g}"))


def source_words(source: str) -> str:
    """Say what a share of the variance belongs to, in a few words."""
    kind, _, channel = source.partition(" ")
    if kind in ("noise", "steps", "gain"):
        kind = "scale" if kind == "gain" else kind
        return plain(f"{channel.replace('_', ' ')}: {kind}")
    if source in QUANTITIES:
        return QUANTITIES[source][1]
    return {
        "prior": "belief before the data",
        "data": "recordings",
        "between samples": "motion between samples",
        "start": "state at the beginning",
        "lost readings": "clipped or missing readings",
    }.get(source, plain(source))


def remedy_sentence(measures: list[Document], names: list[str], runs: int) -> str:
    """Say what to do to halve the width of some answers.

    Parameters
    ----------
    measures : list of dict
        Of one remedy: ``what`` with ``now_sd_percent`` and so on, or ``runs`` with ``further``.
    names : list of str
        The answers that it halves.
    runs : int
        Number of runs there are.

    Returns
    -------
    str
        A whole sentence.
    """
    parts = [_measure(measure, runs) for measure in measures]
    text = f"{_listed(parts)}: that halves the uncertainty of {_listed([_the(n) for n in names])}"
    return f"{text[0].upper()}{text[1:]}."


def _measure(measure: Document, runs: int) -> str:
    if measure["what"] == "runs":
        n = measure["further"]
        count = _NUMBERS[n] if n < len(_NUMBERS) else str(n)
        kind = "like this one" if runs == 1 else "like these"
        return f"record {count} more run{'' if n == 1 else 's'} {kind}"
    unit, needed = measure["unit"], measure["needed_sd"]
    if unit == "lbf*s^2/in":  # which no scale reads
        needed, unit = float(from_si(to_si(needed, unit, "mass"), "lbm", "mass")), "lbm"
    size = f"±{_two(needed)} {readable_unit(unit)}; " if unit else ""
    kind, _, channel = measure["what"].partition(" ")
    what = (
        f"calibrate the {channel.replace('_', ' ')} sensor to"
        if kind == "gain"
        else _MEASURES[measure["what"]]
    )
    return (
        f"{what} {sd_words(measure['needed_sd_percent'])} "
        f"({size}now {sd_words(measure['now_sd_percent'])})"
    )


def _the(name: str) -> str:
    return f"the {QUANTITIES[name][1]}"


def _listed(parts: list[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def width_steps(document: Document) -> list[str]:
    """Say what to weigh, measure or drive next to halve what is widest.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1``.

    Returns
    -------
    list of str
        Whole sentences, a remedy each; answers that the same one halves stand together, and
        the tightest demand of them holds. Answers within half a percent need none.
    """
    best: dict[tuple[str, ...], tuple[list[Document], list[str]]] = {}
    for name, budget in budgets(document).items():
        if budget["sd_percent"] < _WORTH or not budget["halve"]:
            continue
        measures = budget["halve"][0]["measures"]
        key = tuple(m["what"] for m in measures)
        before, names = best.get(key, (measures, []))
        best[key] = (list(map(_tighter, before, measures)), [*names, name])
    runs = document["width"]["runs"] if best else 0
    return [remedy_sentence(measures, names, runs) for measures, names in best.values()]


def _tighter(one: Document, other: Document) -> Document:
    if one["what"] == "runs":
        return max(one, other, key=lambda m: int(m["further"]))
    return min(one, other, key=lambda m: float(m["needed_sd"]))


def halving_lines(document: Document) -> list[str]:
    """Say for every answer what would halve its width, the least demanding first."""
    lines = []
    for name, budget in budgets(document).items():
        runs = document["width"]["runs"]
        ways = [_listed([_measure(m, runs) for m in way["measures"]]) for way in budget["halve"]]
        start = f"{QUANTITIES[name][1].capitalize()}, now {sd_words(budget['sd_percent'])}"
        if not ways:
            lines.append(f"{start}: nothing that could be weighed, measured or driven halves it.")
            continue
        text = f"{start}: {'; or '.join(ways[:3])}."
        single = len(budget["halve"][0]["measures"]) == 1
        if not single:
            text += " No single one of these would do."
        elif not any(w["measures"][0]["what"] != "runs" for w in budget["halve"]):
            text += " Nothing that could be weighed or measured would."
        elif budget["runs_to_halve"] is None:
            text += " No number of further runs would."
        lines.append(text)
    return lines


def width_limits(document: Document) -> list[str]:
    """Say what makes each answer as wide as it is, and which undeclared fault would hurt most.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/estimate/1``.

    Returns
    -------
    list of str
        Whole sentences; none without an error budget.
    """
    found = budgets(document)
    groups: dict[tuple[str, str], list[str]] = {}
    for name, budget in found.items():
        source = max(budget["shares"], key=lambda s: float(budget["shares"][s]))
        sensors = _by_sensor(budget["noises"]) if source == "data" else {}
        worst = max(sensors, key=lambda c: sensors[c]) if sensors else ""
        groups.setdefault((source, worst), []).append(name)
    lines = [_ruled(*key, names, found, document) for key, names in groups.items()]
    doubtful = [name for name in _all(document) if name not in found]
    if doubtful:
        lines.append(
            f"What makes {_listed([_the(n) for n in doubtful])} as uncertain as the draws say "
            "cannot be told apart: close to its most probable value the posterior is much "
            "narrower or wider than as a whole."
        )
    return lines + _worst_faults(document, found)


def _ruled(
    source: str, worst: str, names: list[str], found: dict[str, Document], document: Document
) -> str:
    """One sentence about answers whose width has the same main cause."""
    much = _span([found[name]["shares"][source] for name in names])
    whose = f"{much} of the variance of {_listed([_the(n) for n in names])}"
    if source == "data":
        if not document["width"]["white"]:
            return f"Motion that the half car does not explain makes {whose}."
        if not worst:
            return f"The noise of the recordings makes {whose}."
        parts = [_by_sensor(found[n]["noises"])[worst] / found[n]["shares"]["data"] for n in names]
        return (
            f"The noise of the recordings makes {whose}; the largest part, {_span(parts)}, comes "
            f"from the {worst.replace('_', ' ')} sensor."
        )
    if source == "prior":
        return f"What was believed before the data makes {whose}: the recordings say little."
    known = document.get("known", {}).get(source) or {}
    given = ""
    if known.get("sd") and known.get("value"):
        given = f", given to {sd_words(100.0 * known['sd'] / abs(known['value']))},"
    left = [found[n]["exact_sd_percent"].get(source) for n in names]
    if any(value is None for value in left):
        return f"The {source_words(source)}{given} makes {whose}."
    then = _listed([sd_words(value) for value in left])
    now = _listed([sd_words(found[n]["sd_percent"]) for n in names])
    they = "it would be" if len(names) == 1 else "they would be"
    return (
        f"The {source_words(source)}{given} makes {whose}: were it exact, {they} known to {then} "
        f"instead of {now}."
    )


def _worst_faults(document: Document, found: dict[str, Document]) -> list[str]:
    """Tell the most harmful value given as exact and the most harmful fault of a sensor."""
    lines = []
    faults = (document.get("width") or {}).get("faults") or {}
    for given in (True, False):
        felt = [
            (abs(fault["shift"][name]["sd"]), key, name)
            for key, fault in faults.items()
            if (fault["kind"] == "given") == given
            for name in _SPOKEN
            if name in found
        ]
        if not felt:
            continue
        most, key, name = max(felt)
        if most < _FELT:
            continue
        shift = faults[key]["shift"][name]
        way = "high" if shift["percent"] > 0.0 else "low"
        told = fault_words(faults[key], document)
        start = (
            f"The {QUANTITIES[faults[key]['where']][1]} is given as exact: with {told}"
            if given
            else f"Of sensor faults that the residuals would not show, {told} matters most: with it"
        )
        lines.append(
            f"{start} {_the(name)} would come out {sd_words(abs(shift['percent']), '')} too {way} "
            f"({number(most, 1.0)} of its deviations)."
        )
    return lines


def _span(shares: list[float]) -> str:
    low, high = percent(min(shares)), percent(max(shares))
    return low if low == high else f"{low.removesuffix(' %')} to {high}"


def _by_sensor(noises: Document) -> dict[str, float]:
    """Noise and steps of each sensor together."""
    out: dict[str, float] = {}
    for name, share in noises.items():
        kind, _, channel = name.partition(" ")
        if kind in ("noise", "steps"):
            out[channel] = out.get(channel, 0.0) + float(share)
    return out


def fault_words(fault: Document, document: Document, *, brief: bool = False) -> str:
    """Say what is wrong.

    Parameters
    ----------
    fault : dict
        One of the document's.
    document : dict
        Gives the system of units.
    brief : bool
        ``front wheel: 1 % too much`` instead of ``a front wheel sensor that reads 1 % too
        much``.
    """
    kind, size = fault["kind"], float(fault["size"])
    up = "≤ " if fault["larger_shows"] and brief else ""
    share = up + sd_words(100.0 * size, "")
    if kind == "given":
        name = QUANTITIES[fault["where"]][1]
        return f"{name}: {share} larger" if brief else f"one {share} larger"
    place = fault["where"].replace("_", " ")
    sensor = f"{place}:" if brief else f"a {place} sensor"
    if kind == "gain":
        return f"{sensor} {share} too much" if brief else f"{sensor} that reads {share} too much"
    if kind == "delay":
        return f"{sensor} {'' if brief else 'sampled '}{up}{_two(1e3 * size)} ms later"
    if kind == "bandwidth":
        return f"{sensor} {'' if brief else 'of '}{share} more bandwidth"
    us = (document.get("vehicle") or {}).get("units") == "US"
    length = f"{_two(size / 0.0254)} in" if us else f"{_two(1e3 * size)} mm"
    return f"{sensor} {up}{length} ahead of {'' if brief else 'its '}axle"
