"""The reference reproduced: its tables and figures, its two methods, and what is right.

The reference is S. C. Hoffman, *Automotive suspension parameter estimation using smart wireless
sensor technology*, California Polytechnic State University, 2008.  Chapters, tables, figures and
equations without another name are its own.
"""

from __future__ import annotations
