"""Where a linear solver holds K, the stiffness is made by rows, and neither of the two ever stands whole here."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp

import vemcvx as vx
from vemcvx.linear import Elsewhere, SuperLU, sizes
from vemcvx.linear import residual as residual_of
from vemcvx.scene import pose_scene
from vemcvx.testing.effects import mesh as cut_in_two
from vemcvx.vem import Space, SumOverCells

AT_A_TIME = 40


class InPieces(Elsewhere):
    """K as its rows were made, some at a time."""

    def __init__(self, made, n):
        self.shape, self.starts = (n, n), range(0, n, AT_A_TIME)
        self.pieces = [made(start, min(start + AT_A_TIME, n)) for start in self.starts]

    def whole(self):
        return sp.vstack(self.pieces, format="csr")

    def __matmul__(self, x):
        return np.concatenate([piece @ x for piece in self.pieces])

    def diagonal(self):
        own = zip(self.starts, self.pieces, strict=True)
        return np.concatenate([piece.diagonal(start) for start, piece in own])

    def sizes(self, x):
        return sizes(self.whole(), x)

    def residual(self, force, y, held):
        return residual_of(force, self.whole(), y, held)


class Holding(SuperLU):
    def held(self, made, n):
        return InPieces(made, n)


class Halves(vx.Stabilisation):
    def form(self, cells, C):
        return C[:, -1, -1, None, None] * np.eye(cells.nodes.shape[1])


def laws(space):
    moduli = ((3.0, 2.0, 1.0), (0.3, 0.2, 0.1), (1.0, 0.7, 0.5)) if space.dim == 3 else ((3.0, 2.0), 0.3, 1.0)
    return {
        "one": vx.Elasticity(3.0, 0.3),
        "varying": vx.Elasticity(lambda x: 1 + x[:, 0], 0.3),
        "orthotropic": vx.Orthotropic(*moduli, angle=lambda x: x[:, 0]),
        "stabilised by a class of one's own": vx.Elasticity(3.0, 0.3, stabilisation=Halves()),
        "of a part": vx.Elasticity(3.0, 0.3, on="west"),
    }


@pytest.mark.parametrize("family", ["squares", "triangles", "voronoi", "hexagons", "cubes", "tetrahedra", "voronoi3"])
def test_rows_are_those_of_the_whole_to_the_bit(family):
    space = Space(cut_in_two(family, 2 if family == "voronoi3" else 3))
    some = np.random.default_rng(0).permutation(space.n_unknowns)[:30]
    for law in laws(space).values():
        form = law.contribute(space).material.stiffness(space)
        whole = form.whole()
        for unknowns in (some, np.arange(30), some[:1]):
            rows, expected = form.rows(unknowns), whole[unknowns]
            for part in ("indptr", "indices", "data"):
                assert np.array_equal(getattr(rows, part), getattr(expected, part))


SPRUNG = vx.ElasticFoundation(normal=2.0, tangential=0.5, on="back")
MOVED = vx.PrescribedDisplacement(lambda x, t: np.tile([0.01 * t, 0.0, -0.02 * t], (len(x), 1)), on="right")
SCENE = vx.Scene(
    vx.Elasticity(200.0, 0.3, on="west"),
    vx.Elasticity(70.0, 0.2, on="east"),
    MOVED,
    SPRUNG,
    vx.Traction((0.1, 0.2, -0.3), on="top"),
    vx.BilateralContact(on="bottom"),
    vx.TrescaFriction(bound=1.0, on="bottom"),
)


def test_a_scene_whose_k_stands_elsewhere_is_the_same_and_nothing_of_it_stands_whole(monkeypatch):
    mesh, largest = cut_in_two("cubes", 5), [0]
    alone = pose_scene(SCENE, mesh)
    for kind in (sp.csr_matrix, sp.csc_matrix, sp.bsr_matrix, sp.csr_array, sp.csc_array, sp.bsr_array):

        def noted(self, *given, first=kind.__init__, **more):
            first(self, *given, **more)
            largest[0] = max(largest[0], self.nnz)

        monkeypatch.setattr(kind, "__init__", noted)
    posed = pose_scene(SCENE, mesh, linear=Holding())
    monkeypatch.undo()
    K, A = alone.system.K, alone.A
    assert 0 < largest[0] < 0.4 * K.nnz  # rows of two sides that are held, and these as columns, are most of it
    found = posed.system.K.whole()
    assert (found != K).nnz == 0
    assert found.nnz == K.nnz
    u = np.random.default_rng(0).normal(size=A.shape[0])
    assert np.abs(posed.A @ u - A @ u).max() < 1e-13 * np.abs(A).max() * np.abs(u).max()
    assert np.array_equal(posed.A.diagonal(), A.diagonal())
    for t in (0.3, 1.0):
        assert np.array_equal(posed.system.force(t), alone.system.force(t))
        apart = posed.system.motion.dirichlet_force(t) - alone.system.motion.dirichlet_force(t)
        assert not apart.any()


def test_springs_beside_a_material_are_rows_of_the_sum():
    mesh = cut_in_two("squares", 4)
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Clamp(on="top"),
        vx.ElasticFoundation(normal=2.0, tangential=0.5, on="bottom"),
    )
    alone, posed = pose_scene(scene, mesh), pose_scene(scene, mesh, linear=Holding())
    assert (posed.system.K.whole() != alone.system.K).nnz == 0


def test_nodes_without_cells_of_a_material_have_empty_rows():
    space = Space(cut_in_two("squares", 4))
    form = SumOverCells(space, None, np.arange(space.mesh.n_cells) == 0, ())
    far = 2 * int(np.argmax(space.mesh.points.sum(axis=1)))
    assert form.rows(np.array([far, far + 1])).nnz == 0
