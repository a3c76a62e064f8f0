"""A diagnosis in words."""

from __future__ import annotations

import math
from typing import Any, Final

from bayes_asv.diagnosis.thresholds import AS_WELL, ENOUGH, LEVEL, NOTICED
from bayes_asv.domain.quantities import QUANTITIES
from bayes_asv.report.readable import number, percent, plain, probability, readable_unit

__all__ = [
    "closed_words",
    "diagnose_headline",
    "diagnose_steps",
    "diagnosis_lines",
    "effect_sentence",
    "effects_lines",
    "gap_sentence",
    "is_exact",
    "name_of",
    "place",
    "spread",
]

Document = dict[str, Any]

_SURE, _LIKELY = 0.95, 0.7
_SUSPENSION: Final = ("front", "rear")
_FEW: Final = 3  # effects that a headline holds


def diagnosis_lines(document: Document) -> list[str]:
    """Say what was found, one line a thing, most important first.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/diagnose/1``.
    """
    verdict = document["verdict"]
    if verdict == "refused":
        return ["These recordings cannot answer.", *(plain(r) for r in document["reasons"])]
    lines = []
    if verdict == "agreement":
        lines.append(
            "The linear half car and the measurement agree: nothing is missing that these "
            f"drives would show (p = {_p(document['p_value'])})."
        )
    elif verdict == "unexplained" and not document["unexplained"]["present"]:
        lines.append(
            f"Simulation and measurement disagree (p = {_p(document['p_value'])}), by no more than "
            "a little of everything would make: springs, dampers and sensors that are off by what "
            "is usual. No effect stands out."
        )
    elif verdict == "unexplained":
        lines.append(
            "Simulation and measurement disagree, and nothing in the list explains it "
            f"(p = {_p(document['p_value'])})."
            if document["p_value"] < LEVEL
            else f"Nothing in the list is missing (p = {_p(document['p_value'])}), and yet "
            "something is left that it does not explain."
        )
    else:
        lines += [effect_sentence(effect) for effect in document["effects"]]
        if document["unexplained"]["present"]:
            lines.append("That is not all: something is left that nothing in the list explains.")
    lines += _left(document["unexplained"])
    lines += _rates(document)
    lines += gap_sentence(document["gap"])
    lines += [_moved(name, document) for name in ("c_f", "c_r", "i") if verdict == "named"]
    return lines + [f"Note: {plain(note)}." for note in document["warnings"]]


def diagnose_headline(document: Document) -> str:
    """Say the verdict in a sentence or two."""
    verdict = document["verdict"]
    if verdict == "refused":
        return "These recordings cannot answer."
    if verdict == "agreement":
        return "Nothing is missing that these drives would show."
    if verdict == "unexplained" and not document["unexplained"]["present"]:
        return "Simulation and measurement disagree, by no more than a little of everything."
    if verdict == "unexplained":
        return "Something is left that nothing in the list explains."
    text = ""
    told = document["effects"][:_FEW]
    for sure in dict.fromkeys(_sure(e["probability"]) for e in told):
        names = ", ".join(
            f"{name_of(e)}{place(e)}" for e in told if _sure(e["probability"]) == sure
        )
        words = "Missing" if sure == "certainly" else f"{sure.capitalize()} missing"
        text += f"{words}: {names}. "
    if len(document["effects"]) > _FEW:
        text = f"{text[:-2]} and more. "
    key = "holdout" if document["gap"].get("holdout") else "fit"
    part = document["gap"].get(key)
    if part and part.get("closed") is not None and not part.get("worse"):
        where = "what was held out" if key == "holdout" else "the runs fitted"
        wide, left, floor = _gap_numbers(part)
        text += (
            f"With it the gap on {where} falls from {wide} to {left} "
            f"{readable_unit(document['gap']['unit'])}; sensor noise alone leaves {floor}. "
        )
    elif part and part.get("worse"):
        text += "But the gap grew on what was held out. "
    if document["unexplained"]["present"]:
        text += "Something else is left without a name. "
    return text.rstrip()


def closed_words(share: float | None) -> str:
    """Say the share of a gap that was closed, rounded down: what is left is never rounded away."""
    if share is None:
        return "–"
    if share > 0.999:
        return "> 99.9 %"
    return percent(math.floor(1000.0 * share) / 1000.0, 1)


def diagnose_steps(document: Document) -> list[str]:
    """Say what to do next."""
    verdict = document["verdict"]
    if verdict == "refused":
        return [
            "Read the reasons above, mend what they name, and drive again.",
            "Ask 'bayes-asv plan' which road and speed would answer.",
        ]
    steps = []
    sites = []
    for effect in document["effects"]:
        others = effect["indistinguishable_from"]
        drive = plain(effect.get("drive") or "")
        of_a_drive = effect["name"] == "engine_vibration" or bool(effect.get("run"))
        if others and drive:
            names = " or ".join(f"{name_of(o)}{place(o)}" for o in others)
            steps.append(f"To tell {name_of(effect)}{place(effect)} from {names}: {drive}.")
        elif of_a_drive:  # neither is a part that a model could be given
            steps.append(f"To prove {name_of(effect)}{place(effect)}: {drive}.")
        if not of_a_drive:
            where = "@" + plain(effect["where"]) if effect["where"] else ""
            sites.append(f"--with {plain(effect['name'])}{where}")
    if sites:
        steps.append(
            "Look at the part itself. If it is meant to be so, or until it is mended, estimate "
            "with it in the model: "
            f"bayes-asv estimate … {' '.join(sites)}."
        )
    if document["unexplained"]["present"]:
        steps.append(_where_to_look(document))
    if (document["gap"].get("fit") or {}) and not document["gap"].get("holdout"):
        steps.append("Drive once more over another road and give it as --holdout: that proves it.")
    if verdict == "agreement":
        steps.append(
            "Nothing needs to be added. A weaker effect shows in a harder or longer drive only."
        )
    if steps:
        return steps
    return [
        "Drive the same again: chance does not come back, and a fault shows more plainly in a "
        "longer or harder drive.",
        "Calibrate the sensors on one plate, and weigh what was guessed: the less may be a little "
        "off, the smaller a fault can be named.",
    ]


def _where_to_look(document: Document) -> str:
    seen = document.get("disagreement") or {}
    text = "Look for what has no name here"
    if seen.get("channel"):
        text += f", first near the {plain(seen['channel']).replace('_', ' ')} sensor"
    parts = []
    if seen.get("frequency"):
        low = min(band[0] for band in seen["frequency"])
        high = max(band[1] for band in seen["frequency"])
        parts.append(f"between {low:.2g} and {high:.2g} Hz")
    if seen.get("time"):
        source = plain((seen.get("time_run") or [""])[0])
        begin, end = seen["time"][0]
        parts.append(f"from {begin:.2f} to {end:.2f} s{' of ' + source if source else ''}")
    if parts:
        text += f"; it shows {' and '.join(parts)}"
    return text + ". A loose mount, a seat, a panel, tyres off the ground or roll are usual."


def name_of(effect: Document) -> str:
    """Name of an effect in words."""
    return plain(effect.get("title") or str(effect["name"]).replace("_", " "))


def place(effect: Document) -> str:
    """Where an effect is, in words; empty when it is nowhere in particular."""
    where = effect["where"]
    if not where:
        return ""
    if where == "both":
        return " at both axles"
    if where in _SUSPENSION:
        return f" at the {where}"
    return f" of the {plain(where).replace('_', ' ')} sensor"


def effect_sentence(effect: Document) -> str:
    """Say what an effect is, how sure that is, how large it is and what it may be instead."""
    p = effect["probability"]
    sizes = [_size(plain(name), value) for name, value in effect["parameters"].items()]
    text = f"{_sure(p).capitalize()} {name_of(effect)}{place(effect)} ({probability(p)})"
    if sizes:
        text += ": " + ", ".join(sizes)
    if effect.get("run"):
        text += f"; in {plain(effect['run'])} alone"
    others = effect["indistinguishable_from"]
    if others:
        names = [f"{name_of(other)}{place(other)}" for other in others]
        text += f"; these drives cannot tell it from {' or '.join(names)}"
        if effect.get("drive"):
            text += f". This would: {plain(effect['drive'])}"
    return text + "."


def _sure(p: float) -> str:
    """How sure a probability is, in a word."""
    return "certainly" if p > _SURE else "probably" if p > _LIKELY else "perhaps"


def effects_lines(effects: list[Document]) -> list[str]:
    """Say what an extended model was given beside the half car, one line an effect.

    Parameters
    ----------
    effects : list of dict
        ``effects`` of schema ``bayes_asv/estimate/1``.
    """
    out = []
    for effect in effects:
        sizes = [_size(plain(name), value) for name, value in effect["parameters"].items()]
        text = f"In the model: {name_of(effect)}{place(effect)}"
        out.append(f"{text}: {', '.join(sizes)}." if sizes else f"{text}.")
    return out


def is_exact(value: Document) -> bool:
    """Whether a parameter was found without an interval."""
    low, high = value["eti95"]
    return bool(low == high)


def spread(value: Document) -> float:
    """Deviation of a parameter of an effect, from its 95 % interval."""
    low, high = value["eti95"]
    return float((high - low) / 3.92)


def _size(name: str, value: Document) -> str:
    low, high = value["eti95"]
    unit, sd = readable_unit(value.get("unit", "")), spread(value)
    digits = f"{number(value['mean'], sd)}{' ' + unit if unit else ''}"
    if is_exact(value):
        return f"{name} {value['mean']:.3g}{' ' + unit if unit else ''}"
    return f"{name} {digits} (95 %: {number(low, sd)} to {number(high, sd)})"


def _left(unexplained: Document) -> list[str]:
    """Say what tells that something is left without a name."""
    if not unexplained["present"]:
        return []
    signs = []
    score, ended = unexplained.get("score"), unexplained.get("ended")
    course = f"a force of free course at the {plain(unexplained.get('axle') or 'car')}"
    if score is not None and score > ENOUGH and ended != course:
        signs.append(f"{course} would explain the recordings better by {score:.0f} nats")
    if ended:
        signs.append(f"{plain(ended)} explains more than anything that has a name here")
    like = unexplained.get("like")
    if like and like != ended and (unexplained.get("p_decoy") or 0.0) < NOTICED:
        signs.append(f"it looks most like {plain(unexplained['like'])}")
    rival = unexplained.get("rival")
    if rival is not None and rival > AS_WELL:
        signs.append(
            f"{plain(unexplained.get('like') or 'something else')} alone would explain the "
            f"recordings {'as well' if rival < 1.0 else f'better by {rival:.0f} nats'}"
        )
    if (unexplained.get("p_jitter", 1.0) or 0.0) < NOTICED and unexplained.get("jitters"):
        channel = plain(unexplained["jitters"]).replace("_", " ")
        signs.append(
            f"noise is largest where the {channel} signal is steep, as with time stamps that jitter"
        )
    if (unexplained.get("p_memory") or 0.0) < NOTICED:
        signs.append("the innovations remember their past")
    if unexplained.get("swollen"):
        names = ", ".join(plain(n).replace("_", " ") for n in unexplained["swollen"])
        signs.append(f"the noise of {names} is far above what was given")
    if unexplained.get("failed"):
        names = ", ".join(plain(n) for n in unexplained["failed"])
        signs.append(f"{names} fitted, but made it worse on what was held out")
    if not signs:
        signs.append("several faint signs of it, which together are a plain one")
    return [f"What shows it: {'; '.join(signs)}."]


def _rates(document: Document) -> list[str]:
    """Bound and rebound rates of a damper in which they differ."""
    out = []
    for axle, law in (document.get("laws") or {}).items():
        rates = law.get("rates")
        if not rates:
            continue
        unit = readable_unit(rates["unit"])
        parts = []
        for side in ("bound", "rebound"):
            low, high = rates[side]["eti95"]
            sd = spread(rates[side])
            parts.append(
                f"{side} {number(rates[side]['mean'], sd)} "
                f"(95 %: {number(low, sd)} to {number(high, sd)})"
            )
        out.append(f"The {axle} damper in {unit}: {', '.join(parts)}.")
    return out


def _gap_numbers(part: Document) -> list[str]:
    """Three significant digits each, a zero at the end as well: 1.00 beside 12.2."""
    return [number(part[key], part[key], digits=3) for key in ("before", "after", "floor")]


def gap_sentence(gap: Document) -> list[str]:
    """Say what became of the gap."""
    out = []
    unit = readable_unit(gap["unit"])
    for key, words in (("fit", "the runs fitted"), ("holdout", "runs that were held out")):
        part = gap.get(key)
        if part is None:
            continue
        wide, left, floor = _gap_numbers(part)
        text = (
            f"Gap on {words}: {wide} {unit} before, {left} after; sensor noise alone leaves {floor}"
        )
        out.append(text + ("; it grew." if part.get("worse") else "."))
    return out


def _moved(name: str, document: Document) -> str:
    before, after = document["parameters_before"][name], document["parameters_after"][name]
    unit = readable_unit(after["unit"])
    low, high = after["eti95"]
    sd = after["sd"]
    label = QUANTITIES[name][1]
    return (
        f"{label.capitalize()}: {number(before['mean'], before['sd'])} before, "
        f"{number(after['mean'], sd)} {unit} after (95 %: {number(low, sd)} to "
        f"{number(high, sd)}; nominal {number(after.get('nominal'))})."
    )


def _p(p: float) -> str:
    return f"{p:.2g}" if p >= 1e-3 else "under 0.001"
