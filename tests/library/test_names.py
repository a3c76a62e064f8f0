"""What ``import bayes_asv`` offers, and what it costs."""

from __future__ import annotations

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import bayes_asv as asv

HEAVY = ("numpy", "scipy", "numba", "emcee", "matplotlib", "pandas", "pydantic", "rich", "typing")
FUNCTIONS = [name for name in asv.__all__ if inspect.isfunction(getattr(asv, name))]


def test_the_names_are_few_sorted_and_there() -> None:
    assert asv.__all__ == sorted(asv.__all__)
    assert len(asv.__all__) <= 24
    assert set(dir(asv)) == set(asv.__all__)
    for name in asv.__all__:
        assert getattr(asv, name) is not None
    with pytest.raises(AttributeError, match="no attribute 'estimat'"):
        asv.estimat  # type: ignore[attr-defined] # noqa: B018


def test_importing_it_imports_nothing_heavy() -> None:
    code = (
        "import sys; before = set(sys.modules); import bayes_asv; dir(bayes_asv); "
        f"print([m for m in {HEAVY!r} if m in sys.modules and m not in before])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_reading_files_compiles_nothing() -> None:
    code = (
        "import sys, bayes_asv as asv; asv.read_vehicle(asv.example('baja2008.toml')); "
        "asv.read_recording(asv.example('stops-400hz.csv')); asv.Estimate; asv.estimate; "
        "print([m for m in ('numba', 'scipy', 'emcee', 'matplotlib') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


@pytest.mark.parametrize("name", FUNCTIONS)
def test_every_argument_has_a_type_and_is_described(name: str) -> None:
    function = getattr(asv, name)
    signature = inspect.signature(function)
    assert signature.return_annotation is not inspect.Parameter.empty
    for parameter in signature.parameters.values():
        assert parameter.annotation is not inspect.Parameter.empty, parameter
        assert parameter.name in function.__doc__, parameter
    positional = [p for p in signature.parameters.values() if p.kind is not p.KEYWORD_ONLY]
    assert len(positional) <= (3 if name == "compare" else 2)  # two sessions and a vehicle


def test_type_checkers_read_its_annotations() -> None:
    assert (Path(asv.__file__).parent / "py.typed").exists()
