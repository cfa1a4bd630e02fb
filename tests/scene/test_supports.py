"""Supports: what is held is held exactly, whatever its direction, order or neighbours."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest
from scenes import FAMILIES, few_families, paper_load, small

import vemcvx as vx
from vemcvx.effects import Friction, Support
from vemcvx.scene import pose_scene
from vemcvx.scene.supports import resolve

TIMES = np.linspace(0.0, 1.0, 9)
EPS = np.finfo(float).eps
STEEL = vx.Elasticity(young=200.0, poisson=0.3)


def course(t):
    return np.sin(6 * t)


def turn(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s], [s, c]])


def moved(mesh, matrix, node=None, cell=None):
    """The mesh turned, its nodes and cells renumbered; boundaries and their names stay."""
    node = np.arange(mesh.n_nodes) if node is None else node
    cell = np.arange(mesh.n_cells) if cell is None else cell
    number = np.argsort(node)
    # Cells also begin at another of their vertices.
    cells = [np.roll(number[mesh.cells[c]], c % 3) for c in cell]
    names = {name: number[edges] for name, edges in mesh.boundaries.items() if name != "boundary"}
    return vx.PolygonMesh((mesh.points @ matrix.T)[node], cells, boundaries=names)


def paper(matrix):
    """The paper's scene on a body turned by `matrix`."""

    def pull(x, t):
        return paper_load(course)(x @ matrix, t) @ matrix.T

    return vx.Scene(
        STEEL,
        vx.Clamp(on="right"),
        vx.Traction(pull, on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=4.0, on="bottom"),
    )


def held_by(history, name, direction):
    """u . direction (S, m) at the nodes of a boundary."""
    nodes = np.unique(history.mesh.boundaries[name])
    return history.displacement[:, nodes] @ np.asarray(direction)


@pytest.mark.long
@few_families
@pytest.mark.parametrize("degrees", [30.0, 90.0, -135.0])
def test_inclined_contact_is_level_contact_turned(family, degrees):
    """Nothing knows the axes. Turning rounds coordinates by eps, which K^{-1} amplifies: cond(K) < 1e4."""
    mesh, R = small(family, 4), turn(degrees)
    level = vx.simulate(paper(np.eye(2)), mesh, TIMES)
    inclined = vx.simulate(paper(R), moved(mesh, R), TIMES)
    assert level.contact.sticking[1:].any()
    assert not level.contact.sticking.all()
    tolerance = 1e-10
    for name in ("energy", "dissipated", "work"):
        one, two = getattr(level, name), getattr(inclined, name)
        assert np.abs(one - two).max() < tolerance * np.abs(one).max(), name
    for name in ("slip", "traction"):
        one, two = getattr(level.contact, name), getattr(inclined.contact, name)
        assert np.abs(one @ R.T - two).max() < tolerance * np.abs(one).max(), name
    assert np.abs(level.contact.pressure - inclined.contact.pressure).max() < tolerance * 200
    assert np.array_equal(level.contact.sticking, inclined.contact.sticking)
    assert np.abs(level.displacement @ R.T - inclined.displacement).max() < tolerance * np.abs(level.displacement).max()
    # Contact holds to the rounding of one product, not to that of the solve.
    assert np.abs(held_by(inclined, "bottom", R @ [0, -1])).max() < 4 * EPS * np.abs(inclined.displacement).max()


@pytest.mark.long
@pytest.mark.parametrize("family", FAMILIES)
def test_numbering_changes_nothing(family):
    mesh, R = small(family, 4), turn(30.0)
    rng = np.random.default_rng(0)
    node, cell = rng.permutation(mesh.n_nodes), rng.permutation(mesh.n_cells)
    one = vx.simulate(paper(R), moved(mesh, R), TIMES)
    two = vx.simulate(paper(R), moved(mesh, R, node, cell), TIMES)
    # Sums run in another order; the factorisation too: eps times cond(K) < 1e4.
    assert np.abs(two.displacement - one.displacement[:, node]).max() < 1e-11 * np.abs(one.displacement).max()
    assert np.abs(two.energy - one.energy).max() < 1e-11 * one.energy.max()
    back = np.argsort(node[two.contact.nodes])
    assert np.array_equal(node[two.contact.nodes][back], one.contact.nodes)
    assert np.array_equal(two.contact.sticking[:, back], one.contact.sticking)
    assert np.abs(two.reaction("right") - one.reaction("right")).max() < 1e-10 * np.abs(one.reaction("right")).max()


@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_a_corner_of_the_contact_boundary_holds_both_normals(degrees):
    R = turn(degrees)
    mesh = moved(small("squares", 4), R)
    scene = vx.Scene(
        STEEL,
        vx.BilateralContact(on=["bottom", "right"]),
        vx.TrescaFriction(bound=0.5, on=["bottom", "right"]),
        vx.Traction(lambda x, t: np.tile(t * np.array([3.0, -5.0]) @ R.T, (len(x), 1)), on=["left", "top"]),
    )
    history = vx.simulate(scene, mesh, TIMES)
    size = np.abs(history.displacement).max()
    assert np.abs(held_by(history, "bottom", R @ [0, -1])).max() < 4 * EPS * size
    assert np.abs(held_by(history, "right", R @ [1, 0])).max() < 4 * EPS * size
    (corner,) = np.intersect1d(mesh.boundaries["bottom"], mesh.boundaries["right"])
    # Not one digit, not even rounding: the corner is no unknown, and no place where anything could slip.
    assert np.array_equal(history.displacement[:, corner], np.zeros((len(TIMES), 2)))
    assert corner not in history.contact.nodes
    assert len(history.contact.nodes) == 8
    # The ends of the contact boundary belong to it with half a cell, and do slide.
    assert np.abs(history.contact.slip[-1]).max(axis=1).min() > 1e-6 * size


@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_a_clamp_wins_at_shared_nodes(degrees):
    R = turn(degrees)
    mesh = moved(small("squares", 4), R)
    history = vx.simulate(paper(R), mesh, TIMES)
    assert np.array_equal(held_by(history, "right", np.eye(2)), np.zeros((len(TIMES), 5, 2)))
    shared = np.intersect1d(mesh.boundaries["bottom"], mesh.boundaries["right"])
    assert len(history.contact.nodes) == 4
    assert not np.isin(shared, history.contact.nodes).any()


@pytest.mark.long
@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_a_prescribed_normal_wins_over_contact_and_leaves_friction(degrees):
    """An obstacle that moves: u . n is prescribed on the contact boundary itself."""
    R = turn(degrees)
    mesh = moved(small("squares", 4), R)

    def sink(x, t):
        return 0.01 * t * (1 + (x @ R)[:, 0])

    base = list(paper(R).effects)
    history = vx.simulate(vx.Scene(*base), mesh, TIMES)
    lowered = [vx.Clamp(on="top") if isinstance(e, vx.Clamp) else e for e in base]
    driven = vx.simulate(
        vx.Scene(*lowered, vx.PrescribedDisplacement(sink, on="bottom", direction="normal")), mesh, TIMES
    )
    nodes = np.unique(mesh.boundaries["bottom"])
    wanted = np.array([sink(mesh.points[nodes], t) for t in TIMES])
    assert np.abs(held_by(driven, "bottom", R @ [0, -1]) - wanted).max() < 8 * EPS * wanted.max()
    assert len(driven.contact.nodes) == 5
    # The slip is tangential, the traction within its bound, and the obstacle pulls: it moves away from the body.
    assert np.abs(driven.contact.slip @ (R @ [0, -1])).max() < 8 * EPS * wanted.max()
    assert (np.linalg.norm(driven.contact.traction, axis=2) <= 4.0 * (1 + 4 * EPS)).all()
    assert driven.contact.pressure[-1].mean() < 0
    assert np.abs(history.contact.slip).max() > 0


def test_contact_gives_way_where_everything_is_prescribed():
    """A clamped part that moves drags its end of the contact boundary off the obstacle."""
    mesh = small("squares", 4)

    def lift(x, t):
        return np.tile([0.0, 0.1 * t], (len(x), 1))

    scene = vx.Scene(STEEL, vx.PrescribedDisplacement(lift, on="right"), vx.BilateralContact(on="bottom"))
    history = vx.simulate(scene, mesh, TIMES)
    assert np.abs(held_by(history, "right", [0, 1]) - 0.1 * TIMES[:, None]).max() <= EPS
    others = np.setdiff1d(mesh.boundaries["bottom"], mesh.boundaries["right"])
    assert not history.displacement[:, others, 1].any()


@pytest.mark.parametrize(
    ("direction", "unit"),
    [
        ("normal", (0, -1)),
        ("tangent", (1, 0)),
        ((3.0, 4.0), (0.6, 0.8)),
        ([-1e200, 0.0], (-1, 0)),
        ((0, 1e-200), (0, 1)),
    ],
    ids=str,
)
@pytest.mark.parametrize("degrees", [0.0, 30.0])
def test_one_component_is_prescribed_and_the_other_is_free(direction, unit, degrees):
    R = turn(degrees)
    mesh = moved(small("voronoi", 3), R)
    given = direction if isinstance(direction, str) else tuple(R @ np.array(direction))

    def value(x, t):
        return 0.02 * t * (2 - (x @ R)[:, 0])

    scene = vx.Scene(STEEL, vx.Clamp(on="top"), vx.PrescribedDisplacement(value, on="bottom", direction=given))
    history = vx.simulate(scene, mesh, TIMES)
    nodes = np.unique(mesh.boundaries["bottom"])
    wanted = np.array([value(mesh.points[nodes], t) for t in TIMES])
    along = R @ np.array(unit, dtype=float)
    assert np.abs(held_by(history, "bottom", along) - wanted).max() < 8 * EPS * wanted.max()
    across = held_by(history, "bottom", turn(90) @ along)
    assert np.abs(across[-1]).max() > 1e-3 * wanted.max()
    # Nobody pushes across: what the support exerts is along its direction, to the rounding of K u.
    forces = history.forces[:, nodes]
    assert np.abs(forces @ (turn(90) @ along)).max() < 1e-12 * np.abs(forces).max()


@pytest.mark.long
def test_the_same_prescribed_twice_is_no_contradiction():
    mesh = small("squares", 3)

    def value(x, t):
        return 0.01 * t * np.column_stack([np.ones(len(x)), x[:, 0]])

    whole = vx.PrescribedDisplacement(value, on="bottom")
    again = vx.PrescribedDisplacement(lambda x, t: value(x, t) @ [0.6, 0.8], on="bottom", direction=(3, 4))
    base = (STEEL, vx.Clamp(on="top"), whole)
    once, twice = (vx.simulate(vx.Scene(*base, *more), mesh, TIMES) for more in ((), (again,)))
    assert np.abs(once.displacement - twice.displacement).max() <= 4 * EPS * 0.01
    wrong = vx.PrescribedDisplacement(lambda x, t: value(x, t) @ [0.6, 0.8] + 1e-8 * t, on="bottom", direction=(3, 4))
    with pytest.raises(vx.SceneError, match="other supports already move it"):
        vx.simulate(vx.Scene(*base, wrong), mesh, TIMES)


@pytest.mark.parametrize("dim", [2, 3])
@pytest.mark.parametrize("seed", range(4))
def test_frames_are_orthonormal_and_obey_every_support(dim, seed):
    """u = P y + u_D(t): P'P = I, u_D orthogonal to P's range, and d . u = value for all y; in any dimension."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(30, dim))

    field = rng.normal(size=points.shape)

    def rows(m, among, contact):
        nodes = rng.choice(among, size=m, replace=not contact)
        directions = rng.normal(size=(m, dim))
        directions[rng.random(m) < 0.4] = np.eye(dim)[0]
        directions /= np.linalg.norm(directions, axis=1)[:, None]
        # One motion gives every row its value: no contradiction, however many rows a node has.
        values = np.einsum("ij,ij->i", directions, field[nodes])
        return Support("test", nodes, directions, points[nodes], None if contact else lambda t: t * values, contact)

    prescribed, contact = rows(40, 20, False), rows(15, 30, True)
    normals = rng.normal(size=(15, dim))
    normals /= np.linalg.norm(normals, axis=1)[:, None]
    friction = Friction("test", rng.choice(30, 15, replace=False), normals, np.ones(15), lambda t: np.ones(15))
    supports = resolve([contact, prescribed], [friction], points)
    P, n = supports.P, supports.P.shape[1]
    # Gram-Schmidt on directions at an angle s loses eps / s, and values reached through it as much; here s > 1e-3.
    tight = 1e-12
    assert np.abs((P.T @ P).toarray() - np.eye(n)).max() < tight
    free = np.zeros(30, dtype=int)
    np.add.at(free, supports.owner, 1)
    for i in range(30):
        first, second = prescribed.directions[prescribed.nodes == i], contact.directions[contact.nodes == i]
        held = np.concatenate([first, second])
        assert free[i] == dim - (np.linalg.matrix_rank(held, tol=1e-6) if len(held) else 0)
    for t in (0.0, 0.7):
        motion = supports.motion(t)
        assert np.abs(P.T @ motion).max() < tight * 10
        u = (P @ rng.normal(size=n) + motion).reshape(points.shape)
        reached = np.einsum("ij,ij->i", prescribed.directions, u[prescribed.nodes])
        assert np.abs(reached - prescribed.value(t)).max() < tight * 10
        # Contact holds its normal to zero, unless what is prescribed at its node already moves it.
        for node, normal in zip(contact.nodes, contact.directions, strict=True):
            before = prescribed.directions[prescribed.nodes == node]
            if np.linalg.matrix_rank(np.vstack([before, normal]), tol=1e-6) > (
                len(before) and np.linalg.matrix_rank(before)
            ):
                assert abs(normal @ u[node]) < tight * 10
    assert 0 < len(np.setdiff1d(contact.nodes, prescribed.nodes)) < len(contact.nodes)


@pytest.mark.filterwarnings("ignore:.*nothing holds the body in the normal direction")
@pytest.mark.parametrize("family", FAMILIES)
@pytest.mark.parametrize("degrees", [0.0, 30.0])
@pytest.mark.parametrize("surface", ["contact", "part of the contact", "no contact"])
def test_every_friction_term_reads_one_unknown_of_its_own(family, degrees, surface):
    """Sticking is then exact; also on an incline, where the tangent is no axis."""
    R = turn(degrees)
    mesh = moved(small(family, 4), R)
    # Its normals are averaged over fewer edges than those of the contact, and differ from them by rounding.
    mesh = mesh.with_boundary("rough", lambda x: (np.abs((x @ R)[:, 1]) < 1e-9) & ((x @ R)[:, 0] < 0.6))
    on = "rough" if surface == "part of the contact" else "bottom"
    contact = [] if surface == "no contact" else [vx.BilateralContact(on="bottom")]
    posed = pose_scene(vx.Scene(STEEL, vx.Clamp(on="top"), *contact, vx.TrescaFriction(4.0, on=on)), mesh)
    B = posed.system.norms.B
    assert B.shape[0] == len(np.unique(mesh.boundaries[on]))
    assert np.array_equal(np.diff(B.indptr), np.ones(B.shape[0]))
    assert len(np.unique(B.indices)) == B.shape[0]
    assert np.array_equal(np.abs(B.data), np.ones(B.shape[0]))
    assert (posed.system.K - posed.system.K.T).nnz == 0


def test_a_body_held_everywhere_has_nothing_to_solve_for():
    history = vx.simulate(
        vx.Scene(STEEL, vx.PrescribedDisplacement(lambda x, t: t * x, on="boundary")), small("squares", 1), TIMES
    )
    assert np.array_equal(history.displacement, TIMES[:, None, None] * history.mesh.points)
    assert not history.certificate.any()
    # u = t x: 1/2 a(u, u) = 1/2 t^2 (2 mu 2 + lam 4) on the unit square.
    lam, mu = history.moduli[:, 0]
    assert history.energy == pytest.approx(0.5 * TIMES**2 * (4 * mu + 4 * lam), rel=1e-14)


def test_a_motion_is_asked_for_a_few_times_an_instant():
    """Twelve times, once; what is known of an instant serves loads, friction, obstacles and the ledger."""
    asked = Counter()

    def move(x, t):
        asked[float(t)] += 1
        return np.tile([0.03 * np.sin(6 * t), -0.02 * t], (len(x), 1))

    moved = vx.PrescribedDisplacement(move, on="top")
    scene = vx.Scene(STEEL, moved, vx.UnilateralContact(on="bottom"), vx.TrescaFriction(0.1, on="bottom"))
    vx.simulate(scene, small("squares", 3), np.linspace(0, 1, 6))
    assert len(asked) == 6
    assert max(asked.values()) <= 4
