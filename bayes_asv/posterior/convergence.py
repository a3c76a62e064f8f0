"""Convergence criteria, which the sampler applies and the report states.

Vehtari et al. (2021), Bayesian Analysis 16, 667–718, recommend R̂ < 1.01.  With an effective sample
size of 1000 in the tails, the ends of a 95 % interval have a standard error of 0.085 posterior
standard deviations.
"""

from __future__ import annotations

from typing import Final

__all__ = ["ESS_WANTED", "RHAT_WANTED"]

ESS_WANTED: Final = 1000.0
RHAT_WANTED: Final = 1.01
