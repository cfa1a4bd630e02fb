"""Contact between bodies whose meshes do not match: patch tests, action and reaction, curved interfaces."""

import itertools

import numpy as np
import pytest
from scenes import mostly_long, moved, rotation

import vemcvx as vx
from vemcvx.meshes import FAMILIES, SPACE_FAMILIES, bodies
from vemcvx.vem import Space

PLANE, SPACE = [name for name in FAMILIES if name != "l_shape"], list(SPACE_FAMILIES)
NEXT = {name: names[k - len(names) + 1] for names in (PLANE, SPACE) for k, name in enumerate(names)}
JOINT = "lower|upper"
TURNS = {2: rotation(0.4), 3: np.linalg.qr(np.array([[0.6, -0.3, 0.7], [0.2, 0.9, 0.1], [-0.8, 0.1, 0.6]]))[0]}
YOUNG, POISSON, COEFFICIENT = 10.0, 0.3, 0.4
SHEAR = YOUNG / (2 * (1 + POISSON))


def two_blocks(below, above, n=(2, 3), height=1.0, angle=0.0):
    """Return two stacked blocks. The upper block is rotated by `angle`."""
    families = FAMILIES if below in PLANE else SPACE_FAMILIES
    foot = [(-0.5, 0.5)] * (1 if below in PLANE else 2)
    lower, upper = families[below](n[0], box=(*foot, (-1, 0))), families[above](n[1], box=(*foot, (0, height)))
    if angle:
        c, s = 0.6 * np.cos(angle), 0.6 * np.sin(angle)
        upper = moved(upper, [[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return bodies({"lower": lower, "upper": upper})


def outside(mesh, body):
    return [name for name in mesh.boundaries if name.startswith(f"{body}.")]


def nodes_of(mesh, names):
    return np.unique(np.concatenate([Space(mesh).part(name, "test").nodes for name in names]))


def nodes_of_body(mesh, name):
    cells = np.flatnonzero(mesh.cell_data[name] == 1)
    return np.unique(np.concatenate([np.ravel(part) for k in cells for part in mesh.cells[k]]))


def pressed(pressure, shear):
    """Return a displacement gradient with this pressure and shear on horizontal planes."""
    lame, along = 2 * SHEAR * POISSON / (1 - 2 * POISSON), [0.02, 0.01][: len(shear)]
    gradient = np.diag([*along, -(pressure + sum(along) * lame) / (lame + 2 * SHEAR)])
    gradient[:-1, -1] = shear / SHEAR
    return gradient


ALONG = {2: np.array([1.0]), 3: np.array([0.6, 0.8])}
PRESSED, COULOMB = vx.UnilateralContact(on=JOINT), vx.CoulombFriction(COEFFICIENT, on=JOINT)
CONTACTS = {
    "bilateral": ([vx.BilateralContact(on=JOINT)], 0.0, 0.0),
    "stuck by Coulomb": ([PRESSED, COULOMB], 0.3, 0.0),
    "sliding": ([PRESSED, COULOMB], COEFFICIENT, 0.05),
}
"""Name -> effects, shear stress at the joint, and slip of the upper body"""


def assert_patch(mesh, kind):
    (effects, shear, slides), rotation = CONTACTS[kind], TURNS[mesh.points.shape[1]]
    tangent = ALONG[len(rotation)]
    gradient = rotation @ pressed(1.0, shear * tangent) @ rotation.T
    along = rotation[:, :-1] @ tangent
    mesh = moved(mesh, rotation)
    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(lambda x, t: t * x @ gradient.T, on=outside(mesh, "lower")),
        vx.PrescribedDisplacement(lambda x, t: t * (x @ gradient.T + slides * along), on=outside(mesh, "upper")),
        *effects,
    )
    history = vx.simulate(scene, mesh, [0.0, 0.5, 1.0])
    upper = np.isin(np.arange(mesh.n_nodes), nodes_of_body(mesh, "upper"))
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


@pytest.mark.parametrize("kind", CONTACTS)
@mostly_long("family", PLANE, "voronoi")
def test_constant_stress_passes_an_interface(family, kind):
    assert_patch(two_blocks(family, NEXT[family], (3, 2)), kind)


@pytest.mark.parametrize("kind", ["sliding", *(pytest.param(k, marks=pytest.mark.slow) for k in list(CONTACTS)[:-1])])
@mostly_long("family", SPACE, "cubes")
def test_constant_stress_passes_an_interface_in_space(family, kind):
    n = (2, 2) if "kelvin" in (family, NEXT[family]) else (3, 2)
    assert_patch(two_blocks(family, NEXT[family], n, angle=0.4 if kind == "sliding" else 0.0), kind)


@pytest.mark.parametrize(
    ("layers", "friction"),
    [(2, False), pytest.param(1, True, marks=pytest.mark.long)],
)
def test_constant_stress_passes_where_blocks_meet_at_an_edge_or_a_point(layers, friction):
    """At the common corner of eight blocks, contact forces are not unique."""
    corners = list(itertools.product((0, 1), (0, 1), range(layers)))
    kinds = zip(corners, itertools.cycle(SPACE[:4]), itertools.cycle((2, 1, 3)), strict=False)
    mesh = bodies(
        {
            f"{x}{y}{z}": SPACE_FAMILIES[family]((n, 2, 1), ((x, x + 1), (y, y + 1), (z, z + 1)))
            for (x, y, z), family, n in kinds
        }
    )
    gradient, joints = np.diag([-0.1, -0.12, -0.09]), list(mesh.interfaces)
    assert len(joints) == {1: 4, 2: 12}[layers]
    scene = vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(lambda x, t: t * x @ gradient, on="outside"),
        vx.UnilateralContact(on=joints),
        *([vx.CoulombFriction(0.3, on=joints)] if friction else []),
    )
    mesh = mesh.with_boundary("outside", lambda x: np.ones(len(x), dtype=bool))
    history = vx.simulate(scene, mesh, [0.0, 1.0], solver=vx.Newton())
    assert np.abs(history.displacement[-1] - mesh.points @ gradient).max() < 1e-11


def turned_in(sides):
    """Simulate a polygonal ring that turns inside a fixed ring with the same number of sides."""
    mesh = bodies({"a": vx.meshes.ring([1.0, 2.0], sides), "b": vx.meshes.ring([2.0, 3.0], sides)})
    scene = vx.Scene(
        vx.Elasticity(1.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: 0.1 * t * np.column_stack([-x[:, 1], x[:, 0]]), on="a.inner"),
        vx.Clamp(on="b.outer"),
        vx.BilateralContact(on="a|b"),
    )
    return vx.simulate(scene, mesh, [0.0, 1.0])


def test_bodies_slide_along_a_curve_but_not_around_corners():
    """A node of a curve has the mean normal of both adjacent sides. A square peg does not turn in a square hole."""
    history = turned_in(24)
    mesh = history.mesh
    turned = 0.1 * np.column_stack([-mesh.points[:, 1], mesh.points[:, 0]])
    turned[nodes_of_body(mesh, "b")] = 0.0
    assert np.abs(history.displacement[-1] - turned).max() < 1e-13
    assert np.abs(history.contact.pressure).max() < 1e-13
    assert turned_in(4).energy[-1] > 1e-3
