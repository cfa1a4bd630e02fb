"""Contact between bodies in space: what passes through an interface of tilings that do not match, and closed forms."""

import itertools

import numpy as np
import pytest
from tubes import ring

import vemcvx as vx
from vemcvx.meshes import SPACE_FAMILIES, bodies

FAMILIES = list(SPACE_FAMILIES)
NEXT = dict(zip(FAMILIES, FAMILIES[1:] + FAMILIES[:1], strict=True))
JOINT = "lower|upper"
TURN = np.linalg.qr(np.array([[0.6, -0.3, 0.7], [0.2, 0.9, 0.1], [-0.8, 0.1, 0.6]]))[0]
YOUNG, POISSON, COEFFICIENT = 10.0, 0.3, 0.4
SHEAR = YOUNG / (2 * (1 + POISSON))


def moved(mesh, matrix):
    """The mesh with its points multiplied by a matrix, and all names."""
    named = {name: sides for name, sides in mesh.boundaries.items() if name not in (*mesh.interfaces, "boundary")}
    joints = dict(mesh.interfaces)
    points = mesh.points @ np.asarray(matrix).T
    return vx.PolyhedralMesh(points, mesh.cells, boundaries=named, cell_data=mesh.cell_data, interfaces=joints)


def two_blocks(below, above, n=(2, 3), height=1.0, angle=0.0):
    """Blocks on one another; if turned about the upright axis, the upper one stands on a part of the face below."""
    lower = SPACE_FAMILIES[below](n[0], box=((-0.5, 0.5), (-0.5, 0.5), (-1, 0)))
    upper = SPACE_FAMILIES[above](n[1], box=((-0.5, 0.5), (-0.5, 0.5), (0, height)))
    if angle:
        c, s = 0.6 * np.cos(angle), 0.6 * np.sin(angle)
        upper = moved(upper, [[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return bodies({"lower": lower, "upper": upper})


def outside(mesh, body):
    return [name for name in mesh.boundaries if name.startswith(f"{body}.")]


def nodes_of(mesh, names):
    faces = np.concatenate([mesh.boundaries[name] for name in names])
    return np.unique(np.concatenate([mesh.face_vertices[slice(*mesh.face_offsets[k : k + 2])] for k in faces]))


def pressed(pressure, shear):
    """The gradient of a field that is stretched along planes z = const, and has these stresses on them."""
    lame = 2 * SHEAR * POISSON / (1 - 2 * POISSON)
    gradient = np.diag([0.02, 0.01, -(pressure + 0.03 * lame) / (lame + 2 * SHEAR)])
    gradient[:2, 2] = np.asarray(shear) / SHEAR
    return gradient


ALONG = np.array([0.6, 0.8])
PRESSED, COULOMB = vx.UnilateralContact(on=JOINT), vx.CoulombFriction(COEFFICIENT, on=JOINT)
CONTACTS = {
    "bilateral": ([vx.BilateralContact(on=JOINT)], 0.0, 0.0),
    "unilateral": ([PRESSED], 0.0, 0.0),
    "stuck": ([vx.BilateralContact(on=JOINT), vx.TrescaFriction(10.0, on=JOINT)], 0.3, 0.0),
    "stuck by Coulomb": ([PRESSED, COULOMB], 0.3, 0.0),
    "sliding": ([PRESSED, COULOMB], COEFFICIENT, 0.05),
}
"""Effects, the shear stress that they bear, and how far the upper body slides"""


def assert_patch(mesh, kind, rotation=TURN):
    effects, shear, slides = CONTACTS[kind]
    gradient = rotation @ pressed(1.0, shear * ALONG) @ rotation.T
    along = rotation[:, :2] @ ALONG
    mesh = moved(mesh, rotation)
    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(lambda x, t: t * x @ gradient.T, on=outside(mesh, "lower")),
        vx.PrescribedDisplacement(lambda x, t: t * (x @ gradient.T + slides * along), on=outside(mesh, "upper")),
        *effects,
    )
    history = vx.simulate(scene, mesh, [0.0, 0.5, 1.0])
    offsets, nodes = mesh.cell_nodes
    upper = np.isin(np.arange(mesh.n_nodes), nodes[np.repeat(mesh.cell_data["upper"] == 1, np.diff(offsets))])
    exact = mesh.points @ gradient.T + upper[:, None] * slides * along
    assert np.abs(history.displacement[-1] - exact).max() < 1e-11
    assert np.ptp(history.stress(-1), axis=0).max() < 1e-11 * mesh.n_nodes
    contact = history.contact
    inner = ~np.isin(contact.nodes, nodes_of(mesh, outside(mesh, "lower")))
    inner &= ~np.isin(contact.partners, nodes_of(mesh, outside(mesh, "upper")))
    assert contact.pressure[-1][inner] == pytest.approx(1.0, rel=1e-9)
    if shear:
        assert contact.traction[-1][inner] == pytest.approx(np.tile(shear * along, (inner.sum(), 1)), abs=1e-9)
    assert contact.slip[-1][inner] == pytest.approx(np.tile(-slides * along, (inner.sum(), 1)), abs=1e-11)


@pytest.mark.parametrize(
    ("family", "kind"),
    [
        (family, kind)
        if kind == "sliding" or family == "tetrahedra"
        else pytest.param(family, kind, marks=pytest.mark.slow)
        for family, kind in itertools.product(FAMILIES, CONTACTS)
    ],
)
def test_constant_stress_passes(family, kind):
    n = (2, 2) if "kelvin" in (family, NEXT[family]) else (3, 2)
    assert_patch(two_blocks(family, NEXT[family], n, angle=0.4 if kind == "sliding" else 0.0), kind)


@pytest.mark.slow
@pytest.mark.parametrize("kind", CONTACTS)
@pytest.mark.parametrize(("below", "above"), list(itertools.product(FAMILIES, FAMILIES)))
def test_constant_stress_passes_between_all_families(below, above, kind):
    assert_patch(two_blocks(below, above, (7, 5)), kind)
    assert_patch(two_blocks(below, above, (4, 3), angle=0.4), kind)


@pytest.mark.long
def test_constant_stress_passes_through_a_curved_joint():
    """A pin of sixteen sides bonded in a hole of twenty-four: any linear displacement is that of one body."""
    mesh = bodies({"pin": ring([0.4, 1.0], 16, 2), "lug": ring([1.0, 2.0], 24, 3)}, tolerance=0.03)
    mesh = mesh.with_boundary("outside", lambda x: np.ones(len(x), dtype=bool))
    gradient = np.array([[0.02, 0.01, -0.03], [0.02, -0.04, 0.01], [0.0, 0.03, 0.01]])
    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(lambda x, t: t * x @ gradient.T, on="outside"),
        vx.BilateralContact(on="pin|lug"),
        vx.TrescaFriction(1e3, on="pin|lug"),
    )
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    assert np.abs(history.displacement[-1] - mesh.points @ gradient.T).max() < 1e-11
    assert np.ptp(history.stress(-1), axis=0).max() < 1e-11 * mesh.n_nodes


# Two materials in series under turning shear: a play operator with a disc.


MODULI, HEIGHTS, BOUND = (10.0, 30.0), (1.0, 0.5), 1.0


def circle(t):
    return 0.8 * np.array([np.sin(2 * np.pi * t), 1 - np.cos(2 * np.pi * t)])


def in_series(times):
    """Friction traction q and relative slip a at all instants: q_n = P((U_n - a_{n-1}) / C), in a disc of radius g."""
    flexibility = sum(height * 2 * (1 + POISSON) / young for young, height in zip(MODULI, HEIGHTS, strict=True))
    q, a = [np.zeros(2)], [np.zeros(2)]
    for t in times[1:]:
        trial = (circle(t) - a[-1]) / flexibility
        q.append(trial * min(1.0, BOUND / np.linalg.norm(trial)))
        a.append(circle(t) - q[-1] * flexibility)
    return np.array(q), np.array(a)


@pytest.mark.parametrize("family", ["cubes", "tetrahedra", pytest.param("voronoi3", marks=pytest.mark.slow)])
def test_two_blocks_in_series_are_exact(family):
    times = np.linspace(0, 1.25, 11)
    mesh = two_blocks(family, NEXT[family], height=HEIGHTS[1])
    sides = [f"{body}.{side}" for body in ("lower", "upper") for side in ("left", "right", "front", "back")]
    scene = vx.Scene(
        vx.Elasticity(MODULI[0], POISSON, on="lower"),
        vx.Elasticity(MODULI[1], POISSON, on="upper"),
        vx.Clamp(on="lower.bottom"),
        vx.PrescribedDisplacement(lambda x, t: np.tile([*circle(t), 0.0], (len(x), 1)), on="upper.top"),
        vx.PrescribedDisplacement(0.0, on=sides, direction=(0, 0, 1)),
        vx.BilateralContact(on=JOINT),
        vx.TrescaFriction(BOUND, on=JOINT),
    )
    contact = vx.simulate(scene, mesh, times).contact
    q, a = in_series(times)
    assert np.abs(contact.traction[:, :, :2] - q[:, None]).max() < 1e-9
    assert np.abs(contact.slip[:, :, :2] + a[:, None]).max() < 1e-9
    wear = np.cumsum(BOUND * np.linalg.norm(np.diff(a, axis=0, prepend=0.0 * a[:1]), axis=1))
    assert np.abs(contact.wear - wear[:, None]).max() < 1e-9


# Action and reaction, and bonds.


def dragged_over(*contact):
    """The upper block is pressed by its weight, and pulled; nothing but the lower one holds it."""

    def pull(x, t):
        return np.tile([0.2 * t, 0.1 * t, 0.0], (len(x), 1))

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.Clamp(on="lower.bottom"),
        vx.Pressure(lambda x, t: np.full(len(x), t), on="upper.top"),
        vx.Traction(pull, on="upper.left"),
        *contact,
    )


EFFECTS = {
    "Coulomb": [PRESSED, vx.CoulombFriction(0.5, on=JOINT)],
    "Tresca while closed": [vx.UnilateralContact(on=JOINT, gap=0.0), vx.TrescaFriction(0.6, on=JOINT)],
    "compliance": [vx.NormalCompliance(50.0, on=JOINT), vx.CoulombFriction(0.5, on=JOINT)],
    "bilateral": [vx.BilateralContact(on=JOINT), vx.TrescaFriction(lambda x, t: 0.5 + x[:, 0], on=JOINT)],
}


@pytest.mark.long
@pytest.mark.parametrize("kind", EFFECTS)
def test_action_is_reaction(kind):
    mesh = two_blocks("voronoi3", "tetrahedra", (2, 2), angle=0.3)
    history = vx.simulate(dragged_over(*EFFECTS[kind]), mesh, np.linspace(0, 1, 4))
    contact, forces = history.contact, history.forces[-1]
    assert (contact.partners >= 0).all()
    assert len(contact.nodes) == len(mesh.interfaces[JOINT].pairs)
    assert contact.points == pytest.approx(mesh.points[contact.partners], abs=0)
    # Nothing but contact and the load acts on the nodes of the interface.
    free = ~np.isin(contact.partners, nodes_of(mesh, ["upper.left"]))
    i, j = contact.nodes[free], contact.partners[free]
    size = np.abs(forces).max() * mesh.n_nodes
    assert np.abs(forces[i] + forces[j]).max() < 1e-12 * size
    shown = (
        contact.traction * contact.friction_lengths[:, None]
        - (contact.pressure * contact.lengths)[:, :, None] * contact.normals
    )
    assert np.abs(forces[i] - shown[-1][free]).max() < 1e-12 * size
    assert np.abs(shown[-1]).max() > 0


@pytest.mark.long
def test_bonded_blocks_are_one_body():
    mesh = two_blocks("voronoi3", "cubes", (2, 3))
    place = np.arange(mesh.n_nodes)
    pairs = mesh.interfaces[JOINT].pairs
    place[pairs[:, 1]] = pairs[:, 0]
    kept, number = np.unique(place, return_inverse=True)
    whole = vx.PolyhedralMesh(mesh.points[kept], [[number[face] for face in cell] for cell in mesh.cells])

    def supported(one):
        return one.with_boundary("foot", lambda x: x[:, 2] < -1 + 1e-9).with_boundary(
            "head", lambda x: x[:, 2] > 1 - 1e-9
        )

    effects = vx.Elasticity(YOUNG, POISSON), vx.Clamp(on="foot"), vx.Traction(lambda x, t: t * x, on="head")
    bonds = vx.BilateralContact(on=JOINT), vx.TrescaFriction(1e3, on=JOINT)
    one = vx.simulate(vx.Scene(*effects), supported(whole), [0.0, 1.0])
    two = vx.simulate(vx.Scene(*effects, *bonds), supported(mesh), [0.0, 1.0])
    assert np.abs(two.displacement[-1] - one.displacement[-1][number]).max() < 1e-12


def blocks_at_a_point(layers):
    """Four blocks around an edge, or eight around a point, and what passes through all of them at once."""
    corners = list(itertools.product((0, 1), (0, 1), range(layers)))
    kinds = zip(corners, itertools.cycle(FAMILIES[:4]), itertools.cycle((2, 1, 3)), strict=False)
    mesh = bodies(
        {
            f"{x}{y}{z}": SPACE_FAMILIES[family]((n, 2, 1), ((x, x + 1), (y, y + 1), (z, z + 1)))
            for (x, y, z), family, n in kinds
        }
    )
    gradient = np.diag([-0.1, -0.12, -0.09])
    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(lambda x, t: t * x @ gradient, on="outside"),
        vx.UnilateralContact(on=list(mesh.interfaces)),
    )
    return scene, mesh.with_boundary("outside", lambda x: np.ones(len(x), dtype=bool)), mesh.points @ gradient


@pytest.mark.long
def test_four_blocks_meet_at_an_edge():
    scene, mesh, exact = blocks_at_a_point(1)
    assert len(mesh.interfaces) == 4
    history = vx.simulate(scene.with_(vx.CoulombFriction(0.3, on=list(mesh.interfaces))), mesh, [0.0, 1.0])
    assert np.abs(history.displacement[-1] - exact).max() < 1e-11


@pytest.mark.parametrize(
    "friction", [False, pytest.param(True, marks=pytest.mark.slow)], ids=["without friction", "Coulomb"]
)
def test_eight_blocks_meet_at_a_point(friction):
    """Where twelve pairs of nodes join eight, forces are not unique; of Coulomb's, Clarabel finds some."""
    scene, mesh, exact = blocks_at_a_point(2)
    assert len(mesh.interfaces) == 12
    if friction:
        scene = scene.with_(vx.CoulombFriction(0.3, on=list(mesh.interfaces)))
    history = vx.simulate(scene, mesh, [0.0, 1.0], solver=vx.Clarabel() if friction else vx.Newton())
    assert np.abs(history.displacement[-1] - exact).max() < 1e-11


# What else knows of interfaces.


@pytest.mark.long
def test_partners_are_stored_and_probes_tell_the_first_body(tmp_path):
    mesh = two_blocks("cubes", "tetrahedra")
    history = vx.simulate(dragged_over(*EFFECTS["Coulomb"]), mesh, np.linspace(0, 1, 3))
    history.write(tmp_path)
    read = vx.read_history(tmp_path)
    np.testing.assert_array_equal(read.contact.partners, history.contact.partners)
    np.testing.assert_array_equal(read.mesh.interfaces[JOINT].partners, mesh.interfaces[JOINT].partners)
    assert read.mesh.interfaces[JOINT].bodies == ("lower", "upper")
    pairs = mesh.interfaces[JOINT].pairs
    found = history.probe(mesh.points[pairs[:, 1]])[-1]
    np.testing.assert_allclose(found, history.displacement[-1][pairs[:, 0]], atol=1e-15)
    assert np.abs(found - history.displacement[-1][pairs[:, 1]]).max() > 1e-3


@pytest.mark.parametrize(
    "effect",
    [vx.Pressure(1.0, on=JOINT), vx.Clamp(on=["lower.bottom", JOINT]), vx.Symmetry(on="boundary")],
    ids=lambda effect: type(effect).__name__,
)
def test_what_is_no_contact_is_refused_between_bodies(effect):
    mesh = two_blocks("cubes", "cubes", (1, 1))
    with pytest.raises(vx.SceneError, match=r"has faces of an interface \(lower\|upper\) between two bodies"):
        vx.simulate(dragged_over(PRESSED, COULOMB).with_(effect), mesh, [0.0, 1.0])


def test_bodies_that_nothing_holds_are_called_by_their_names():
    mesh = two_blocks("cubes", "cubes", (1, 2))
    scene = dragged_over(vx.BilateralContact(on=JOINT))
    with pytest.raises(vx.SceneError, match=r"the first the translation \(1, 0, 0\) of upper"):
        vx.simulate(scene, mesh, [0.0, 1.0])
    with pytest.raises(vx.SceneError, match=r"this interface is named 'lower\|upper'"):
        vx.simulate(scene.with_(vx.TrescaFriction(1.0, on="upper|lower")), mesh, [0.0, 1.0])
