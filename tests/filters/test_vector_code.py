"""Steps that are emitted as vector code do what the same steps do where nothing is compiled."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

from tests.cli.conftest import ROOT

CODE = """
import numpy as np
from bayes_asv.filters import kalman, kalman_ar
from tests.filters.linear_cases import linear_case

case = linear_case("half", 4, n=12, sets=3)
values = [kalman.log_likelihood(case.system, case.noise, case.data)]
closes = np.ones(len(case.data.step), bool)
ny = case.data.kind.shape[1]
ar = 0.1 * np.eye(ny)[None]
values.append(
    kalman_ar.log_likelihood(case.system, case.noise, case.data, closes, ar, np.eye(ny))
)
print(*np.concatenate(values).tolist())
"""


def values(interpreted: bool) -> list[float]:
    environment = {**os.environ, "NUMBA_DISABLE_JIT": str(int(interpreted))}
    done = subprocess.run(
        [sys.executable, "-c", CODE], env=environment, cwd=ROOT, text=True, capture_output=True,
        check=True,
    )  # fmt: skip
    return [float(word) for word in done.stdout.split()]


def test_it_computes_what_the_same_steps_do_interpreted() -> None:
    compiled = values(interpreted=False)
    assert len(compiled) == 6
    assert np.all(np.isfinite(compiled))
    assert values(interpreted=True) == pytest.approx(compiled, rel=1e-11)
