"""Write ``docs/effects.md``: ``python -m tests.effects_page``.

Names, locations, priors, tolerances and drives come from the registry.  This module adds the law of
each effect and the meaning of each of its parameters.
"""

# ruff: noqa: E501  (lines of Markdown)

from __future__ import annotations

import math
from pathlib import Path

from bayes_asv.domain.clocks import GROUPS
from bayes_asv.filters.force_laws import CURVE_KNOTS, SPRING_KNOTS
from bayes_asv.models.effects import AXLES, BOTH, EFFECTS, Effect, Parameter

__all__ = ["LAWS", "MEANINGS", "PAGE", "page"]

PAGE = Path(__file__).parents[1] / "docs" / "effects.md"

LAWS = {
    "bound_rebound": r"""$F=-k\delta-c\,\dot\delta\Big(1+a\frac{\dot\delta}{\sqrt{\dot\delta^2+b^2}}\Big)$
with $a=(\text{ratio}-1)/(\text{ratio}+1)$; $c$ is the mean of the two rates.""",
    "digressive_damper": r"""$F=-k\delta-c\,\dot\delta\,\big(1-s+s/\sqrt{1+(\dot\delta/\text{knee})^2}\big)$ with
$s=\text{drop}/(1+\text{drop})$; $c$ is the slope at rest, and far beyond the knee the slope is $c(1-s)$.""",
    "damper_curve": r"""$F=-k\delta-c\int_0^{\dot\delta} g(v)\,\mathrm dv$. The slope $g>0$ is piecewise linear
between knots at rest, at ±6.25 mm/s and at each $\sqrt2$ times that up to ±0.8 m/s; from knot to knot $\ln g$ takes
independent steps. $g$ is scaled so that $c$ is the rate of the linear damper that takes the same power where
the rates of deflection are normal with a standard deviation of 0.15 m/s.""",
    "damper_hysteresis": r"""The damper is in series with a stiffness $K$ (gas, oil, rubber mounts: a Maxwell element):
$F=-k\delta-m$ with $\dot m=K(\dot\delta-u)$, where $u$ is the rate at which the damper alone has the force $m$. A
linear damper lags by $c/K$.""",
    "coulomb_friction": r"""$F=-k\delta-c\,\dot\delta-m$ with
$\text{presliding}\cdot\dot m=\text{force}\cdot\dot\delta-m\sqrt{\dot\delta^2+\text{slip}^2}$: at first an elastic
force, as bushings, seals and leaf springs have it, and sliding friction after a few times the displacement
$\text{presliding}$. In steady motion $m=\text{force}\cdot\dot\delta/\sqrt{\dot\delta^2+\text{slip}^2}$; online,
`track` takes that throughout.""",
    "progressive_spring": r"""$F=-k\delta\,(1+\kappa\delta^2+q\,\kappa^2\delta^4)-c\,\dot\delta$.""",
    "spring_curve": r"""$F=-k\int_0^{\delta} g(x)\,\mathrm dx-c\,\dot\delta$. The slope $g>0$ is piecewise linear
between knots at rest, at ±4 mm and at each $\sqrt2$ times that up to ±91 mm; $g(0)=1$, so that $k$ is the stiffness at
rest. From knot to knot $\ln g$ takes independent steps.""",
    "bump_stop": r"""$F=-k\delta-c\,\dot\delta+\text{rate}\cdot w\,(d/w)^p$ with
$d=\tfrac12\big(e+\sqrt{e^2+w^2}\big)$ minus its value at rest, and $e=-\delta-\text{gap}$ the
compression beyond the gap.""",
    "droop_stop": r"""$F=-k\delta-c\,\dot\delta-\text{rate}\cdot w\,(d/w)^p$ with
$d=\tfrac12\big(e+\sqrt{e^2+w^2}\big)$ minus its value at rest, and $e=\delta-\text{gap}$ the
extension beyond the gap.""",
    "damper_fade": r"""$F=-k\delta-c\,\dot\delta\,\big(1-\text{loss}\,\frac{1-e^{-bs}}{1-e^{-b}}\big)$ with $s$ the
elapsed fraction of the run; $c$ is the rate at its start.""",
    "external_force": r"""A force on the chassis at an axle, upward positive, that acts in one run only; at both
axles half of it acts at each. It rises and falls within `rise` each, as $3s^2-2s^3$.""",
    "spring_rate": r"""$F=-\text{factor}\cdot k\,\delta-c\,\dot\delta$ with $k$ the given rate. The linear
car varies $k$ within its given standard deviation; the effect is named beyond about three of them.""",
    "weight_distribution": r"""The front weight fraction is $\text{factor}\cdot w$ with $w$ as given. The
linear car varies $w$ within its given standard deviation; the effect is named beyond about three of
them.""",
    "sensor_gain": r"""The channel reads $\text{factor}$ times the true value.""",
    "sensor_lag": r"""The channel samples later than declared; a negative lag is earlier.""",
    "clock_offset": r"""A group of channels is sampled later than all others, by the same time: `body` is all channels
but the wheel hubs, `front` those of the front axle, `left` those of the left side. In `estimate` it is a clock with an
offset of its own in each recording and a common drift of 0 ± 50 ppm, as `[clocks]` of the vehicle file declares it
([vehicle.md](vehicle.md#clocks-optional)). The tolerance is that of each of its channels.""",
    "sensor_bandwidth": r"""The corner frequency of the channel's one-pole filter is not the declared one.
This effect needs a `bandwidth` in the vehicle file.""",
    "sensor_drift": r"""The zero of the channel drifts linearly. For a deflection or an angular rate prior and
tolerance are the same share of the sensor's offset: 0.07 and 0.0007 m/s or rad/s².""",
}
"""Law of every effect: the force of an axle in N, upward on the chassis, extension positive."""

_FACTOR = "over the given value; 1 means as given"
MEANINGS = {
    "bound_rebound": {
        "ratio": "rebound rate over compression rate",
        "rounding": "velocity $b$ that rounds the corner at zero velocity",
    },
    "digressive_damper": {
        "knee": "velocity at which the curve bends",
        "drop": "slope that is lost far beyond the knee over the one that remains",
    },
    "damper_curve": {
        **{f"{side}_{k}": "step of $\\ln g$ to the next knot"
           for side in ("compression", "extension") for k in range(1, CURVE_KNOTS + 1)},
    },
    "damper_hysteresis": {"stiffness": "stiffness $K$ in series with the dampers of the axle"},
    "coulomb_friction": {
        "force": "friction force of the axle, both sides",
        "slip": "velocity that rounds the corner at zero velocity",
        "presliding": "displacement over which the force builds up; its stiffness is force/presliding",
    },
    "progressive_spring": {
        "kappa": "$\\kappa$: relative stiffening per squared deflection",
        "curl": "$q$: fourth-order coefficient; 0.3 for a $\\sinh$ law",
    },
    "spring_curve": {
        **{f"{side}_{k}": "step of $\\ln g$ to the next knot"
           for side in ("compression", "extension") for k in range(1, SPRING_KNOTS + 1)},
    },
    "bump_stop": {
        "rate": "spring rate of the stop", "gap": "compression from rest at which the stop is reached",
        "onset": "travel $w$ over which the force sets in",
        "power": "exponent $p$: 1 for a spring, more for compressed rubber",
    },
    "droop_stop": {
        "rate": "spring rate of the stop", "gap": "extension from rest at which the stop is reached",
        "onset": "travel $w$ over which the force sets in",
        "power": "exponent $p$: 1 for a spring, more for compressed rubber",
    },
    "damper_fade": {
        "loss": "fraction of the rate lost by the end of each run",
        "bend": "$b$: 0 for a linear loss in time, positive if it levels off",
    },
    "external_force": {
        "force": "amplitude, upward on the chassis",
        "start": "time at which half of the amplitude is reached",
        "duration": "time from there until the force has fallen to half again",
        "rise": "time of the rise and of the fall",
    },
    "spring_rate": {"factor": f"spring rate {_FACTOR}"},
    "weight_distribution": {"factor": f"front weight fraction {_FACTOR}"},
    "sensor_gain": {"factor": "reading over true value; 1.03 reads 3 % too high"},
    "sensor_lag": {"lag": "additional delay"},
    "clock_offset": {"offset": "time by which the group is late"},
    "sensor_bandwidth": {"bandwidth": "corner frequency; reported in Hz"},
    "sensor_drift": {"slope": "drift rate of the zero"},
}  # fmt: skip
"""Meaning of every parameter of every effect."""

_RANGES = {
    "digressive_damper": "less where the dampers stay below 0.5 m/s, down to {limit:g}, so that the largest speed has 2 % less force",
    "progressive_spring": "more where the travel is below 5 cm, up to {limit:g}, so that the largest travel has 1.5 % more force",
}
"""Tolerances that depend on the motion of the drive; the limit is that of a drive that hardly moves."""

_ABOUT = """\
# Effects

This page lists the effects that `bayes-asv diagnose` tests and that
`bayes-asv estimate --with NAME@WHERE` adds to the linear car. `damper_curve` and
`spring_curve` are not tested one by one: a diagnosis gives them to a damper or a spring where the other effects leave
something unexplained, and keeps them where that explains the recordings decisively better and held-out runs are not
simulated worse; `damper_curve` then comes with `damper_hysteresis`. Effects are defined in files under
`bayes_asv/models/effects`, similar ones together; `python -m tests.effects_page` generates this page from them. Extension is
positive, and so is a force upward on the chassis.

On the roll car an effect at the front or the rear acts alike on both sides. Except for a push, it may also be
at one corner, such as `bound_rebound@front_left`; tolerances are those of the corners, and "the mean axle's
load" is the mean corner's.

A **named** effect has the wide prior given below. An effect that is not named has a **tolerance
prior**: a narrow prior whose scale is the deviation that data sheets leave open and that
nobody calls a fault. The analysis integrates over it, so that small deviations of many kinds widen the
intervals instead of producing a name. Stops and external forces have no tolerance, because they are
absent unless they act; nor have free curves, which are used only where nothing else fits.

"""

_OTHERWISE = """\
## Effects detected by other means

| name | how it is detected |
|---|---|
| `engine_vibration` | spectral lines of the innovations; a notch removes them from all channels. It comes first in the list of effects and has no location: `frequency` of the strongest tone, `amplitude` of the net force on the chassis at that frequency |
| `sensor_clipping` | readings at the limits of the range, counted before any fit, under `preflight` |
| `dropped_samples` | missing rows or readings, under `preflight` |
| `uneven_clock` | time stamps with a scatter above 2 % of a time step, under `preflight` |
| `outlier` | readings that fit badly for a moment (spikes, filled gaps, a sagging supply), with channel and time, under `unexplained` |
| `missing_bits` | a converter that never changes one of its bits, under `unexplained` |
| `jitters` | time stamps that jitter: noise that is largest where the signal of a channel is steep, under `unexplained` |
| `initial_state` | a recording that does not begin at rest: the rms of its first tenth of a second exceeds four times the sensor's noise; under `preflight`. The initial state is estimated in any case |
| `mass_scale` | only as a member of an indistinguishable class: a wrong mass looks like two wrong spring rates |
| `pitch_centre` | never: a pitch centre at a distance $r$ from the centre of gravity adds $m r^2$ to the pitch inertia, which is estimated |

"""

_ADDING = """\
## Adding an effect

A new effect needs one file, one branch in the compiled kernel and one line in the registry. The example
is a damper with a force that contains a term quadratic in velocity, $F=-k\\delta-c\\,\\dot\\delta-q\\,\\dot\\delta|\\dot\\delta|$.
`tests/test_effects_docs.py` executes these steps in a copy of the package.

**1. The file** `bayes_asv/models/effects/quadratic_damper.py` defines the effect. `force` is the readable
form of the force that the law adds to $-k\\delta-c\\,\\dot\\delta$. `packed` converts the parameters to
the numbers that the kernel takes. The first parameter is the one that is zero without the effect.

```python
\"\"\"A damper with a quadratic term: F = −c δ̇ − q δ̇ |δ̇|.\"\"\"

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
    allowed_places=AXLES,
    parameters=(Parameter("quadratic", "N*s^2/m^2", "linear", 0.0, 800.0, (200.0, 800.0)),),
    tolerance_values={"quadratic": 15.0},
    code=QUADRATIC,
    packed=_packed,
    force=_force,
    drive="a sharper bump, so that the damper moves faster",
)
```

**2. The branch** in `bayes_asv/filters/force_laws.py` needs a code number and a function that returns the
force and its derivatives with respect to deflection and velocity. It is emitted as vector code: each
number in it stands for one of every parameter set that the filter processes side by side. A law that
multiplies the damper or the spring returns its factor and the factor's derivative instead, so that it
composes with other laws, and is listed with those of the damper or the spring.

```diff
     SERIES_STIFFNESS,
     SPRING_CURVE,
-) = range(11)
+    QUADRATIC,
+) = range(12)
```

```diff
     return p[0] * (up - down), nothing, nothing
+
+
+def _quadratic(p: Numbers, delta: Vector, rate: Vector, time: Vector) -> tuple[Vector, ...]:
+    \"\"\"Take p0 = q, N s²/m².\"\"\"
+    return -p[0] * rate * abs(rate), 0.0 * rate, -2.0 * p[0] * abs(rate)
```

```diff
     OUTSIDE: _outside,
+    QUADRATIC: _quadratic,
 }
```

**3. The line** in `bayes_asv/models/effects/__init__.py`, with its import.

```diff
     progressive_spring,
+    quadratic_damper,
     sensors,
```

```diff
         progressive_spring.EFFECT,
+        quadratic_damper.EFFECT,
         spring_curve.EFFECT,
```

`diagnose` then tests the effect, `estimate --with quadratic_damper@rear` adds it, and
`tests/filters/test_force_laws.py` compares the branch with the readable form, force and derivatives. For
this page, add the law and the meaning of the parameter to `tests/effects_page.py`. Results show the units
N, N/m, m, m/s, m/s³ and 1/m² in the vehicle's system of units and other units unchanged. An effect on a
given value (`acts="car"`) or on a reading (`acts="reading"`) has no branch in the kernel; it is implemented
in `bayes_asv/posterior/parameters.py` or `effects.py`.
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
    head = "| name | location | description | most informative test |\n|---|---|---|---|\n"
    return head + "\n".join(rows) + "\n\n"


def _where(effect: Effect) -> str:
    if effect.allowed_places == (*AXLES, BOTH):
        return "front, rear or both"
    if effect.allowed_places == AXLES:
        return "front, rear"
    if effect.allowed_places == tuple(GROUPS):
        return "body, front or left channels"
    return "any channel" if any(effect.allowed_places) else "the car"


def _section(effect: Effect) -> str:
    alike: dict[
        tuple[str, str, str, str], list[str]
    ] = {}  # parameters that differ in their names alone
    for p in effect.parameters:
        about = _unit(p), MEANINGS[effect.name][p.name], _prior(p), _tolerance(effect, p)
        alike.setdefault(about, []).append(p.name)
    rows = []
    for about, names in alike.items():
        name = f"`{names[0]}`" if len(names) == 1 else f"`{names[0]}` … `{names[-1]}`"
        rows.append(f"| {name} | {' | '.join(about)} |")
    title = effect.title[:1].upper() + effect.title[1:]
    return (
        f"## {effect.name}\n\n{title}. {LAWS[effect.name]}\n\n"
        "| parameter | unit | meaning | prior if named | tolerance |\n|---|---|---|---|---|\n"
        + "\n".join(rows)
        + "\n\n"
        + _forms(effect)
    )


def _forms(effect: Effect) -> str:
    """Say how much the parameters change with the formula."""
    spread = [
        f"{'the logarithm of ' if p.is_ratio else ''}`{p.name}` by {100.0 * p.form_spread:.0f} %"
        for p in effect.parameters
        if p.form_spread
    ]
    if not spread:
        return ""
    return (
        f"Other formulas of this shape change {' and '.join(spread)} (one standard deviation), "
        "which the reported interval includes ([benchmarks](benchmarks.md), law forms).\n\n"
    )


def _unit(parameter: Parameter) -> str:
    return {"": "–", "share": "fraction of the declared corner"}.get(parameter.unit, parameter.unit)


_PER = {"": "", "load": " of the mean axle's load", "spring": " mean spring rates"}


def _prior(parameter: Parameter) -> str:
    per = _PER[parameter.prior_unit]
    if parameter.form == "log":
        return f"log-normal, {parameter.centre:g}{per}, a factor {math.exp(parameter.prior_scale):.3g} at one sd"
    if parameter.form == "positive":
        return f"half-normal, {parameter.prior_scale:g}{per}"
    if parameter.form == "sinh":
        return f"{parameter.centre:g} ± {parameter.prior_scale:g}{per} × sinh(z), z standard normal"
    return f"normal, {parameter.centre:g} ± {parameter.prior_scale:g}{per}"


def _tolerance(effect: Effect, parameter: Parameter) -> str:
    if effect.tolerance_values is None:
        return "none"
    if parameter.shape:
        return f"fixed at {effect.tolerance_values[parameter.name]:g}"
    value = effect.tolerance_values[parameter.name]
    text = f"{value:g}{_PER[parameter.prior_unit]}"
    if effect.scaled_to_range is not None:
        still = effect.scaled_to_range(effect.tolerance_values, 0.0, 0.0)
        text += f"; {_RANGES[effect.name].format(limit=still[parameter.name])}"
    return f"± {value - 1.0:.2g}".rstrip("0") if parameter.form == "log" and value < 2.0 else text


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
