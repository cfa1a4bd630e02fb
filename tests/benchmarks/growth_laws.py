"""Memory and CPU seconds of meshes, factors and steps against n, each in a process of its own: what forecasts rest on.

python tests/benchmarks/growth_laws.py [FAMILY:N:LINEAR ...]
"""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

ROOT = Path(__file__).parents[2]
STEPS = 8
STAGES = "assemble", "prepare", "step", "peak_MB"
PLANE = [
    f"{family}:{n}:{linear}"
    for family, ns in {
        "squares": (64, 128, 256, 512),
        "triangles": (128, 256, 512),
        "hexagons": (128, 256),
        "distorted": (128, 256),
        "nonconvex": (64, 128),
        "hanging": (128, 256),
        "voronoi": (64, 128, 256),
    }.items()
    for n in ns
    for linear in ("SuperLU", "Pardiso")
]
SPACE = [
    f"{family}:{n}:{linear}"
    for family, ns in {
        "cubes": (8, 12, 16, 24),
        "voronoi3": (6, 8),
        "tetrahedra": (8, 12, 16),
        "kelvin": (4, 6),
    }.items()
    for n in ns
    for linear in ("SuperLU", "Pardiso")
]
LARGE = ["squares:256:Iterative", "squares:512:Iterative", "cubes:16:Iterative", "cubes:24:Iterative"]


def measure(word: str) -> None:
    """Print a row: cells, nodes, unknowns; seconds and peak of the mesh; seconds of a run and its peak."""
    import vemcvx as vx
    from vemcvx.results.files import peak_memory_mb

    family, n, linear = word.split(":")
    sys.path.insert(0, str(ROOT / "problems"))
    space = family in vx.meshes.SPACE_FAMILIES
    problem = __import__("block_in_space" if space else "feng_han_huang")
    empty, start = peak_memory_mb(), time.process_time()
    mesh = problem.mesh(int(n), family=family)
    made, meshed = time.process_time() - start, peak_memory_mb()
    start = time.process_time()
    history = vx.simulate(problem.scene(), mesh, problem.times(STEPS), linear=getattr(vx, linear)(), check=False)
    ran, peak, seconds = time.process_time() - start, peak_memory_mb(), history.seconds
    row = [family, n, linear, mesh.n_cells, mesh.n_nodes, history.trajectory.state.shape[1]]
    row += [f"{made:.3g}", f"{meshed - empty:.0f}", f"{ran:.3g}", f"{seconds['assemble']:.3g}"]
    row += [f"{seconds['prepare']:.3g}", f"{seconds['solve'] / STEPS:.3g}", f"{peak - empty:.0f}"]
    print("".join(f"{cell!s:>10}" for cell in row), flush=True)


if __name__ == "__main__":
    if sys.argv[1:2] == ["--one"]:
        measure(sys.argv[2])
        sys.exit()
    names = "family", "n", "linear", "cells", "nodes", "unknowns", "mesh_s", "mesh_MB", "run_s", *STAGES
    print("".join(f"{name:>10}" for name in names))
    for word in sys.argv[1:] or [*PLANE, *SPACE, *LARGE]:
        subprocess.run([sys.executable, __file__, "--one", word], check=False)
