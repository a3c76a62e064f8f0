"""What the page says beside its figures."""

from __future__ import annotations

from typing import Final

__all__ = ["HOW", "INTRODUCTION", "LIMITS", "SOURCES"]

INTRODUCTION: Final = """# The battery: does the diagnosis name what is wrong?

*Written by `python -m benchmarks.battery --report` from the runs in
`benchmarks/results/battery`; do not edit.*

## What is asked

`bayes-asv diagnose` says where the linear half car and a measurement disagree, names what is
missing, gives the name a probability, and claims that the gap on a held-out run closes. Here it
is asked about cars whose faults are known, but not to it:

- A case is one car, driven three times for 2.5 s at 400 Hz: two runs over one terrain to fit,
  one over another to hold out. Mass, weight split and springs are off by what the vehicle file
  declares (1 %, 1 %, 5 %); dampers 30 %, pitch inertia 20 %; biases, speeds, heights, noise
  (half, once and twice the usual, declared) and terrain (bump, stops, rough road, rollers) vary.
- Whole families of cars are kept for the test; the diagnosis is developed on others.
- The simulator (`tests/rig`) shares no code with the package, and its dampers, springs, stops
  and friction are other functions (tanh, sinh, softplus) than those that are fitted.
- **Strength** is defined without the diagnosis: how much the best linear half car loses through
  the effect, as the noncentrality of a likelihood ratio: the whitened distance that is left in
  the noise-free difference after c_f, c_r, i, the given values within their deviations, biases
  and the initial state are fitted again. 10 is hard to tell from noise; 4000 is plain.
- **Answers are sealed**: they are written to a file named by its own hash before any of its
  cases is diagnosed. Every result carries that hash and the time of its diagnosis; the
  diagnosis gets recordings and vehicle file, under names that say nothing.

Brackets are Wilson's 95 % intervals of shares, and bootstrap intervals (2000 draws) of quantiles.
*Name and place* counts the first effect that is named; *class* also counts what it lists as
something that the data cannot tell from it. *Confidently wrong* is a wrong effect (not even in
the class) with a probability of 0.9 or more in a document that does not say that something is
left unexplained.
"""

HOW: Final = """## How it is judged

- **False alarm**: any verdict but agreement where nothing is wrong. Refused cases are left out
  and counted apart.
- **A tyre that leaves the ground** is no fault of the half car, which begins at the wheels.
- **A little of everything**: every effect at once at a fraction of what data sheets leave open
  (bound over rebound within 3 %, friction of 1 to 2 N for a 230 kg car, gains within 0.5 %,
  lags within 20 µs, bandwidths within 3 %, fading of 1 to 2 %, and so on). Its noncentrality is
  often in the hundreds, so a disagreement is there to be seen; what must not be is a confident
  name.
- **Share of the gap closed**: 1 − (after² − floor²) / (before² − floor²) on the held-out run, for
  cases whose effect has a noncentrality of 40 or more in the fitted runs, and whose linear car,
  found there without noise, leaves as much of it in the held-out run. (A spring rate for which a
  linear car bends its given value leaves no gap to close.) A verdict of agreement closes nothing.
  *Worse* is what the document itself says by a bootstrap interval of the change; where it says
  nothing, a growth of one per cent.
- **Coverage**: c_f, c_r and i mean what is written for each effect (the mean of bound and rebound,
  the slope at rest, the rate at the start of the run). Where the rig's form is another function,
  the written form is fitted to the rig's force along the fitted runs; an interval is right that
  reaches the span between the rig's c and that fit. For tanh against the root form, softened
  friction and rounded stops that span is at most about 2 %; a fading that levels off against one
  that is straight in time makes up to a tenth. Before naming the same values are meant.
- **An engine** is heard everywhere: a tone that is named without a place counts as its place.
- **A push** comes once, in one of the fitted runs; on the held-out run it leaves the car that it
  drew away.
- **Reliability**: every effect that is named counts, with its probability, as true when it or its
  class is. Bins hold equal numbers.
"""

LIMITS: Final = """## What falls short

- The rig is a simulator. A real car has more that is not in any list.
- At a given strength an effect may be smaller than what data sheets leave open (see the sizes
  above): who trusts the data sheet is then right not to name it. The table by condition splits
  single effects there, the short answer pairs.
- Effects that cannot be made strong enough on a car (a weight split beyond a quarter, a spring
  beyond a factor 2.5) are left out of that strength when they reach less than half of it.
- What lies outside the list is drawn by us as well; twelve kinds are not everything.
"""

SOURCES: Final = """
Sources: Wilson, *Probable inference, the law of succession, and statistical inference*, Journal of
the American Statistical Association 22, 209 (1927). Naeini, Cooper & Hauskrecht, *Obtaining well
calibrated probabilities using Bayesian binning*, AAAI (2015). Bröcker & Smith, *Increasing the
reliability of reliability diagrams*, Weather and Forecasting 22, 651 (2007).
"""
