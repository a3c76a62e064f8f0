"""The page of effects says what the registry has, and its example can be followed."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from bayes_asv.models.effects import EFFECTS, Effect, Scale
from tests.effects_page import LAWS, MEANINGS, PAGE, page
from tests.extension_steps import ROOT, apply, blocks, copy_package, run

HEADING = "Adding an effect"
VEHICLE = ROOT / "data" / "vehicles" / "baja2008.toml"
SCALE = Scale(load=1100.0, spring=17000.0)


def test_the_page_is_what_the_registry_says() -> None:
    assert PAGE.read_text(encoding="utf-8") == page(), "run: python -m tests.effects_page"


def test_every_effect_has_a_law_and_every_parameter_a_meaning() -> None:
    assert set(LAWS) == set(EFFECTS)
    for effect in EFFECTS.values():
        assert set(MEANINGS[effect.name]) == {p.name for p in effect.parameters}
        assert effect.title
        assert effect.drive
    assert set(MEANINGS) == set(EFFECTS)


@pytest.mark.parametrize("effect", EFFECTS.values(), ids=lambda e: e.name)
def test_priors_and_tolerances_on_the_page_are_those_of_the_draws(effect: Effect) -> None:
    """What a row says of a prior, held against draws of it and not against the fields again."""
    section = page().split(f"## {effect.name}\n")[1].split("\n## ")[0]
    draws = np.random.default_rng([7, 1]).normal(size=40_000)  # seed 7, 40,000 draws
    for parameter in effect.parameters:
        rows = [x for x in section.splitlines() if x.startswith(f"| `{parameter.name}` |")]
        (row,) = rows or [x for x in section.splitlines() if "` … `" in x]  # several alike
        prior, tolerance = (cell.strip() for cell in row.split("|")[4:6])
        per = {"load": SCALE.load, "spring": SCALE.spring}.get(parameter.prior_unit, 1.0)
        drawn = np.asarray(parameter.value(draws, SCALE)) / per
        numbers = [float(x) for x in re.findall(r"-?\d+(?:\.\d+)?", prior)]
        if prior.startswith("log-normal"):
            assert np.median(drawn) == pytest.approx(numbers[0], rel=0.03)
            assert np.exp(np.std(np.log(drawn))) == pytest.approx(numbers[1], rel=0.02)
        elif prior.startswith("half-normal"):
            assert np.all(drawn >= 0.0)
            assert np.sqrt(np.mean(drawn**2)) == pytest.approx(numbers[0], rel=0.02)
        elif "sinh" in prior:
            assert np.median(drawn) == pytest.approx(numbers[0], abs=0.03 * numbers[1])
            assert np.std(np.arcsinh(drawn / numbers[1])) == pytest.approx(1.0, rel=0.02)
        else:
            assert np.mean(drawn) == pytest.approx(numbers[0], abs=0.03 * numbers[1])
            assert np.std(drawn) == pytest.approx(numbers[1], rel=0.02)
        assert (tolerance == "none") == (effect.tolerance_values is None)


@pytest.fixture(scope="module")
def extended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy the package and follow the page's steps in it, no more."""
    folder = tmp_path_factory.mktemp("copy")
    package = copy_package(folder)
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "tests" / "filters", folder / "tests" / "filters", ignore=ignored)
    (file,) = blocks(PAGE, HEADING, "python")
    (package / "models/effects/quadratic_damper.py").write_text(file, encoding="utf-8")
    number, branch, entry, imported, listed = blocks(PAGE, HEADING, "diff")
    apply(package / "filters/force_laws.py", (number, branch, entry))
    apply(package / "models/effects/__init__.py", (imported, listed))
    return folder


def _run(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    # Interpreted: what is compiled is the same text, and compiling would take longer than all else.
    return run(folder, *words, environment={"NUMBA_DISABLE_JIT": "1"})


def test_the_steps_make_an_effect_that_is_asked_for(extended: Path) -> None:
    code = (
        "import bayes_asv\n"
        f"assert bayes_asv.__file__.startswith({str(extended)!r})\n"
        "from bayes_asv.posterior.effect_fit import read_effect\n"
        "from bayes_asv.posterior.effects import law_table\n"
        "from bayes_asv.filters.force_laws import excess_many\n"
        "from bayes_asv.domain.vehicle import read_vehicle\n"
        "from bayes_asv.models.cars import car_model\n"
        "import numpy as np\n"
        "placed = read_effect('quadratic_damper@rear')\n"
        f"car = car_model('half', read_vehicle({str(VEHICLE)!r}))\n"
        "table = law_table(car, {placed: {'quadratic': 300.0}}, 0)\n"
        "rate = np.array([-0.5, 0.0, 2.0])\n"
        "found = excess_many(table, 1, 1000.0, 2e4, 0 * rate, rate, 0 * rate, 1.0)\n"
        "print(found[:, 0].tolist(), found[:, 2].tolist())\n"
    )
    done = _run(extended, "-c", code)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip() == "[75.0, 0.0, -1200.0] [-300.0, 0.0, -1200.0]"


def test_the_tests_that_are_there_hold_its_branch_against_its_readable_form(extended: Path) -> None:
    words = ("-m", "pytest", "-q", "-p", "no:cacheprovider", "-k", "quadratic_damper")
    done = _run(extended, *words, "tests/filters/test_force_laws.py")
    assert done.returncode == 0, done.stdout
    assert "2 passed" in done.stdout
    wrong = extended / "bayes_asv/filters/force_laws.py"
    text = wrong.read_text(encoding="utf-8")
    wrong.write_text(text.replace("-2.0 * p[0] * abs(rate)", "-p[0] * abs(rate)"), encoding="utf-8")
    assert "1 failed" in _run(extended, *words, "tests/filters/test_force_laws.py").stdout
    wrong.write_text(text, encoding="utf-8")
