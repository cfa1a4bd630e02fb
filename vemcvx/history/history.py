"""What a simulation leaves, in the words of contact: displacements, slips, tractions, reactions, energies.

Sign conventions: stresses are positive in tension; the pressure of contact is positive in compression;
traction is the friction force per length that acts on the body; reactions act on the body.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.errors import SceneError
from vemcvx.history.contact import Contact
from vemcvx.kinds import is_whole
from vemcvx.meshes import PolygonMesh
from vemcvx.meshes.polygons.topology import edge_keys
from vemcvx.real import brief
from vemcvx.scene import Scene
from vemcvx.stepping.trajectory import Trajectory
from vemcvx.vem import Space, equivalent, principal, strains, stresses

if TYPE_CHECKING:
    from vemcvx.probes import Profile

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
        Nodal forces that supports, contact and friction exert on the body, A u - f, and with viscosity A u + A_1 u' - f
        at the rates of the step; no step leads to row 0, whose forces are those of the elastic part.
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
    across : (n_cells, 3) or None
        Stress zz across the plane of unit strains e_xx, e_yy, 2 e_xy; zero in plane stress, None if the material does
        not say.
    prestress_across : (S, n_cells) or None
        What eigenstrains add to it; None where there are none.
    void : tuple of str
        What of the scene did nothing in this run, and was left out or never reached.
    dragged_ends : (q, 2) int or None
        Where supports drag nodes along against friction, edge by edge: the node, and the other one of the edge.
    dragged_friction : (S, q, dim) or None
        The friction on the body there, which `forces` include.
    errors : dict or None
        Of an adaptive run: "algebra", "space", "time", their sum "total", and the "target", relative energy errors.
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
    across: Floats | None = None
    prestress_across: Floats | None = None
    void: tuple[str, ...] = ()
    errors: dict[str, float] | None = None
    dragged_ends: Ints | None = None
    dragged_friction: Floats | None = None

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
        """(S,) sum of end-of-step forces and reactions times increments since the initial instant.

        Obstacles whose gap changes work, too. What is left of it after `energy` and `dissipated` is never negative:
        1/2 a^h(du, du) of every step, and pressures times the gaps that they closed.
        """
        return self.trajectory.work[self.stored]

    @property
    def certificate(self) -> Floats:
        """(S,) certified relative energy error of each stored step, given the step before."""
        return self.trajectory.certificate[self.stored]

    @property
    def certificate_kind(self) -> str:
        """What `certificate` is: "bound", or "estimate" if it is no more than that in some step.

        Estimates are for friction that depends on pressure (Coulomb), in steps where what sticks, slips and touches
        does not settle; a bound is then on the distance to *a* solution of the step, which for coefficients that are
        not small need not be the only one.
        """
        return self.trajectory.certificate_kind

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
        """(S,) rate with which Coulomb's fixed point contracted in each step; NaN where two programs were enough."""
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

        Nodes shared by two boundaries count in both; but friction against supports that drag such a node along counts
        with the edges that rub: a block pulled by its side over a floor shows all friction as reaction of that side.
        """
        part = self._space.part(name, "reaction")
        total = self.forces[:, part.nodes].sum(axis=1)
        if self.dragged_ends is None or self.dragged_friction is None:
            return total
        node, beyond = self.dragged_ends.T
        here = edge_keys(*part.edges.T, self.mesh.n_nodes)
        elsewhere = np.isin(node, part.nodes) & ~np.isin(edge_keys(node, beyond, self.mesh.n_nodes), here)
        return total - self.dragged_friction[:, elsewhere].sum(axis=1)

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

    def stress_across(self, step: int) -> Floats:
        """(n_cells,) stress zz across the plane at a stored step; tension positive.

        0 in plane stress. In plane strain lam (e_xx + e_yy) = nu (xx + yy), of an orthotropic material as its E3, nu13
        and nu23 say, minus what blocked swellings cost there (E alpha theta of a body free in the plane). A Prestress
        has no component across the plane and counts as 0 there.

        Raises
        ------
        SceneError
            That step was not stored, or the material does not say.
        """
        row = self.row(step)
        if self.across is None:
            raise SceneError(
                "history: the stress across the plane is not determined, because a material gives its law in the plane "
                "only (Material.across); principal_stresses(step) and stress(step) do not need it."
            )
        zz = np.einsum("ck,ck->c", self.across, strains(self._space, self.displacement[row]))
        return zz if self.prestress_across is None else zz + self.prestress_across[row]

    def von_mises(self, step: int) -> Floats:
        """(n_cells,) von Mises' equivalent stress at a stored step, the stress across the plane included.

        See :mod:`vemcvx.vem.invariants` for the formula and :meth:`stress_across` for that component, and its errors.
        """
        return equivalent(self.stress(step), self.stress_across(step))

    def principal_stresses(self, step: int) -> Floats:
        """(n_cells, 2) principal stresses in the plane at a stored step, the larger one first; tension positive.

        Raises
        ------
        SceneError
            That step was not stored.
        """
        return principal(self.stress(step))

    def probe(self, points: ArrayLike) -> Floats:
        """(S, p, 2) displacements at any points (p, 2) of the body: see :mod:`vemcvx.probes`.

        Exact nodal values at nodes, between two nodes linear on edges, and Pi u inside cells, (3.11).

        Raises
        ------
        SceneError
            A point lies outside the body, or `points` are not points.
        """
        from vemcvx.probes import places

        return places(self.mesh, points, "probe").at_nodes(self.displacement)

    def along(self, start: ArrayLike, end: ArrayLike, count: int = 101, field: str = "displacement") -> Profile:
        """A field along a straight line, at all stored steps.

        Parameters
        ----------
        start, end : (2,) points
            Of the body, as all points between them.
        count : int
            How many points, evenly spaced, the ends among them; at least 2.
        field : {"displacement", "stress", "stress_across", "von_mises", "principal_stresses"}
            Displacements are those of :meth:`probe`; stresses are constant on cells, and where several cells meet the
            mean of theirs is given.

        Returns
        -------
        Profile
            ``arc, values = history.along(...)``: distances (count,) from the start, and values (S, count, ...).

        Raises
        ------
        SceneError
            The line leaves the body, or something of the above is not as it should be.
        """
        from vemcvx.probes import profile

        return profile(self, start, end, count, field)

    def row(self, step: int) -> int:
        """The row of a step in the arrays; negative steps count from the end."""
        found = np.flatnonzero(self.stored == (step if step >= 0 else step + self.steps + 1)) if is_whole(step) else ()
        if len(found) == 0:
            kept = np.array2string(self.stored, threshold=8)
            raise SceneError(f"history: step {brief(step)} was not stored; stored are {kept} of 0 ... {self.steps}.")
        return int(found[0])

    def summary(self) -> str:
        """The run in a few lines of words."""
        from vemcvx.history.in_words import in_words

        return in_words(self)

    def write(self, folder: str | Path) -> Path:
        """Write the history to a folder: see :func:`vemcvx.files.write_history`."""
        from vemcvx.files import write_history

        return write_history(self, folder)
