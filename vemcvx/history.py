"""What a simulation leaves, in the words of contact: displacements, slips, tractions, reactions, energies.

Sign conventions: stresses are positive in tension; the pressure of contact is positive in compression;
traction is the friction force per length that acts on the body; reactions act on the body.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vemcvx.contact import Contact, contact_history
from vemcvx.errors import SceneError
from vemcvx.meshes import PolygonMesh
from vemcvx.pose import Posed
from vemcvx.scene import Scene
from vemcvx.storage import Storage
from vemcvx.trajectory import Trajectory
from vemcvx.vem import Space, strains, stresses

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class History:
    """A simulated history; arrays over time have one row a stored step.

    Attributes
    ----------
    mesh : PolygonMesh
    scene : Scene or None
        None when the history was read from files: functions of a scene are not kept.
    effects : tuple of str
        The scene in words.
    displacement : (S, n_nodes, dim)
    forces : (S, n_nodes, dim)
        Nodal forces that supports, contact and friction exert on the body, A u - f.
    contact : Contact
    moduli : (2, n_cells) or (6, n_cells)
        Lame's lambda (as it acts in the plane) and mu; where some cell is anisotropic the upper triangle of the elastic
        matrix row by row, see :mod:`vemcvx.vem.hooke`.
    trajectory : Trajectory
        The march in free unknowns, with scalars of all N + 1 instants.
    seconds : dict
        "assemble", "prepare" and "solve".
    prestress : (S, n_cells, 3) or None
        Stresses at zero strain, of eigenstrains and prestress; None where the scene has none.
    """

    mesh: PolygonMesh
    scene: Scene | None
    effects: tuple[str, ...]
    displacement: Floats
    forces: Floats
    contact: Contact
    moduli: Floats
    trajectory: Trajectory
    seconds: dict[str, float]
    prestress: Floats | None = None

    @property
    def steps(self) -> int:
        """The number of steps N, stored or not."""
        return len(self.trajectory.times) - 1

    @property
    def stored(self) -> Ints:
        """(S,) numbers of the stored steps; 0 is the initial instant."""
        return self.trajectory.stored

    @property
    def times(self) -> Floats:
        """(S,) stored instants."""
        return self.trajectory.times[self.stored]

    @property
    def energy(self) -> Floats:
        """(S,) 1/2 a^h(u, u): what the body stores, and springs with it, where no stress precedes strain."""
        return self.trajectory.energy[self.stored]

    @property
    def dissipated(self) -> Floats:
        """(S,) energy lost to friction since the initial instant."""
        return self.trajectory.dissipated[self.stored]

    @property
    def work(self) -> Floats:
        """(S,) sum of end-of-step forces and reactions times increments since the initial instant."""
        return self.trajectory.work[self.stored]

    @property
    def certificate(self) -> Floats:
        """(S,) certified relative energy error of each stored step, given the step before."""
        return self.trajectory.certificate[self.stored]

    @property
    def certificate_floor(self) -> Floats:
        """(S,) what round-off alone may account for in `certificate`."""
        return self.trajectory.certificate_floor[self.stored]

    @property
    def certificate_total(self) -> Floats:
        """(S,) certified relative energy error, the errors of all steps so far added up."""
        return self.trajectory.certificate_total[self.stored]

    @property
    def iterations(self) -> Ints:
        """(S,) iterations of the solver."""
        return self.trajectory.iterations[self.stored]

    @property
    def safeguards(self) -> Ints:
        """(S,) how many of the iterations stood in for faster ones that failed (Newton's proximal steps)."""
        return self.trajectory.safeguards[self.stored]

    @property
    def contraction(self) -> Floats:
        """(S,) rate with which Coulomb's fixed point contracted in each step; NaN where there was none to find."""
        return self.trajectory.contraction[self.stored]

    @property
    def solver(self) -> str:
        """Name and settings of the solver that answered."""
        return self.trajectory.solver

    @cached_property
    def _space(self) -> Space:
        return Space(self.mesh)

    def reaction(self, name: str) -> Floats:
        """(S, dim) total force on the body from supports, contact and friction at the nodes of a boundary.

        Nodes shared by two boundaries count in both.
        """
        return self.forces[:, self._space.part(name, "reaction").nodes].sum(axis=1)

    def stress(self, step: int) -> Floats:
        """(n_cells, 3) stresses (xx, yy, xy) of Pi u, and those at zero strain, at a stored step; tension positive.

        Raises
        ------
        SceneError
            That step was not stored.
        """
        row = self.row(step)
        sigma = stresses(self.moduli, strains(self._space, self.displacement[row]))
        return sigma if self.prestress is None else sigma + self.prestress[row]

    def row(self, step: int) -> int:
        """The row of a step in the arrays; negative steps count from the end."""
        wanted = step + self.steps + 1 if step < 0 else step
        found = np.flatnonzero(self.stored == wanted)
        if len(found) == 0:
            kept = np.array2string(self.stored, threshold=8)
            raise SceneError(f"history: step {step} was not stored; stored are {kept} of 0 ... {self.steps}.")
        return int(found[0])

    def summary(self) -> str:
        """The run in a few lines of words."""
        last = self.trajectory
        sticking = int(self.contact.sticking[-1].sum())
        lines = [
            f"{self.mesh.n_cells} cells, {self.mesh.n_nodes} nodes, {last.state.shape[1]} unknowns, "
            f"{len(self.contact.nodes)} contact nodes, {self.steps} steps",
            f"solver      {self.solver}",
            f"certified   {last.certificate.max():.1e} relative energy error a step "
            f"(floor {last.certificate_floor.max():.1e}), {last.certificate_total[-1]:.1e} accumulated",
            f"iterations  {int(np.median(last.iterations[1:])) if self.steps else 0} a step at the median, at most "
            f"{last.iterations.max()}; {last.safeguards.sum()} of them safeguards",
            f"energy      stored {last.energy[-1]:.6g}, dissipated {last.dissipated[-1]:.6g}, work {last.work[-1]:.6g}",
            f"contact     {sticking} nodes stick, {len(self.contact.nodes) - sticking} slip in the last step",
            "seconds     " + ", ".join(f"{name} {value:.3g}" for name, value in self.seconds.items()),
        ]
        return "\n".join(lines)

    def write(self, folder: str | Path) -> Path:
        """Write the history to a folder: see :func:`vemcvx.files.write_history`."""
        from vemcvx.files import write_history

        return write_history(self, Path(folder))


def record(posed: Posed, trajectory: Trajectory, assembled: float, storage: Storage) -> History:
    """The history of a posed scene."""
    shape = (len(trajectory.stored), *posed.space.mesh.points.shape)
    u, forces = storage.array("displacement", shape), storage.array("forces", shape)
    for row, n in enumerate(trajectory.stored):
        t = float(trajectory.times[n])
        u[row] = posed.displacement(trajectory.state[row], t).reshape(shape[1:])
        forces[row] = (posed.A @ u[row].ravel() - posed.force(t)).reshape(shape[1:])
    return History(
        mesh=posed.space.mesh,
        scene=posed.scene,
        effects=tuple(effect.describe() for effect in posed.scene.canonical),
        displacement=u,
        forces=forces,
        contact=contact_history(posed, trajectory, u, forces),
        moduli=posed.material.moduli,
        trajectory=trajectory,
        seconds={"assemble": assembled, **trajectory.seconds},
        prestress=_prestress(posed, trajectory, storage),
    )


def _prestress(posed: Posed, trajectory: Trajectory, storage: Storage) -> Floats | None:
    """Stresses at zero strain at the stored instants, (S, n_cells, 3), if there are any."""
    if posed.prestress is None:
        return None
    times = trajectory.times[trajectory.stored]
    stress = storage.array("prestress", (len(times), posed.space.mesh.n_cells, 3))
    for row, t in enumerate(times):
        stress[row] = posed.prestress.stress(float(t))
    return stress
