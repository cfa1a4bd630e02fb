"""Properties of the body: the kernel of the stiffness matrix, and answers for moved bodies."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from hypothesis import strategies as st
from strategies import SEEDS, for_all, materials, meshes, settings_of_scenes

import vemcvx as vx
from properties.rounding import EPS, Energy, majorant
from vemcvx.scene import pose_scene
from vemcvx.vem import Space
from vemcvx.vem.elasticity import rigid_modes

CELL = 64
"""Bound on the number of rounding errors in an entry of a local matrix."""


@for_all(mesh=meshes(), data=st.data(), kind=st.sampled_from(("shear", "unit")))
def stiffness_has_the_rigid_motions_as_kernel(mesh, data, kind):
    """The stiffness matrix A is exactly symmetric, zero on rigid motions R, and positive on all other motions.

    Entries have errors of at most CELL eps M_ij with M = `majorant(A)`. A product with R adds one rounding error per
    summand. For D^{-1/2} A D^{-1/2}, where D is the diagonal of A, all entries of M are 1. For N nodes M has the norm
    2N, so eigenvalues have errors of at most (CELL + 2N) eps 2N.
    """
    material = data.draw(materials(mesh))
    material = vx.Elasticity(material.young, material.poisson, material.plane, kind)
    A = material.contribute(Space(mesh)).material.stiffness(Space(mesh)).toarray()
    assert np.array_equal(A, A.T)
    size = len(A)
    largest = np.where(A != 0, majorant(A), 0.0)
    R = rigid_modes(mesh.points)
    assert (np.abs(A @ R) <= (CELL + size) * EPS * largest @ np.abs(R)).all()
    root = 1 / np.sqrt(np.diagonal(A))
    eigenvalues = np.linalg.eigvalsh(root[:, None] * A * root)
    rounding = (CELL + size) * EPS * size
    assert (np.abs(eigenvalues[:3]) <= rounding).all()
    assert eigenvalues[3] > 10 * rounding


@dataclass(frozen=True)
class Motion:
    """A rotation or reflection x -> Q x of a body, with new numbers for its nodes and cells."""

    Q: np.ndarray
    nodes: np.ndarray
    """new number of each node"""
    cells: np.ndarray
    """old number of each new cell"""

    def mesh(self, mesh):
        """Return the moved mesh. A reflection reverses the order of vertices."""
        points = np.empty_like(mesh.points)
        points[self.nodes] = mesh.points @ self.Q.T
        turn = 1 if np.linalg.det(self.Q) > 0 else -1
        old = [self.nodes[mesh.cells[c]][::turn] for c in self.cells]
        names = {name: self.nodes[edges] for name, edges in mesh.boundaries.items() if name != "boundary"}
        return vx.PolygonMesh(points, [np.roll(cell, c) for c, cell in enumerate(old)], boundaries=names)

    def scene(self, setting):
        """Return the moved scene, with rotated forces."""
        Q = self.Q

        def rotate(force):
            return lambda x, t: force(x @ Q, t) @ Q.T

        effects = []
        for effect in setting.scene:
            if isinstance(effect, vx.Traction):
                effect = vx.Traction(rotate(effect.force), on=effect.on)
            elif isinstance(effect, vx.BodyForce):
                effect = vx.BodyForce(rotate(effect.force))
            elif isinstance(effect, vx.TrescaFriction):
                bound = effect.bound
                effect = vx.TrescaFriction(lambda x, t, g=bound: g(x @ Q, t), effect.on, effect.quadrature)
            elif isinstance(effect, vx.Elasticity) and np.ndim(effect.young):
                effect = vx.Elasticity(effect.young[self.cells], effect.poisson, effect.plane)
            effects.append(effect)
        return vx.Scene(*effects)


ANGLES = st.one_of(st.just(0.0), st.floats(0, 2 * np.pi))


@for_all(setting=settings_of_scenes(), angle=ANGLES, mirror=st.booleans(), renumber=st.booleans(), seed=SEEDS)
def answers_move_with_the_body(setting, angle, mirror, renumber, seed):
    """Displacements obey u(Q x) = Q u(x) for every rotation or reflection Q and every numbering of nodes and cells.

    The coordinates Q x are rounded. In a cell of diameter h, the relative error is kappa eps with kappa = CELL / h.
    Rounding has two consequences, with M = `majorant(A)` and the slips s:

    - Elastic forces A u and loads f change by c = kappa eps (M|u| + |f|). Then u changes by |c|_{K^-1} in the energy
      norm, with the stiffness matrix K of the free unknowns.
    - Weights w change by kappa eps w. Multipliers times 1 - kappa eps are admissible for both bodies. With loss = sum
      w|s|, the gap grows by 2 kappa eps loss, and the error in the energy norm by sqrt(4 kappa eps loss).

    Steps do not enlarge earlier errors, so all errors add up.
    """
    rng, mesh = np.random.default_rng(seed), setting.mesh
    c, s = np.cos(angle), np.sin(angle)
    Q = np.array([[c, -s], [s, c]]) @ np.diag([-1.0 if mirror else 1.0, 1.0])
    nodes = rng.permutation(mesh.n_nodes) if renumber else np.arange(mesh.n_nodes)
    cells = rng.permutation(mesh.n_cells) if renumber else np.arange(mesh.n_cells)
    move, options = Motion(Q, nodes, cells), {"solver": vx.Newton(accuracy=1e-9), "check": False}
    here = vx.simulate(setting.scene, mesh, setting.times, **options)
    there = vx.simulate(move.scene(setting), move.mesh(mesh), setting.times, **options)
    posed = pose_scene(setting.scene, mesh)
    P, A = posed.supports.P.toarray(), posed.A.toarray()
    energy = Energy(posed.system.K.toarray())
    shortest = np.linalg.norm(mesh.points[mesh.vertices] - mesh.points[np.roll(mesh.vertices, 1)], axis=1)
    kappa = CELL / min(shortest[shortest > 0].min(), np.sqrt(mesh.areas.min()))
    claimed = 0.0
    for n, t in enumerate(setting.times):
        u, back = here.displacement[n].ravel(), (there.displacement[n][nodes] @ Q).ravel()
        forces = np.abs(posed.force(t)) + majorant(A) @ (np.abs(u) + np.abs(back))
        claimed += energy.of_blurred_force(kappa * EPS * np.abs(P).T @ forces)
        if n:
            loss = (here.dissipated[n] - here.dissipated[n - 1]) + (there.dissipated[n] - there.dissipated[n - 1])
            claimed += np.sqrt(4 * kappa * EPS * loss)
            claimed += sum(np.sqrt(2 * h.trajectory.gap[n]) + np.sqrt(2 * h.trajectory.floor[n]) for h in (here, there))
        assert energy.norm(P.T @ (u - back)) <= claimed
    assert np.abs(here.contact.bound.sum() - there.contact.bound.sum()) <= kappa * EPS * here.contact.bound.sum()
