"""Extremes at corners with unbounded stress are marked."""

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
CLAMP, RUBBED = (f"at a corner of {what} and free side{MAY}" for what in ("clamp", "contact with friction"))
REENTRANT = f"at a reentrant corner{MAY}"
STEEL = vx.Elasticity(200.0, 0.3)


def marks(history):
    return {one.key: one.unbounded for one in history.extremes}


def run_settled(mesh, *effects):
    return vx.simulate(vx.Scene(*effects), mesh, [0.0, 1.0], initial="settled")


def mark_at(history, place):
    node = int(np.linalg.norm(history.mesh.points - place, axis=1).argmin())
    return Corners(history.mesh, history.contact, history.sides).sentence([node], -1)


@pytest.mark.long
def test_corners_of_clamps_and_of_contact_with_friction_are_marked():
    """From h = 1/8 to h = 1/16, the corner pressure grows by about the factor 2^.29 (Williams)."""
    found = {n: cycle(vx.meshes.squares(n)) for n in (8, 16)}
    told = marks(found[16])
    assert told["von_mises"] == told["largest_principal_stress"] == CLAMP
    assert {told[key] for key in ("pressure", "pressure_recovered", "friction")} == {RUBBED}
    assert told["displacement"] == told["slip"] == ""
    peak = [{one.key: one.value for one in history.extremes}["pressure"] for history in found.values()]
    assert peak[1] / peak[0] == pytest.approx(2**0.29, rel=0.03)


@pytest.mark.parametrize(
    ("held", "place", "words"),
    [
        (vx.Clamp(on="bottom"), (0.0, 0.0), CLAMP),
        (vx.Symmetry(on=["bottom", "right"]), (0.0, 0.0), ""),
        (vx.Clamp(on=["bottom", "left"]), (0.0, 0.0), ""),
        (vx.Clamp(on="bottom"), (0.5, 0.5), REENTRANT),
        (vx.Clamp(on="bottom"), (0.0, 1.0), ""),
        (vx.Clamp(on="bottom"), (0.25, 0.0), ""),
    ],
)
def test_angles_and_boundary_conditions_decide_which_corners_are_marked(held, place, words):
    load = vx.Traction((0.0, -1.0), on="left")
    assert mark_at(run_settled(vx.meshes.l_shape(8), STEEL, held, load), place) == words


@pytest.mark.parametrize(("degrees", "words"), [(90, ""), (120, f"at a corner of clamp and contact{MAY}")])
def test_frictionless_contact_counts_as_symmetry(degrees, words):
    """The body and the mirror image form one wedge."""
    lean = 1.0 / np.tan(np.radians(degrees))
    mesh = vx.PolygonMesh(np.array([[0, 0], [2, 0], [2, 1], [lean, 1]]), [[0, 1, 2, 3]]).refine().refine()
    mesh = mesh.with_boundary("flank", lambda x: np.abs(x[:, 0] - lean * x[:, 1]) < 1e-9)
    mesh = mesh.with_boundary("base", lambda x: x[:, 1] < 1e-9).with_boundary("top", lambda x: x[:, 1] > 1 - 1e-9)
    pressed = vx.UnilateralContact(on="flank"), vx.Traction((-1.0, -1.0), on="top")
    assert mark_at(run_settled(mesh, STEEL, vx.Clamp(on="base"), *pressed), (0.0, 0.0)) == words


@pytest.mark.parametrize("friction", [(), (vx.CoulombFriction(0.3, on="bottom"),)])
def test_the_edge_of_contact_inside_a_side_is_no_corner(friction):
    """One end of the contact is the left corner. The other end is inside the bottom edge."""
    lift = vx.PrescribedDisplacement(lambda x, t: t * (x[:, :1] * [0.0, 0.04] + [0.0, -0.02]), on="top")
    history = run_settled(vx.meshes.squares(8), STEEL, lift, vx.UnilateralContact(on="bottom"), *friction)
    places = sorted(history.contact.points.tolist())
    assert 2 < history.contact.closed[-1].sum() < 7
    assert {mark_at(history, place) for place in places[1:]} == {""}
    assert mark_at(history, places[0]) == (RUBBED if friction else "")


@pytest.mark.parametrize(("width", "words"), [(2.0, REENTRANT), (1.0, "")])
def test_angles_of_touching_bodies_are_added(width, words):
    """The angle is 270 degrees on a wider block, and 180 degrees on a block of the same width."""
    boxes = {"lower": ((-1.0, width - 1.0), (-1.0, 0.0)), "upper": ((-1.0, 0.0), (0.0, 1.0))}
    mesh = vx.meshes.bodies({name: vx.meshes.squares((4 * int(box[0][1] + 1), 4), box) for name, box in boxes.items()})
    contact = vx.UnilateralContact(on="lower|upper"), vx.Clamp(on="lower.bottom")
    history = run_settled(mesh, STEEL, *contact, vx.PrescribedDisplacement((0.0, -0.01), on="upper.top"))
    assert mark_at(history, (0.0, 0.0)) == words


def test_the_tip_of_a_crack_is_marked():
    mesh = vx.meshes.squares(8)
    x, y = mesh.centroids.T
    cut = mesh.cut("crack", {"above": (y > 0.5) & (x < 0.5), "below": (y < 0.5) & (x < 0.5)})
    history = run_settled(cut, STEEL, vx.Clamp(on="bottom"), vx.Traction((0.0, 1.0), on="top"))
    assert mark_at(history, (0.5, 0.5)) == REENTRANT
    assert mark_at(history, (0.25, 0.5)) == mark_at(history, (0.0, 0.5)) == ""


@pytest.mark.long
@pytest.mark.parametrize(
    ("problem", "n"),
    [(hertz_contact, 8), (plate_with_hole, 6), (press_fit, 4), (two_blocks_in_series, 4), (block_between_dies, 8)],
)
def test_bounded_stresses_are_not_marked(problem, n):
    begin = getattr(problem, "initial", None)
    history = vx.simulate(problem.scene(), problem.mesh(n), problem.times(4), initial=begin)
    assert not any(marks(history).values())


@pytest.mark.long
def test_marks_of_given_friction_and_of_a_read_history(tmp_path):
    """Tresca's friction is bounded, but von Mises' stress at the same corner is unbounded."""
    history = vx.simulate(feng_han_huang.scene(), feng_han_huang.mesh(8), feng_han_huang.times(2))
    told = marks(history)
    assert (told["von_mises"], told["friction"]) == (RUBBED, "")
    history.write(tmp_path)
    assert marks(vx.read_history(tmp_path)) == told


def test_growth_compares_the_finest_mesh_with_a_clearly_coarser_mesh():
    h = 0.5 ** np.arange(5)
    assert growth(h, h**-0.29) == "grew by a factor 1.22 from h = 0.125 to 0.0625"
    assert growth(h, -3.0 * h**-0.1) == "grew by a factor 1.07 from h = 0.125 to 0.0625"
    assert growth(h, 2.0 - h) == growth(h, np.ones(5)) == growth(h[:1], h[:1]) == growth([], []) == ""
    # Meshes are skipped if their cells are less than 1.5 times as large as the finest cells.
    assert growth([1.0, 0.5, 0.5, 0.45], [1.0, 1.3, 1.35, 1.5]) == "grew by a factor 1.5 from h = 1 to 0.45"


@pytest.mark.long
def test_adaptive_runs_report_growth_and_write_it(tmp_path):
    found = vx.adapt(cycle(vx.meshes.squares(2)).scene, vx.meshes.squares(4), np.linspace(0.0, 2.0, 9), 0.1)
    told = marks(found.history)
    assert f"{RUBBED}; grew by a factor " in told["pressure"]
    assert set(found.history.growth) >= {"von_mises", "pressure"}
    found.history.write(tmp_path)
    kept = json.loads((tmp_path / "summary.json").read_text())["extremes"]
    assert {key: one["unbounded"] or "" for key, one in kept.items()} == told
    again = vx.read_history(tmp_path)
    assert (again.growth, marks(again)) == (found.history.growth, told)


@pytest.mark.parametrize("dim", [2, 3])
def test_point_loads_are_marked(dim):
    """Cells of half the size have 2^(dim-1) times the stress beside the load."""
    found = {}
    for n in (4, 8) if dim == 3 else (8, 16):
        mesh = vx.meshes.squares(n) if dim == 2 else vx.meshes.cubes(n)
        down, at = (0.0,) * (dim - 1) + (-1.0,), (0.5,) * (dim - 1) + (1.0,)
        found[n] = run_settled(mesh, STEEL, vx.Clamp(on="bottom"), vx.PointLoad(down, at=at))
    coarse, fine = ({one.key: one for one in history.extremes} for history in found.values())
    assert {fine[key].unbounded for key in ("von_mises", "smallest_principal_stress", "displacement")} == {LOADED}
    assert fine["von_mises"].value / coarse["von_mises"].value == pytest.approx(2 ** (dim - 1), rel=0.15)
