"""What a simulation leaves: displacements, slips, tractions, reactions, stresses, energies."""

# No annotations from __future__: subclasses in other modules inherit the fields, and pdoc reads their types there.
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from vemcvx.arguments import is_whole
from vemcvx.arrays import Floats, Ints, brief
from vemcvx.errors import SceneError
from vemcvx.meshes import AnyMesh
from vemcvx.results.contact import Contact
from vemcvx.scene import Scene
from vemcvx.stepping.trajectory import Trajectory
from vemcvx.vem import Space, equivalent, principal, strains, stresses


@dataclass(frozen=True, kw_only=True, repr=False)
class Results:
    """The arrays of a simulation: what a :class:`vemcvx.History`, whose docstring says all of them, is made of."""

    mesh: AnyMesh
    scene: Scene | None
    effects: tuple[str, ...]
    displacement: Annotated[Floats, "S nodes dim"]
    forces: Annotated[Floats, "S nodes dim"]
    contact: Contact
    moduli: Annotated[Floats, "constants cells"]
    trajectory: Trajectory
    seconds: dict[str, float]
    prestress: Annotated[Floats | None, "S cells components"] = None
    out_of_plane: Annotated[Floats | None, "cells 3"] = None
    out_of_plane_prestress: Annotated[Floats | None, "S cells"] = None
    inactive: tuple[str, ...] = ()
    errors: dict[str, float] | None = None
    dragged_ends: Annotated[Ints | None, "dragged 2"] = None
    dragged_friction: Annotated[Floats | None, "S dragged dim"] = None

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

        Obstacles whose gap changes work, too, and ground that moves. What is left of it after `energy` and `dissipated`
        is never negative: 1/2 a^h(du, du) of every step, and pressures times the gaps that they closed.
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
        does not settle or, in space, is too close to something else. A bound is then on the distance to *a* solution
        of the step, which for coefficients that are not small need not be the only one.
        They are also for friction that depends on slip, unless it is known to weaken by less than the body is stiff;
        bounds are then on the distance to the only solution.
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
        part = self._space.part(name, "reaction", contact=True)
        total: Floats = self.forces[:, part.nodes].sum(axis=1)
        if self.dragged_ends is None or self.dragged_friction is None:
            return total
        most = max(self.dragged_ends.max(), part.names.max()) + 1
        here, dragged = (names[:, 0] * most + names[:, 1] for names in (part.names, self.dragged_ends))
        elsewhere = np.isin(self.dragged_ends[:, 0], part.nodes) & ~np.isin(dragged, here)
        total -= self.dragged_friction[:, elsewhere].sum(axis=1)
        return total

    def stress(self, step: int) -> Floats:
        """(n_cells, 3) stresses (xx, yy, xy) of Pi u, and those at zero strain, at a stored step; tension positive.

        In space (n_cells, 6): xx, yy, zz, xy, yz, xz.

        Raises
        ------
        SceneError
            That step was not stored.
        """
        row = self.row(step)
        sigma = stresses(self.moduli, strains(self._space, self.displacement[row]))
        return sigma if self.prestress is None else sigma + self.prestress[row]

    def out_of_plane_stress(self, step: int) -> Floats:
        """(n_cells,) stress zz across the plane at a stored step; tension positive.

        0 in plane stress. In plane strain lam (e_xx + e_yy) = nu (xx + yy), of an orthotropic material as its E3, nu13
        and nu23 say, minus what blocked eigenstrains cost there (E alpha theta of a body free in the plane). A
        Prestress has no component across the plane and counts as 0 there.

        Raises
        ------
        SceneError
            That step was not stored, the material does not say, or the body is in space, where `stress` has it.
        """
        self._space.require_plane("history: out_of_plane_stress", "take the third column of stress(step)")
        row = self.row(step)
        if self.out_of_plane is None:
            raise SceneError(
                "history: the stress across the plane is not determined, because a material gives its law in the plane "
                "only (Material.out_of_plane); principal_stresses(step) and stress(step) do not need it."
            )
        zz: Floats = np.einsum("ck,ck->c", self.out_of_plane, strains(self._space, self.displacement[row]))
        return zz if self.out_of_plane_prestress is None else zz + self.out_of_plane_prestress[row]

    def von_mises(self, step: int) -> Floats:
        """(n_cells,) von Mises' equivalent stress at a stored step, the stress across the plane included.

        See :mod:`vemcvx.vem.stress` for the formula, `out_of_plane_stress` for that component and its errors.
        """
        stress = self.stress(step)
        return equivalent(stress, self.out_of_plane_stress(step)) if self._space.in_plane else equivalent(stress)

    def principal_stresses(self, step: int) -> Floats:
        """(n_cells, 2) principal stresses in the plane at a stored step, the larger one first; tension positive.

        In space (n_cells, 3), the largest first.

        Raises
        ------
        SceneError
            That step was not stored.
        """
        return principal(self.stress(step))

    def row(self, step: int) -> int:
        """The row of a step in the arrays; negative steps count from the end."""
        wanted = step if not is_whole(step) or step >= 0 else step + self.steps + 1
        stored: list[int] = self.stored.tolist()
        if not is_whole(step) or wanted not in stored:
            kept = np.array2string(self.stored, threshold=8)
            raise SceneError(f"history: step {brief(step)} was not stored; stored are {kept} of 0 ... {self.steps}.")
        return stored.index(wanted)
