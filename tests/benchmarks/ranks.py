"""PETSc on several ranks: seconds of set-up and of solves, and the peak memory of each rank.

mpiexec -n 2 python tests/benchmarks/ranks.py [--n 40] [--linear petsc | iterative] [--solves 3]

A unit cube of n x n x n cubes (E = 200, nu = .3) is held at the top and pushed sideways at the bottom. Set-up happens
once per run and includes a bound on eigenvalues. A solve computes K^{-1} b to the relative residual 1e-12, with the
stiffness matrix K and a force b. Rank 0 prints the wall seconds of set-up and solves. Every rank prints peak memory,
CPU seconds, and floating-point operations (in solves and matrix products only).
`--linear iterative` on one rank uses PyAMG instead.
"""

from __future__ import annotations

import argparse
import os
import resource
import time

import numpy as np

import vemcvx as vx
from vemcvx.linear import petsc
from vemcvx.scene import pose_scene

SCENE = vx.Scene(
    vx.Elasticity(young=200.0, poisson=0.3),
    vx.Clamp(on="top"),
    vx.Traction(lambda x, t: np.column_stack([t + 0 * x[:, 0], 0.3 * x[:, 0], -0.2 + 0 * x[:, 0]]), on="bottom"),
)


def seconds_here() -> float:
    """Return the CPU seconds of this rank so far."""
    own = resource.getrusage(resource.RUSAGE_SELF)
    return own.ru_utime + own.ru_stime


def peak() -> str:
    """Return the peak memory of this rank as text."""
    return f"{resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20:.2f} GB at most"


def measure(given: argparse.Namespace) -> float:
    """Print times and memory, and return the CPU seconds before the set-up."""
    linear = vx.PETSc() if given.linear == "petsc" else vx.Iterative()
    system = pose_scene(SCENE, vx.meshes.cubes(given.n)).system
    print(f"{system.n} unknowns; after assembly {peak()}", flush=True)
    posed = seconds_here()
    start = time.perf_counter()
    factor = linear.factorise(system.K, system.near_kernel)
    set_up, b = time.perf_counter() - start, system.force(1.0)
    forces, seconds, answers = [b, b * np.cos(np.arange(len(b))), system.force(0.2)][: given.solves], [], []
    for force in forces:
        start = time.perf_counter()
        answers.append(factor.solve(force))
        seconds.append(time.perf_counter() - start)
    off = max(np.linalg.norm(f - system.K @ x) / np.linalg.norm(f) for f, x in zip(forces, answers, strict=True))
    solve, load = np.median(seconds), os.getloadavg()[0]
    print(f"set-up {set_up:.2f} s, a solve {solve:.2f} s, residual {off:.1e}; load average {load:.1f}")
    return posed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--n", type=int, default=40, help="cubes along a side")
    parser.add_argument("--linear", choices=("petsc", "iterative"), default="petsc")
    parser.add_argument("--solves", type=int, default=3)
    given = parser.parse_args()
    before, own = seconds_here(), "rank 0"
    if given.linear == "iterative" or not petsc.serve():
        before = measure(given)
    counted = ""
    if given.linear == "petsc":
        from petsc4py import PETSc

        own, counted = f"rank {petsc.all_ranks().comm.rank}", f", {PETSc.Log.getFlops():.4g} operations"
    print(f"{own}: {peak()}, {seconds_here() - before:.1f} CPU seconds{counted}", flush=True)


if __name__ == "__main__":
    main()
