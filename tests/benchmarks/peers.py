"""Solution times of vemcvx and Siconos for Coulomb's law on the same matrices.

python tests/benchmarks/peers.py [--siconos 12 20 32] [--steps 4] [--python /usr/bin/python3]

A block of 1 x 1 x 1/4 with E = 200 and nu = .3 lies on a rigid floor with mu = .3. The mesh has n x n x n/4 cubes,
each cut into six tetrahedra. The top of the block moves down, tilts and moves sideways. Times are CPU seconds.

Siconos (Debian: python3-siconos) computes contact forces r in Coulomb's cones and relative displacements u = W r + q,
with the flexibility W and the displacements q without contact. Nonsmooth Gauss-Seidel (NSGS) starts from the forces of
the previous step and stops at 1e-8. Our solver receives the condensed program. Times are medians over steps, without
the computation of W and of the condensed matrix. Our median leaves out the first step.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import tempfile
import time

import numpy as np
import scipy.sparse as sp

import vemcvx as vx

YOUNG, FRICTION = 200.0, 0.3
AGREE = 1e-6
"""Largest accepted relative difference of answers."""
SCENE = vx.Scene(
    vx.Elasticity(young=YOUNG, poisson=0.3),
    vx.PrescribedDisplacement(
        lambda x, t: np.column_stack(
            [0.02 * t + 0 * x[:, 0], 0.01 * t * x[:, 0], -0.01 + 0 * x[:, 0] - 0.002 * x[:, 1]]
        ),
        on="top",
    ),
    vx.UnilateralContact(on="bottom"),
    vx.CoulombFriction(FRICTION, on="bottom"),
)

SICONOS = """
import json, sys, time, numpy as np, siconos.numerics as sn
d = np.load(sys.argv[1])
seconds, forces, r = [], [], np.zeros(len(d["W"]))
for q in d["q"]:
    problem = sn.FrictionContactProblem(3, np.asfortranarray(d["W"]), q.copy(), d["mu"])
    options = sn.SolverOptions(sn.SICONOS_FRICTION_3D_NSGS)
    options.dparam[sn.SICONOS_DPARAM_TOL] = 1e-8
    options.iparam[sn.SICONOS_IPARAM_MAX_ITER] = 100000
    start = time.process_time()
    failed = sn.fc3d_driver(problem, r, np.zeros(len(r)), options)
    seconds.append(time.process_time() - start)
    forces.append(r.copy())
    if failed:
        raise SystemExit("NSGS did not converge")
np.savez(sys.argv[2], forces=forces)
print(json.dumps(seconds))
"""


def block(n: int) -> vx.meshes.PolyhedralMesh:
    return vx.meshes.tetrahedra((n, n, max(n // 4, 2)), box=((0, 1), (0, 1), (0, 0.25)))


def run_peer(python: str, code: str, *arguments: str) -> object:
    """Run a program with the Python that has Siconos, and return the JSON that it prints."""
    one = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    made = subprocess.run([python, "-c", code, *arguments], capture_output=True, text=True, env={**os.environ, **one})
    if made.returncode:
        raise SystemExit(f"{made.stderr.strip() or made.stdout.strip()}")
    return json.loads(made.stdout.strip().splitlines()[-1])


def compare_siconos(n: int, steps: int, python: str) -> None:
    """Compare the steps of our solver with NSGS on the same condensed data."""
    times = np.linspace(0.0, 1.0, steps + 1)
    solved = list(vx.programs(SCENE, block(n), times, initial="settled", solver=vx.Newton(1e-9)))
    ends: list[float] = []
    solver, progress = vx.Newton(1e-9), lambda *_: ends.append(time.process_time())
    vx.simulate(SCENE, block(n), times, initial="settled", solver=solver, progress=progress)
    operators = solved[0].operators
    m = operators.D.shape[0]
    # In the notation of `StepProgram`, r = (p, -lam) and u = (e - D d, B d - b).
    order = np.column_stack([2 * m + np.arange(m), 2 * np.arange(m), 2 * np.arange(m) + 1]).ravel()
    sign = np.where(order < 2 * m, 1.0, -1.0)
    A = sp.csr_matrix(sp.vstack([operators.B, operators.D]))
    spread = operators.factor.solve(A.T.toarray())
    W = sign[:, None] * (A @ spread)[np.ix_(order, order)] * sign
    q = [sign * (spread.T @ one.g - np.concatenate([one.b, one.e]))[order] for one in solved]
    ours = [-sign * np.concatenate([one.answer.lam.ravel(), one.answer.p])[order] for one in solved]
    with tempfile.TemporaryDirectory() as folder:
        np.savez(f"{folder}/data.npz", W=W, q=q, mu=np.full(m, FRICTION))
        theirs = run_peer(python, SICONOS, f"{folder}/data.npz", f"{folder}/made.npz")
        forces = np.load(f"{folder}/made.npz")["forces"]
    seconds, peer = statistics.median(np.diff(ends)), statistics.median(theirs)
    apart = max(np.abs(a - b).max() / np.abs(a).max() for a, b in zip(ours, forces, strict=True))
    if apart > AGREE:
        raise SystemExit(f"{m} contacts: the answers differ by {apart:.1e}, so the ratio is meaningless.")
    print(f"| {m} contacts | {seconds:.3g} | {peer:.3g} | {peer / seconds:.2g} | {apart:.0e} |", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--siconos", type=int, nargs="*", default=[12, 20, 32], help="cubes along a side")
    parser.add_argument("--steps", type=int, default=4)
    parser.add_argument("--python", default="/usr/bin/python3", help="Python that can import Siconos")
    arguments = parser.parse_args()
    print("| a step with | vemcvx, s | Siconos, s | ratio | apart |\n|---|---|---|---|---|")
    for n in arguments.siconos:
        compare_siconos(n, arguments.steps, arguments.python)


if __name__ == "__main__":
    main()
