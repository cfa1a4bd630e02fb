"""Contact and friction on polyhedra: edges and corners, wear, and an independent program."""

import cvxpy as cp
import numpy as np
import pytest
import skfem
from skfem.models.elasticity import linear_elasticity

import vemcvx as vx

BOX = ((0.0, 1.0), (0.0, 1.2), (0.0, 0.9))


def test_contact_holds_every_normal_at_edges_and_corners():
    """A cube in a corner slides along walls and edges. The corner node is fixed."""
    mesh = vx.meshes.cubes(2)
    walls = ["left", "front", "bottom"]
    scene = vx.Scene(
        vx.Elasticity(1.0, 0.3),
        vx.BilateralContact(on=walls),
        vx.TrescaFriction(1e-3, on=walls),
        vx.Traction(lambda x, t: [0.1 * t, 0.05 * t, 0.0], on="top"),
        vx.Pressure(lambda x, t: -0.2 * t, on="right"),
    )
    history = vx.simulate(scene, mesh, np.linspace(0, 1, 3))
    u, slip = history.displacement[-1], history.contact.slip[-1]
    on = np.isclose(mesh.points, 0.0)
    assert np.abs(u[on]).max() < 1e-14
    free = ~on & (on.sum(axis=1) > 0)[:, None]
    assert np.abs(u[free]).min() > 1e-4
    assert np.array_equal(history.contact.nodes, np.flatnonzero((on.sum(axis=1) > 0) & (on.sum(axis=1) < 3)))
    assert slip == pytest.approx(u[history.contact.nodes], abs=1e-14)
    # Dissipation is the bound times slip, summed over walls.
    lengths = history.contact.friction_lengths
    moved = np.linalg.norm(np.diff(history.contact.slip, axis=0), axis=2)
    assert history.dissipated[-1] == pytest.approx(1e-3 * (moved @ lengths).sum(), rel=1e-6)


class Independent:
    """A block of linear tetrahedra in scikit-fem. cvxpy minimises the energy of a step over all unknowns."""

    def __init__(self, mesh, lam, mu):
        cells = mesh.cell_nodes[1].reshape(-1, 4)
        solid = skfem.MeshTet(mesh.points.T.copy(), cells.T.copy())
        basis = skfem.Basis(solid, skfem.ElementVector(skfem.ElementTetP1()))
        order = basis.nodal_dofs.T.ravel()
        self.K = linear_elasticity(lam, mu).assemble(basis)[order][:, order]
        self.points, z = mesh.points, mesh.points[:, 2]
        self.bottom, self.top = np.flatnonzero(z == z.min()), np.flatnonzero(z == z.max())
        facets = solid.facets[:, solid.boundary_facets()]
        under = facets[:, (z[facets] == z.min()).all(axis=0)]
        a, b, c = (self.points[corner, :2] for corner in under)
        area = 0.5 * np.abs(np.linalg.det(np.stack([b - a, c - a], axis=1)))
        self.area = np.bincount(under.ravel(), np.tile(area / 3, 3), len(z))[self.bottom]

    def step(self, previous, moved, gap, bound):
        u = cp.Variable(self.points.shape)
        slip = u[self.bottom, :2] - previous[self.bottom, :2]
        stored = 0.5 * cp.quad_form(cp.vec(u, order="C"), cp.psd_wrap(self.K))
        rubbed = cp.sum(cp.multiply(bound * self.area, cp.norm(slip, axis=1)))
        limits = [u[self.top] == moved, -u[self.bottom, 2] <= gap]
        problem = cp.Problem(cp.Minimize(stored + rubbed), limits)
        problem.solve(solver="CLARABEL", tol_gap_abs=1e-13, tol_gap_rel=1e-13, tol_feas=1e-13)
        return u.value


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:Solution may be inaccurate")
def test_a_block_agrees_with_scikit_fem_and_cvxpy():
    mesh, E, nu = vx.meshes.tetrahedra(3, BOX), 200.0, 0.3
    lam, mu = E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))
    x, bound = mesh.points, 3.0

    def top(x, t):
        return np.column_stack([0.08 * np.sin(t) - 0.09 * t * x[:, 1], 0.06 * t * x[:, 0], 0.02 * t * x[:, 0] - 0.03])

    def gap(x, t=0.0):
        return 0.02 * x[:, 1] ** 2

    scene = vx.Scene(
        vx.Elasticity(E, nu),
        vx.PrescribedDisplacement(top, on="top"),
        vx.UnilateralContact(on="bottom", gap=gap),
        vx.TrescaFriction(bound, on="bottom", while_closed=False),
    )
    times = np.linspace(0, 1.5, 4)
    history = vx.simulate(scene, mesh, times, initial="settled")
    other = Independent(mesh, lam, mu)
    u = history.displacement[0]
    for t, found in zip(times[1:], history.displacement[1:], strict=True):
        u = other.step(u, top(x[other.top], t), gap(x[other.bottom]), bound)
        assert np.abs(found - u).max() < 1e-6 * np.abs(u).max()
    counts = history.contact.slip_count, history.contact.stick_count, history.contact.open_count
    assert all(count[1] > 0 for count in counts)
    # The error of an inexact answer is below its certificate.
    careless = vx.simulate(scene, mesh, times[:2], initial=history.displacement[0], solver=vx.Clarabel(accuracy=1e-2))
    apart = (careless.displacement[1] - history.displacement[1]).ravel()
    distance = np.sqrt(apart @ (other.K @ apart))
    assert 1e-9 < distance / np.sqrt(2 * history.energy[:2].max()) <= careless.certificate[1]
