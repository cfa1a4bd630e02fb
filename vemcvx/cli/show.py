"""`vemcvx show`: a problem's scene, its convex program and its solvers, in words."""

from __future__ import annotations

import inspect

from rich.console import Console

from vemcvx import effects
from vemcvx.arrays import Floats
from vemcvx.cli.problem_file import Problem, is_file
from vemcvx.cli.terminal import say_words
from vemcvx.effects import Effect
from vemcvx.meshes import AnyMesh
from vemcvx.program import Norms
from vemcvx.program.condensation import Condensation
from vemcvx.program.operators import BOUNDS, SQUARED_POSITIVE_PARTS, Operators
from vemcvx.scene import Scene
from vemcvx.scene.pose import pose_scene
from vemcvx.solvers.default import BY_SIZE, words
from vemcvx.stepping.backward_euler import checked_times
from vemcvx.stepping.state import stability


def print_scene(problem: Problem, family: str | None, n: int, settings: tuple[str, ...]) -> None:
    """Print the table to standard output; without colours and frames it reads the same."""
    # Data are looked at at 64 instants, to see whether they are zero at all times.
    times = checked_times(problem.times(64))
    rows = scene_in_words(problem.scene(settings), problem.mesh(n, family), times, mesh_name(problem, family, n))
    # Square brackets in a user's words are no markup.
    Console(highlight=False, markup=False).print(f"{problem.name}: {problem.title}")
    say_words(rows)


def mesh_name(problem: Problem, family: str | None, n: int) -> str:
    """The name of a mesh: its file, or its family and number of cells."""
    name = family or problem.family or "its own"
    return name if is_file(name) else f"{name}, n = {n}"


def scene_in_words(scene: Scene, mesh: AnyMesh, times: Floats, name: str) -> list[tuple[str, str]]:
    """The scene as rows of a name and words; data are looked at, whether they are zero, at these instants."""
    posed = pose_scene(scene, mesh, times.tolist())
    seen = Condensation(posed.system)
    size = f"{mesh.n_cells} cells, {mesh.n_nodes} nodes, h = {mesh.h:.4g}"
    return [
        ("simulated", "\n".join(effect.describe() for effect in scene.canonical)),
        *([("left out", "\n".join(posed.inactive))] if posed.inactive else []),
        ("not simulated", ", ".join(_absent(scene))),
        ("mesh", f"{name}: {size}"),
        ("unknowns", f"{posed.system.n} in all, {len(seen.retained)} after condensation"),
        ("program", _program(seen.operators, posed.system.damping is not None)),
        ("terms", _terms(seen.operators)),
        ("certificate", _certificate(posed.system.norms, seen.operators)),
        *_solvers(seen),
        ("linear solve", _linear(posed.system.K.nnz, posed.system.n, seen)),
    ]


def _absent(scene: Scene) -> list[str]:
    """The effects of the library that the scene does not name."""
    named = {type(effect).__name__ for effect in scene}
    return [name for name in effects.__all__ if _is_effect(name) and name not in named]


def _is_effect(name: str) -> bool:
    kind = getattr(effects, name)
    return isinstance(kind, type) and issubclass(kind, Effect) and not inspect.isabstract(kind)


def _program(operators: Operators, viscous: bool) -> str:
    parts = ["minimise 1/2 d'Kd - g'd" + (" + d'Cd / 2k" if viscous else "")]
    if operators.count:
        parts.append("sum of w_i |B_i d - b_i|")
    if SQUARED_POSITIVE_PARTS in operators.features:
        parts.append("sum of (D_j d - e_j)_+^2 / 2c_j")
    subject = ", subject to D_j d <= e_j" if BOUNDS in operators.features else ""
    return (
        " + ".join(parts)
        + subject
        + (", once a step" if len(operators.features) > 1 else ": quadratic, no convex terms")
    )


def _terms(operators: Operators) -> str:
    """The numbers of convex terms by kind, and the second-order cones that they need."""
    bounds, soft = int((operators.compliance == 0).sum()), int((operators.compliance > 0).sum())
    kind = (
        "absolute values"
        if operators.block == 1
        else f"norms of {operators.block} components, {operators.count} second-order cones"
    )
    found = [(operators.count, kind), (bounds, "bounds"), (soft, "squared positive parts")]
    return ", ".join(f"{count} {words}" for count, words in found if count) or "none; no cones"


def _certificate(norms: Norms | None, operators: Operators) -> str:
    """The kind of a step's certificate: see :mod:`vemcvx.stepping.fixed_point`."""
    if norms is None or not norms.dependent:
        return "a bound"
    if norms.slip_law is not None and norms.slope is None:
        found = stability(operators, norms.softest)
        if found is not None and found.margin > 0:
            return f"a bound, because friction falls slowly with slip: softening over stiffness is {found.rho:.2g} < 1"
        said = "" if found is None else f": softening over stiffness is {found.rho:.2g}, where less than 1 proves more"
        return f"an estimate, because weights depend on slip{said}"
    bound = "a bound on the distance to a solution, by its sets; where they do not settle "
    return (bound if norms.slope is not None else "") + "an estimate, because weights depend on pressures"


def _solvers(seen: Condensation) -> list[tuple[str, str]]:
    able = [solver.name for solver in BY_SIZE if seen.operators.features <= solver.accepts]
    unable = [
        f"{solver.name} (no {words(seen.operators.features - solver.accepts)})"
        for solver in BY_SIZE
        if not seen.operators.features <= solver.accepts
    ]
    rows = [("solvers", f"{', '.join(able)}; the smallest is {able[0]}")]
    return [*rows, ("not", ", ".join(unable))] if unable else rows


def _linear(nonzeros: int, n: int, seen: Condensation) -> str:
    once = f"{type(seen.linear).__name__} on {n} x {n} with {nonzeros} nonzeros, once"
    m = len(seen.retained)
    if m == 0:
        return f"{once}; then a back-substitution for every new shape of the load"
    return f"{once}; then dense {m} x {m} each step" if m < n else f"{once} a step"
