"""Which texts are units, to tell a row of units from a row of names."""

from __future__ import annotations

import re
from typing import Final, NamedTuple

__all__ = ["is_unit", "split_unit"]

_LIST: Final = """
    s sec secs second seconds ms us µs ns min h hr hour hours hz khz unix unixtime epoch
    m mm cm km in inch inches ft feet foot mi mile miles um µm mil mils thou yd
    mph kmh kph km/h kmph knots kn kts fps ips
    g gs g-force mg ug µg gn gal
    deg degs degree degrees ° rad rads mrad rev revs turn turns dps rps rpm ppm pct percent % %rh
    v mv volt volts a ma amp amps ohm ohms w kw hp ps wh ah farad
    pa hpa kpa mpa bar mbar psi psig inhg mmhg atm torr
    c f k °c °f degc degf celsius fahrenheit kelvin .c .f
    n kn lbf lb lbs kg kgf nm n·m lbft lb-ft ft-lb ftlb t
    l cc ml gal gallon gallons l/h kg/h
    t µt ut nt gauss gs tesla
    count counts raw bit bits lsb code step steps # no nr enum state bool boolean flag number
    db dba lux lx cd dop sats satellites ratio lambda afr pulse pulses none - --
    (null) null unitless
"""
_WORDS: Final = frozenset(_LIST.split())
_LONGEST: Final = 200  # characters of a name; it bounds the search for brackets
_SPLIT: Final = re.compile(r"\*\*|[*·⋅×/^ ()²³¹⁻⁄]|per")
_BRACKETS: Final = re.compile(
    r"(.*?\S)\s*(?:\[([^\[\]]*)\]|\(([^()]*)\)|/ ?([^\s/]{1,6}))", re.DOTALL
)
_STAR: Final = re.compile(r"(.*\S)\s+\*(\w[\w ]*)")


class _Split(NamedTuple):
    name: str
    unit: str
    source: str


def is_unit(text: str) -> bool:
    """Whether a text reads as a unit: a known one, or a product or quotient of known ones."""
    folded = text.strip().lower().replace("μ", "µ")
    if not folded or len(folded) > 24:
        return False
    if folded in _WORDS or folded.replace(" time", "") in _WORDS:
        return True
    parts = [part for part in _SPLIT.split(folded) if part]
    return bool(parts) and all(
        part.rstrip("1234") in _WORDS or re.fullmatch(r"-?[1-4]", part) for part in parts
    )


def split_unit(cell: str) -> _Split:
    """Split a header cell such as ``Speed (m/s) *gps`` into name, unit and source.

    What stands in brackets is a unit if it reads as one, in square brackets always.
    """
    name, source = cell.strip(), ""
    if len(name) > _LONGEST:
        return _Split(name, "", "")
    star = _STAR.fullmatch(name)
    if star:
        name, source = star[1], star[2]
    match = _BRACKETS.fullmatch(name)
    if match is None:
        return _Split(name, "", source)
    square, round_, slash = match[2], match[3], match[4]
    if square is not None:
        return _Split(match[1].strip(), square.strip(), source)
    unit = (round_ if round_ is not None else slash).strip()
    return _Split(match[1].strip(), unit, source) if is_unit(unit) else _Split(name, "", source)
