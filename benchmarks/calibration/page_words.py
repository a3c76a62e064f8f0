"""What the page says beside its figures."""

from __future__ import annotations

from typing import Final

__all__ = ["BOUND", "HOW", "INTRODUCTION", "LIMITS", "MODEL_DRAWS", "SOURCES"]

INTRODUCTION: Final = """# Calibration

*Written by `python -m benchmarks.calibration --report` from the runs in
`benchmarks/results/calibration`; do not edit.*

## What is asked

An interval of 95 % makes a promise: of a hundred such intervals, about 95 hold the true value.
Nobody knows the true value of a car, so on a car nobody can tell whether the promise was kept. On a
simulator one can. Here thousands of cars are drawn, driven, measured with imperfect sensors and
estimated, and the share of intervals that hold the truth is counted: the *coverage*.

- Coverage **below** the promise means intervals that are too narrow: a damper may be called worn
  that is not.
- Coverage **above** it means intervals that are too wide: honest, but one drives more than needed.
- Coverage says nothing about how narrow an interval could be. So every width is also held against
  the **bound**: what an ideal estimator would reach that knew the sensors' noise exactly and the
  wheels' motion between the samples. 1.00 means that the drive has nothing more to give.

The simulator (`tests/rig`) shares no code with the estimator. It has tyres that can lift, its own
integrator, and sensors with filter, delay, bias, noise and a 10-bit converter. Each run draws mass,
weight split and springs from the deviations that the vehicle file declares (1 %, 1 %, 5 %),
dampers (log-normal, 30 %), pitch inertia (20 %), biases, road and noise. Recordings last 2 s.

In the tables *p* is the smallest of the exact binomial tests at 50 % and 95 %, adjusted after Holm
over the terrains and quantities of its condition, each level a family: below 0.05 the promise was
not kept. Brackets are Jeffreys' 95 % intervals of the true coverage. *Width* is the relative
deviation that the 95 % interval stands for (its width over 2 · 1.96), median over runs.

A mass that is known to 1 % is most of the width of c_f, c_r and i, whatever the drive says. What
the drive itself says is seen in k_g, which hardly depends on it, and where known values are exact.
"""

MODEL_DRAWS: Final = """## Draws from the model itself

The rig asks whether the model is good enough for a car. This asks whether the arithmetic is right:
car, noise levels and everything else are drawn from the prior, a recording is drawn from the
estimator's own model on the wheels of some drive, and the truth must then lie anywhere in the
posterior with equal probability (Talts et al. 2018). Priors of the dampers are 30 % and of the
inertia 20 % here, since a factor of three makes cars that nobody would build. No run is left out,
even where the product would refuse to answer. The log-likelihood is judged as well: it feels errors
that single parameters do not (Modrák et al. 2023).

Grey bands hold the whole curve, or all bars, of every quantity at once with a probability of 95 %
when all is well (Säilynoja, Bürkner & Vehtari 2022, with the level shared among the quantities).
"""

BOUND: Final = """## What is in the bound

The bound is the square root of the inverse of the information in the readings at the true car and
that of the prior together (van Trees 1968). In it are the true noise of all four sensors, filtered
or white as it is, a converter step q as q²/12, the wheel sensors' noise passed on through the car,
and what is not known: all of the car, the initial state, the biases. What the wheels did between
their samples, and what the noise levels are, the ideal estimator knows. Left out are the little
that the noise's covariance tells about the car, readings lost at a rail, and an engine: with an
engine the ratio says what it costs. The bound is computed run by run at that run's truth. A second
computation with whole covariance matrices, which shares no code with the product, is held against
it in `tests/calibration`.
"""

HOW: Final = """## How it is computed

A posterior of the product takes four ensembles and a few seconds. Here it is drawn by importance
sampling from a Student t at the same mode: 512 points of a Sobol sequence, four and sixteen times
as many where fewer than 200 are effective, and the ensembles where that does not help either. What
the data cannot see (the mass) is averaged analytically. The noise of a place p in the posterior was
at most 0.7 √(p (1 − p) / effective number) on 24 fits held against 16 384 draws each, which lowers
a coverage of 95 % by less than 0.2 %.
"""

LIMITS: Final = """- The rig is a simulator, and its suspension is linear here, as the model's
  is. What a nonlinear damper does to the answer is not a question of calibration.
- The truth is drawn as the vehicle file declares it. Who declares 1 % and weighs to 3 % gets
  intervals that are too narrow, and no drive can show it.
- Coverage is that of the runs that were answered; a run that the product refuses is not counted.
"""

SOURCES: Final = """
Sources: Talts, Betancourt, Simpson, Vehtari & Gelman, *Validating Bayesian inference algorithms
with simulation-based calibration*, arXiv:1804.06788 (2018). Säilynoja, Bürkner & Vehtari,
*Graphical test for discrete uniformity and its applications in goodness-of-fit evaluation and
multiple sample comparison*, Statistics and Computing 32, 32 (2022). Modrák, Moon, Kim, Bürkner,
Huurre, Faltejsková, Gelman & Vehtari, *Simulation-based calibration checking for Bayesian
computation: the choice of test quantities shapes sensitivity*, Bayesian Analysis (2023). van Trees,
*Detection, Estimation, and Modulation Theory, Part I* (1968), section 2.4. Brown, Cai & DasGupta,
*Interval estimation for a binomial proportion*, Statistical Science 16, 101 (2001). Holm, *A simple
sequentially rejective multiple test procedure*, Scandinavian Journal of Statistics 6, 65 (1979).
"""
