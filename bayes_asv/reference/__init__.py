"""Reproduction of the reference: its tables, figures and two methods, and their corrections.

The reference is S. C. Hoffman, *Automotive suspension parameter estimation using smart wireless
sensor technology*, California Polytechnic State University, 2008.  Chapters, sections,
tables, figures and equations cited in this package are those of the reference.
"""

from __future__ import annotations
