"""Pictures of bodies in space show the numbers of the history; pictures that cannot be drawn are named."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from pages import assert_drawn_within_the_page

import block_in_space as block
import vemcvx as vx
from vemcvx.base.canvas import new_figure
from vemcvx.plots import animate, contact_face, deformed_body, write_plots
from vemcvx.plots.faces import contact_faces
from vemcvx.plots.pictures import draw_pictures, omissions
from vemcvx.plots.style import SLIP_AREA, STICK_AREA

matplotlib = pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def history():
    return vx.simulate(block.scene(), vx.meshes.prisms(3), block.times(4))


def drag(mesh, sides="bottom", motion=(1.0, 0.0, 0.0)):
    """Drag the top of a block that has contact on some sides."""
    moved = vx.PrescribedDisplacement(lambda x, t: t * np.array(motion), on="top")
    contact = vx.BilateralContact(on=sides), vx.TrescaFriction(bound=1.0, on=sides)
    return vx.simulate(vx.Scene(vx.Elasticity(200.0, 0.3), moved, *contact), mesh, [0.0, 1.0])


def find_areas(corners):
    after = np.roll(corners, -1, axis=1)
    return 0.5 * np.abs((corners[..., 0] * after[..., 1] - corners[..., 1] * after[..., 0]).sum(axis=1))


@pytest.mark.long
def test_the_contact_face_shows_sticking_and_slipping_areas_and_the_slip_of_the_step(history):
    figure = contact_face(history)
    filled, arrows = figure.axes[0].collections[:2]
    corners = np.array([path.vertices[:4] for path in filled.get_paths()])
    (face,) = contact_faces(history).values()
    contact = history.contact
    sticks = contact.sticking[-1][face.owners]
    assert np.allclose(corners, face.corners)
    for state, colour in ((sticks, STICK_AREA), (~sticks, SLIP_AREA)):
        assert state.any()
        assert np.allclose(filled.get_facecolors()[state], matplotlib.colors.to_rgba(colour))
    # The rest of the face belongs to the clamp.
    assert 0.8 < find_areas(corners).sum() < 1.0
    assert_drawn_within_the_page(figure)
    slip = (contact.slip[-1] - contact.slip[-2])[:, :2]
    drawn, places = np.stack([arrows.U, arrows.V], axis=1), arrows.XY
    at = np.linalg.norm(contact.points[None, :, :2] - places[:, None], axis=2).argmin(axis=1)
    assert not contact.sticking[-1, at].any()
    scale = np.linalg.norm(drawn, axis=1) / np.linalg.norm(slip[at], axis=1)
    assert scale == pytest.approx(scale[0], rel=1e-9)
    assert np.allclose(drawn, scale[0] * slip[at], rtol=1e-9)
    assert "slip of the step at most" in figure.axes[0].get_title()
    assert contact_face(history, 0).axes[0].get_title() == "t = 0"


@pytest.mark.long
@pytest.mark.parametrize("show", ["pressure", "friction", "wear"])
def test_the_contact_face_shows_pressure_friction_and_wear(history, show):
    figure = contact_face(history, show=show, units={"length": "mm", "force": "N"})
    contact, drawn = history.contact, figure.axes[0].collections[0]
    fields = {"pressure": contact.pressure_recovered, "friction": np.linalg.norm(contact.traction, axis=2)}
    field = fields.get(show, contact.wear)
    assert np.array_equal(drawn.get_array(), field[-1, contact_faces(history)["obstacles"].owners])
    assert drawn.get_clim() == (min(0.0, field.min()), field.max())
    assert "N" in figure.axes[1].get_ylabel()
    assert_drawn_within_the_page(figure)
    assert contact_face(history, 2, show=show).axes[0].collections[0].get_clim() == drawn.get_clim()


@pytest.mark.long
def test_an_inclined_face_is_drawn_along_its_normal():
    """The drawing keeps the lengths of slips and the area of the face, sqrt(2)."""
    flat = vx.meshes.cubes(2)
    points = flat.points + np.column_stack([0 * flat.points[:, :2], flat.points[:, 0]])
    names = {name: faces for name, faces in flat.boundaries.items() if name != "boundary"}
    mesh = vx.PolyhedralMesh(points, flat.cells, boundaries=names)
    slope = drag(mesh, motion=(1.0, 0.0, 1.0))
    (layout,) = contact_faces(slope).values()
    assert layout.frame @ layout.frame.T == pytest.approx(np.eye(2), abs=1e-12)
    slip = slope.contact.slip[-1]
    assert np.linalg.norm(layout.flat(slip), axis=1) == pytest.approx(np.linalg.norm(slip, axis=1), rel=1e-9)
    assert find_areas(layout.corners).sum() == pytest.approx(np.sqrt(2.0), rel=1e-9)
    assert_drawn_within_the_page(contact_face(slope))


@pytest.mark.long
def test_contact_on_opposite_sides_is_not_drawn():
    around = drag(vx.meshes.cubes(2), ("left", "right"))
    with pytest.raises(vx.HistoryError, match="contact goes round the body"):
        contact_face(around)
    with pytest.raises(vx.HistoryError, match="contact_face: there is no contact on 'bottom'; give on='obstacles'"):
        contact_face(around, on="bottom")
    assert "contact_face: contact goes round the body" in omissions(around)[-1]
    assert "contact_face" not in draw_pictures(around, None)


@pytest.mark.long
def test_each_interface_has_its_own_axes():
    """The middle block of three blocks is pulled."""
    boxes = {name: ((0, 1), (0, 1), (z, z + 0.5)) for name, z in (("low", 0.0), ("middle", 0.5), ("top", 1.0))}
    mesh = vx.meshes.bodies({name: vx.meshes.cubes((4, 4, 2), box) for name, box in boxes.items()})
    joints = ["low|middle", "middle|top"]
    pull = vx.PrescribedDisplacement(lambda x, t: [0.1 * t, 0.0, 0.0], on="middle.right")
    held = vx.Clamp(on=["low.bottom", "top.top"])
    contact = vx.BilateralContact(on=joints), vx.TrescaFriction(0.5, on=joints)
    stacked = vx.simulate(vx.Scene(vx.Elasticity(200.0, 0.3), held, pull, *contact), mesh, [0.0, 0.5, 1.0])
    figure, ways = contact_face(stacked), {}
    for ax in figure.axes:
        (arrows,) = [drawn for drawn in ax.collections if hasattr(drawn, "U")]
        ways[ax.get_title().split(",")[0]] = set(np.sign(arrows.U))
        assert len(arrows.U) > 10
    assert ways == {"low|middle": {-1.0}, "middle|top": {1.0}}
    assert_drawn_within_the_page(figure)
    assert len(contact_face(stacked, on="low|middle").axes) == 1
    with pytest.raises(vx.HistoryError, match=r"select one of 'low\|middle', 'middle\|top' by on="):
        contact_face(stacked, ax=new_figure().add_subplot())


@pytest.mark.long
def test_bodies_are_left_out_without_pyvista(history, monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pyvista", None)
    with pytest.raises(vx.VemcvxError, match=r"pip install 'vemcvx\[view\]'$"):
        deformed_body(history)
    assert [found.split(":")[0] for found in omissions(history)] == ["deformed_body"]
    names = {path.stem for path in write_plots(history, tmp_path)}
    assert names == {"contact_face", "energy_ledger", "forces_over_time", "hysteresis_loop"}


@pytest.mark.long
def test_the_body_is_drawn_without_a_display(history, tmp_path, capfd):
    pytest.importorskip("pyvista")
    first, last = (deformed_body(history, step).axes[0].images[0].get_array() for step in (0, -1))
    assert first.shape == last.shape
    assert (np.asarray(last) < 250).any(axis=2).mean() > 0.4
    assert (first != last).any(axis=2).mean() > 0.1
    assert animate(history, tmp_path / "body.gif", seconds=1.0).read_bytes().startswith(b"GIF8")
    assert capfd.readouterr() == ("", "")
