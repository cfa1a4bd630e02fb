"""Corners where stress may have no limit: what is said of extremes there, and where nothing is said."""

import json

import numpy as np
import pytest
from test_extremes import cycle

import block_between_dies
import feng_han_huang
import hertz_contact
import plate_with_hole
import press_fit
import two_blocks_in_series
import vemcvx as vx
from vemcvx.results import Corners, growth

MAY = ": may grow without limit as the mesh is refined"
LOADED = "at a point load: grows without limit as the mesh is refined"
STEEL = vx.Elasticity(200.0, 0.3)


def said(history):
    return {one.key: one.unbounded for one in history.extremes}


def settled(mesh, *effects):
    return vx.simulate(vx.Scene(*effects), mesh, [0.0, 1.0], initial="settled")


def corner_at(history, place):
    """What is said of the corner at a place."""
    node = int(np.linalg.norm(history.mesh.points - place, axis=1).argmin())
    return Corners(history.mesh, history.contact, history.sides).sentence([node], -1)


@pytest.mark.long
def test_a_clamp_and_contact_with_friction_are_told():
    """From squares of 1/8 to 1/16 the pressure at the corner grows by 2^.29, as Williams' exponent says."""
    found = {n: cycle(vx.meshes.squares(n)) for n in (8, 16)}
    told = said(found[16])
    assert told["von_mises"] == told["largest_principal_stress"] == f"at a corner of clamp and free side{MAY}"
    of_contact = {told[key] for key in ("pressure", "pressure_recovered", "friction")}
    assert of_contact == {f"at a corner of contact with friction and free side{MAY}"}
    assert told["displacement"] == told["slip"] == ""
    peak = [{one.key: one.value for one in history.extremes}["pressure"] for history in found.values()]
    assert peak[1] / peak[0] == pytest.approx(2**0.29, rel=0.03)


@pytest.mark.parametrize(
    ("held", "place", "told"),
    [
        (vx.Clamp(on="bottom"), (0.0, 0.0), f"at a corner of clamp and free side{MAY}"),
        (vx.Symmetry(on=["bottom", "right"]), (0.0, 0.0), ""),
        (vx.Clamp(on=["bottom", "left"]), (0.0, 0.0), ""),
        (vx.Clamp(on="bottom"), (0.5, 0.5), f"at a reentrant corner{MAY}"),
        (vx.Clamp(on="bottom"), (0.0, 1.0), ""),
        (vx.Clamp(on="bottom"), (0.25, 0.0), ""),
    ],
)
def test_angles_and_conditions_decide(held, place, told):
    """An L-shaped body: alike sides are told beyond 180 degrees, held ones beside free ones at 90, mirrors never."""
    assert corner_at(settled(vx.meshes.l_shape(8), STEEL, held, vx.Traction((0.0, -1.0), on="left")), place) == told


@pytest.mark.parametrize(("degrees", "told"), [(90, ""), (120, f"at a corner of clamp and contact{MAY}")])
def test_contact_without_friction_is_a_mirror(degrees, told):
    """Between clamp and contact: by symmetry twice the angle between two clamps, singular beyond 180 degrees."""
    lean = 1.0 / np.tan(np.radians(degrees))
    mesh = vx.PolygonMesh(np.array([[0, 0], [2, 0], [2, 1], [lean, 1]]), [[0, 1, 2, 3]]).refine().refine()
    mesh = mesh.with_boundary("flank", lambda x: np.abs(x[:, 0] - lean * x[:, 1]) < 1e-9)
    mesh = mesh.with_boundary("base", lambda x: x[:, 1] < 1e-9).with_boundary("top", lambda x: x[:, 1] > 1 - 1e-9)
    pressed = vx.UnilateralContact(on="flank"), vx.Traction((-1.0, -1.0), on="top")
    assert corner_at(settled(mesh, vx.Elasticity(100.0, 0.3), vx.Clamp(on="base"), *pressed), (0.0, 0.0)) == told


@pytest.mark.parametrize("friction", [(), (vx.CoulombFriction(0.3, on="bottom"),)])
def test_contact_that_opens_along_a_side_is_no_corner(friction):
    """An edge is lifted: its end on the left is a corner, that of contact in the middle is none."""
    lift = vx.PrescribedDisplacement(lambda x, t: t * (x[:, :1] * [0.0, 0.04] + [0.0, -0.02]), on="top")
    history = settled(vx.meshes.squares(8), STEEL, lift, vx.UnilateralContact(on="bottom"), *friction)
    contact = history.contact
    places = contact.points[np.argsort(contact.points[:, 0])]
    closed = contact.closed[-1][np.argsort(contact.points[:, 0])]
    assert 2 < closed.sum() < 7
    assert {corner_at(history, place) for place in places[1:]} == {""}
    corner = f"at a corner of contact with friction and free side{MAY}" if friction else ""
    assert corner_at(history, places[0]) == corner


@pytest.mark.parametrize(("wide", "told"), [(2.0, f"at a reentrant corner{MAY}"), (1.0, "")])
def test_bodies_that_meet_are_one_of_all_their_angles(wide, told):
    """A block on a wider one, 270 degrees, and on one as wide."""
    boxes = {"lower": ((-1.0, wide - 1.0), (-1.0, 0.0)), "upper": ((-1.0, 0.0), (0.0, 1.0))}
    mesh = vx.meshes.bodies({name: vx.meshes.squares((4 * int(box[0][1] + 1), 4), box) for name, box in boxes.items()})
    contact = vx.UnilateralContact(on="lower|upper"), vx.Clamp(on="lower.bottom")
    history = settled(mesh, STEEL, *contact, vx.PrescribedDisplacement((0.0, -0.01), on="upper.top"))
    assert corner_at(history, (0.0, 0.0)) == told


def test_the_tip_of_a_crack_is_told():
    mesh = vx.meshes.squares(8)
    x, y = mesh.centroids.T
    cut = mesh.cut("crack", {"above": (y > 0.5) & (x < 0.5), "below": (y < 0.5) & (x < 0.5)})
    history = settled(cut, STEEL, vx.Clamp(on="bottom"), vx.Traction((0.0, 1.0), on="top"))
    assert corner_at(history, (0.5, 0.5)) == f"at a reentrant corner{MAY}"
    assert corner_at(history, (0.25, 0.5)) == corner_at(history, (0.0, 0.5)) == ""


@pytest.mark.long
@pytest.mark.parametrize(
    ("problem", "n"),
    [(hertz_contact, 8), (plate_with_hole, 6), (press_fit, 4), (two_blocks_in_series, 4), (block_between_dies, 8)],
)
def test_nothing_is_said_where_stress_has_a_limit(problem, n):
    """Contact that ends where it opens, curves of polygons, planes of symmetry, uniform stress."""
    begin = getattr(problem, "initial", None)
    history = vx.simulate(problem.scene(), problem.mesh(n), problem.times(4), initial=begin)
    assert not any(said(history).values())


@pytest.mark.long
def test_a_corner_beside_the_largest_stress_is_told():
    """On the coarse mesh von Mises' stress is largest one cell from the corner, which it is no more on the next."""
    for n, place in ((8, (-0.5, 1.5)), (16, (-0.5, 0.5))):
        history = settled(
            vx.meshes.l_shape(n), vx.Elasticity(2e4, 0.3), vx.Clamp(on="top"), vx.Traction((0.0, -1.0), on="right")
        )
        (largest,) = (one for one in history.extremes if one.key == "von_mises")
        assert tuple(n * (largest.place - 0.5)) == place
        assert largest.unbounded == f"at a reentrant corner{MAY}"


@pytest.mark.long
def test_given_friction_has_its_bound_and_sides_are_kept_in_files(tmp_path):
    history = vx.simulate(feng_han_huang.scene(), feng_han_huang.mesh(8), feng_han_huang.times(2))
    told = said(history)
    assert told["von_mises"] == f"at a corner of contact with friction and free side{MAY}"
    assert told["friction"] == ""
    history.write(tmp_path)
    assert said(vx.read_history(tmp_path)) == told


def test_values_that_grow_are_told_from_those_that_do_not():
    h = 0.5 ** np.arange(5)
    assert growth(h, h**-0.29) == "grew by a factor 1.22 from h = 0.125 to 0.0625"
    assert growth(h, -3.0 * h**-0.1) == "grew by a factor 1.07 from h = 0.125 to 0.0625"
    assert growth(h, 2.0 - h) == growth(h, np.ones(5)) == growth(h[:1], h[:1]) == growth([], []) == ""
    # Two meshes with the same cells there are one.
    assert growth([1.0, 0.5, 0.5, 0.45], [1.0, 1.3, 1.35, 1.5]) == "grew by a factor 1.5 from h = 1 to 0.45"


@pytest.mark.long
def test_adaptive_runs_tell_growth_and_keep_it(tmp_path):
    scene = cycle(vx.meshes.squares(2)).scene
    found = vx.adapt(scene, vx.meshes.squares(4), np.linspace(0.0, 2.0, 9), 0.1)
    told = said(found.history)
    assert f"at a corner of contact with friction and free side{MAY}; grew by a factor " in told["pressure"]
    assert set(found.history.growth) >= {"von_mises", "pressure"}
    found.history.write(tmp_path)
    kept = json.loads((tmp_path / "summary.json").read_text())["extremes"]
    assert {key: one["unbounded"] or "" for key, one in kept.items()} == told
    again = vx.read_history(tmp_path)
    assert again.growth == found.history.growth
    assert said(again) == told


@pytest.mark.parametrize("dim", [2, 3])
def test_point_loads_are_told(dim):
    """From squares of 1/8 to 1/16 the stress of the cell beside the load doubles; half as large, it is no extreme."""
    found = {}
    for n in (4, 8) if dim == 3 else (8, 16):
        mesh = vx.meshes.squares(n) if dim == 2 else vx.meshes.cubes(n)
        down, at = (0.0,) * (dim - 1) + (-1.0,), (0.5,) * (dim - 1) + (1.0,)
        found[n] = settled(mesh, STEEL, vx.Clamp(on="bottom"), vx.PointLoad(down, at=at))
    coarse, fine = ({one.key: one for one in history.extremes} for history in found.values())
    assert {fine[key].unbounded for key in ("von_mises", "smallest_principal_stress", "displacement")} == {LOADED}
    assert fine["von_mises"].value / coarse["von_mises"].value == pytest.approx(2 ** (dim - 1), rel=0.15)


@pytest.mark.parametrize("friction", [vx.CoulombFriction(0.3, on="bottom"), vx.TrescaFriction(0.05, on="bottom")])
def test_friction_at_a_point_load_is_told_where_it_follows_pressure(friction):
    load = vx.PointLoad((0.5, -1.0), at=(0.5, 0.0))
    history = settled(
        vx.meshes.squares(8), STEEL, vx.Clamp(on="top"), vx.UnilateralContact(on="bottom"), load, friction
    )
    assert said(history)["pressure"] == LOADED
    assert (said(history)["friction"] == LOADED) == isinstance(friction, vx.CoulombFriction)
