"""Boundary parts with contact or friction that share nodes or edges."""

import numpy as np
import pytest
from scenes import few_families, mostly_long, moved, rotation, small

import vemcvx as vx
from vemcvx.scene import pose_scene

STEEL = vx.Elasticity(young=200.0, poisson=0.3)
TIMES = np.linspace(0.0, 1.0, 7)
FIELDS = ("nodes", "points", "normals", "slip", "traction", "bound", "pressure", "sticking", "wear")
FIELDS += ("closed", "lengths", "friction_lengths")


def floor(family, n=5):
    """Return a square whose bottom has the parts west, east and inner."""
    mesh = small(family, n)
    for name, where in {"west": lambda x: x < 0.5, "east": lambda x: x >= 0.5, "inner": lambda x: x > 0.3}.items():
        mesh = mesh.with_boundary(name, lambda p, where=where: (p[:, 1] < 1e-9) & where(p[:, 0]))
    return mesh


def share(mesh, name, nodes):
    """Return the integrals of nodal basis functions over a part of the boundary."""
    part = vx.vem.Space(mesh).part(name, "test")
    length = np.zeros(mesh.n_nodes)
    length[part.nodes] = part.node_lengths
    return length[nodes]


def driven(x, t):
    """Return the motion of the top: down and to the right, with a small rotation."""
    return np.column_stack([0.05 * t - 0.01 * t * x[:, 0], -0.03 * t - 0.01 * t * x[:, 0]])


def run(mesh, *effects, **options):
    top = vx.PrescribedDisplacement(driven, on="top")
    return vx.simulate(vx.Scene(STEEL, top, *effects), mesh, TIMES, solver=vx.Newton(), **options)


PAIRS = {
    "Tresca": lambda on: (vx.BilateralContact(on=on), vx.TrescaFriction(2.0, on=on)),
    "Tresca, integrals": lambda on: (
        vx.UnilateralContact(on=on),
        vx.TrescaFriction(lambda x, t: 1 + x[:, 0], on=on, quadrature="integral"),
    ),
    "Coulomb": lambda on: (vx.UnilateralContact(on=on), vx.CoulombFriction(0.3, on=on, cap=3.0)),
    "Coulomb, compliant": lambda on: (vx.NormalCompliance(2000.0, on=on), vx.CoulombFriction(0.3, on=on)),
    "a gap": lambda on: (vx.UnilateralContact(on=on, gap=lambda x, t: 0.02 * x[:, 0] * (1 - 0.5 * t)),),
}


@pytest.mark.long
@few_families
@pytest.mark.parametrize("pair", PAIRS)
def test_a_side_divided_into_two_parts_acts_as_one_side(family, pair):
    mesh = floor(family)
    one, two = run(mesh, *PAIRS[pair]("bottom")), run(mesh, *PAIRS[pair]("west"), *PAIRS[pair]("east"))
    size = np.abs(one.displacement).max()
    # The runs add weights in different orders. Coulomb's law is solved to 1e-8 in the energy norm.
    loose = 1e-6 if "Coulomb" in pair else 1e-11
    assert np.abs(one.displacement - two.displacement).max() <= loose * size
    for name in FIELDS:
        mine, other = getattr(one.contact, name), getattr(two.contact, name)
        assert mine.shape == other.shape, name
        assert np.abs(1.0 * mine - other).max() <= loose * max(np.abs(mine).max(), 1e-300), name
    assert one.dissipated[-1] > 0 or pair == "a gap"
    assert one.contact.lengths.sum() == pytest.approx(1.0, rel=1e-14)


@few_families
def test_the_bound_where_two_parts_meet_is_the_mean_over_their_edges(family):
    """A block is dragged over two floors that share a node."""
    mesh = floor(family)
    parts = vx.TrescaFriction(0.5, on="west"), vx.TrescaFriction(2.0, on="east")
    contact = run(mesh, vx.BilateralContact(on="bottom"), *parts).contact
    west, east = (share(mesh, name, contact.nodes) for name in ("west", "east"))
    assert np.count_nonzero(west * east) == 1
    mean = (0.5 * west + 2.0 * east) / (west + east)
    assert np.abs(contact.bound - mean).max() < 1e-13
    assert (np.linalg.norm(contact.traction, axis=2) <= contact.bound * (1 + 1e-12)).all()
    slips = ~contact.sticking[-1]
    assert slips.all()
    force = contact.traction[-1] * contact.friction_lengths[:, None]
    assert force[:, 0].sum() == pytest.approx(-(0.5 * west.sum() + 2.0 * east.sum()), rel=1e-12)


@few_families
def test_friction_at_the_end_of_a_part_is_integrated_over_this_part_only(family):
    mesh = floor(family)
    contact = run(mesh, vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.4, on="inner")).contact
    inner, whole = share(mesh, "inner", contact.nodes), share(mesh, "bottom", contact.nodes)
    end = (inner > 0) & (inner < 0.99 * whole)
    assert end.sum() == 1
    assert contact.friction_lengths == pytest.approx(inner, rel=1e-14)
    assert contact.lengths == pytest.approx(whole, rel=1e-14)
    rubs = inner > 0
    assert np.abs(contact.bound - 0.4 * contact.pressure)[1:, rubs].max() < 1e-6 * contact.pressure.max()
    assert not contact.bound[:, ~rubs].any()


@few_families
def test_frictions_on_overlapping_parts_add_up(family):
    mesh = floor(family)
    frictions = vx.TrescaFriction(0.5, on="bottom"), vx.TrescaFriction(1.0, on="inner")
    contact = run(mesh, vx.BilateralContact(on="bottom"), *frictions).contact
    inner, whole = share(mesh, "inner", contact.nodes), share(mesh, "bottom", contact.nodes)
    assert np.abs(contact.bound - (0.5 + inner / whole)).max() < 1e-13


@few_families
def test_the_nearer_of_two_obstacles_stops_a_node(family):
    mesh = floor(family)
    far, near = vx.UnilateralContact(on="bottom", gap=0.02), vx.UnilateralContact(on="inner", gap=0.005)
    both = run(mesh, far, near)
    inner = np.isin(both.contact.nodes, vx.vem.Space(mesh).part("inner", "test").nodes)
    posed = pose_scene(both.scene, mesh)
    assert len(np.unique(posed.obstacles.nodes)) == len(posed.obstacles.nodes)
    depth = -both.displacement[-1][both.contact.nodes, 1]
    assert (depth <= np.where(inner, 0.005, 0.02) * (1 + 1e-12)).all()
    assert (both.contact.pressure[-1] > 0).any()


@few_families
@pytest.mark.filterwarnings("ignore:supports. nothing but friction or one-sided contact")
@mostly_long("degrees", [0.0, 30.0], 1)
@pytest.mark.parametrize("touch", [vx.UnilateralContact, vx.BilateralContact, lambda on: vx.NormalCompliance(1e4, on)])
def test_a_corner_shows_the_pressure_of_its_sides(family, degrees, touch):
    """The pressure 1 on two sides presses a block into a corner."""
    mesh = moved(small(family, 4), rotation(np.deg2rad(degrees)))
    scene = vx.Scene(STEEL, touch(on="left"), touch(on="bottom"), vx.Pressure(1.0, on=["right", "top"]))
    contact = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled", solver=vx.Newton(accuracy=1e-10)).contact
    assert np.abs(contact.pressure[-1] - 1.0).max() < 1e-9
    if touch is not vx.BilateralContact:  # Two bilateral contacts fix the corner node.
        assert contact.lengths.sum() == pytest.approx(2.0, rel=1e-12)
        assert len(contact.nodes) == len(np.union1d(*(np.unique(mesh.boundaries[name]) for name in ("left", "bottom"))))
