"""Energy distances: closed forms, symmetry, and refusals."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scenes import mostly_long, small

import vemcvx as vx
from vemcvx.estimate.measures.distance import common_rule

LAM, MU = 1.5, 0.8


def field(mesh, displacement, lam=LAM, mu=MU):
    """Return the nodal interpolant of a displacement."""
    moduli = np.array([np.full(mesh.n_cells, lam), np.full(mesh.n_cells, mu)])
    return vx.measures.Field(mesh, displacement(mesh.points), moduli)


def affine(x):
    return x @ np.array([[0.3, 0.2], [-0.1, 0.4]]) + np.array([5.0, -2.0])


def wavy(x):
    return np.column_stack([np.sin(3 * x[:, 0] + x[:, 1]), x[:, 0] ** 2 * x[:, 1]])


def other(x):
    return np.column_stack([np.cos(2 * x[:, 1]), x[:, 0] * x[:, 1] ** 2])


def nothing(x):
    return np.zeros_like(x)


@cache
def mesh_of(family, n, seed=0):
    return small(family, n, seed=seed)


@mostly_long("second", ["squares", "voronoi", "nonconvex"], "voronoi")
def test_affine_fields_have_no_distance_and_distances_are_symmetric(family, second):
    meshes = mesh_of(family, 6), mesh_of(second, 4, seed=2)
    apart = vx.measures.energy_distance(*(field(mesh, affine) for mesh in meshes))
    assert apart.relative < 1e-13
    # The squared norm is C eps : eps of the affine field, times the area 1.
    xx, yy, xy = 0.3, 0.4, 0.1
    energy = LAM * (xx + yy) ** 2 + 2 * MU * (xx**2 + yy**2) + MU * xy**2
    assert apart.reference == pytest.approx(np.sqrt(energy), rel=1e-12)
    one, two = field(meshes[0], wavy), field(meshes[1], other)
    there, back = vx.measures.energy_distance(one, two), vx.measures.energy_distance(two, one)
    assert there.absolute == pytest.approx(back.absolute, rel=1e-12)
    assert np.sum(there.cells**2) == pytest.approx(np.sum(back.cells**2), rel=1e-12)
    # The quadrature rule for both meshes integrates x^2, x y and y^2 exactly.
    rule = common_rule(*meshes)
    x, y = rule.points.T
    assert [rule.weights @ p for p in (x**2, x * y, y**2)] == pytest.approx([1 / 3, 1 / 4, 1 / 3], rel=1e-12)


@pytest.mark.parametrize("kind", ["exact", "projected", "nodal"])
def test_a_field_has_no_distance_from_itself(kind):
    a = field(vx.meshes.squares(6), wavy)
    assert vx.measures.energy_distance(a, a, kind=kind).absolute == 0.0
    b = field(vx.meshes.squares(6), wavy)
    assert vx.measures.energy_distance(a, b, kind=kind).relative < 1e-15


def hats(points):
    """Return u = (|x_1 - 1/2|, 0)."""
    return np.column_stack([np.abs(points[:, 0] - 0.5), np.zeros(len(points))])


@pytest.mark.parametrize(("first", "second"), [("squares", "triangles"), ("triangles", "squares")])
@pytest.mark.parametrize("kind", ["exact", "projected"])
def test_the_distance_of_two_piecewise_linear_fields_is_exact(first, second, kind):
    """Interpolants of |x_1 - 1/2| have the slopes -1, 0, 1 on three columns of cells, and -1, 1 on two columns.

    The slopes differ by 1 on a third of the square, so the squared distance is (lambda + 2 mu) / 3.
    """
    a, b = field(mesh_of(first, 2), hats), field(mesh_of(second, 3), hats)
    C = LAM + 2 * MU
    apart = vx.measures.energy_distance(a, b, kind=kind)
    assert apart.absolute == pytest.approx(np.sqrt(C / 3), rel=1e-12)
    assert apart.reference == pytest.approx(np.sqrt(C * 2 / 3), rel=1e-12)
    assert np.sum(apart.cells**2) == pytest.approx(C / 3, rel=1e-12)
    assert vx.measures.energy_distance(b, a, kind=kind).relative == pytest.approx(np.sqrt(1 / 3), rel=1e-12)


def test_hourglasses_on_nested_squares_have_exact_norms():
    """The field u_1 = x_1 x_2 is bilinear, so interpolation on squares is exact.

    The integrals of e_xx^2 = x_2^2 and of (2 e_xy)^2 = x_1^2 are 1/3. On one square, the projection has e_xx = 1/2 and
    2 e_xy = 1/2.
    """

    def twist(x):
        return np.column_stack([x[:, 0] * x[:, 1], np.zeros(len(x))])

    one, fine = field(vx.meshes.squares(1), twist), field(vx.meshes.squares(8), twist)
    exact = vx.measures.energy_distance(one, fine, kind="exact")
    assert exact.relative < 1e-14
    norm = np.sqrt((LAM + 2 * MU + MU) / 3)
    assert exact.reference == pytest.approx(norm, rel=1e-13)
    rest = field(vx.meshes.squares(4), nothing)
    assert vx.measures.energy_distance(one, rest, kind="exact").absolute == pytest.approx(norm, rel=1e-13)
    projected = vx.measures.energy_distance(one, rest).absolute
    assert projected == pytest.approx(np.sqrt((LAM + 3 * MU) / 4), rel=1e-13)


def test_exact_distances_of_rectangles_do_not_depend_on_their_angle():
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    straight = vx.meshes.squares((4, 6), box=((0, 2), (0, 1)))
    turned = vx.PolygonMesh(straight.points @ turn.T + 7.0, straight.cells)
    u = wavy(straight.points)
    moduli = np.array([np.full(24, LAM), np.full(24, MU)])
    rest = vx.measures.Field(straight, 0 * u, moduli), vx.measures.Field(turned, 0 * u, moduli)
    a = vx.measures.energy_distance(vx.measures.Field(straight, u, moduli), rest[0], kind="exact")
    b = vx.measures.energy_distance(vx.measures.Field(turned, u @ turn.T, moduli), rest[1], kind="exact")
    assert b.cells == pytest.approx(a.cells, rel=1e-12)


def test_distances_use_the_moduli_of_the_first_mesh():
    a, b = field(vx.meshes.squares(3), affine), field(vx.meshes.squares(2), nothing, lam=3.0)
    apart = vx.measures.energy_distance(a, b)
    same = vx.measures.energy_distance(a, field(vx.meshes.squares(2), nothing))
    assert apart.absolute == pytest.approx(same.absolute)


def test_nodal_distance_is_the_norm_of_the_stiffness_matrix(family):
    from vemcvx.vem import Space, stiffness

    a, b = field(mesh_of(family, 5), wavy), field(mesh_of(family, 5), other)
    A = stiffness(Space(a.mesh), *a.moduli)
    w = (a.displacement - b.displacement).ravel()
    apart = vx.measures.energy_distance(a, b, kind="nodal")
    assert apart.absolute == pytest.approx(np.sqrt(w @ A @ w), rel=1e-12)
    v = b.displacement.ravel()
    assert apart.reference == pytest.approx(np.sqrt(v @ A @ v), rel=1e-12)


def test_nodal_distances_need_the_nodes_of_the_first_mesh_in_the_second():
    """The nodes of 9 x 9 squares are nodes of 27 x 27 squares, up to rounding."""
    coarse, fine = (field(mesh_of("squares", n), wavy) for n in (9, 27))
    assert vx.measures.energy_distance(coarse, fine, kind="nodal").relative < 1e-14
    with pytest.raises(vx.MeshError, match=r"node \d+ of the first mesh, .* is no node of the second"):
        vx.measures.energy_distance(fine, coarse, kind="nodal")


def test_different_domains_are_refused_unless_their_common_part_is_requested():
    a, b = field(vx.meshes.squares(4), affine), field(vx.meshes.squares(4, box=((0, 0.5), (0, 1))), nothing)
    with pytest.raises(vx.MeshError, match=r"first mesh has the area 1, the second 0.5, and they share 0.5; both must"):
        vx.measures.energy_distance(a, b)
    aside = field(vx.meshes.squares(4, box=((0.5, 1.5), (0, 1))), nothing)
    with pytest.raises(vx.MeshError, match=r"first mesh has the area 1, the second 1, and they share 0.5; both must"):
        vx.measures.energy_distance(a, aside)
    half = vx.measures.energy_distance(a, b, common=True).absolute
    assert half == pytest.approx(vx.measures.energy_distance(a, field(a.mesh, nothing)).absolute / np.sqrt(2))
