"""Corners where stress has no limit: exponents against closed forms, and what is said of extremes there."""

import json

import numpy as np
import pytest
from scipy.optimize import brentq
from test_extremes import cycle

import block_between_dies
import hertz_contact
import l_shaped_bracket
import plate_with_hole
import press_fit
import two_blocks_in_series
import vemcvx as vx
from vemcvx.results.corners import Corners
from vemcvx.results.quoted import growth
from vemcvx.results.wedges import CLAMPED, FREE, Sector, Wedge, held_along, joined, slipping

KAPPA = 3.0 - 4.0 * 0.3


def exponent(sectors, joints, ends):
    return Wedge(sectors, joints, ends).exponent


def sector(degrees):
    return Sector(np.deg2rad(degrees), KAPPA, 7.0)


@pytest.mark.parametrize("degrees", [190, 225, 270, 315, 350])
def test_free_sides_are_as_williams_has_them(degrees):
    """Symmetric fields: sin(lam a) = -lam sin(a)."""
    a = np.deg2rad(degrees)
    closed = brentq(lambda lam: np.sin(lam * a) + lam * np.sin(a), 0.4, 0.99)
    assert exponent([sector(degrees)], [], (FREE, FREE)) == pytest.approx(closed, abs=1e-8)


@pytest.mark.parametrize("degrees", [75, 90, 105, 120])
def test_a_clamp_beside_a_free_side_is_as_williams_has_it(degrees):
    """sin^2(lam a) = (kappa + 1)^2 / 4 kappa - lam^2 sin^2(a) / kappa."""
    a = np.deg2rad(degrees)

    def closed(lam):
        return np.sin(lam * a) ** 2 - (KAPPA + 1) ** 2 / (4 * KAPPA) + lam**2 * np.sin(a) ** 2 / KAPPA

    for ends in ((CLAMPED, FREE), (FREE, CLAMPED)):
        assert exponent([sector(degrees)], [], ends) == pytest.approx(brentq(closed, 0.3, 0.995), abs=1e-8)


@pytest.mark.long
def test_exponents_that_everybody_knows():
    smooth, crack, clamped = sector(180), sector(360), (CLAMPED, FREE)
    assert exponent([smooth], [], (FREE, FREE)) == 1.0
    assert exponent([sector(60)], [], (FREE, FREE)) == 1.0
    assert exponent([crack], [], (FREE, FREE)) == pytest.approx(0.5, abs=1e-6)
    # Half plane, half of it clamped: 1/2 +- i log(kappa) / 2 pi.
    assert exponent([smooth], [], clamped) == pytest.approx(0.5, abs=1e-8)
    # A corner of 90 degrees on a half plane of the same material, glued: a reentrant corner of 270 degrees.
    glued = exponent([sector(90), smooth], [joined("sticks")], (FREE, FREE))
    assert glued == pytest.approx(0.544483736782464, abs=1e-8)
    # Without friction: .774 (Dundurs and Lee, Stress concentration at a sharp edge in contact problems, 1972).
    pressed = exponent([sector(90), smooth], [joined("slips")], (FREE, FREE))
    assert pressed == pytest.approx(0.774, abs=5e-4)
    # With friction, one edge is worse and the other better (Comninou 1976).
    worse, better = sorted(exponent([sector(90), smooth], [joined("slips", f)], (FREE, FREE)) for f in (-0.3, 0.3))
    assert worse < pressed < better
    # A ring: a crack closed by glue is none.
    assert exponent([crack], [joined("sticks")], None) == 1.0
    assert exponent([crack], [joined("open")], None) == pytest.approx(0.5, abs=1e-6)


def test_a_plane_of_symmetry_is_half_of_the_whole():
    roller = held_along(0.0, 1.0)
    np.testing.assert_array_equal(np.abs(roller), np.abs(slipping(0.0)))
    assert exponent([sector(135)], [], (roller, FREE)) == pytest.approx(0.544483736782464, abs=1e-8)
    assert exponent([sector(90)], [], (roller, FREE)) == 1.0


def said(history):
    return {one.key: one.unbounded for one in history.extremes}


@pytest.mark.long
def test_a_clamp_and_contact_that_sticks_are_told():
    """From squares of 1/8 to 1/16 the pressure at the corner grows by 2^.29, as the exponent says."""
    found = {n: cycle(vx.meshes.squares(n)) for n in (8, 16)}
    told = said(found[16])
    clamp = "at a corner of clamp and free side: grows without limit as the mesh is refined, like r^-0.29"
    touch = "at a corner of contact that sticks and free side: grows without limit as the mesh is refined, like r^-0.29"
    assert told["von_mises"] == told["largest_principal_stress"] == clamp
    assert told["pressure"] == told["friction"] == touch
    assert told["displacement"] == told["slip"] == ""
    peak = [{one.key: one.value for one in history.extremes}["pressure"] for history in found.values()]
    assert peak[1] / peak[0] == pytest.approx(2**0.29, rel=0.03)


@pytest.mark.long
def test_the_recovered_pressure_is_told_as_the_raw_one():
    """Nodes of contact are not cells: on a flat row of eight there are more of them."""
    moved = vx.PrescribedDisplacement(
        lambda x, t: -0.01 * t * np.column_stack([0 * x[:, 0], 1 + x[:, 0] / 4]), on="top"
    )
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), moved, vx.UnilateralContact(on="bottom"))
    flat = vx.simulate(scene, vx.meshes.squares((8, 1), box=((-4.0, 4.0), (0.0, 1.0))), [0.0, 0.5, 1.0])
    assert said(flat)["pressure_recovered"] == said(flat)["pressure"] == ""
    told = said(cycle(vx.meshes.squares(16)))
    assert told["pressure_recovered"] == told["pressure"] != ""


@pytest.mark.long
def test_clamp_and_contact_at_an_obtuse_corner():
    """120 degrees between them: by symmetry 240 degrees between two clamps, singular where 90 degrees are not."""
    mesh = vx.PolygonMesh(np.array([[0, 0], [2, 0], [2, 1], [-(3**-0.5), 1]]), [[0, 1, 2, 3]]).refine().refine()
    mesh = mesh.with_boundary("flank", lambda x: np.abs(x[:, 0] * 3**0.5 + x[:, 1]) < 1e-9)
    mesh = mesh.with_boundary("base", lambda x: x[:, 1] < 1e-9).with_boundary("top", lambda x: x[:, 1] > 1 - 1e-9)
    pressed = vx.UnilateralContact(on="flank"), vx.Traction((-1.0, -1.0), on="top")
    for friction in ((), (vx.TrescaFriction(0.1, on="flank"),)):
        scene = vx.Scene(vx.Elasticity(100.0, 0.3), vx.Clamp(on="base"), *pressed, *friction)
        corners = corners_of(vx.simulate(scene, mesh, [0.0, 1.0], initial="settled"))
        told = corners.sentence({0: 1.0}, -1, "pressure")
        assert told.startswith("at a corner of clamp and contact: grows without limit")
        assert corners.sentence({0: 1.0}, -1, "friction") == ""
    a = np.deg2rad(240)
    odd, even = (brentq(lambda lam, f=f: KAPPA * np.sin(lam * a) + f * lam * np.sin(a), 0.5, 0.99) for f in (-1, 1))
    assert exponent([sector(240)], [], (CLAMPED, CLAMPED)) == pytest.approx(min(odd, even), abs=1e-8)
    assert exponent([sector(120)], [], (CLAMPED, slipping(0.0))) == pytest.approx(max(odd, even), abs=1e-8)
    assert exponent([sector(90)], [], (CLAMPED, slipping(0.0))) == 1.0


def corners_of(history):
    return Corners(history.mesh, history.contact, history.moduli, history.sides)


@pytest.mark.long
@pytest.mark.parametrize(
    ("problem", "n"),
    [(hertz_contact, 8), (plate_with_hole, 6), (press_fit, 4), (two_blocks_in_series, 4), (block_between_dies, 8)],
)
def test_nothing_is_said_where_stress_has_a_limit(problem, n):
    """Contact that ends where it opens, curves of polygons, planes of symmetry, glue by friction, uniform stress."""
    begin = getattr(problem, "initial", None)
    history = vx.simulate(problem.scene(), problem.mesh(n), problem.times(4), initial=begin)
    assert not any(said(history).values())


def test_a_reentrant_corner_is_told():
    mesh = vx.meshes.l_shape(8)
    scene = l_shaped_bracket.scene()
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    near = np.linalg.norm(mesh.centroids - 0.5, axis=1).argmin()
    node = int(np.linalg.norm(mesh.points - 0.5, axis=1).argmin())
    assert node in mesh.cells[near]
    told = corners_of(history).sentence(dict.fromkeys(mesh.cells[near].tolist(), 1.0), -1, "von_mises")
    assert told == "at a reentrant corner: grows without limit as the mesh is refined, like r^-0.46"


@pytest.mark.long
def test_a_corner_beside_the_largest_stress_is_told():
    """On the coarse mesh von Mises' stress is largest one cell from the corner, which it is no more on the next."""
    places, told = [], []
    for n in (8, 16):
        scene = vx.Scene(vx.Elasticity(2e4, 0.3), vx.Clamp(on="top"), vx.Traction((0.0, -1.0), on="right"))
        history = vx.simulate(scene, vx.meshes.l_shape(n), [0.0, 1.0], initial="settled")
        (largest,) = (one for one in history.extremes if one.key == "von_mises")
        places.append(tuple(n * (largest.place - 0.5)))
        told.append(largest.unbounded)
    assert places == [(-0.5, 1.5), (-0.5, 0.5)]
    assert told == ["at a reentrant corner: grows without limit as the mesh is refined, like r^-0.46"] * 2


def test_values_that_grow_by_a_factor_are_told_from_those_with_a_limit():
    h = 0.5 ** np.arange(5)
    assert growth(h, h**-0.29).startswith("grew from mesh to mesh at a rate that hardly falls: 1.22, 1.49, 1.83")
    assert growth(h, -3.0 * h**-0.1)
    assert growth(h, 2.0 - h) == ""
    assert growth(h, 2.0 - 0.9 * np.sqrt(h)) == ""
    assert growth(h, np.ones(5)) == ""
    assert growth(h[:2], h[:2] ** -0.5) == ""
    # Two meshes with the same cells there are one.
    assert growth([1.0, 1.0, 0.5, 0.5, 0.25], [1.0, 1.1, 1.3, 1.35, 1.7]) != ""


@pytest.mark.long
def test_adaptive_runs_tell_growth_and_keep_it(tmp_path):
    scene = cycle(vx.meshes.squares(2)).scene
    found = vx.adapt(scene, vx.meshes.squares(4), np.linspace(0.0, 2.0, 9), 0.1)
    told = said(found.history)
    assert "at a corner of contact that sticks and free side" in told["pressure"]
    assert "; grew from mesh to mesh at a rate that hardly falls: " in told["pressure"]
    assert set(found.history.growth) >= {"von_mises", "pressure"}
    found.history.write(tmp_path)
    kept = json.loads((tmp_path / "summary.json").read_text())["extremes"]
    assert {key: one["unbounded"] or "" for key, one in kept.items()} == told
    again = vx.read_history(tmp_path)
    assert again.growth == found.history.growth
    assert said(again) == told


@pytest.mark.parametrize(("dim", "like"), [(2, "r^-1"), (3, "r^-2")])
def test_point_loads_are_told(dim, like):
    """From squares of 1/8 to 1/16 the stress of the cell beside the load doubles; half as large, it is no extreme."""
    found = {}
    for n in (4, 8) if dim == 3 else (8, 16):
        mesh = vx.meshes.squares(n) if dim == 2 else vx.meshes.cubes(n)
        down = (0.0,) * (dim - 1) + (-1.0,)
        at = (0.5,) * (dim - 1) + (1.0,)
        scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="bottom"), vx.PointLoad(down, at=at))
        found[n] = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
    coarse, fine = ({one.key: one for one in history.extremes} for history in found.values())
    words = f"at a point load: grows without limit as the mesh is refined, like {like}"
    assert fine["von_mises"].unbounded == fine["smallest_principal_stress"].unbounded == words
    assert fine["displacement"].unbounded == words.replace(like, "log r" if dim == 2 else "r^-1")
    assert fine["von_mises"].value / coarse["von_mises"].value == pytest.approx(2 ** (dim - 1), rel=0.15)


@pytest.mark.parametrize("friction", [vx.CoulombFriction(0.3, on="bottom"), vx.TrescaFriction(0.05, on="bottom")])
def test_friction_at_a_point_load_is_told_where_it_follows_pressure(friction):
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Clamp(on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.PointLoad((0.5, -1.0), at=(0.5, 0.0)),
        friction,
    )
    history = vx.simulate(scene, vx.meshes.squares(8), [0.0, 1.0], initial="settled")
    assert said(history)["pressure"].startswith("at a point load")
    assert said(history)["friction"].startswith("at a point load") == isinstance(friction, vx.CoulombFriction)


@pytest.mark.long
def test_point_loads_elsewhere_are_not_told(tmp_path):
    """The largest stress is that of a clamp's corner, and the remark on it is kept in files."""
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Clamp(on="left"),
        vx.Traction((0.0, -1.0), on="right"),
        vx.PointLoad((0.0, -1e-3), at=(0.5, 1.0)),
    )
    history = vx.simulate(scene, vx.meshes.squares(8), [0.0, 1.0], initial="settled")
    assert said(history)["von_mises"].startswith("at a corner of clamp and free side")
    assert said(history)["displacement"] == ""
    history.write(tmp_path)
    assert said(vx.read_history(tmp_path)) == said(history)


@pytest.mark.parametrize(("young", "poisson"), [(10.0, 0.3), (0.2, 0.45), (3.0, 0.0)])
def test_bonded_quarters_are_as_bogy_has_them(young, poisson):
    """Two quarter planes with a common free side, from Dundurs' parameters (Bogy, J. Appl. Mech. 38, 1971)."""
    one, other = (E / (2 * (1 + nu)) for E, nu in ((1.0, 0.3), (young, poisson)))
    k, m = 3 - 4 * 0.3, 3 - 4 * poisson
    total = other * (k + 1) + one * (m + 1)
    a, b = (other * (k + 1) - one * (m + 1)) / total, (other * (k - 1) - one * (m - 1)) / total

    def closed(p):
        s = np.sin(np.pi * p / 2) ** 2 - p**2
        return b**2 * s**2 + 2 * a * b * p**2 * s + a**2 * p**2 * (p**2 - 1) + np.sin(np.pi * p) ** 2 / 4

    known = brentq(closed, 0.5, 0.999)
    quarters = [Sector(np.pi / 2, k, one), Sector(np.pi / 2, m, other)]
    assert exponent(quarters, [joined("sticks")], (FREE, FREE)) == pytest.approx(known, abs=1e-8)


@pytest.mark.long
def test_the_free_edge_of_two_materials_is_told():
    """A strip of two materials, side by side, is pulled along: stress grows where they meet at its free sides."""
    found = {}
    for n in (8, 16):
        mesh = vx.meshes.squares((2 * n, n), box=((-1.0, 1.0), (0.0, 1.0)))
        mesh = mesh.with_cell_data("young", np.where(mesh.centroids[:, 0] < 0, 1.0, 20.0))
        mesh = mesh.with_cell_data("poisson", np.where(mesh.centroids[:, 0] < 0, 0.3, 0.2))
        ends = vx.Symmetry(on="left"), vx.Symmetry(on="bottom")
        scene = vx.Scene(vx.Elasticity("young", "poisson"), *ends, vx.Traction((0.01, 0.0), on="right"))
        found[n] = vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")
    told = said(found[16])["von_mises"]
    assert told.startswith("where materials meet at free side: grows without limit as the mesh is refined, like r^-0.")
    places = [{one.key: one for one in history.extremes}["von_mises"] for history in found.values()]
    grown = np.log2(places[1].value / places[0].value)
    assert grown == pytest.approx(float(told.split("r^-")[1]), abs=0.03)


def test_fields_of_material_are_no_corners():
    """Moduli that change from cell to cell are those of a field, which changes no more as the mesh is refined."""
    mesh = vx.meshes.squares(8)
    mesh = mesh.with_cell_data("young", 100.0 + 900.0 * np.random.default_rng(1).random(mesh.n_cells))
    scene = vx.Scene(
        vx.Elasticity("young", 0.3), vx.Symmetry(on=("left", "bottom")), vx.Traction((1.0, 0.0), on="right")
    )
    assert set(said(vx.simulate(scene, mesh, [0.0, 1.0], initial="settled")).values()) == {""}
