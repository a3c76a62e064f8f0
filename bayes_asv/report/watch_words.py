"""An alarm, or that there was none, in words."""

from __future__ import annotations

from typing import Any

from bayes_asv.report.readable import number, percent, plain, probability

__all__ = ["watch_lines"]

Document = dict[str, Any]


def watch_lines(document: Document) -> list[str]:
    """Say what was seen, the alarm first.

    Parameters
    ----------
    document : dict
        Schema ``bayes_asv/watch/1``.
    """
    asked = document["asked"]
    wanted = f"below {percent(asked['share'])} of its nominal rate"
    alarm = document["alarm"]
    if alarm is not None:
        low, high = alarm["eti95"]
        return [
            f"ALARM: the {alarm['axle']} damper is {wanted}, with a probability of "
            f"{probability(alarm['probability'])}.",
            f"It has {percent(alarm['share_of_nominal'])} of nominal left (95 %: {percent(low)} to "
            f"{percent(high)}). The alarm was raised at {number(alarm['time'], 0.1)} s, after "
            f"{number(alarm['time'] - alarm['since'], 0.1)} s at that level.",
            f"Next: stop and look at the {alarm['axle']} damper: oil, seals, gas charge, heat.",
        ]
    if document["verdict"] == "refused":
        return [
            "No alarm, but no answer either.",
            *(f"Why: {plain(r)}." for r in document["reasons"]),
        ]
    now = document["probability"]
    lines = [
        f"No alarm in {number(document['seconds_watched'], 1.0)} s: that a damper is {wanted} has "
        f"a probability of {probability(now['front'])} at the front and "
        f"{probability(now['rear'])} at the rear."
    ]
    told = document["share_of_time"]
    if told < 0.95:
        lines.append(
            f"For {percent(1.0 - told)} of the time the filter was not consistent, and nothing "
            "could have raised an alarm; look at 'bayes-asv track'."
        )
    return lines
