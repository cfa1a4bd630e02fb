"""Contact between bodies: what passes through an interface of meshes that do not match, and what it does to both."""

import numpy as np
import pytest

import vemcvx as vx
from plate_with_hole import polar

FAMILIES = [name for name in vx.meshes.FAMILIES if name != "l_shape"]
JOINT = "lower|upper"
TURN = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]])
SHEAR, PRESS = 0.3, 1.0


def two_blocks(below, above, n=(2, 3), height=1.0):
    lower = vx.meshes.FAMILIES[below](n[0], box=((0, 1), (0, 1)))
    upper = vx.meshes.FAMILIES[above](n[1], box=((0, 1), (1, 1 + height)))
    return vx.meshes.bodies({"lower": lower, "upper": upper})


def turned(mesh, rotation):
    interfaces = dict(mesh.interfaces)
    return vx.PolygonMesh(mesh.points @ rotation.T, mesh.cells, interfaces=interfaces).with_boundary(
        "outside", lambda x: ~np.isclose((x @ rotation)[:, 1], 1.0)
    )


def linear(gradient):
    return lambda x, t: t * x @ gradient.T


def conforming_to(shear, rotation):
    """The gradient of a field with the pressure PRESS across the turned interface and some shear along it."""
    gradient = np.array([[0.02, 0.04 * shear], [0.01 * shear, -0.12]])
    return rotation @ gradient @ rotation.T


CONTACTS = {
    "bilateral": (vx.BilateralContact, None, 0.0),
    "unilateral": (vx.UnilateralContact, None, 0.0),
    "stuck": (vx.BilateralContact, vx.TrescaFriction(10.0, on=JOINT), 1.0),
    "stuck by Coulomb": (vx.UnilateralContact, vx.CoulombFriction(0.6, on=JOINT), 1.0),
}


def assert_patch(mesh, kind, rotation=TURN):
    contact, friction, shear = CONTACTS[kind]
    mesh = turned(mesh, rotation)
    gradient = conforming_to(shear, rotation)
    effects = [vx.Elasticity(10.0, 0.3), vx.PrescribedDisplacement(linear(gradient), on="outside"), contact(on=JOINT)]
    history = vx.simulate(vx.Scene(*effects, *([] if friction is None else [friction])), mesh, [0.0, 0.5, 1.0])
    assert np.abs(history.displacement[-1] - mesh.points @ gradient.T).max() < 1e-11
    stress = history.stress(-1)
    assert np.abs(stress - stress[0]).max() < 1e-11 * np.abs(stress).max() * mesh.n_nodes
    across = rotation @ [0, 1]
    sigma = np.array([[stress[0, 0], stress[0, 2]], [stress[0, 2], stress[0, 1]]])
    assert history.contact.pressure[-1] == pytest.approx(-across @ sigma @ across, rel=1e-10)
    traction = sigma @ across - (across @ sigma @ across) * across
    inner = np.setdiff1d(history.contact.nodes, mesh.boundaries["outside"])
    mine = np.isin(history.contact.nodes, inner)
    assert history.contact.traction[-1][mine] == pytest.approx(np.tile(traction, (mine.sum(), 1)), abs=1e-10)


@pytest.mark.parametrize("kind", CONTACTS)
@pytest.mark.parametrize("family", FAMILIES)
def test_constant_stress_passes(family, kind):
    other = FAMILIES[(FAMILIES.index(family) + 3) % len(FAMILIES)]
    assert_patch(two_blocks(family, other, (3, 2)), kind)


@pytest.mark.slow
@pytest.mark.parametrize("kind", CONTACTS)
@pytest.mark.parametrize("below", FAMILIES)
@pytest.mark.parametrize("above", FAMILIES)
def test_constant_stress_passes_between_all_families(below, above, kind):
    for n in ((7, 5), (1, 13)):
        assert_patch(two_blocks(below, above, n), kind)


SOLVERS = {"Newton": vx.Newton(), "Clarabel": vx.Clarabel(), "OSQP": vx.OSQP()}
YOUNG, POISSON, HEIGHTS, BOUND = (10.0, 30.0), 0.3, (1.0, 0.5), 1.0


def sheared(mesh, move, contact=vx.BilateralContact, bound=BOUND):
    """Two blocks in series, in simple shear: FORMULAS, two bodies."""
    sides = [f"{body}.{side}" for body in ("lower", "upper") for side in ("left", "right")]
    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON, on="lower"),
        vx.Elasticity(YOUNG[1], POISSON, on="upper"),
        vx.Clamp(on="lower.bottom"),
        vx.PrescribedDisplacement(lambda x, t: np.tile([move(t), 0.0], (len(x), 1)), on="upper.top"),
        vx.PrescribedDisplacement(0.0, on=sides, direction=(0, 1)),
        contact(on=JOINT),
        vx.TrescaFriction(bound, on=JOINT),
    )


def move(t):
    return 0.6 * np.sin(2 * np.pi * t)


def in_series(times):
    """Friction traction q and relative slip a at all instants: q_n = P((U_n - a_{n-1}) / C), radius g."""
    flexibility = sum(height * 2 * (1 + POISSON) / young for young, height in zip(YOUNG, HEIGHTS, strict=True))
    q, a = [0.0], [0.0]
    for t in times[1:]:
        q.append(np.clip((move(t) - a[-1]) / flexibility, -BOUND, BOUND))
        a.append(move(t) - q[-1] * flexibility)
    return np.array(q), np.array(a)


@pytest.mark.long
@pytest.mark.parametrize("family", FAMILIES)
def test_two_blocks_in_series_are_exact(family):
    times = np.linspace(0, 1.5, 19)
    mesh = two_blocks(family, FAMILIES[FAMILIES.index(family) - 2], height=HEIGHTS[1])
    contact = vx.simulate(sheared(mesh, move), mesh, times).contact
    q, a = in_series(times)
    assert np.abs(contact.traction[:, :, 0] - q[:, None]).max() < 1e-10
    assert np.abs(contact.slip[:, :, 0] + a[:, None]).max() < 1e-10
    wear = np.cumsum(BOUND * np.abs(np.diff(a, prepend=0.0)))
    assert np.abs(contact.wear - wear[:, None]).max() < 1e-10


def dragged_over(mesh):
    """The upper block is pressed by its weight, and pulled; nothing but the lower one holds it."""

    def pull(x, t):
        return np.tile([0.25 * t, 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(10.0, 0.3),
        vx.Clamp(on="lower.bottom"),
        vx.Pressure(lambda x, t: np.full(len(x), t), on="upper.top"),
        vx.Traction(pull, on="upper.left"),
        vx.UnilateralContact(on=JOINT),
        vx.CoulombFriction(0.5, on=JOINT),
    )


@pytest.mark.long
@pytest.mark.parametrize("solver", SOLVERS)
def test_solvers_agree_on_a_block_that_lies_on_another(solver):
    mesh = two_blocks("voronoi", "hexagons", (3, 4))
    history = vx.simulate(dragged_over(mesh), mesh, np.linspace(0, 1, 5), solver=SOLVERS[solver])
    other = vx.simulate(dragged_over(mesh), mesh, np.linspace(0, 1, 5), solver=vx.Newton(accuracy=1e-10))
    size = np.sqrt(2 * other.energy.max())
    # What the projection sees is at most the energy norm.
    distance = vx.measures.energy_distance(history, other).absolute
    assert distance <= (history.certificate_total[-1] + other.certificate_total[-1]) * size


def closing(mesh):
    """The upper block comes down on the lower one, whose face it meets in the middle first, and moves aside."""

    def moved(x, t):
        return np.tile([0.1 * t, -0.1 * t], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(10.0, 0.3),
        vx.Clamp(on="lower.bottom"),
        vx.PrescribedDisplacement(moved, on="upper.top"),
        vx.UnilateralContact(on=JOINT, gap=lambda x, t: 0.02 + 0.05 * (x[:, 0] - 0.5) ** 2),
        vx.CoulombFriction(0.3, on=JOINT),
    )


@pytest.mark.long
@pytest.mark.parametrize("solver", ["Clarabel", "OSQP"])
def test_solvers_agree_where_gaps_close_with_friction(solver):
    """Bounds d_i = e_i that are met exactly are met by y_n - y_{n-1}, too, which is d but for rounding."""
    mesh, times = two_blocks("voronoi", "hexagons", (3, 4)), np.linspace(0, 1, 5)
    history, other = (vx.simulate(closing(mesh), mesh, times, solver=one) for one in (SOLVERS[solver], vx.Newton()))
    assert history.certificate.max() < 1e-6
    assert 0 < history.contact.closed_count[1] < history.contact.closed_count[-1]
    size = np.sqrt(2 * other.energy.max())
    distance = vx.measures.energy_distance(history, other).absolute
    assert distance <= (history.certificate_total[-1] + other.certificate_total[-1]) * size


@pytest.mark.long
def test_a_solver_that_is_too_coarse_for_friction_is_told_so():
    """What slips and touches is known from its answers, and these come no nearer: that is no lack of contraction."""
    mesh = two_blocks("squares", "squares", (2, 3))
    coarse = vx.Clarabel(options=dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), 1e-3))
    with pytest.raises(vx.NotCertified, match=r"step 1 .*Clarabel reached .*asked was 1\.0e-06\. .*Ask for accuracy="):
        vx.simulate(closing(mesh), mesh, [0.0, 0.25], solver=coarse)


def test_the_axis_of_a_half_model_bears_its_pressure():
    mesh = two_blocks("triangles", "triangles", (4, 4))
    scene = vx.Scene(
        vx.Elasticity(100.0, 0.3),
        vx.Clamp(on="lower.bottom"),
        vx.Symmetry(on=["lower.left", "upper.left"]),
        vx.PrescribedDisplacement(lambda x, t: np.tile([0.0, -0.05 * t], (len(x), 1)), on="upper.top"),
        vx.BilateralContact(on=JOINT),
        vx.TrescaFriction(0.5, on=JOINT),
    )
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    contact = history.contact
    assert 0.0 in contact.points[:, 0]
    borne = (contact.pressure * contact.lengths).sum(axis=1)[-1]
    assert borne == pytest.approx(-history.reaction("upper.top")[-1, 1], rel=1e-10)


def turned_in(sides):
    """A ring turned inside another that is held, both with so many sides; only the contact joins them."""
    angles = np.linspace(0, 2 * np.pi, sides + 1)
    mesh = vx.meshes.bodies({"a": polar(np.array([1.0, 2.0]), angles), "b": polar(np.array([2.0, 3.0]), angles)})
    scene = vx.Scene(
        vx.Elasticity(1.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: 0.1 * t * np.column_stack([-x[:, 1], x[:, 0]]), on="a.inner"),
        vx.Clamp(on="b.outer"),
        vx.BilateralContact(on="a|b"),
    )
    return vx.simulate(scene, mesh, [0.0, 1.0])


def test_bodies_slide_along_a_curve():
    """Its nodes have the mean of the normals of their sides, and a motion along it meets no resistance."""
    history = turned_in(24)
    mesh, inside = history.mesh, history.mesh.cell_data["body"] == 0
    turned = 0.1 * np.column_stack([-mesh.points[:, 1], mesh.points[:, 0]])
    turned[np.unique(np.concatenate([cell for cell, mine in zip(mesh.cells, inside, strict=True) if not mine]))] = 0.0
    assert np.abs(history.displacement[-1] - turned).max() < 1e-13
    assert np.abs(history.contact.pressure).max() < 1e-13


def test_bodies_do_not_slide_around_corners():
    """Sides that turn by 45 degrees and more both hold: a square peg does not turn in a square hole."""
    assert turned_in(4).energy[-1] > 1e-3


def test_constant_pressure_passes_a_curve():
    """A disc in a ring, pressed uniformly: as much passes each node as pushes its chords; nothing rubs."""
    angles = np.linspace(0, 2 * np.pi, 17)
    mesh = vx.meshes.bodies(
        {"a": polar(np.array([0.5, 2.0]), angles, centre=True), "b": polar(np.array([2.0, 3.0]), angles)}
    )
    scene = vx.Scene(
        vx.Elasticity(1.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: -0.01 * t * x, on="b.outer"),
        vx.UnilateralContact(on="a|b"),
        vx.TrescaFriction(1.0, on="a|b"),
    )
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    assert np.abs(history.displacement[-1] + 0.01 * mesh.points).max() < 1e-12
    assert np.abs(history.contact.traction).max() < 1e-12
