"""A plan in words, for the terminal and for the document: pure functions."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.domain.units import display_units, from_si, si_factor
from bayes_asv.planning.grid import Planned
from bayes_asv.planning.grounds import Ground
from bayes_asv.planning.limits import Limit
from bayes_asv.planning.pairs import ALWAYS, Pair, pairs
from bayes_asv.planning.plan import Judged, Plan
from bayes_asv.planning.widths import ANSWERS
from bayes_asv.report.readable import plain, readable_unit

__all__ = [
    "always_words",
    "assumption_lines",
    "drive_words",
    "ground_words",
    "length",
    "limit_lines",
    "limit_words",
    "never_words",
    "pair_words",
    "plan_lines",
    "share_words",
    "speed",
    "times_words",
]

_INCH, _FOOT, _MPH, _KMH = 0.0254, 0.3048, 0.44704, 1.0 / 3.6
_Z95 = 1.96
_MOST = 4  # pairs on the terminal; one blind direction of the car makes many


def length(value: float, units: str) -> tuple[float, str]:
    """Give a length (m) as people lay it out: inches and whole feet, or centimetres and metres."""
    if units == "US":
        feet = value / _FOOT
        if feet > 1.5 and abs(feet - round(feet)) < 1e-6:
            return float(round(feet)), "ft"
        return round(value / _INCH, 6), "in"
    return (round(value, 6), "m") if value >= 0.5 else (round(100.0 * value, 6), "cm")


def speed(value: float, units: str) -> tuple[float, str]:
    """Give a speed (m/s) in miles or kilometres an hour."""
    return (round(value / _MPH, 6), "mph") if units == "US" else (round(value / _KMH, 6), "km/h")


def ground_words(ground: Ground, units: str) -> str:
    """Name what lies on the ground, with its dimensions."""
    if ground.kind == "rough":
        return f"a rough road (ISO 8608 class {ground.iso})"
    high, long = _said(length(ground.height, units)), _said(length(ground.length, units))
    if ground.kind == "bump":
        return f"a bump {high} high and {long} long"
    if ground.kind == "stops":
        return f"two parking stops {high} high and {long} apart"
    return f"{ground.count} rollers {high} high, {long} from crest to crest"


def drive_words(drive: Planned, units: str) -> str:
    """Name a drive: ``over a bump 3 in high and 3 ft long at 6 mph, recorded at 400 Hz …``."""
    return (
        f"over {ground_words(drive.ground, units)} at {_said(speed(drive.speed, units))}, recorded "
        f"at {drive.rate:g} Hz for {drive.seconds:.1f} s"
    )


def share_words(share: float) -> str:
    """Write a width: two significant digits, no false precision above 100 %."""
    if not math.isfinite(share) or share >= 1.0:
        return "> 100 %"
    if share < 1e-5:
        return "0 %"
    digits = max(0, 1 - math.floor(math.log10(100.0 * share) + 1e-9))
    return f"{100.0 * share:.{digits}f} %"


def times_words(passes: int) -> str:
    """``once``, ``twice``, ``3 times``."""
    return {1: "once", 2: "twice"}.get(passes, f"{passes} times")


def pair_words(pair: Pair) -> str:
    """Name two parameters that a drive hardly tells apart."""
    first, second = (_label(name) for name in pair.names)
    return f"{first} and {second} (correlation {pair.correlation:+.2f})".replace("-", "−")


def always_words() -> list[str]:
    """Name what no drive tells apart, however it is driven."""
    return [
        f"{_listed([_label(name) for name in names])}: {words} moves alike"
        for names, words in ALWAYS
    ]


def limit_words(what: Limit, plan: Plan) -> str:
    """Say which given value to measure better, and to what."""
    return _mend((what.answer,), what, plan)


def limit_lines(plan: Plan) -> list[str]:
    """Say it for all answers that stay too wide, those with the same mend together."""
    groups: dict[str, list[Limit]] = {}
    for what in plan.limits:
        key = f"{plan.want[what.answer]} {_needed(what, plan)}"
        groups.setdefault(key, []).append(what)
    return [_mend([what.answer for what in group], group[0], plan) for group in groups.values()]


def _needed(what: Limit, plan: Plan) -> str:
    """Name given values and what they need; empty when none is at fault."""
    parts = [
        f"the {_label(name)} to {share_words(sd)} (given: {share_words(plan.before.log_sd[name])})"
        for name, sd in what.needed.items()
    ]
    return _listed(parts) if parts else ""


def _mend(answers: Sequence[str], what: Limit, plan: Plan) -> str:
    """One sentence for answers with the same mend."""
    labels = _listed([f"the {_label(name)}" for name in answers])
    wanted = share_words(plan.want[what.answer])
    if what.needed:
        return f"to know {labels} to {wanted}, know {_needed(what, plan)}"
    stays = "stays" if len(answers) == 1 else "stay"
    return (
        f"{labels} {stays} wider than {wanted} in {plan.most_passes} passes even if all that is "
        "given were exact: allow more passes, or use sensors with less noise"
    )


def never_words(plan: Plan, one: Judged, answer: str) -> str:
    """Say why no number of passes brings an answer to its wanted width."""
    if not one.trial.usable:
        return one.trial.reasons[0]
    floor, want = plan.floor[answer], plan.want[answer]
    if floor > want:
        return (
            f"stays at {share_words(floor)} however often you drive: accelerations give it only in "
            f"proportion to what is weighed and measured ({_given_words(plan, answer)})"
        )
    return "more than a thousand passes"


def assumption_lines(plan: Plan) -> list[str]:
    """Say what the vehicle file leaves open and the plan had to assume."""
    lines = []
    if plan.assumed_noise:
        which = "any sensor" if len(plan.assumed_noise) == 4 else _listed(
            [name.replace("_", " ") for name in plan.assumed_noise]
        )  # fmt: skip
        lines.append(
            f"the vehicle file gives no noise for {which}; that of a small 10-bit logger is assumed"
        )
    if not plan.tyres_told:
        rate = [_shown(value, "stiffness", plan) for value in plan.tyres.rate]
        mass = [_weight(value, plan) for value in plan.tyres.mass]
        lines.append(
            f"tyres of {rate[0]} and {rate[1]} and unsprung masses of {mass[0]} and {mass[1]}, "
            "front and rear, are taken; say --tyre-rate and --unsprung if yours differ"
        )
    if any(not math.isfinite(s.low) and not math.isfinite(s.high) for s in plan.vehicle.sensors):
        lines.append(
            "the vehicle file gives no range for some sensors; compare the largest readings of "
            "the drive with theirs"
        )
    travel = plan.vehicle.travel
    if None in (travel.front_bump, travel.front_droop, travel.rear_bump, travel.rear_droop):
        lines.append(
            "the vehicle file does not give all suspension travel; what is missing is not checked"
        )
    return lines


def _shown(value: float, dimension: str, plan: Plan) -> str:
    """Write a quantity in the vehicle's units, two digits."""
    unit = display_units(plan.vehicle.units)[dimension]
    digits = 1 - math.floor(math.log10(value / si_factor(unit, dimension)))
    return f"{round(from_si(value, unit, dimension), digits):g} {readable_unit(unit)}"


def _weight(value: float, plan: Plan) -> str:
    """Write a mass as scales show it."""
    unit = "lbm" if plan.vehicle.units == "US" else "kg"
    return f"{from_si(value, unit, 'mass'):.0f} {unit}"


def plan_lines(plan: Plan) -> list[str]:
    """Tell a plan on the terminal.

    Parameters
    ----------
    plan : Plan
        From :func:`bayes_asv.planning.plan.plan`.

    Returns
    -------
    list of str
        Lines.
    """
    units = plan.vehicle.units
    lines = [f"Plan for {plain(plan.vehicle.name)}", ""]
    best = plan.best
    if best is None:
        lines += ["No drive can be used.", *(f"- {why}" for why in common_reasons(plan.judged))]
        return lines
    words = f"rive {times_words(plan.passes)} {drive_words(best.trial.drive, units)}."
    if plan.chosen is None:
        lines.append(
            f"No drive gives every parameter as well as wanted in {plan.most_passes} passes."
        )
    lines.append(f"D{words}" if plan.chosen is not None else f"Nearest: d{words}")
    lines += ["", *_promises(plan, best), ""]
    lines += [f"- {text}" for text in limit_lines(plan)]
    lines += [f"- {note}" for note in best.trial.notes]
    lines += [f"- {text}" for text in assumption_lines(plan)]
    lines += _blind_spots(plan, best)
    lines += ["", *_grounds_table(plan, best)]
    rates = _rates_table(plan, best)
    return [*lines, "", *rates] if rates else lines


def common_reasons(judged: Sequence[Judged]) -> list[str]:
    """Distinct reasons why drives cannot be used, the most frequent first, three at most."""
    counted: dict[str, int] = {}
    for one in judged:
        for reason in one.trial.reasons:
            counted[reason] = counted.get(reason, 0) + 1
    return sorted(counted, key=lambda reason: -counted[reason])[:3]


def _promises(plan: Plan, one: Judged) -> list[str]:
    """Promised widths of one drive, a line a parameter."""
    promised = plan.promised(one, plan.passes)
    rows = [
        (
            f"{_label(name)} ({name})",
            share_words(promised[name]),
            f"± {share_words(_Z95 * promised[name])}",
            share_words(plan.want[name]),
        )
        for name in ANSWERS
    ]
    return _columns([("", "one deviation", "95 %", "wanted"), *rows])


def _blind_spots(plan: Plan, one: Judged) -> list[str]:
    """Name what the drive cannot tell apart."""
    lines = ["", "No drive tells apart:"]
    lines += [f"- {words}" for words in always_words()]
    held = [name for name in ANSWERS if plan.floor[name] > 1e-5]
    for floor in dict.fromkeys(share_words(plan.floor[name]) for name in held):
        alike = [name for name in held if share_words(plan.floor[name]) == floor]
        lines.append(f"- so {_listed(alike)} cannot come below {floor}")
    close = pairs(one.trial.information)
    if close:
        lines += ["This drive hardly tells apart:", *(f"- {pair_words(p)}" for p in close[:_MOST])]
    if len(close) > _MOST:
        lines.append(f"- and {len(close) - _MOST} more pairs of the same")
    return lines


def _grounds_table(plan: Plan, best: Judged) -> list[str]:
    """Best drive over each ground at the rate of the chosen one."""
    units, rate = plan.vehicle.units, best.trial.drive.rate
    rows: list[tuple[str, ...]] = []
    places: dict[Ground, list[Judged]] = {}
    for one in plan.judged:
        if one.trial.drive.rate == rate:
            places.setdefault(one.trial.drive.ground, []).append(one)
    for ground, tried in places.items():
        usable = [one for one in tried if one.trial.usable]
        name = ground_words(ground, units).removeprefix("a ")
        if not usable:
            rows.append((name, "none", *["–"] * len(ANSWERS), ""))
            continue
        top = min(usable, key=lambda one: (not one.trial.gentle, one.quality))
        promised = plan.promised(top, plan.passes)
        faults = [one.trial.drive.speed for one in tried if not one.trial.usable]
        rows.append(
            (
                name,
                _said(speed(top.trial.drive.speed, units)),
                *(share_words(promised[a]) for a in ANSWERS),
                f"not from {_said(speed(min(faults), units))} on" if faults else "",
            )
        )
    head = f"At {rate:g} Hz, {times_words(plan.passes)}, the best of the speeds tried:"
    return [head, *_columns([("", "speed", *ANSWERS, ""), *rows])]


def _rates_table(plan: Plan, best: Judged) -> list[str]:
    """Tell the chosen drive at every rate tried; empty when there was one only."""
    drive = best.trial.drive
    same = [
        one
        for one in plan.judged
        if (one.trial.drive.ground, one.trial.drive.speed) == (drive.ground, drive.speed)
    ]
    if len(same) < 2:
        return []
    rows = []
    for one in same:
        said = ["–"] * len(ANSWERS)
        if one.trial.usable:
            said = [share_words(share) for share in plan.promised(one, plan.passes).values()]
        rows.append((f"{one.trial.drive.rate:g} Hz", *said))
    return ["The drive above at other rates:", *_columns([("", *ANSWERS), *rows])]


def _columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """First column flush left, the others flush right, the last flush left if it is a remark."""
    width = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [row[0].ljust(width[0])]
        cells += [cell.rjust(w) for cell, w in zip(row[1:], width[1:], strict=True)]
        lines.append(("  " + "  ".join(cells)).rstrip())
    return lines


def _given_words(plan: Plan, answer: str) -> str:
    """``sprung mass 1 %, wheelbase 0.5 %``: what holds an answer up."""
    names = {"c_f": ("m",), "c_r": ("m",), "i": ("m", "l"), "k_g": ("l",)}[answer]
    said = [
        f"{_label(name)} {share_words(plan.before.log_sd[name])}"
        for name in names
        if plan.before.log_sd[name] > 0.0
    ]
    return ", ".join(said)


def _label(name: str) -> str:
    return QUANTITIES[name][1]


def _listed(parts: Sequence[str]) -> str:
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def _said(quantity: tuple[float, str]) -> str:
    return f"{quantity[0]:g} {quantity[1]}"
