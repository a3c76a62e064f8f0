"""From where on something counts, for those who decide and for those who say why."""

from __future__ import annotations

from typing import Final

__all__ = ["AS_WELL", "ENOUGH", "LEVEL", "NOTICED", "PRICE", "SHORT"]

LEVEL: Final = 0.05
"""Of the family-wise test for a disagreement: false alarms that are accepted."""

ENOUGH: Final = 5.0
"""Nats by which a slack model has to win."""

NOTICED: Final = 1e-3
"""p-value below which a test of what is left, or all of them together, are taken seriously."""

AS_WELL: Final = -4.0
"""Nats from which on a decoy explains as well as names."""

PRICE: Final = 4.0
"""Nats that something of unknown size costs, which has no prior of its own."""

SHORT: Final = 0.1
"""Share of what something is worth by which a fit may fall short of first order, or that of it."""
