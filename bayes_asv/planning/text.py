"""Text about a plan, for the terminal and for the document."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bayes_asv.domain.errors import enumerated
from bayes_asv.domain.quantities import NORMAL_975, QUANTITIES
from bayes_asv.domain.units import FOOT, INCH, KMH, MPH, display_units, from_si, si_factor
from bayes_asv.planning.drive_information import (
    CorrelatedPair,
    correlated_pairs,
    inseparable_groups,
)
from bayes_asv.planning.drives import Drive, RoadProfile
from bayes_asv.planning.plan import PlanResult, RatedDrive
from bayes_asv.planning.predicted_sd import LimitingValues
from bayes_asv.planning.ride_simulation import RIGHT_LATER
from bayes_asv.posterior.identifiability import sensor_for
from bayes_asv.posterior.information import predicted_sd, unmeasured
from bayes_asv.report.words import plain, readable_unit

__all__ = [
    "assumption_lines",
    "drive_text",
    "length",
    "limit_lines",
    "limit_sentence",
    "pair_text",
    "percent_text",
    "plan_lines",
    "road_text",
    "speed",
    "times_text",
    "unidentifiable_lines",
    "unidentified_lines",
    "unreachable_reason",
]

_MAX_PAIRS = 4  # listed on the terminal; one poorly determined direction makes many pairs


def length(value: float, units: str) -> tuple[float, str]:
    """Convert a length, m, to inches or whole feet, or to centimetres or metres."""
    if units == "US":
        feet = value / FOOT
        if feet > 1.5 and abs(feet - round(feet)) < 1e-6:
            return float(round(feet)), "ft"
        return round(value / INCH, 6), "in"
    return (round(value, 6), "m") if value >= 0.5 else (round(100.0 * value, 6), "cm")


def speed(value: float, units: str) -> tuple[float, str]:
    """Convert a speed, m/s, to miles or kilometres per hour."""
    return (round(value / MPH, 6), "mph") if units == "US" else (round(value / KMH, 6), "km/h")


def road_text(road: RoadProfile, units: str) -> str:
    """Describe a road with its dimensions."""
    if road.kind == "rough":
        return f"a rough road (ISO 8608 class {road.iso})"
    height = _quantity_text(length(road.height, units))
    distance = _quantity_text(length(road.length, units))
    if road.kind == "bump":
        return f"a bump {height} high and {distance} long"
    if road.kind == "stops":
        return f"two parking stops {height} high and {distance} apart"
    return f"{road.count} rollers {height} high, {distance} from crest to crest"


def drive_text(drive: Drive, units: str) -> str:
    """Describe a drive: ``over a bump 3 in high and 3 ft long at 6 mph, recorded at 400 Hz …``."""
    return (
        f"over {road_text(drive.road, units)} at {_quantity_text(speed(drive.speed, units))}, "
        f"recorded at {drive.rate:g} Hz for {drive.seconds:.1f} s"
    )


def percent_text(fraction: float) -> str:
    """Format a fraction in percent with two significant digits, ``> 100 %`` from one on."""
    if not math.isfinite(fraction) or fraction >= 1.0:
        return "> 100 %"
    if fraction < 1e-5:
        return "0 %"
    digits = max(0, 1 - math.floor(math.log10(100.0 * fraction) + 1e-9))
    return f"{100.0 * fraction:.{digits}f} %"


def times_text(passes: int) -> str:
    """``once``, ``twice``, ``3 times``."""
    return {1: "once", 2: "twice"}.get(passes, f"{passes} times")


def pair_text(pair: CorrelatedPair) -> str:
    """Describe a pair of strongly correlated parameters."""
    first, second = (_label(name) for name in pair.names)
    return f"{first} and {second} (correlation {pair.correlation:+.2f})".replace("-", "−")


def unidentifiable_lines(plan: PlanResult) -> list[str]:
    """Describe the combinations of parameters that no drive identifies."""
    outputs = [channel for channel in plan.measured.channels if not channel.is_input]
    readings = "accelerations" if all(c.quantity == "acceleration" for c in outputs) else "readings"
    return [
        f"{enumerated([_label(name) for name in group.names])}: "
        f"{group.words} has the same {readings}"
        for group in inseparable_groups(plan.prior)
    ]


def unidentified_lines(plan: PlanResult) -> list[str]:
    """Describe the parameters that the sensors at hand do not identify.

    A parameter is not identified if its posterior standard deviation after the passes of the plan's
    drive is about the prior one (:data:`bayes_asv.posterior.information.UNMEASURED`), or if the
    car model lacks it.
    """
    car, parameter_prior = plan.measured.car, plan.prior
    lines = []
    if len(car.axles) == 1:
        other = "rear" if car.axles == ("front",) else "front"
        lines.append(
            f"the {other} damping rate and the pitch inertia: nothing is measured at the {other} "
            "axle"
        )
    if plan.best is None:
        return lines
    prior = {name: parameter_prior.sd(name) for name in car.estimated}
    directions = {name: parameter_prior.log_gradients[name] for name in prior}
    after = predicted_sd(plan.best.evaluation.information, plan.passes, parameter_prior, directions)
    outputs = [channel for channel in plan.measured.channels if not channel.is_input]
    for name in unmeasured(prior, after):
        fix = sensor_for(car, outputs, name) or "drive over something else, or faster"
        lines.append(
            f"the {_label(name)} ({name}): its standard deviation stays at "
            f"{percent_text(after[name])}, and the vehicle file gives {percent_text(prior[name])}; "
            f"{fix}"
        )
    return lines


def limit_sentence(limiting: LimitingValues, plan: PlanResult) -> str:
    """State which given value to measure better, and how well."""
    return _limit_sentence((limiting.parameter,), limiting, plan)


def limit_lines(plan: PlanResult) -> list[str]:
    """Return the limit sentences of all parameters, one for those with the same requirement."""
    groups: dict[str, list[LimitingValues]] = {}
    for limiting in plan.limits:
        key = f"{plan.want[limiting.parameter]} {_required_text(limiting, plan)}"
        groups.setdefault(key, []).append(limiting)
    return [
        _limit_sentence([limiting.parameter for limiting in group], group[0], plan)
        for group in groups.values()
    ]


def _required_text(limiting: LimitingValues, plan: PlanResult) -> str:
    """List the limiting values with their required deviations; empty if there are none."""
    parts = [
        f"the {_label(name)} to {percent_text(sd)} (given: {percent_text(plan.prior.sd(name))})"
        for name, sd in limiting.required_sd.items()
    ]
    return enumerated(parts) if parts else ""


def _limit_sentence(parameters: Sequence[str], limiting: LimitingValues, plan: PlanResult) -> str:
    """Write one sentence for parameters with the same requirement."""
    labels = enumerated([f"the {_label(name)}" for name in parameters])
    wanted = percent_text(plan.want[limiting.parameter])
    if limiting.required_sd:
        return f"to estimate {labels} to {wanted}, measure {_required_text(limiting, plan)}"
    return (
        f"{plan.max_passes} passes do not determine {labels} to {wanted} even with exact given "
        "values: allow more passes, or use sensors with less noise"
    )


def unreachable_reason(plan: PlanResult, one: RatedDrive, parameter: str) -> str:
    """Explain why no number of passes reaches the wanted standard deviation of a parameter."""
    if not one.evaluation.usable:
        return one.evaluation.reasons[0]
    floor, want = plan.sd_floor[parameter], plan.want[parameter]
    if floor > want:
        return (
            f"stays at {percent_text(floor)} however often you drive: accelerations give it "
            f"only in proportion to given values ({_given_text(plan, parameter)})"
        )
    return "needs more than a thousand passes"


def assumption_lines(plan: PlanResult) -> list[str]:
    """State what the plan assumes because the vehicle file does not give it."""
    lines = []
    if plan.assumed_noise:
        all_channels = len(plan.assumed_noise) == len(plan.measured.channels)
        which = "any sensor" if all_channels else enumerated(
            [name.replace("_", " ") for name in plan.assumed_noise]
        )  # fmt: skip
        lines.append(
            f"the vehicle file gives no noise for {which}; the plan assumes a small 10-bit logger"
        )
    if not plan.tyres_given:
        car = plan.measured.car
        sums = [list(car.elements_at(axle)) for axle in car.axles]
        rate = [
            _value_text(plan.tyres.rate[elements].sum(), "stiffness", plan) for elements in sums
        ]
        mass = [_mass_text(plan.tyres.mass[elements].sum(), plan) for elements in sums]
        lines.append(
            f"the plan assumes tyre rates of {enumerated(rate)} and unsprung masses of "
            f"{enumerated(mass)}, {enumerated(car.axles)}; give --tyre-rate and --unsprung if "
            "yours differ"
        )
    if any(element.side == "right" for element in plan.measured.car.elements):
        metric = plan.vehicle.units != "US"
        later = f"{RIGHT_LATER:g} m" if metric else f"{RIGHT_LATER / INCH:.0f} in"
        lines.append(
            f"the right wheels meet every obstacle {later} after the left ones; on a rough road "
            "they have a track of their own"
        )
    if any(
        not math.isfinite(s.low) and not math.isfinite(s.high)
        for s in plan.vehicle.sensors_of([c.name for c in plan.measured.channels])
    ):
        lines.append(
            "the vehicle file gives no range for some sensors; compare the largest readings of "
            "the drive with the data sheets"
        )
    travel = plan.vehicle.travel
    ends = [f"{axle}_{end}" for axle in plan.measured.car.axles for end in ("bump", "droop")]
    if any(getattr(travel, end) is None for end in ends):
        lines.append(
            "the vehicle file does not give every suspension travel; the missing ones are unchecked"
        )
    return lines


def _value_text(value: float, dimension: str, plan: PlanResult) -> str:
    """Format a quantity in the vehicle's units with two significant digits."""
    unit = display_units(plan.vehicle.units)[dimension]
    digits = 1 - math.floor(math.log10(value / si_factor(unit, dimension)))
    return f"{round(from_si(value, unit, dimension), digits):g} {readable_unit(unit)}"


def _mass_text(value: float, plan: PlanResult) -> str:
    """Format a mass in lbm or kg."""
    unit = "lbm" if plan.vehicle.units == "US" else "kg"
    return f"{from_si(value, unit, 'mass'):.0f} {unit}"


def plan_lines(plan: PlanResult) -> list[str]:
    """Describe a plan on the terminal.

    Parameters
    ----------
    plan : PlanResult
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
        lines += ["No drive can be used.", *(f"- {why}" for why in common_reasons(plan.rated))]
        return lines
    words = f"{times_text(plan.passes)} {drive_text(best.evaluation.drive, units)}."
    if plan.chosen is None:
        lines += [
            f"No drive reaches every wanted standard deviation in {plan.max_passes} passes.",
            f"Nearest: drive {words}",
        ]
    else:
        lines.append(f"Drive {words}")
    lines += ["", *_sd_table(plan, best), ""]
    lines += [f"- {text}" for text in limit_lines(plan)]
    lines += [f"- {note}" for note in best.evaluation.notes]
    lines += [f"- {text}" for text in assumption_lines(plan)]
    unidentified = unidentified_lines(plan)
    if unidentified:
        lines += [
            "",
            "Not identifiable with these sensors:",
            *(f"- {text}" for text in unidentified),
        ]
    lines += _unidentifiable_section(plan, best)
    lines += ["", *_roads_table(plan, best)]
    rates = _rates_table(plan, best)
    return [*lines, "", *rates] if rates else lines


def common_reasons(rated: Sequence[RatedDrive]) -> list[str]:
    """Return the three most frequent reasons why drives cannot be used."""
    counted: dict[str, int] = {}
    for one in rated:
        for reason in one.evaluation.reasons:
            counted[reason] = counted.get(reason, 0) + 1
    return sorted(counted, key=lambda reason: -counted[reason])[:3]


def _sd_table(plan: PlanResult, one: RatedDrive) -> list[str]:
    """Format the predicted standard deviations of one drive, one line per parameter."""
    sd = plan.sd_after(one, plan.passes)
    rows = [
        (
            f"{_label(name)} ({name})",
            percent_text(sd[name]),
            f"± {percent_text(NORMAL_975 * sd[name])}",
            percent_text(plan.want[name]),
        )
        for name in plan.estimands
    ]
    return _columns([("", "deviation", "95 %", "wanted"), *rows])


def _unidentifiable_section(plan: PlanResult, one: RatedDrive) -> list[str]:
    """List what no drive, and what this drive, cannot separate."""
    lines = ["", "No drive can separate:"]
    lines += [f"- {words}" for words in unidentifiable_lines(plan)]
    limited = [name for name in plan.estimands if plan.sd_floor[name] > 1e-5]
    for floor in dict.fromkeys(percent_text(plan.sd_floor[name]) for name in limited):
        same = [name for name in limited if percent_text(plan.sd_floor[name]) == floor]
        lines.append(f"- so {enumerated(same)} cannot be determined to better than {floor}")
    strongest = correlated_pairs(one.evaluation.information, plan.prior)
    if strongest:
        lines += [
            "This drive hardly separates:",
            *(f"- {pair_text(p)}" for p in strongest[:_MAX_PAIRS]),
        ]
    if len(strongest) > _MAX_PAIRS:
        lines.append(f"- and {len(strongest) - _MAX_PAIRS} more pairs")
    return lines


def _roads_table(plan: PlanResult, best: RatedDrive) -> list[str]:
    """Format the best drive over each road at the rate of the chosen one."""
    units, rate = plan.vehicle.units, best.evaluation.drive.rate
    rows: list[tuple[str, ...]] = []
    by_road: dict[RoadProfile, list[RatedDrive]] = {}
    for one in plan.rated:
        if one.evaluation.drive.rate == rate:
            by_road.setdefault(one.evaluation.drive.road, []).append(one)
    for road, candidates in by_road.items():
        usable = [one for one in candidates if one.evaluation.usable]
        name = road_text(road, units).removeprefix("a ")
        if not usable:
            rows.append((name, "none", *["–"] * len(plan.estimands), ""))
            continue
        top = min(usable, key=lambda one: (not one.evaluation.gentle, one.worst_ratio))
        sd = plan.sd_after(top, plan.passes)
        unusable = [one.evaluation.drive.speed for one in candidates if not one.evaluation.usable]
        rows.append(
            (
                name,
                _quantity_text(speed(top.evaluation.drive.speed, units)),
                *(percent_text(sd[a]) for a in plan.estimands),
                f"unusable from {_quantity_text(speed(min(unusable), units))} on"
                if unusable
                else "",
            )
        )
    head = f"At {rate:g} Hz, {times_text(plan.passes)}, best speed for each road:"
    return [head, *_columns([("", "speed", *plan.estimands, ""), *rows])]


def _rates_table(plan: PlanResult, best: RatedDrive) -> list[str]:
    """Format the chosen drive at every sampling rate; empty for a single rate."""
    drive = best.evaluation.drive
    same = [
        one
        for one in plan.rated
        if (one.evaluation.drive.road, one.evaluation.drive.speed) == (drive.road, drive.speed)
    ]
    if len(same) < 2:
        return []
    rows = []
    for one in same:
        cells = ["–"] * len(plan.estimands)
        if one.evaluation.usable:
            cells = [percent_text(sd) for sd in plan.sd_after(one, plan.passes).values()]
        rows.append((f"{one.evaluation.drive.rate:g} Hz", *cells))
    return ["The drive above at other rates:", *_columns([("", *plan.estimands), *rows])]


def _columns(rows: Sequence[Sequence[str]]) -> list[str]:
    """Align the first column to the left and the others to the right."""
    width = [max(len(row[k]) for row in rows) for k in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [row[0].ljust(width[0])]
        cells += [cell.rjust(w) for cell, w in zip(row[1:], width[1:], strict=True)]
        lines.append(("  " + "  ".join(cells)).rstrip())
    return lines


def _given_text(plan: PlanResult, parameter: str) -> str:
    """List the given values that limit a parameter: ``sprung mass 1 %, wheelbase 0.5 %``."""
    direction = plan.prior.estimands[parameter]
    names = [
        group.names[0]
        for group in inseparable_groups(plan.prior)
        if abs(direction @ group.along) > 0.0 and plan.prior.sd(group.names[0]) > 0.0
    ]
    parts = [f"{_label(name)} {percent_text(plan.prior.sd(name))}" for name in names]
    return ", ".join(parts)


def _label(name: str) -> str:
    return QUANTITIES[name][1]


def _quantity_text(quantity: tuple[float, str]) -> str:
    return f"{quantity[0]:g} {quantity[1]}"
