"""Discs of friction on polyhedra: circular hysteresis, tangents on which nothing depends, edges, another program."""

from __future__ import annotations

import cvxpy as cp
import numpy as np
import pytest
import skfem
from hysteresis_in_space import BOUND, BOX, MU, REACH, SIZE, Turn, circle, curve
from skfem.models.elasticity import linear_elasticity
from solids import SOLIDS, solid

import vemcvx as vx
from vemcvx.vem import tangents_of

AREA, HEIGHT = SIZE[0] * SIZE[1], SIZE[2]
SHARP = vx.Newton(accuracy=1e-11)


def block(family, n=2):
    return solid(family, n, BOX)


@pytest.mark.long
@pytest.mark.parametrize("family", SOLIDS)
def test_hysteresis_along_a_curve_is_exact_step_by_step(family):
    mesh, path = block(family), curve()
    history = vx.simulate(path.scene(), mesh, path.times, solver=SHARP)
    exact, contact = path.displacement(mesh.points), history.contact
    assert np.abs(history.displacement - exact).max() < 1e-9 * np.abs(exact).max()
    assert np.abs(contact.slip[:, :, :2] - path.foot[:, None]).max() < 1e-9 * np.abs(path.foot).max()
    # The body drags the table along gamma, the table holds it back.
    assert np.abs(contact.traction[:, :, :2] + MU * path.shear[:, None]).max() < 1e-9 * BOUND
    assert np.abs(contact.slip[:, :, 2]).max() < 1e-14
    stuck = np.append(True, np.linalg.norm(np.diff(path.foot, axis=0), axis=1) < 1e-12)
    assert 1 < stuck.sum() < len(stuck) - 1
    assert np.array_equal(contact.sticking, np.repeat(stuck[:, None], len(contact.nodes), axis=1))
    assert contact.lengths.sum() == pytest.approx(AREA, rel=1e-13)
    loss = BOUND * AREA * np.linalg.norm(np.diff(path.foot, axis=0), axis=1).cumsum()
    assert history.dissipated[1:] == pytest.approx(loss, rel=1e-9)
    assert contact.wear[-1] == pytest.approx(loss[-1] / AREA, rel=1e-9)
    sigma = np.zeros((mesh.n_cells, 6))
    sigma[:, 4], sigma[:, 5] = MU * path.shear[-1, 1], MU * path.shear[-1, 0]
    assert np.abs(history.stress(-1) - sigma).max() < 1e-9 * BOUND
    assert history.certificate.max() < 1e-9


@pytest.mark.parametrize("steps", [5, 12])
def test_a_turn_of_steady_sliding_dissipates_what_the_closed_form_says(steps):
    radius = 2.5 * REACH
    path, loss = circle(steps, radius)
    mesh = block("tetrahedra")
    history = vx.simulate(path.scene(), mesh, path.times, initial=path.displacement(mesh.points)[0], solver=SHARP)
    assert not history.contact.sticking[1:].any()
    assert history.dissipated[-1] == pytest.approx(loss, rel=1e-9)
    # As steps shrink, the foot goes round the circle that lags behind by a right triangle; the difference is O(delta).
    assert loss == pytest.approx(2 * np.pi * BOUND * AREA * np.sqrt(radius**2 - REACH**2), rel=np.pi / steps)


def test_ground_that_moves_in_a_curve_drags_the_block_likewise():
    """The lid stands still, the table moves the other way: shear, slip on the table and loss are those of the block."""
    mesh, path = block("hanging faces"), curve()
    still = Turn(np.zeros_like(path.top), -HEIGHT * path.shear)

    def table(x, t):
        return [*-path.top[round(t)], 0.0]

    history = vx.simulate(
        still.scene(vx.TrescaFriction(BOUND, on="bottom", ground=table)), mesh, path.times, solver=SHARP
    )
    exact = still.displacement(mesh.points)
    assert np.abs(history.displacement - exact).max() < 1e-9 * np.abs(exact).max()
    assert np.abs(history.contact.slip[:, :, :2] - path.foot[:, None]).max() < 1e-9 * np.abs(path.foot).max()
    loss = BOUND * AREA * np.linalg.norm(np.diff(path.foot, axis=0), axis=1).sum()
    assert history.dissipated[-1] == pytest.approx(loss, rel=1e-9)


@pytest.mark.long
def test_a_block_that_is_turned_in_space_answers_turned():
    mesh, path = block("voronoi3"), curve()
    axes = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    axes *= np.sign(np.linalg.det(axes))
    faces = mesh.face_offsets, mesh.face_vertices, mesh.cell_offsets, mesh.cell_faces, mesh.face_cells
    turned = vx.PolyhedralMesh.unchecked(mesh.points @ axes.T, *faces)
    named = {name: part for name, part in mesh.boundaries.items() if name != "boundary"}
    history = vx.simulate(path.scene(axes=axes), turned.with_boundaries(named), path.times, solver=SHARP)
    exact = path.displacement(mesh.points) @ axes.T
    assert np.abs(history.displacement - exact).max() < 1e-9 * np.abs(exact).max()


def rubbed(mesh):
    """A block pressed onto a table with a hollow, twisted and dragged: places stick, slip, turn and open."""

    def top(x, t):
        turn = 0.08 * np.sin(2 * t)
        return np.column_stack(
            [0.03 * np.sin(t) - turn * (x[:, 1] - 0.4), turn * (x[:, 0] - 0.6), 0 * t * x[:, 0] - 0.02]
        )

    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(top, on="top"),
        vx.UnilateralContact(on="bottom", gap=lambda x, t: 0.03 * x[:, 0] ** 2),
        vx.CoulombFriction(0.4, on="bottom"),
    )
    return vx.simulate(scene, mesh, np.linspace(0, 2, 5), initial="settled", solver=SHARP)


@pytest.mark.long
def test_nothing_depends_on_which_tangents_are_taken(monkeypatch):
    """Every normal gets its own angle by which its tangents are turned."""
    mesh = block("prisms", 3)
    before = rubbed(mesh)

    def turned(normals):
        first, second = tangents_of(normals).swapaxes(0, 1)
        angle = 1.0 + np.arange(len(normals))
        c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
        return np.stack([c * first + s * second, c * second - s * first], axis=1)

    for module in ("scene.contact", "scene.supports", "vem"):
        monkeypatch.setattr(f"vemcvx.{module}.tangents_of", turned)
    after = rubbed(mesh)
    assert not np.allclose(before.trajectory.multipliers, after.trajectory.multipliers)
    assert 0 < before.contact.slip_count[-1] < len(before.contact.nodes)
    assert before.contact.open_count[-1] > 0
    for name in ("displacement", "forces", "energy", "work", "dissipated"):
        one, other = getattr(before, name), getattr(after, name)
        assert np.abs(one - other).max() < 1e-10 * np.abs(one).max(), name
    for name in ("slip", "traction", "pressure", "wear", "bound"):
        one, other = getattr(before.contact, name), getattr(after.contact, name)
        assert np.abs(one - other).max() < 1e-10 * np.abs(one).max(), name
    assert np.array_equal(before.contact.sticking, after.contact.sticking)


def test_at_edges_and_corners_of_contact_every_normal_holds():
    """A cube in a corner: nodes of one wall slide along it, those of two along their edge, that of three is held."""
    mesh = vx.meshes.cubes(2)
    walls = ["left", "front", "bottom"]
    scene = vx.Scene(
        vx.Elasticity(1.0, 0.3),
        vx.BilateralContact(on=walls),
        vx.TrescaFriction(1e-3, on=walls),
        vx.Traction(lambda x, t: np.tile([0.1 * t, 0.05 * t, 0.0], (len(x), 1)), on="top"),
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
    # What friction takes is the bound times the slip on each wall; both walls of an edge count.
    lengths = history.contact.friction_lengths
    moved = np.linalg.norm(np.diff(history.contact.slip, axis=0), axis=2)
    assert history.dissipated[-1] == pytest.approx(1e-3 * (moved @ lengths).sum(), rel=1e-6)


class Independent:
    """The same block of linear tetrahedra in scikit-fem, a step as one program of all its unknowns in cvxpy."""

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
def test_agrees_with_the_full_size_program_of_scikit_fem_cvxpy_and_clarabel():
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
    # A careless answer is no further away than its certificate says.
    careless = vx.simulate(scene, mesh, times[:2], initial=history.displacement[0], solver=vx.Clarabel(accuracy=1e-2))
    apart = (careless.displacement[1] - history.displacement[1]).ravel()
    distance = np.sqrt(apart @ (other.K @ apart))
    assert 1e-9 < distance / np.sqrt(2 * history.energy[:2].max()) <= careless.certificate[1]


LOADS = {
    "monotone": lambda t: (0.06 * t, 0.02 * t),
    "cyclic": lambda t: (0.05 * np.sin(3 * t), 0.02 * np.sin(3 * t)),
    "turning": lambda t: (0.05 * np.sin(2 * t), 0.05 - 0.05 * np.cos(2 * t)),
}


def agree(family, load):
    """A block with a stressed lid, pressed, twisted and dragged, by Newton and by Clarabel: their answers' distance."""
    move = LOADS[load]

    def top(x, t):
        turned = 0.03 * t * np.column_stack([0.6 - x[:, 1], x[:, 0] - 0.5, np.zeros(len(x))])
        return turned + np.array([*move(t), -0.01 * t])

    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(top, on="top"),
        vx.UnilateralContact(on="bottom", gap=lambda x, t: 0.004 * x[:, 0] ** 2),
        vx.TrescaFriction(lambda x, t: 2.0 + x[:, 1], on="bottom", while_closed=False),
    )
    mesh, times = block(family), np.linspace(0.0, 2.0, 5)
    newton = vx.simulate(scene, mesh, times)
    conic = vx.simulate(scene, mesh, times, solver=vx.Clarabel())
    assert newton.certificate.max() < 1e-8
    assert conic.certificate.max() < 1e-6
    # Each bounds its own distance to the exact answer, step after step, relative to the largest energy norm so far.
    K = newton.program(1, condense=False).operators.K
    apart = newton.trajectory.state - conic.trajectory.state
    norm = np.sqrt(np.maximum.accumulate(2 * np.maximum(newton.energy, conic.energy)))
    distance = np.sqrt(np.einsum("si,si->s", apart, (K @ apart.T).T))
    allowed = (newton.certificate_total + conic.certificate_total) * norm
    assert (distance <= allowed + 1e-13 * norm).all()
    assert distance[-1] > 0.0
    assert newton.contact.slip_count[-1] > 0


def test_wear_is_traction_times_slip_but_at_edges_times_displacement():
    """There friction acts in two planes, and slip is but the part across their mean normal."""
    mesh, sides = vx.meshes.cubes(2), ["bottom", "left"]
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: [0.1 * t, 0.07 * t, 0.12 * t], on="right"),
        vx.TrescaFriction(1.0, on=sides),
        vx.UnilateralContact(on=sides),
    )
    history = vx.simulate(scene, mesh, [0.0, 1.0], solver=SHARP)
    contact = history.contact
    moved = history.displacement[1, contact.nodes]
    along = [-np.einsum("md,md->m", contact.traction[1], way) for way in (contact.slip[1], moved)]
    edge = np.abs(contact.normals).max(axis=1) < 0.9
    assert 0 < edge.sum() < len(edge)
    assert (contact.wear[1] > 0).all()
    assert along[1] == pytest.approx(contact.wear[1], rel=1e-9)
    assert along[0][~edge] == pytest.approx(contact.wear[1, ~edge], rel=1e-9)
    assert (np.abs(along[0] - contact.wear[1])[edge] > 0.01 * contact.wear[1, edge]).all()
    out_of_plane = np.einsum("md,md->m", contact.traction[1], contact.normals)
    assert np.abs(out_of_plane[~edge]).max() < 1e-9


@pytest.mark.long
@pytest.mark.parametrize("size", [1.0, 1000.0])
def test_a_gap_that_is_negative_by_rounding_alone_is_none(size):
    """What coordinates are rounded by, size EPS, is nothing to refuse a body for; a hundred times that is."""
    mesh = vx.meshes.cubes(2, box=((0, size),) * 3)

    def run(gap):
        scene = vx.Scene(
            vx.Elasticity(200.0, 0.3),
            vx.UnilateralContact(on="bottom", gap=lambda x, t: gap + 0 * x[:, 0]),
            vx.PrescribedDisplacement(lambda x, t: [0.0, 0.0, -0.01 * size * t], on="top"),
        )
        return vx.simulate(scene, mesh, [0.0, 1.0])

    eps = np.finfo(float).eps
    for gap in (-1e-17, -size * eps):
        assert np.array_equal(run(gap).displacement, run(0.0).displacement)
    with pytest.raises(vx.SceneError, match="inside its obstacle"):
        run(-100 * size * eps)


@pytest.mark.slow
@pytest.mark.parametrize("load", LOADS)
@pytest.mark.parametrize("family", SOLIDS)
def test_newton_and_clarabel_agree_within_their_certificates(family, load):
    agree(family, load)
