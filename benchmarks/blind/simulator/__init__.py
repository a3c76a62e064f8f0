"""A blind test set for the estimation and diagnosis of small cars from four accelerometers.

It shares no code with the package that it tests; see README.md in this folder.
"""

from __future__ import annotations

from .cases import CELLS, SEED, make
from .kinds import Drawn, Fault, Run, Truth

__all__ = ["CELLS", "SEED", "Drawn", "Fault", "Run", "Truth", "make"]
