"""Energy distances: closed forms of piecewise fields, zeros, symmetry, what is refused."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from counted import calls
from scenes import mostly_long, small

import vemcvx as vx
from vemcvx.estimate.measures.distance import common_rule

LAM, MU = 1.5, 0.8


def field(mesh, displacement, lam=LAM, mu=MU):
    """The nodal interpolant of a displacement f(x) (n, 2)."""
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
def test_affine_fields_are_no_distance_apart_and_others_as_far_there_as_back(family, second):
    meshes = mesh_of(family, 6), mesh_of(second, 4, seed=2)
    apart = vx.measures.energy_distance(*(field(mesh, affine) for mesh in meshes))
    assert apart.relative < 1e-13
    # C eps : eps of the affine field, times the area 1.
    xx, yy, xy = 0.3, 0.4, 0.1
    energy = LAM * (xx + yy) ** 2 + 2 * MU * (xx**2 + yy**2) + MU * xy**2
    assert apart.reference == pytest.approx(np.sqrt(energy), rel=1e-12)
    one, two = field(meshes[0], wavy), field(meshes[1], other)
    there, back = vx.measures.energy_distance(one, two), vx.measures.energy_distance(two, one)
    assert there.absolute == pytest.approx(back.absolute, rel=1e-12)
    assert np.sum(there.cells**2) == pytest.approx(np.sum(back.cells**2), rel=1e-12)
    # Degree 2 on the unit square: int x^2, xy, y^2.
    rule = common_rule(*meshes)
    x, y = rule.points.T
    assert [rule.weights @ p for p in (x**2, x * y, y**2)] == pytest.approx([1 / 3, 1 / 4, 1 / 3], rel=1e-12)


@pytest.mark.parametrize("kind", ["exact", "projected", "nodal"])
def test_a_field_is_no_distance_from_itself(kind):
    a = field(vx.meshes.squares(6), wavy)
    assert vx.measures.energy_distance(a, a, kind=kind).absolute == 0.0
    b = field(vx.meshes.squares(6), wavy)
    assert vx.measures.energy_distance(a, b, kind=kind).relative < 1e-15


def hats(points):
    """u_1 = |x_1 - 1/2|, linear on either side of the middle."""
    return np.column_stack([np.abs(points[:, 0] - 0.5), np.zeros(len(points))])


@pytest.mark.parametrize(("first", "second"), [("squares", "triangles"), ("triangles", "squares")])
@pytest.mark.parametrize("kind", ["exact", "projected"])
def test_two_known_piecewise_fields(first, second, kind):
    """e_xx = +-1 on halves of two and on thirds of three: they differ by 2 or not at all, area by area.

    On three columns the interpolant of |x - 1/2| has slopes -1, 0, 1; on two -1, 1: they differ by 1 on the middle
    third, hence (lambda + 2 mu) / 3.
    """
    a, b = field(mesh_of(first, 2), hats), field(mesh_of(second, 3), hats)
    C = LAM + 2 * MU
    apart = vx.measures.energy_distance(a, b, kind=kind)
    assert apart.absolute == pytest.approx(np.sqrt(C / 3), rel=1e-12)
    assert apart.reference == pytest.approx(np.sqrt(C * 2 / 3), rel=1e-12)
    assert np.sum(apart.cells**2) == pytest.approx(C / 3, rel=1e-12)
    assert vx.measures.energy_distance(b, a, kind=kind).relative == pytest.approx(np.sqrt(1 / 3), rel=1e-12)


def test_hourglasses_on_nested_squares():
    """u_1 = x_1 x_2 on one square is bilinear: exactly zero from its refinement, and known from nothing and from Pi u.

    int e_xx^2 = int x_2^2 = 1/3, int (2 e_xy)^2 = int x_1^2 = 1/3; of Pi u both mean strains are 1/2.
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


def test_rectangles_may_be_turned():
    """xi eta is harmonic in every orthogonal frame: the twist of a turned rectangle is known."""
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    straight = vx.meshes.squares((4, 6), box=((0, 2), (0, 1)))
    turned = vx.PolygonMesh(straight.points @ turn.T + 7.0, straight.cells)
    u = wavy(straight.points)
    moduli = np.array([np.full(24, LAM), np.full(24, MU)])
    rest = vx.measures.Field(straight, 0 * u, moduli), vx.measures.Field(turned, 0 * u, moduli)
    a = vx.measures.energy_distance(vx.measures.Field(straight, u, moduli), rest[0], kind="exact")
    b = vx.measures.energy_distance(vx.measures.Field(turned, u @ turn.T, moduli), rest[1], kind="exact")
    assert b.cells == pytest.approx(a.cells, rel=1e-12)


def graded(n):
    """Columns that double in width to the right: sizes spread over 2^n."""
    x = np.concatenate([[0.0], 0.5 ** np.arange(n, -1, -1)])
    points = np.concatenate([np.column_stack([x, np.zeros_like(x)]), np.column_stack([x, np.ones_like(x)])])
    k = np.arange(n + 1)
    return vx.PolygonMesh(points, np.column_stack([k, k + 1, k + n + 3, k + n + 2]))


def comb(n=40):
    """A cell with forty vertices on one side, some of whose ears are flat, above as many others."""
    x = np.linspace(0, 1, n + 1)
    points = np.concatenate([np.column_stack([x, 0 * x]), [[1, 1], [0, 1]], np.column_stack([x, 0 * x - 1 / n])])
    return vx.PolygonMesh(points, [[*range(n + 3)], *([n + 3 + i, n + 4 + i, i + 1, i] for i in range(n))])


@pytest.mark.long
@pytest.mark.parametrize(
    ("made", "low", "rounding"),
    [(lambda: graded(33), 0.0, 1e-9), (lambda: vx.meshes.squares((2, 2000)), 0.0, 1e-12), (comb, -1 / 40, 1e-13)],
)
def test_sizes_that_spread_and_slivers(made, low, rounding):
    """Widths over ten decades, cells a thousand times as wide as high, and many vertices on one side."""
    meshes = made(), small("voronoi", 6, box=((0, 1), (low, 1)))
    assert vx.measures.energy_distance(*(field(mesh, affine) for mesh in meshes)).relative < rounding
    a, b = (field(mesh, wavy) for mesh in meshes)
    there, back = vx.measures.energy_distance(a, b), vx.measures.energy_distance(b, a)
    assert there.absolute == pytest.approx(back.absolute, rel=1e-11)


@pytest.mark.long
def test_far_from_the_origin():
    """Coordinates near 1e5 and cells of 1e-3: points are rounded to 1e-11, a part 1e-8 of a cell."""
    box = ((1e5, 1e5 + 0.01), (-1e5, -1e5 + 0.01))
    a, b = vx.meshes.voronoi(box=box, cells=100), vx.meshes.squares((8, 8), box=box)

    def gentle(x):
        return wavy((x - a.points.min(axis=0)) * 100)

    near = [field(vx.PolygonMesh((m.points - a.points.min(axis=0)) * 100, m.cells), wavy) for m in (a, b)]
    far = [field(m, gentle) for m in (a, b)]
    expected = vx.measures.energy_distance(*near)
    assert vx.measures.energy_distance(*far).relative == pytest.approx(expected.relative, rel=1e-6)


def test_different_moduli_are_the_first_ones_and_said_so(caplog):
    a, b = field(vx.meshes.squares(3), affine), field(vx.meshes.squares(2), nothing, lam=3.0)
    apart = vx.measures.energy_distance(a, b)
    assert apart.moduli_apart == pytest.approx(1.5 / (LAM + 2 * MU))
    assert "moduli of the two meshes differ by up to 0.484" in caplog.text
    same = vx.measures.energy_distance(a, field(vx.meshes.squares(2), nothing))
    assert (apart.absolute, same.moduli_apart) == (pytest.approx(same.absolute), 0.0)


def test_an_orthotropic_matrix_weighs_like_the_isotropic_it_equals():
    a, b = field(small("voronoi", 4), wavy), field(vx.meshes.squares(4), wavy)
    C = [LAM + 2 * MU, LAM, 0.0, LAM + 2 * MU, 0.0, MU]
    full = vx.measures.Field(a.mesh, a.displacement, np.tile(np.array(C)[:, None], a.mesh.n_cells))
    one, two = vx.measures.energy_distance(a, b), vx.measures.energy_distance(full, b)
    assert two.cells == pytest.approx(one.cells, rel=1e-13)
    assert two.moduli_apart == 0.0


def test_nodal_distance_is_the_norm_of_the_stiffness_matrix(family):
    """|u - I v|_{a^h} by the assembled matrix; a mesh's nodes are its own."""
    from vemcvx.vem import Space, stiffness

    a, b = field(mesh_of(family, 5), wavy), field(mesh_of(family, 5), other)
    A = stiffness(Space(a.mesh), *a.moduli)
    w = (a.displacement - b.displacement).ravel()
    apart = vx.measures.energy_distance(a, b, kind="nodal")
    assert apart.absolute == pytest.approx(np.sqrt(w @ A @ w), rel=1e-12)
    v = b.displacement.ravel()
    assert apart.reference == pytest.approx(np.sqrt(v @ A @ v), rel=1e-12)


@pytest.mark.parametrize("name", ["squares", "triangles"])
def test_nested_nodes(name):
    """27 by 27 in 9 by 9: the thirds of a box round differently, and are the same nodes."""
    coarse, fine = field(mesh_of(name, 9), wavy), field(mesh_of(name, 27), wavy)
    assert vx.measures.energy_distance(coarse, fine, kind="nodal").relative < 1e-14
    with pytest.raises(vx.MeshError, match=r"node \d+ of the first mesh, .* is no node of the second"):
        vx.measures.energy_distance(fine, coarse, kind="nodal")


def test_mistakes():
    a, b = field(vx.meshes.squares(3), wavy), field(small("voronoi", 3), wavy)
    distance = vx.measures.energy_distance
    for error, said, call in (
        (vx.HistoryError, "found kind 'best'", lambda: distance(a, b, kind="best")),
        (vx.MeshError, r"second mesh\): cell \d+, of \d vertices", lambda: distance(a, b, kind="exact")),
        (vx.HistoryError, "found 3; wanted a History", lambda: distance(3, b)),
        (
            vx.HistoryError,
            r"found displacements \(4, 2\)",
            lambda: vx.measures.Field(a.mesh, np.zeros((4, 2)), a.moduli),
        ),
        (vx.HistoryError, r"found moduli \(2, 3\)", lambda: vx.measures.Field(a.mesh, a.displacement, np.ones((2, 3)))),
    ):
        with pytest.raises(error, match=said):
            call()


def test_different_domains_are_refused_unless_meant():
    a, b = field(vx.meshes.squares(4), affine), field(vx.meshes.squares(4, box=((0, 0.5), (0, 1))), nothing)
    with pytest.raises(vx.MeshError, match=r"first mesh has the area 1, the second 0.5, and they share 0.5; both must"):
        vx.measures.energy_distance(a, b)
    aside = field(vx.meshes.squares(4, box=((0.5, 1.5), (0, 1))), nothing)
    with pytest.raises(vx.MeshError, match=r"first mesh has the area 1, the second 1, and they share 0.5; both must"):
        vx.measures.energy_distance(a, aside)
    half = vx.measures.energy_distance(a, b, common=True).absolute
    assert half == pytest.approx(vx.measures.energy_distance(a, field(a.mesh, nothing)).absolute / np.sqrt(2))


@pytest.mark.long
@pytest.mark.parametrize("kind", ["projected", "exact", "nodal"])
def test_sixteen_times_the_cells_take_hardly_more_calls(kind):
    def count(a, b):
        common_rule.cache_clear()
        return calls(lambda: vx.measures.energy_distance(a, b, kind=kind))

    coarse = field(vx.meshes.squares(8), wavy)
    meshes = [field(vx.meshes.squares(n), wavy) for n in (16, 64)]
    small, large = (count(coarse, fine) if kind == "nodal" else count(fine, coarse) for fine in meshes)
    assert large < 1.5 * small
    if kind == "projected":
        meshes = [[field(vx.meshes.voronoi(cells=n, seed=seed), wavy) for seed in (0, 1)] for n in (40, 400)]
        few, many = (count(*pair) for pair in meshes)
        assert many < 1.5 * few
