"""The body put together from its materials: every cell has exactly one.

Stresses that need no strain are known only here, where the effects that cause them meet the materials that bear them:

    sigma = C eps(u) + sigma_0,   sigma_0 = sum of initial stresses - b sum of eigenstrains,

with b what a material says that a blocked unit eigenstrain costs. sigma_0 acts as the load
-sum_K |K| sigma_0 : eps(Pi v).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Floats
from vemcvx.effects import Contribution, Eigenstrain, InitialStress, Material
from vemcvx.errors import SceneError
from vemcvx.meshes import AnyMesh
from vemcvx.vem import Space, elastic_matrix, stress_load, upper_triangle

# A node sums some ten products. What rounding leaves of a uniform stress would set a held body moving, on a scale on
# which nothing else happens, and so violate the condition on initial states.
STRESS_ROUNDING = 16 * float(np.finfo(float).eps)


def compose(materials: Sequence[Material], mesh: AnyMesh) -> Material:
    """One material for the whole body; SceneError if cells have none or several, or the planes are mixed."""
    if len(materials) == 1 and materials[0].cells is None:
        return materials[0]
    _check_cover(materials, mesh)
    planes = {m.plane: m.subject for m in materials}
    if len(planes) > 1:
        words = " and ".join(f"plane {plane} in {subject}" for plane, subject in sorted(planes.items()))
        raise SceneError(
            f"materials: found {words}; one body is in one of them, so give all materials the same plane=."
        )
    isotropic = all(len(m.moduli) == 2 for m in materials)
    moduli = [m.moduli if isotropic else upper_triangle(elastic_matrix(m.moduli)) for m in materials]
    thermal_stress_moduli = np.sum([m.thermal_stress_moduli for m in materials], axis=0)
    known = [m.out_of_plane for m in materials if m.out_of_plane is not None]
    out_of_plane = np.sum(known, axis=0) if len(known) == len(materials) else None
    tau = np.sum([m.tau for m in materials], axis=0)
    return Material(
        subject="materials",
        moduli=np.sum(moduli, axis=0),
        thermal_stress_moduli=thermal_stress_moduli,
        plane=materials[0].plane,
        cells=None,
        out_of_plane=out_of_plane,
        stabilisation=tau,
    )


def _check_cover(materials: Sequence[Material], mesh: AnyMesh) -> None:
    whole = np.ones(mesh.n_cells, dtype=bool)
    count = np.sum([whole if m.cells is None else m.cells for m in materials], axis=0)
    found = []
    for wrong, words in ((count == 0, "no material"), (count > 1, "more than one")):
        if wrong.any():
            first = int(np.argmax(wrong))
            found.append(f"{wrong.sum()} with {words}, the first cell {first} around {mesh.centroids[first]}")
    if found:
        subjects = ", ".join(m.subject for m in materials)
        raise SceneError(
            f"materials: every cell takes exactly one; of {mesh.n_cells} cells there are {' and '.join(found)}. Found "
            f"{subjects}; name the cells of each by on=, a cell datum that is nonzero there."
        )


@dataclass(frozen=True)
class InitialStresses:
    """sigma_0 of a body, and the load that it is."""

    material: Material
    eigenstrains: tuple[Eigenstrain, ...]
    stresses: tuple[InitialStress, ...]
    matrix: sp.csr_matrix
    """(n_u, components n_cells) virtual work of stresses constant on cells"""

    def stress(self, t: float) -> Floats:
        """sigma_0 (n_cells, components) at the instant `t`."""
        total = np.zeros_like(self.material.thermal_stress_moduli)
        for stress in self.stresses:
            total += stress.value(t)
        for eigenstrain in self.eigenstrains:
            total -= self.material.thermal_stress_moduli * eigenstrain.value(t)[:, None]
        return total

    def out_of_plane(self, t: float) -> Floats | None:
        """What eigenstrains add to the stress zz across the plane, (n_cells,); None where the material does not say."""
        if self.material.out_of_plane is None:
            return None
        total = np.zeros(len(self.material.thermal_stress_moduli))
        for eigenstrain in self.eigenstrains:
            total -= self.material.out_of_plane[:, 3] * eigenstrain.value(t)
        return total

    def vector(self, t: float) -> Floats:
        """Nodal force (n_u,) at the instant `t`; zero where the stresses around a node balance but for rounding."""
        sigma = self.stress(t).ravel()
        force = -(self.matrix @ sigma)
        force[np.abs(force) <= STRESS_ROUNDING * (abs(self.matrix) @ np.abs(sigma))] = 0.0
        return force


def initial_stresses(parts: Sequence[Contribution], material: Material, space: Space) -> InitialStresses | None:
    """What the contributions say of sigma_0; None if nothing."""
    eigenstrains = tuple(s for part in parts for s in part.eigenstrains)
    stresses = tuple(s for part in parts for s in part.initial_stresses)
    return InitialStresses(material, eigenstrains, stresses, stress_load(space)) if eigenstrains or stresses else None
