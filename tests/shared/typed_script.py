"""A user's script with types, which tests/whole/test_types.py checks by mypy and pyright in strict mode."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

import vemcvx as vx
from vemcvx import plots
from vemcvx.effects import Contribution
from vemcvx.vem import Space

Floats = NDArray[np.float64]


def pull(x: Floats, t: float) -> Floats:
    return np.column_stack([8.0 * (1.25 - x[:, 1]) * t, np.full(len(x), -0.01 * t)])


def young(x: Floats) -> Floats:
    return 200.0 + 10.0 * x[:, 0]


def bottom(x: Floats) -> NDArray[np.bool_]:
    return x[:, 1] < 1e-9


def abstract() -> vx.Trajectory:
    """Pose problems with dense and sparse matrices, loads as lists, and integers."""
    K = np.array([[2.0, -1.0], [-1.0, 1.0]])
    rows = sp.csr_matrix(np.eye(2))
    vx.System(sp.csc_array(K), lambda t: np.array([t, 0.0]))
    vx.System([[2, -1], [-1, 1]], lambda t: [t, 0])
    system = vx.System(
        K,
        lambda t: [2.0 * t, 0.0],
        vx.Norms(np.eye(2), 0.5),
        limits=vx.Limits(np.eye(2), [0.5, 0.25]),
        damping=vx.Damping(0.1 * K),
    )
    varying = replace(system, norms=vx.Norms(rows, lambda t: np.full(2, t)), limits=None)
    count: int = varying.n + system.K.nnz
    print(count, varying.force(0.5).sum())
    return vx.march(system, [0.0, 0.5, 1.0], solver=vx.Newton(accuracy=1e-8))


def scene(bound: float = 4.0) -> vx.Scene:
    made = vx.Scene(
        vx.Elasticity(young=young, poisson=0.3),
        vx.Clamp(on="right"),
        vx.Traction(pull, on="left"),
        vx.Traction(vx.Tabulated([0, 1], [[0.0, 0.0], [0.0, -0.1]]), on=["top"]),
        vx.Pressure(vx.Tabulated([0, 1], [0, 0.01]), on="top"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=bound, on="bottom"),
    )
    made.with_(vx.BodyForce(np.array([0.0, -0.1]))).with_(vx.ThermalStrain(1e-5, temperature=lambda x, t: t * x[:, 0]))
    return made.without(vx.Pressure)


def contact() -> vx.Scene:
    return vx.Scene(
        vx.Elasticity(np.full(16, 10.0), 0.45, plane="stress"),
        vx.PrescribedDisplacement(lambda x, t: np.tile([0.0, -0.02 - 0.01 * t], (len(x), 1)), on="top"),
        vx.PrescribedDisplacement(0.0, on="left", direction="normal"),
        vx.PointLoad([0.0, 0.0], at=(1.0, 0.5)),
        vx.UnilateralContact(on="bottom", gap=lambda x, t: 0.01 * x[:, 0] ** 2),
        vx.CoulombFriction(0.3, on="bottom", cap=1.5),
    )


@dataclass(frozen=True)
class Weight(vx.Effect):
    """A user-defined effect, made of an effect of the package."""

    density: float

    def contribute(self, space: Space) -> Contribution:
        return vx.BodyForce((0.0, -9.81 * self.density)).contribute(space)

    def describe(self) -> str:
        return f"Weight: density {self.density}"


class Mine:
    """A user-defined solver without a base class."""

    def solve(self, program: vx.StepProgram, target: float) -> tuple[Floats, Floats, Floats]:
        d = program.operators.factor.solve(program.g)
        lam, p = program.multipliers(d)
        print(program.certify(d, lam, p).gap <= target, program.to_cvxpy().problem.is_dcp())
        return d, lam, p


# With `scene` above, the functions of a problem file.
def mesh(n: int, family: str = "voronoi") -> vx.PolygonMesh:
    make = vx.meshes.FAMILIES[family]
    return make(n, box=((0.0, 2.0), (0.0, 1.0)))


def times(steps: int) -> Floats:
    return np.linspace(0.0, 1.0, steps + 1)


def meshes(folder: Path) -> list[vx.PolygonMesh]:
    own = vx.PolygonMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]])
    fine = vx.meshes.voronoi((8, 4), box=((0, 2), (0, 1)), seed=1)
    named = vx.meshes.squares(size=0.25).with_boundary("floor", bottom).with_cell_data("soil", np.zeros(16))
    named.write(folder / "mesh.vtu")
    back = vx.meshes.read(folder / "mesh.vtu")
    return [own, fine, mesh(4, family="hexagons"), named, back, named.refine([0, 3])]


def measured(history: vx.History, folder: Path) -> float:
    """Read the results of a run: attributes, probes, stresses, files."""
    energy: Floats = history.energy
    stuck: NDArray[np.bool_] = history.contact.sticking[-1]
    stress: Floats = history.stress(-1)
    force: Floats = history.reaction("right")
    there: Floats = history.probe([[0.5, 0.5], [0.25, 0.75]])
    arc, along = history.along((0.0, 0.5), (1.0, 0.5))
    words: str = history.summary()
    history.write(folder)
    again = vx.read_history(folder)
    print(words, again.times[-1], stuck.sum(), history.seconds["solve"])
    print(*(array.shape for array in (stress, force, there, arc, along)))
    return float(energy[-1]) + float(history.certificate.max())


def programs(history: vx.History, folder: Path) -> vx.Certificate:
    solved = history.program(2)
    vx.write_program(solved, folder / "step.npz")
    program, answer = vx.read_program(folder / "step.npz"), solved.answer
    print(answer.lam.shape, answer.p.shape, program.to_cvxpy().problem.is_dcp())
    for number, each in enumerate(vx.programs(history.scene or scene(), history.mesh, history.times)):
        print(number, each.certificate.gap)
    return program.certify(answer.d)


def accuracy(history: vx.History) -> float:
    budget = vx.error_budget(history)
    adapted = vx.adapt(scene(), vx.meshes.squares(4), times=[0, 0.5, 1], target=0.2)
    print(adapted.met, adapted.history.mesh.n_cells)
    return budget.largest["total"]


def pictures(history: vx.History, folder: Path) -> None:
    figure = plots.deformed_mesh(history, magnify=10.0, units={"length": "mm"})
    ax = figure.axes[0]
    plots.friction_traction(history, ax=ax)
    print(plots.write_plots(history, folder), plots.animate(history, folder / "slip.gif", seconds=1.0))


def main(folder: Path) -> None:
    history = vx.simulate(scene(), vx.meshes.voronoi(4), times=times(4), solver=vx.Clarabel(accuracy=1e-6))
    vx.simulate(contact(), vx.meshes.squares(4), [0, 0.5, 1], initial="settled", store="last", linear=vx.SuperLU())
    heavy = scene().with_(Weight(1.0))
    vx.simulate(heavy, vx.meshes.squares(4), times(2), solver=Mine(), initial="settled", check=False)
    print(abstract().state[-1], [mesh.n_cells for mesh in meshes(folder)])
    try:
        print(measured(history, folder / "run"), accuracy(history), programs(history, folder).gap)
    except vx.VemcvxError as error:
        print(error)
        raise
    pictures(history, folder)
