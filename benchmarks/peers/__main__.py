"""Speed beside peers and beside C: ``make bench``.

All solve one problem: the shipped drive over parking stops (799 steps at 400 Hz), the half car with
eleven coordinates, the same priors and noise.  NumPyro and blackjax have the same likelihood,
written in JAX and compared with ours at 256 points; emcee with ``lsim`` and PINTS have what a user
would write: output error with white noise of one size.  The floor is the recursion in C, one car at
a time and 8 cars side by side.  Rounds are interleaved, each peer is a process on one processor,
and what is reported are ratios within a round: median, least and largest.

Results go to ``benchmarks/results/peers.json`` and ``docs/peers.md``.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from arviz_stats.base import array_stats
from numpy.typing import NDArray

from bayes_asv.filters import kalman
from bayes_asv.posterior.sampler import sample_posterior
from benchmarks.peers.floor import Floor
from benchmarks.peers.problem import Problem, make_problem
from benchmarks.peers.samplers import NAMES, WANTED
from benchmarks.provenance import current_commit, keep

Array = NDArray[np.float64]

ROOT = Path(__file__).parents[2]
RESULTS = ROOT / "benchmarks" / "results" / "peers.json"
PAGE = ROOT / "docs" / "peers.md"
OURS = "bayes_asv"
_REPEATS = 30  # of a likelihood; the fastest counts
_LANES = 8
_LIBRARIES = ("numpy", "scipy", "emcee", "pints", "jax", "numpyro", "blackjax", "filterpy")


def _fastest(work: Callable[[], object]) -> float:
    """Return the shortest of many times, s."""
    times = []
    for _ in range(_REPEATS):
        begin = time.perf_counter()
        work()
        times.append(time.perf_counter() - begin)
    return min(times)


def likelihoods(problem: Problem, folder: Path) -> dict[str, float]:
    """Time the likelihood of a batch of sets, nanoseconds a step and a set."""
    space, sets = problem.posterior.space, problem.points
    data = space.recordings[0].measurements
    system, noise = space.state_space(sets, 0), space.noises(sets, 0)
    per = 1e9 / len(sets) / len(data.step)
    from_coordinates = _fastest(lambda: problem.posterior.log_likelihood(sets))
    out = {
        f"{OURS}, from coordinates on": per * from_coordinates,
        OURS: per * _fastest(lambda: kalman.log_likelihood(system, noise, data)),
    }
    ours = kalman.log_likelihood(system, noise, data)
    for lanes, name in ((1, "C, one car at a time"), (_LANES, "C, 8 cars side by side")):
        floor = Floor(lanes, folder)
        parts = [
            floor.prepared(
                system._replace(
                    A=system.A[k : k + lanes], B=system.B[k : k + lanes], C=system.C[k : k + lanes]
                ),
                type(noise)(*(x[k : k + lanes] for x in noise)), data,
            )
            for k in range(0, len(sets), lanes)
        ]  # fmt: skip

        def every(floor: Floor = floor, parts: list[Any] = parts) -> Array:
            return np.concatenate([floor.log_likelihood(part, data) for part in parts])

        out[name] = per * _fastest(every)
        error = float(np.max(np.abs(every() - ours)))
        out["largest difference"] = max(out.get("largest difference", 0.0), error)
    return out


def effective(draws: Array) -> float:
    """Return the least effective size of c_f, c_r and i of draws (chains, N, 3)."""
    return min(float(array_stats.ess(draws[..., k], method="bulk")) for k in range(draws.shape[2]))


def ours(problem: Problem, seed: int) -> dict[str, Any]:
    """Sample as ``estimate`` does, its fit to begin with included."""
    evaluations = 0

    class Counted:
        space = problem.posterior.space

        def __getattr__(self, name: str) -> Any:
            return getattr(problem.posterior, name)

        def log_posterior(self, z: Array) -> Array:
            nonlocal evaluations
            evaluations += len(z)
            return problem.posterior.log_posterior(z)

    begin = time.process_time()
    again = make_problem(seed)
    found = sample_posterior(Counted(), again.fit.mode, seed)  # type: ignore[arg-type]
    if found.sampler != "weighted draws":
        raise SystemExit("the weights of this posterior can no longer be trusted")
    seconds = time.process_time() - begin
    first = problem.data()
    logs = first["first"] + found.draws @ first["slopes"]
    draws = np.exp(logs)[..., WANTED]
    return _summary(draws, seconds, evaluations)


def _summary(draws: Array, seconds: float, evaluations: int) -> dict[str, Any]:
    size = effective(draws) if draws.size else 0.0
    flat = draws.reshape(-1, 3)
    return {
        "cpu_seconds": seconds, "evaluations": evaluations, "effective": size,
        "effective_a_second": size / seconds, "effective_an_evaluation": size / evaluations,
        "c_f": [float(flat[:, 0].mean()), float(flat[:, 0].std())] if len(flat) else None,
    }  # fmt: skip


def peer(python: str, name: str, where: Path, folder: Path, seed: int) -> dict[str, Any]:
    """Run one peer in its environment, on one processor."""
    out = folder / "out.npz"
    processor = min(os.sched_getaffinity(0))
    subprocess.run(
        [python, str(Path(__file__).parent / "samplers.py"), name, str(where), str(out), str(seed)],
        check=True, preexec_fn=lambda: os.sched_setaffinity(0, {processor}),
        env={**os.environ, "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false"},
    )  # fmt: skip
    with np.load(out) as file:
        found = {key: file[key] for key in file.files}
    result = _summary(found["draws"], float(found["cpu_seconds"]), int(found["evaluations"]))
    if "largest_difference" in found:
        result["largest_difference"] = float(found["largest_difference"])
    return result


def libraries(python: str) -> dict[str, str]:
    """Versions of what the peers' environment has."""
    code = "import importlib.metadata as m, json, sys; print(json.dumps({n: m.version(n) for n in sys.argv[1:]}))"  # noqa: E501
    said = subprocess.run([python, "-c", code, *_LIBRARIES], check=True, capture_output=True)
    found: dict[str, str] = json.loads(said.stdout)
    return found


def spread(values: list[float]) -> list[float]:
    """Return median, least and largest."""
    return [float(np.median(values)), min(values), max(values)]


def page(result: dict[str, Any]) -> str:
    """Return the page of the documentation."""
    times = result["nanoseconds_a_step"]
    floor = result["times_the_floor"]
    rows = [f"| {name} | {spread_text(times[name])} |" for name in times]
    peers = [
        f"| {name} | {one['effective'][0]:.0f} | {one['cpu_seconds'][0]:.2f} | "
        f"{one['effective_a_second'][0]:.3g} | {one['effective_an_evaluation'][0]:.2g} | "
        f"{one['c_f'][0]:.1f} ± {one['c_f'][1]:.1f} | "
        f"{'' if name == OURS else spread_text(one['ours_over_it'])} |"
        for name, one in result["samplers"].items()
    ]
    versions = ", ".join(f"{name} {number}" for name, number in result["libraries"].items())
    text = (Path(__file__).parent / "page.md.in").read_text(encoding="utf-8")
    return text.format(
        commit=result["commit"][:7], seed=result["seed"], rounds=result["rounds"],
        machine=result["machine"], versions=versions, likelihoods="\n".join(rows),
        floor=spread_text(floor), difference=f"{result['largest_difference']:.1g}",
        jax=f"{result['largest_difference_of_jax']:.1g}", peers="\n".join(peers),
        filterpy=f"{result['filterpy_nanoseconds_a_step'] / 1e3:.0f}",
    )  # fmt: skip


def spread_text(values: list[float]) -> str:
    """Median with least and largest in words."""
    return f"{values[0]:.3g} ({values[1]:.3g} – {values[2]:.3g})"


def main() -> int:
    """Run the rounds, and write the results and the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--python", required=True, help="of the environment with the peers")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seed", type=int, default=1)
    arguments = parser.parse_args()
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    names = [name for name in NAMES if name != "filterpy"]
    times: list[dict[str, float]] = []
    found: dict[str, list[dict[str, Any]]] = {name: [] for name in (OURS, *NAMES)}
    problem = make_problem(arguments.seed)
    ours(problem, arguments.seed)  # what is compiled once is compiled
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        where = folder / "problem.npz"
        np.savez(where, **problem.data())
        for turn in range(arguments.rounds):
            seed = arguments.seed + turn
            times.append(likelihoods(problem, folder))
            for name in (OURS, *NAMES):
                one = (
                    ours(problem, seed) if name == OURS
                    else peer(arguments.python, name, where, folder, seed)
                )  # fmt: skip
                found[name].append(one)
                print(f"round {turn + 1}, {name}: {one['effective_a_second']:.3g} a second, "
                      f"{one['cpu_seconds']:.1f} s", file=sys.stderr, flush=True)  # fmt: skip
    kinds = [name for name in times[0] if name != "largest difference"]
    figures = ("effective", "cpu_seconds", "effective_a_second", "effective_an_evaluation")
    steps = len(problem.posterior.space.recordings[0].measurements.step)
    result: dict[str, Any] = {
        "commit": current_commit() or "unknown", "seed": arguments.seed,
        "rounds": arguments.rounds,
        "machine": f"{platform.machine()}, {os.cpu_count()} processors, one used; Python "
        f"{platform.python_version()}, numba {version('numba')}",
        "libraries": libraries(arguments.python),
        "nanoseconds_a_step": {k: spread([one[k] for one in times]) for k in kinds},
        "times_the_floor": spread([one[OURS] / one["C, 8 cars side by side"] for one in times]),
        "largest_difference": max(one["largest difference"] for one in times),
        "largest_difference_of_jax": max(
            one["largest_difference"] for name in names for one in found[name] if "NUTS" in name
        ),
        "filterpy_nanoseconds_a_step": min(
            1e9 * one["cpu_seconds"] / one["evaluations"] / steps for one in found["filterpy"]
        ),
        "samplers": {
            name: {
                **{k: spread([one[k] for one in found[name]]) for k in figures},
                "c_f": found[name][0]["c_f"],
                "ours_over_it": spread([
                    mine["effective_a_second"] / one["effective_a_second"]
                    for mine, one in zip(found[OURS], found[name], strict=True)
                ]),
            }
            for name in (OURS, *names)
        },
    }  # fmt: skip
    keep(RESULTS, result)
    PAGE.write_text(page(result), encoding="utf-8")
    print(page(result))
    return 0


if __name__ == "__main__":
    sys.exit(main())
