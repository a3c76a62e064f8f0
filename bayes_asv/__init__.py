"""Bayesian estimation of vehicle suspension parameters from accelerometers.

>>> import bayes_asv as asv
>>> car = asv.read_vehicle(asv.example("baja2008.toml"))
>>> runs = asv.read_recordings(asv.example("stops-400hz.csv"))
>>> result = asv.estimate(runs, car, seed=1)
>>> result.verdict
'ok'
>>> low, high = result["c_f"].interval(0.95)
>>> low < 5.76 < high  # the true rate of this simulated car, lbf*s/in
True

Functions take what was measured, then the car, then keywords.  Everything is imported when it is
first used, so that ``import bayes_asv`` costs nothing.  ``docs/library.md`` shows all names.
"""

from __future__ import annotations

TYPE_CHECKING = False  # typing alone would take longer to import than everything here

if TYPE_CHECKING:
    from bayes_asv.domain.errors import InputError
    from bayes_asv.library.comparisons import Comparison, compare
    from bayes_asv.library.diagnoses import Diagnosis, diagnose
    from bayes_asv.library.estimates import Estimate, estimate
    from bayes_asv.library.events import find_events
    from bayes_asv.library.fleet import fleet
    from bayes_asv.library.inputs import Vehicle, example, read_vehicle
    from bayes_asv.library.logs import calibrate, inspect_log
    from bayes_asv.library.parameter import Parameter
    from bayes_asv.library.plans import Plan, plan
    from bayes_asv.library.recordings import Recording, read_recording, read_recordings
    from bayes_asv.library.simulations import simulate
    from bayes_asv.library.tracks import Track, track

__version__ = "0.1.0"

__all__ = [
    "Comparison",
    "Diagnosis",
    "Estimate",
    "InputError",
    "Parameter",
    "Plan",
    "Recording",
    "Track",
    "Vehicle",
    "__version__",
    "calibrate",
    "compare",
    "diagnose",
    "estimate",
    "example",
    "find_events",
    "fleet",
    "inspect_log",
    "plan",
    "read_recording",
    "read_recordings",
    "read_vehicle",
    "simulate",
    "track",
]

_MODULES = {
    "InputError": "domain.errors",
    "Comparison": "library.comparisons",
    "compare": "library.comparisons",
    "Diagnosis": "library.diagnoses",
    "diagnose": "library.diagnoses",
    "calibrate": "library.logs",
    "inspect_log": "library.logs",
    "Estimate": "library.estimates",
    "estimate": "library.estimates",
    "find_events": "library.events",
    "fleet": "library.fleet",
    "Recording": "library.recordings",
    "Vehicle": "library.inputs",
    "example": "library.inputs",
    "read_recording": "library.recordings",
    "read_recordings": "library.recordings",
    "read_vehicle": "library.inputs",
    "Parameter": "library.parameter",
    "Plan": "library.plans",
    "plan": "library.plans",
    "simulate": "library.simulations",
    "Track": "library.tracks",
    "track": "library.tracks",
}


if not TYPE_CHECKING:  # so that a type checker finds a misspelt name

    def __getattr__(name: str) -> object:
        """Import a public name when it is first used."""
        if name not in _MODULES:
            raise AttributeError(f"module 'bayes_asv' has no attribute {name!r}")
        from importlib import import_module

        value = getattr(import_module(f"bayes_asv.{_MODULES[name]}"), name)
        globals()[name] = value
        return value


def __dir__() -> list[str]:
    return sorted(__all__)
