"""`vemcvx show`: the scene of a problem in words, with the convex program and the solvers that accept it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from vemcvx.base.arrays import Floats
from vemcvx.base.outline import count_steps
from vemcvx.base.table import Table
from vemcvx.cli.options import NONE, File, FineN, Mesh, Settings
from vemcvx.cli.problem_file import Problem, mesh_name, read_problem
from vemcvx.cli.terminal import say
from vemcvx.history import FOR_GIVEN
from vemcvx.meshes import Mesh as AnyMesh
from vemcvx.program import BOUNDS, SQUARED_POSITIVE_PARTS, Operators
from vemcvx.program.condensation import Condensation
from vemcvx.scene import Scene, pose_scene
from vemcvx.solvers.default import BY_SIZE, name_features


@dataclass(frozen=True, kw_only=True)
class Show:
    """The command `vemcvx show`."""

    file: File
    mesh: Mesh = None
    n: FineN = None
    settings: Settings = NONE

    def __call__(self) -> None:
        """Describe the scene of a problem in words: effects, unknowns, the convex program, its solvers."""
        problem = read_problem(self.file)
        n = self.n or problem.default_n(64, self.mesh)
        mesh = problem.mesh(n, self.mesh, self.settings)
        rows = problem_in_words(problem, self.settings, mesh, mesh_name(problem, self.mesh, n))
        say(f"{problem.name}: {problem.title}\n{Table((), rows).text()}")


def problem_in_words(problem: Problem, settings: Sequence[str], mesh: AnyMesh, name: str) -> list[tuple[str, str]]:
    """Return rows (name, words) for a problem, stage by stage."""
    if not problem.has_stages:
        # Data that are zero at 65 instants are treated as zero.
        return scene_in_words(problem.scene(settings), mesh, problem.times(64), name)
    rows = list[tuple[str, str]]()
    for k, (scene, times) in enumerate(problem.stages(settings), start=1):
        rows.append((f"stage {k}", f"t = {times[0]:.6g} ... {times[-1]:.6g}, {count_steps(len(times) - 1)}"))
        rows += scene_in_words(scene, mesh, times, name)
    return rows


def scene_in_words(scene: Scene, mesh: AnyMesh, times: Floats, name: str) -> list[tuple[str, str]]:
    """Return rows (name, words) for a scene on a mesh called `name`."""
    posed = pose_scene(scene, mesh, times.tolist())
    condensed, n = Condensation(posed.system), posed.system.n
    operators, m = condensed.operators, len(condensed.retained)
    able = [solver for solver in BY_SIZE if operators.features <= solver.accepts]
    lacking = {solver.name: operators.features - solver.accepts for solver in BY_SIZE if solver not in able}
    refusing = [f"{name} (no {name_features(features)})" for name, features in lacking.items()]
    norms = posed.system.norms
    rows = {
        "simulated": "\n".join(effect.describe_body(posed.space.in_plane) for effect in scene.canonical),
        "left out": "\n".join(posed.inactive),
        "mesh": f"{name}: {mesh.n_cells} cells, {mesh.n_nodes} nodes, h = {mesh.h:.4g}",
        "unknowns": f"{n} in all, {m} after condensation",
        "program": _program(operators, posed.system.damping is not None),
        "terms": _terms(operators),
        "certificate": "a bound" if norms is None or norms.is_monotone else FOR_GIVEN,
        "solvers": f"{', '.join(solver.name for solver in able)}; the default is {able[0].name}",
        "not accepting": ", ".join(refusing),
    }
    return [(name, text) for name, text in rows.items() if text]


def _program(operators: Operators, viscous: bool) -> str:
    parts = ["minimise 1/2 d'Kd - g'd" + (" + d'Cd / 2k" if viscous else "")]
    if operators.count:
        parts.append("sum of w_i |B_i d - b_i|")
    if SQUARED_POSITIVE_PARTS in operators.features:
        parts.append("sum of (D_j d - e_j)_+^2 / 2c_j")
    subject = ", subject to D_j d <= e_j" if BOUNDS in operators.features else ""
    often = ", once a step" if len(operators.features) > 1 else ": quadratic, no convex terms"
    return " + ".join(parts) + subject + often


def _terms(operators: Operators) -> str:
    bounds, soft = int((operators.compliance == 0).sum()), int((operators.compliance > 0).sum())
    kind = "absolute values"
    if operators.block > 1:
        kind = f"norms of {operators.block} components, {operators.count} second-order cones"
    found = [(operators.count, kind), (bounds, "bounds"), (soft, "squared positive parts")]
    return ", ".join(f"{count} {words}" for count, words in found if count) or "none; no cones"
