"""A user's script with types, which tests/whole/test_types.py checks by mypy and pyright in strict mode."""

from __future__ import annotations

from dataclasses import dataclass
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


def abstract() -> vx.Trajectory:
    """Build systems from dense matrices, sparse matrices or lists, and march one system."""
    K = np.array([[2.0, -1.0], [-1.0, 1.0]])
    vx.System(sp.csc_array(K), lambda t: np.array([t, 0.0]), vx.Norms(sp.csr_matrix(K), lambda t: np.full(2, t)))
    vx.System([[2, -1], [-1, 1]], lambda t: [t, 0])
    limits, damping = vx.Limits(np.eye(2), [0.5, 0.25]), vx.Damping(0.1 * K)
    system = vx.System(K, lambda t: [2.0 * t, 0.0], vx.Norms(np.eye(2), 0.5), limits=limits, damping=damping)
    return vx.march(system, [0.0, 0.5, 1.0], solver=vx.Newton(accuracy=1e-8))


@dataclass(frozen=True)
class Weight(vx.Effect):
    """A user-defined effect that uses an effect of the package."""

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


# The functions of a problem file.
def scene(bound: float = 4.0) -> vx.Scene:
    return vx.Scene(
        vx.Elasticity(young=lambda x: 200.0 + 10.0 * x[:, 0], poisson=0.3),
        vx.Clamp(on="right"),
        vx.Traction(pull, on="left"),
        vx.Traction(vx.Tabulated([0, 1], [[0.0, 0.0], [0.0, -0.1]]), on=["top"]),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=bound, on="bottom"),
    )


def mesh(n: int, family: str = "voronoi") -> vx.PolygonMesh:
    make = vx.meshes.FAMILIES[family]
    return make(n, box=((0.0, 1.0), (0.0, 1.0)))


def times(steps: int) -> Floats:
    return np.linspace(0.0, 1.0, steps + 1)


def meshes(folder: Path) -> list[vx.PolygonMesh]:
    own = vx.PolygonMesh([[0, 0], [1, 0], [1, 1], [0, 1]], [[0, 1, 2, 3]])
    named = own.with_boundary("floor", lambda x: x[:, 1] < 1e-9).with_cell_data("soil", np.zeros(1))
    named.write(folder / "mesh.vtu")
    return [named, vx.meshes.read(folder / "mesh.vtu"), vx.meshes.squares(size=0.25).refine([0, 3])]


def evaluate(history: vx.History, folder: Path) -> float:
    """Read all kinds of results of a run."""
    energy: Floats = history.energy
    stuck: NDArray[np.bool_] = history.contact.sticking[-1]
    stress: Floats = history.stress(-1)
    force: Floats = history.reaction("right")
    there: Floats = history.probe([[0.5, 0.5], [0.25, 0.75]])
    words: str = history.summary()
    history.write(folder / "run")
    again = vx.read_history(folder / "run")
    print(words, again.times[-1], stuck.sum(), history.seconds["solve"], stress.shape, force.shape, there.shape)
    solved = history.program(2)
    vx.write_program(solved, folder / "step.npz")
    certificate = vx.read_program(folder / "step.npz").certify(solved.answer.d)
    print(certificate.gap, vx.error_budget(history).largest["total"])
    return float(energy[-1]) + float(history.certificate.max())


def main(folder: Path) -> None:
    history = vx.simulate(scene(), mesh(4), times=times(4), solver=vx.Clarabel(accuracy=1e-6))
    heavy = scene().without(vx.Traction).with_(Weight(1.0))
    vx.simulate(heavy, mesh(4), times(2), solver=Mine(), initial="settled", store="last", check=False)
    print(abstract().state[-1], [mesh.n_cells for mesh in meshes(folder)])
    try:
        print(evaluate(history, folder), vx.adapt(scene(), mesh(4), times=[0, 0.5, 1], target=0.2).met)
    except vx.VemcvxError as error:
        print(error)
        raise
    figure = plots.deformed_mesh(history, magnify=10.0, units={"length": "mm"})
    plots.friction_traction(history, ax=figure.axes[0])
    print(plots.write_plots(history, folder), plots.animate(history, folder / "slip.gif", seconds=1.0))
