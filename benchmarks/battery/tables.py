"""Tables of the page."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from bayes_asv.domain.channels import CHANNELS
from benchmarks.battery.cells import GROUPS, Group
from benchmarks.battery.intervals import Share, count_true
from benchmarks.battery.judge import PARAMETERS, Judged
from benchmarks.battery.reliability import calibration_error
from benchmarks.battery.summary import (
    ABOVE_THE_FLOOR,
    by_group,
    closed,
    coverage,
    false_alarm,
    naming,
    probabilities,
    reached,
    single,
    strengths,
)
from benchmarks.calibration.tables import table
from tests.battery.effects import EFFECTS
from tests.battery.unlisted_faults import UNLISTED_FAULTS

__all__ = [
    "by_condition",
    "by_effect",
    "by_strength",
    "coverage_table",
    "effects_coverage_table",
    "gap_table",
    "outside_table",
    "short_answer",
    "sizes_table",
    "summary_row",
]

Groups = Mapping[Group, Sequence[Judged]]

_WITHIN = "within two tolerances"


def percent(one: Share) -> str:
    """Format a proportion in per cent with Wilson's interval; empty without cases."""
    if one.of == 0:
        return ""
    low, high = one.interval
    return f"{100 * one.share:.0f} ({100 * low:.0f}–{100 * high:.0f})"


def _of(cases: Groups, key: str) -> list[Judged]:
    return [one for group, there in cases.items() if group.key == key for one in there]


def _strong(cases: Sequence[Judged], least: float = ABOVE_THE_FLOOR) -> list[Judged]:
    return [one for one in cases if one.truth.strength >= least and reached(one)]


def flagged_outside(cases: Sequence[Judged]) -> Share:
    """Count unlisted faults that are reported as unexplained, or named where there is a name."""
    return count_true([one.flagged or one.class_right for one in cases if one.verdict != "refused"])


def misnamed_outside(cases: Sequence[Judged]) -> Share:
    """Count unlisted faults that are named with a probability of at least 0.9 and not flagged."""
    return count_true([one.confidently_wrong for one in cases if one.verdict != "refused"])


def short_answer(cases: Sequence[Judged]) -> str:
    """Return the summary table."""
    groups = by_group(cases)
    rows: list[list[str]] = []

    def add(what: str, one: Share) -> None:
        if one.of:
            rows.append([what, percent(one) + " %", str(one.of)])

    for group in GROUPS[:4]:
        add(f"false alarms: {_lower(group.title)}", false_alarm(groups[group]))
    clutter = _of(groups, "clutter")
    add("deviations within tolerance: named or unexplained", false_alarm(clutter))
    add("deviations within tolerance: confidently named", naming(clutter).confidently_wrong)
    one_effect = _of(groups, "single")
    above, weak = naming(_strong(one_effect)), naming(_weak(one_effect))
    add("one effect of noncentrality 40 or more: first name and location correct", above.first)
    add("the same: first name's class correct", above.of_class)
    add("the same: confidently wrong", above.confidently_wrong)
    add("one effect of noncentrality 10: first name's class correct", weak.of_class)
    with_tolerances = naming(_of(groups, "in-clutter"))
    add(
        "one effect and deviations within tolerance: first name's class correct",
        with_tolerances.of_class,
    )
    two_effects = _strong(_of(groups, "pair"))
    pairs = naming(two_effects)
    add("two effects: both found", pairs.every)
    add("two effects: both found and nothing else", pairs.exact)
    plain = [one for one in two_effects if _beyond(one) != _WITHIN]
    add("two effects, both beyond two tolerances: both found", naming(plain).every)
    outside = _strong(_of(groups, "outside"))
    add("fault outside the list: reported as unexplained", flagged_outside(outside))
    add("fault outside the list: confidently misnamed", misnamed_outside(outside))
    gap = closed([*one_effect, *_of(groups, "pair")])
    if gap.cases:
        low, high = gap.median_interval
        words = f"{100 * gap.median:.1f} ({100 * low:.1f}–{100 * high:.1f}) %"
        rows.append(["fraction of the held-out gap that is closed, median", words, str(gap.cases)])
        low, high = gap.tenth_interval
        words = f"{100 * gap.tenth:.1f} ({100 * low:.1f}–{100 * high:.1f}) %"
        rows.append(["the same, 10th percentile", words, str(gap.cases)])
        add("held-out gap increased", gap.worse)
    for name, (before, after, _) in coverage(_strong(one_effect)).items():
        add(f"coverage of the 95 % interval of {name}, before naming", before)
        add(f"coverage of the 95 % interval of {name}, after naming", after)
    for name, flagged in (("of all names", True), ("of names with nothing unexplained", False)):
        pairs_of = probabilities(cases, flagged)
        if pairs_of:
            error, chance = calibration_error(pairs_of)
            words = f"{error:.3f} (if calibrated: below {chance:.3f} with 95 %)"
            title = f"expected calibration error of the probabilities {name}"
            rows.append([title, words, str(len(pairs_of))])
    seconds = [one.seconds for one in cases]
    rows.append(["seconds per diagnosis, median and 95th percentile",
                 f"{np.median(seconds):.1f}, {np.quantile(seconds, 0.95):.1f}",
                 str(len(seconds))])  # fmt: skip
    for verdict in ("refused", "error"):
        there = sum(one.verdict == verdict for one in cases)
        if there:
            words = "refused" if verdict == "refused" else "failed"
            rows.append([f"diagnoses that {words}", str(there), str(len(cases))])
    return table(["figure", "found", "cases"], rows)


def _lower(title: str) -> str:
    return title[0].lower() + title[1:]


def _weak(cases: Sequence[Judged]) -> list[Judged]:
    return [one for one in cases if 0.0 < one.truth.strength < ABOVE_THE_FLOOR]


_NAMING_HEAD = ("cases", "detected", "name", "name and location", "class", "all found",
                "exactly", "confidently wrong")  # fmt: skip


def _naming_cells(cases: Sequence[Judged]) -> list[str]:
    n = naming(cases)
    shares = (n.detected, n.name, n.first, n.of_class, n.every, n.exact, n.confidently_wrong)
    return [str(n.first.of), *(percent(one) for one in shares)]


def by_strength(cases: Sequence[Judged]) -> str:
    """Tabulate naming by kind of case and strength."""
    rows = []
    for group, there in by_group(cases).items():
        if group.key not in ("single", "in-clutter", "misstated-single", "pair"):
            continue
        for strength in strengths(there):
            chosen = single(there, strength)
            rows.append([f"{group.title}, {strength:g}", *_naming_cells(chosen)])
    return table(["kind, noncentrality", *_NAMING_HEAD], rows)


def by_effect(cases: Sequence[Judged]) -> str:
    """Tabulate naming of single effects well above the floor, one effect per row."""
    there = _strong(_of(by_group(cases), "single"))
    rows = []
    for name in EFFECTS:
        own = [one for one in there if one.truth.effects[0].name == name]
        if own:
            rows.append([name, *_naming_cells(own)])
    return table(["effect", *_NAMING_HEAD], rows)


def by_condition(cases: Sequence[Judged]) -> str:
    """Tabulate naming of single effects and false alarms by terrain, car, noise and size."""
    groups = by_group(cases)
    there, nulls = _strong(_of(groups, "single")), _of(groups, "null")
    ways: tuple[tuple[str, Callable[[Judged], str]], ...] = (
        ("terrain", lambda one: one.truth.terrain),
        ("car", lambda one: one.truth.family),
        ("noise", lambda one: f"{one.truth.noise:g} times"),
        ("size", _beyond),
    )
    rows = []
    for way, of in ways:
        for value in sorted({of(one) for one in (*there, *nulls)} - {""}):
            own = [one for one in there if of(one) == value]
            n = naming(own)
            alarms = false_alarm([one for one in nulls if of(one) == value])
            rows.append([f"{way}: {value}", str(len(own)), percent(n.first), percent(n.of_class),
                         percent(alarms)])  # fmt: skip
    return table(["condition", "cases", "name and location", "class", "false alarms"], rows)


def _beyond(one: Judged) -> str:
    """Classify effects as beyond or within two tolerances; empty without a tolerance."""
    known = [effect for effect in one.truth.effects if effect.tolerance > 0.0]
    if not known:
        return ""
    beyond = all(effect.size > 2.0 * effect.tolerance for effect in known)
    return "beyond two tolerances" if beyond else _WITHIN


def outside_table(cases: Sequence[Judged]) -> str:
    """Tabulate the results for unlisted faults, one fault per row."""
    there = _strong(_of(by_group(cases), "outside"))
    rows = []
    for name in UNLISTED_FAULTS:
        own = [one for one in there if one.truth.effects[0].name == name]
        if not own:
            continue
        said: dict[str, int] = {}
        for one in own:
            said[one.said] = said.get(one.said, 0) + 1
        words = ", ".join(f"{what} {n}" for what, n in sorted(said.items(), key=lambda x: -x[1]))
        rows.append([name, str(len(own)), percent(flagged_outside(own)),
                     percent(misnamed_outside(own)), words])  # fmt: skip
    return table(["fault", "cases", "unexplained, %", "confidently misnamed, %", "reported first"],
                 rows)  # fmt: skip


def gap_table(cases: Sequence[Judged]) -> str:
    """Tabulate the fraction of the held-out gap that is closed, by strength."""
    rows = []
    for group, there in by_group(cases).items():
        if group.key not in ("single", "in-clutter", "pair"):
            continue
        for strength in strengths(there):
            found = closed(single(there, strength))
            if found.cases:
                rows.append([
                    f"{group.title}, {strength:g}", str(found.cases), f"{100 * found.median:.1f} %",
                    f"{100 * found.tenth:.1f} %", percent(found.worse) + " %",
                ])  # fmt: skip
    return table(["kind, noncentrality", "cases", "median", "10th percentile", "worse"], rows)


def coverage_table(cases: Sequence[Judged]) -> str:
    """Tabulate the coverage of 95 % intervals before and after naming."""
    rows = []
    for group, there in by_group(cases).items():
        if group.key == "outside":
            continue
        for strength in strengths(there) or [0.0]:
            found = coverage(single(there, strength) if strength else there)
            if not found:
                continue
            of = f", {strength:g}" if strength else ""
            row = [f"{group.title}{of}", str(max(after.of for _, after, _ in found.values()))]
            for name in PARAMETERS:
                before, after, _ = found.get(name, (Share(0, 0), Share(0, 0), math.nan))
                row += ["" if before.of == 0 else f"{100 * before.share:.0f}", percent(after)]
            row.append(f"{100 * max(width for _, _, width in found.values()):.2g} %")
            rows.append(row)
    head = [f"{name} {when}" for name in PARAMETERS for when in ("before", "after")]
    return table(["kind, noncentrality", "cases", *head, "widest after"], rows)


def effects_coverage_table(cases: Sequence[Judged]) -> str:
    """Tabulate the coverage of the 95 % intervals of effects' parameters, by effect."""
    found: dict[str, dict[str, list[bool]]] = {}
    for one in cases:
        for effect, parameter, covered in one.effects_covered:
            found.setdefault(effect, {}).setdefault(parameter, []).append(covered)
    rows = []
    for effect in sorted(found, key=lambda name: _held(found[name])):
        of = found[effect]
        each = ", ".join(f"{name} {sum(own)} of {len(own)}" for name, own in of.items())
        rows.append([effect, percent(count_true([x for own in of.values() for x in own])), each])
    every = [x for of in found.values() for own in of.values() for x in own]
    if every:
        rows.append(["all", percent(count_true(every)), f"{sum(every)} of {len(every)}"])
    return table(["effect", "intervals that contain the truth, %", "by parameter"], rows)


def _held(found: Mapping[str, Sequence[bool]]) -> float:
    """Share of true values in lists by name."""
    every = [x for own in found.values() for x in own]
    return sum(every) / len(every)


# Display of effect sizes: parameter, value without the effect, factor, unit.
_SHOWN = {
    "bound_rebound": ("ratio", 1.0, 100.0, "%"),
    "digressive_damper": ("knee", 0.0, 1.0, "m/s"),
    "coulomb_friction": ("force", 0.0, 1.0, "N"),
    "progressive_spring": ("kappa", 0.0, 1.0, "1/m²"),
    "bump_stop": ("gap", 0.0, 1e3, "mm"),
    "droop_stop": ("gap", 0.0, 1e3, "mm"),
    "spring_rate": ("factor", 1.0, 100.0, "%"),
    "damper_fade": ("loss", 0.0, 100.0, "%"),
    "weight_distribution": ("factor", 1.0, 100.0, "%"),
    "external_force": ("force", 0.0, 1.0, "N"),
    "sensor_gain": ("factor", 1.0, 100.0, "%"),
    "sensor_lag": ("lag", 0.0, 1e6, "µs"),
    "sensor_bandwidth": ("bandwidth", 50.0, 2.0, "%"),
    "sensor_drift": ("slope", 0.0, 1.0, "m/s³"),
    "engine_vibration": ("amplitude", 0.0, 1.0, "N"),
}


def sizes_table(cases: Sequence[Judged]) -> str:
    """Tabulate the median size of each effect by strength."""
    there = _of(by_group(cases), "single")
    columns = strengths(there)
    rows = []
    for name, (key, none, factor, unit) in _SHOWN.items():
        cells = []
        for strength in columns:
            sizes = [
                factor * abs(e.parameters[key] - none)
                for one in single(there, strength)
                for e in one.truth.effects
                # a tone of one channel is not a force
                if e.name == name and not (unit == "N" and e.where in CHANNELS)
            ]
            cells.append(f"{np.median(sizes):.2g}" if sizes else "")
        rows.append([f"{name}: {key}, {unit}", *cells])
    return table(["effect", *(f"{s:g}" for s in columns)], rows)


def summary_row(name: str, cases: Sequence[Judged]) -> list[str]:
    """Return one row of main figures, to compare ablations or versions."""
    groups = by_group(cases)
    above = naming(_strong(_of(groups, "single")))
    outside = _strong(_of(groups, "outside"))
    gap = closed([*_of(groups, "single"), *_of(groups, "pair")])
    pairs = probabilities(cases, flagged=True)
    return [
        name,
        str(len(cases)),
        percent(false_alarm(_of(groups, "null"))),
        percent(naming(_of(groups, "clutter")).confidently_wrong),
        percent(above.first),
        percent(above.of_class),
        percent(flagged_outside(outside)),
        percent(misnamed_outside(outside)),
        "" if math.isnan(gap.median) else f"{100 * gap.median:.1f}",
        f"{calibration_error(pairs)[0]:.3f}" if pairs else "",
        f"{np.median([one.seconds for one in cases]):.1f}" if cases else "",
    ]


SUMMARY_HEAD = (
    "", "cases", "false alarms", "tolerances misnamed", "name and location", "class",
    "outside flagged", "outside misnamed", "gap closed", "calibration error", "seconds",
)  # fmt: skip
