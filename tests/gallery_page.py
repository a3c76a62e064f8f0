"""Write ``docs/gallery.md``: ``python -m tests.gallery_page``.

Names and drives come from the registry and laws from :mod:`tests.effects_page`.  This module adds
the signature of each effect: how it shows in a recording, and what else looks like it.
"""

# ruff: noqa: E501  (lines of Markdown)

from __future__ import annotations

from pathlib import Path

from bayes_asv.models.effects import EFFECTS, Effect
from tests.effects_page import LAWS

__all__ = ["PAGE", "SIGNATURES", "page"]

PAGE = Path(__file__).parents[1] / "docs" / "gallery.md"

SIGNATURES = {
    "bound_rebound": "Over one bump the body is pushed up less and pulled down more than the mean rate says, or the other way round. The difference changes sign with the velocity, so that no single rate fits both halves of the bump.",
    "digressive_damper": "Peaks at the edges of a bump are cut off, while small motion is damped as before. A slow and a fast pass over the same bump give different linear rates.",
    "damper_curve": "A curve of any rising shape, compression and extension each its own. It contains the two effects above and is used where neither fits; the result gives the rates at the velocities driven.",
    "damper_hysteresis": "Force over velocity forms a loop: where the damper reverses, its force is still that of a moment ago. Fast reversals show it; on a slow ride the damper looks linear. A late sensor moves whole signals instead.",
    "coulomb_friction": "The body follows small bumps as if the suspension were locked, and comes to rest abruptly. Its share grows as the ride becomes gentler, whereas a damper's share shrinks.",
    "progressive_spring": "The body's oscillation becomes faster as it becomes larger. What is missing depends on deflection, not on velocity.",
    "spring_curve": "A curve of any rising shape, compression and extension each its own. It contains the effect above and is used where neither that nor a stop fits: a second spring that comes in, a spring that is stiffer on one side, one that softens.",
    "bump_stop": "A short, hard push upward whenever compression passes one particular deflection, with ringing after it. Below that deflection nothing differs.",
    "droop_stop": "A short pull downward whenever extension passes one particular deflection.",
    "damper_fade": "The first bumps fit and the last ones do not, or the other way round: the misfit grows with time, not with the size of the bump.",
    "external_force": "The misfit lasts for one moment of one run, and is absent when the same drive is repeated: a tow rope, a driver who shifts in the seat, a kerb under one wheel.",
    "spring_rate": "The period of the oscillation is wrong, while its decay is right. Only beyond three given standard deviations is it called an effect; within them it is uncertainty.",
    "weight_distribution": "The two axles share the response wrongly: one end of the body moves too much and the other too little.",
    "sensor_gain": "One channel is too large by the same factor everywhere. A gain of a wheel sensor is hard to tell from one of the chassis sensor above it, with the opposite sign.",
    "sensor_lag": "One channel is ahead of the simulation or behind it by a constant time; steep edges show it most. It looks like too much or too little damping: an undeclared delay of 8 ms moves both rates by a tenth or more.",
    "clock_offset": "All channels of one logger are late together, by a time of its own in each run. Declare the second logger's clock, and the offset is estimated ([vehicle file](vehicle.md#clocks-optional)).",
    "sensor_bandwidth": "One channel is smoother than the simulation, and its peaks come a little late. Slow motion is right.",
    "sensor_drift": "The reading wanders off, also where the car stands. A long run shows it; damping rates hardly change.",
}
"""How each effect shows in a recording."""

_ABOUT = """\
---
jupytext:
  text_representation:
    format_name: myst
kernelspec:
  display_name: Python 3
  language: python
  name: python3
---

# Effect gallery

Each picture shows one effect at the front axle of the shipped Baja car: on the left its law (grey: the linear car), and on the
right the acceleration of the front chassis over a drive that shows it. The sizes are larger than those that
`bayes-asv diagnose` needs, so that the eye sees them too. Both curves are simulated with the same damping rates; a fit would
bring them closer together, and what it cannot remove is the signature.

Priors, tolerances and parameters of each effect: [Effects](effects.md).

```{code-cell} python
:tags: [remove-input]

from effect_drawings import effect
```

"""


def page() -> str:
    """Return the whole page."""
    return _ABOUT + "\n".join(_section(one) for one in EFFECTS.values())


def _section(effect: Effect) -> str:
    title = effect.title[:1].upper() + effect.title[1:]
    drive = effect.drive[:1].upper() + effect.drive[1:]
    return (
        f"## {title}\n\n"
        f"[`{effect.name}`](effects.md#{effect.name}). {LAWS[effect.name]}\n\n"
        f'```{{code-cell}} python\n:tags: [remove-input]\n\neffect("{effect.name}")\n```\n\n'
        f"**Signature.** {SIGNATURES[effect.name]}\n\n"
        f"**Shown best by:** {drive}.\n"
    )


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
