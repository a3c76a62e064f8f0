"""Write ``docs/effects.md``: ``python -m tests.effects_page``.

Names, places, priors, tolerances and drives come from the registry; laws and meanings in words
stand here, one for each parameter that the registry has.
"""

# ruff: noqa: E501  (lines of Markdown)

from __future__ import annotations

import math
from pathlib import Path

from bayes_asv.models.effects import AXLES, BOTH, EFFECTS, Effect, Parameter

__all__ = ["LAWS", "MEANINGS", "PAGE", "page"]

PAGE = Path(__file__).parents[1] / "docs" / "effects.md"

LAWS = {
    "bound_rebound": r"""$F=-k\delta-c\,\dot\delta\Big(1+a\frac{\dot\delta}{\sqrt{\dot\delta^2+b^2}}\Big)$
with $a=(\text{ratio}-1)/(\text{ratio}+1)$; $c$ is the mean of both rates.""",
    "digressive_damper": r"""$F=-k\delta-c\,\dot\delta\,\big(1+|\dot\delta/\text{knee}|^p\big)^{-1/p}$;
$c$ is the slope at rest.""",
    "coulomb_friction": r"""$F=-k\delta-c\,\dot\delta
-\text{force}\cdot\dot\delta/\sqrt{\dot\delta^2+\text{slip}^2}$.""",
    "progressive_spring": r"""$F=-k\delta\,(1+\kappa\delta^2+q\,\kappa^2\delta^4)-c\,\dot\delta$.""",
    "bump_stop": r"""$F=-k\delta-c\,\dot\delta+\text{rate}\cdot w\,(d/w)^p$ with
$d=\tfrac12\big(e+\sqrt{e^2+w^2}\big)$, less what that leaves at rest, and $e=-\delta-\text{gap}$ the
compression beyond the gap.""",
    "droop_stop": r"""$F=-k\delta-c\,\dot\delta-\text{rate}\cdot w\,(d/w)^p$ with
$d=\tfrac12\big(e+\sqrt{e^2+w^2}\big)$, less what that leaves at rest, and $e=\delta-\text{gap}$ the
extension beyond the gap.""",
    "damper_fade": r"""$F=-k\delta-c\,\dot\delta\,\big(1-\text{loss}\,\frac{1-e^{-bs}}{1-e^{-b}}\big)$ with $s$ the
share of the run that has gone by; $c$ is the rate at its start.""",
    "external_force": r"""A force on the chassis at an axle line, upward positive, that rises at start and
falls after its duration as $3s^2-2s^3$; in one run only.""",
    "spring_rate": r"""$F=-\text{factor}\cdot k\,\delta-c\,\dot\delta$ with $k$ the given rate. The linear
car bends the value within its given deviation; beyond about three of those it is named.""",
    "weight_distribution": r"""The front share of the weight is $\text{factor}\cdot w$ with $w$ as given.
The linear car bends it within its given deviation; beyond about three of those it is named.""",
    "sensor_gain": r"""The channel reads $\text{factor}$ times what it should.""",
    "sensor_lag": r"""The channel samples later than declared; negative is earlier.""",
    "sensor_bandwidth": r"""The channel's one-pole filter has another corner than declared. It can only be
asked where the vehicle file gives a `bandwidth`.""",
    "sensor_drift": r"""The channel's zero moves steadily.""",
}
"""Law of every effect: the force of an axle in N, upward on the chassis, extension positive."""

_FACTOR = "over what was given; 1 is as given"
MEANINGS = {
    "bound_rebound": {
        "ratio": "rebound rate (extension) over bound rate (compression)",
        "rounding": "velocity $b$ over which the corner at rest is rounded",
    },
    "digressive_damper": {
        "knee": "velocity at which the curve flattens; far out the force is $c\\cdot$knee",
        "sharpness": "$p$: how suddenly it bends",
    },
    "coulomb_friction": {
        "force": "friction force of the axle, both sides",
        "slip": "velocity at which it begins to slip",
    },
    "progressive_spring": {
        "kappa": "$\\kappa$: relative stiffening over deflection squared",
        "curl": "$q$: shape far out, $\\sinh$ has 0.3",
    },
    "bump_stop": {
        "rate": "spring rate of the stop", "gap": "compression from rest at which it is met",
        "onset": "travel $w$ over which it comes in",
        "power": "$p$: 1 is a spring, rubber that is squeezed has more",
    },
    "droop_stop": {
        "rate": "spring rate of the stop", "gap": "extension from rest at which it is met",
        "onset": "travel $w$ over which it comes in",
        "power": "$p$: 1 is a spring, rubber that is squeezed has more",
    },
    "damper_fade": {
        "loss": "share of the rate that is gone at the end of a run, anew in each",
        "bend": "$b$: 0 is straight in time, more levels off",
    },
    "external_force": {
        "force": "height of the push, upward on the chassis", "start": "when it begins",
        "duration": "how long it lasts", "rise": "how long it takes to rise and to fall",
    },
    "spring_rate": {"factor": f"spring rate {_FACTOR}"},
    "weight_distribution": {"factor": f"front weight fraction {_FACTOR}"},
    "sensor_gain": {"factor": "reading over truth; 1.03 reads 3 % too much"},
    "sensor_lag": {"lag": "later than declared"},
    "sensor_bandwidth": {"bandwidth": "corner frequency; told in Hz"},
    "sensor_drift": {"slope": "drift of the zero"},
}  # fmt: skip
"""What every parameter of every effect means."""

_ABOUT = """\
# Effects

What `bayes-asv diagnose` looks for, and what `bayes-asv estimate --with NAME@WHERE` adds to the linear
half car. Each effect is one file under `bayes_asv/models/effects`; this page is written from them by
`python -m tests.effects_page`. Signs: extension is positive, so is a force upward on the chassis.

An effect that is **named** gets the wide prior below. One that is not may still be there to its
**tolerance**, the deviation that nobody would call a fault: it is integrated out, so that a little of
everything widens intervals instead of making a name. A stop that is not met and a push that did not
happen have no tolerance.

"""

_OTHERWISE = """\
## Found in other ways

| name | how |
|---|---|
| `engine_vibration` | lines that stand out of the spectrum of the innovations; they are cut out of all channels. Listed first among the effects, without a place: `frequency` of the strongest tone, `amplitude` of the net force on the chassis there |
| `sensor_clipping` | readings at a rail, counted before any fit, under `preflight` |
| `dropped_samples` | rows or readings that are missing, under `preflight` |
| `uneven_clock` | time stamps that scatter by more than 2 % of a step, under `preflight` |
| `initial_state` | a recording that does not begin at rest: its first tenth of a second is more than four times as loud as its sensor's noise; under `preflight`, and estimated in any case |
| `mass_scale` | only as what cannot be told apart: mass that is off looks like both springs off |
| `pitch_centre` | never: a pitch centre $r$ off the centre of gravity adds $m r^2$ to the pitch inertia, which is free |

"""

_ADDING = """\
## Adding an effect

Three places: one file, one branch in the kernel, one line in the registry. The example is a damper
with a part that grows with the square of velocity, $F=-k\\delta-c\\,\\dot\\delta-q\\,\\dot\\delta|\\dot\\delta|$.
`tests/test_effects_docs.py` follows these steps in a copy of the package.

**1. The file** `bayes_asv/models/effects/quadratic_damper.py` says what the effect is. `force` is the
readable form of what the law adds to $-k\\delta-c\\,\\dot\\delta$; `packed` makes up to four numbers of the
parameters for the kernel. The first parameter is the one that vanishes with the effect.

```python
\"\"\"A damper with a part that grows with the square of velocity: F = −c δ̇ − q δ̇ |δ̇|.\"\"\"

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from bayes_asv.filters.force_laws import QUADRATIC
from bayes_asv.models.effects.base import AXLES, BOTH, Array, Effect, Parameter

__all__ = ["EFFECT"]


def _packed(values: Mapping[str, float]) -> tuple[float, ...]:
    return (values["quadratic"],)


def _force(
    values: Mapping[str, float], c: float, k: float, delta: Array, rate: Array, share: Array
) -> Array:
    return np.asarray(-values["quadratic"] * rate * np.abs(rate))


EFFECT = Effect(
    name="quadratic_damper",
    title="a damper that stiffens with speed",
    acts="suspension",
    sites=AXLES,
    parameters=(Parameter("quadratic", "N*s^2/m^2", "linear", 0.0, 800.0, (200.0, 800.0)),),
    slight={"quadratic": 15.0},
    code=QUADRATIC,
    packed=_packed,
    force=_force,
    drive="a sharper bump, so that the damper moves faster",
)
```

**2. The branch** in `bayes_asv/filters/force_laws.py`: a number for it, the force, and its slopes in
deflection (`added_d`) and velocity (`added_v`). A law that multiplies the damper or the spring changes
`damper` or `spring` with its slope instead, so that it composes with others.

```diff
     FADE,
     OUTSIDE,
-) = range(8)
+    QUADRATIC,
+) = range(9)
```

```diff
             added += p0 * (up * up * (3.0 - 2.0 * up) - down * down * (3.0 - 2.0 * down))
+        elif code == QUADRATIC:  # p0 = q, N s²/m²
+            added -= p0 * rate * abs(rate)
+            added_v -= 2.0 * p0 * abs(rate)
```

**3. The line** in `bayes_asv/models/effects/__init__.py`, and its import.

```diff
     progressive_spring,
+    quadratic_damper,
     sensors,
```

```diff
         progressive_spring.EFFECT,
+        quadratic_damper.EFFECT,
         stops.BUMP,
```

That is all: `diagnose` asks for it, `estimate --with quadratic_damper@rear` adds it, and
`tests/filters/test_force_laws.py` holds the branch against the readable form, force and slopes. This page
wants the law and the meaning of the parameter in `tests/effects_page.py`. Units N, N/m, m, m/s, m/s³ and
1/m² are shown in the vehicle's system, others as they are. An effect that acts on a given value
(`acts="car"`) or on a reading (`acts="reading"`) has no branch, but a place of its own in
`bayes_asv/posterior/parameters.py` or `effects.py`.
"""


def page() -> str:
    """Return the whole page."""
    parts = [_ABOUT, _overview()]
    parts += [_section(effect) for effect in EFFECTS.values()]
    return "".join([*parts, _OTHERWISE, _ADDING])


def _overview() -> str:
    rows = [
        f"| [`{e.name}`](#{e.name}) | {_where(e)} | {e.title} | {e.drive} |"
        for e in EFFECTS.values()
    ]
    head = "| name | where | what | the drive that shows it best |\n|---|---|---|---|\n"
    return head + "\n".join(rows) + "\n\n"


def _where(effect: Effect) -> str:
    if effect.sites == (*AXLES, BOTH):
        return "front, rear or both"
    if effect.sites == AXLES:
        return "front, rear"
    return "any channel" if any(effect.sites) else "the car"


def _section(effect: Effect) -> str:
    rows = [
        f"| `{p.name}` | {_unit(p)} | {MEANINGS[effect.name][p.name]} | {_prior(p)} | "
        f"{_tolerance(effect, p)} |"
        for p in effect.parameters
    ]
    title = effect.title[:1].upper() + effect.title[1:]
    return (
        f"## {effect.name}\n\n{title}. {LAWS[effect.name]}\n\n"
        "| parameter | unit | meaning | prior once named | tolerance |\n|---|---|---|---|---|\n"
        + "\n".join(rows)
        + "\n\n"
    )


def _unit(parameter: Parameter) -> str:
    return {"": "–", "share": "of the declared corner"}.get(parameter.unit, parameter.unit)


_PER = {"": "", "load": " of the mean axle's load", "spring": " mean spring rates"}


def _prior(parameter: Parameter) -> str:
    per = _PER[parameter.per]
    if parameter.form == "log":
        return f"log-normal, {parameter.centre:g}{per}, a factor {math.exp(parameter.wide):.3g}"
    if parameter.form == "positive":
        return f"half-normal, {parameter.wide:g}{per}"
    if parameter.form == "sinh":
        return (
            f"{parameter.centre:g} ± {parameter.wide:g}{per} times sinh of a standard normal number"
        )
    return f"normal, {parameter.centre:g} ± {parameter.wide:g}{per}"


def _tolerance(effect: Effect, parameter: Parameter) -> str:
    if effect.slight is None:
        return "none"
    if parameter.shape:
        return f"at {effect.slight[parameter.name]:g}"
    value = effect.slight[parameter.name]
    text = f"{value:g}{_PER[parameter.per]}"
    if effect.straight is not None:
        text += ", or as straight over what was used"
    return f"± {value - 1.0:.2g}".rstrip("0") if parameter.form == "log" and value < 2.0 else text


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
