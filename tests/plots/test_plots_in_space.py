"""Pictures of bodies in space show the numbers of the history; what cannot be drawn is said in a sentence."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from pages import assert_drawn_within_the_page
from scenes import paper_scene, small

import block_in_space as block
import vemcvx as vx
from vemcvx.base.canvas import new_figure
from vemcvx.plots import contact_face, deformed_body, friction_disc, write_plots
from vemcvx.plots.faces import contact_faces
from vemcvx.plots.pictures import draw_pictures, omissions
from vemcvx.plots.style import SLIP_AREA, STICK_AREA

matplotlib = pytest.importorskip("matplotlib")


@pytest.fixture(scope="module")
def history():
    return vx.simulate(block.scene(), vx.meshes.prisms(3), block.times(4))


@pytest.fixture
def without_pyvista(monkeypatch):
    monkeypatch.setitem(sys.modules, "pyvista", None)


def on(*sides):
    """A cube with contact on some sides, dragged by its top."""
    drag = vx.PrescribedDisplacement(lambda x, t: [t, 0.0, 0.0], on="top")
    contact = vx.BilateralContact(on=sides), vx.TrescaFriction(bound=1.0, on=sides)
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), drag, *contact)
    return vx.simulate(scene, vx.meshes.cubes(2), [0.0, 1.0])


def parts(ax):
    """Corners (k, 4, 2) and colours (k, 4) of what is filled."""
    filled = ax.collections[0]
    return np.array([path.vertices[:4] for path in filled.get_paths()]), filled.get_facecolors()


def areas(corners):
    after = np.roll(corners, -1, axis=1)
    return 0.5 * np.abs((corners[..., 0] * after[..., 1] - corners[..., 1] * after[..., 0]).sum(axis=1))


@pytest.mark.long
def test_what_sticks_and_slips_is_coloured(history):
    figure = contact_face(history)
    corners, colours = parts(figure.axes[0])
    (face,) = contact_faces(history).values()
    sticks = history.contact.sticking[-1][face.owners]
    assert np.allclose(corners, face.corners)
    for state, colour in ((sticks, STICK_AREA), (~sticks, SLIP_AREA)):
        assert state.any()
        assert np.allclose(colours[state], matplotlib.colors.to_rgba(colour))
    # All of the floor's face but the parts of nodes that the clamp holds.
    assert 0.8 < areas(corners).sum() < 1.0
    assert_drawn_within_the_page(figure)


@pytest.mark.long
def test_arrows_are_the_slip_of_the_step(history):
    contact = history.contact
    moved = (contact.slip[-1] - contact.slip[-2])[:, :2]
    arrows = contact_face(history).axes[0].collections[1]
    drawn, places = np.stack([arrows.U, arrows.V], axis=1), arrows.XY
    at = np.linalg.norm(contact.points[None, :, :2] - places[:, None], axis=2).argmin(axis=1)
    assert not contact.sticking[-1, at].any()
    scale = np.linalg.norm(drawn, axis=1) / np.linalg.norm(moved[at], axis=1)
    assert scale == pytest.approx(scale[0], rel=1e-9)
    assert np.allclose(drawn, scale[0] * moved[at], rtol=1e-9)
    assert "slip of the step at most" in contact_face(history).axes[0].get_title()
    assert contact_face(history, 0).axes[0].get_title() == "t = 0"


@pytest.mark.long
def test_friction_stays_in_its_disc_and_slips_on_the_rim(history):
    ax = friction_disc(history).axes[0]
    shown = {line.get_label(): line.get_xydata() for line in ax.lines}
    sticks = history.contact.sticking[-1]
    assert len(shown["sticks"]) == sticks.sum()
    assert np.linalg.norm(shown["slips"], axis=1) == pytest.approx(1.0, abs=1e-9)
    assert (np.linalg.norm(shown["sticks"], axis=1) <= 1.0 + 1e-9).all()
    assert np.allclose(shown["slips"], history.contact.traction[-1, ~sticks, :2] / block.scene.__defaults__[2])
    assert_drawn_within_the_page(ax.figure)


@pytest.mark.long
@pytest.mark.parametrize("show", ["pressure", "friction", "wear"])
def test_how_large_things_are_on_the_face(history, show):
    figure = contact_face(history, show=show, units={"length": "mm", "force": "N"})
    contact, drawn = history.contact, figure.axes[0].collections[0]
    drawn_of = {"pressure": contact.pressure_recovered, "friction": np.linalg.norm(contact.traction, axis=2)}
    field = drawn_of.get(show, contact.wear)
    assert np.array_equal(drawn.get_array(), field[-1, contact_faces(history)["obstacles"].owners])
    assert drawn.get_clim() == (min(0.0, field.min()), field.max())
    assert "N" in figure.axes[1].get_ylabel()
    assert_drawn_within_the_page(figure)
    assert contact_face(history, 2, show=show).axes[0].collections[0].get_clim() == drawn.get_clim()


def test_slips_since_stored_steps_are_named_so():
    sparse = vx.simulate(block.scene(), vx.meshes.cubes(2), block.times(4), store=4)
    assert "slip since the last stored step at most" in contact_face(sparse).axes[0].get_title()


@pytest.mark.long
def test_a_face_that_leans_is_seen_along_its_normal():
    """What slips down a slope is drawn in its length, whatever axes say."""
    sheared = vx.meshes.cubes(2)
    points = sheared.points + np.column_stack([0 * sheared.points[:, :2], sheared.points[:, 0]])
    names = {name: faces for name, faces in sheared.boundaries.items() if name != "boundary"}
    arrays = {name: getattr(sheared, name) for name in sheared.ARRAYS if name != "points"}
    mesh = vx.PolyhedralMesh.unchecked(points, *arrays.values()).with_boundaries(names)
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: [t, 0.0, t], on="top"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(bound=1.0, on="bottom"),
    )
    slope = vx.simulate(scene, mesh, [0.0, 1.0])
    (layout,) = contact_faces(slope).values()
    assert layout.frame @ layout.frame.T == pytest.approx(np.eye(2), abs=1e-12)
    flat = np.linalg.norm(layout.flat(slope.contact.slip[-1]), axis=1)
    assert flat == pytest.approx(np.linalg.norm(slope.contact.slip[-1], axis=1), rel=1e-9)
    assert areas(layout.corners).sum() == pytest.approx(np.sqrt(2.0), rel=1e-9)
    assert_drawn_within_the_page(contact_face(slope))


def test_refusals(history):
    plane = vx.simulate(paper_scene(), small("squares", 2), [0.0, 1.0])
    for draw in (contact_face, friction_disc, deformed_body):
        with pytest.raises(vx.HistoryError, match=f"^{draw.__name__}: this body is plane; .* draw"):
            draw(plane)
    with pytest.raises(vx.SceneError, match="polyhedra; contact_face and friction_disc draw contact in space"):
        vx.plots.friction_traction(history)
    with pytest.raises(vx.HistoryError, match="found show 'stress'; there are 'states', 'pressure'"):
        contact_face(history, show="stress")
    with pytest.raises(vx.HistoryError, match="window: found .*; wanted"):
        contact_face(history, window=((0.0, np.nan), (0.0, 1.0)))
    with pytest.raises(vx.HistoryError, match="wanted a vector of three finite components that is not along x_3"):
        deformed_body(history, view=(0.0, 0.0, 1.0))
    with pytest.raises(vx.HistoryError, match="found stress 'large'; there are 'xx', 'yy', 'zz'"):
        deformed_body(history, stress="large")


@pytest.mark.long
def test_contact_all_round_is_left_out_and_said():
    around = on("left", "right")
    for draw in (contact_face, friction_disc):
        with pytest.raises(vx.HistoryError, match="contact goes round the body, .* name one of its boundaries, on="):
            draw(around)
        assert draw(around, on="left").axes[0].get_title().startswith("t = 1")
        with pytest.raises(vx.HistoryError, match=f"{draw.__name__}: there is no contact on 'bottom'"):
            draw(around, on="bottom")
        with pytest.raises(vx.SceneError, match=f"{draw.__name__}: .*'lid'"):
            draw(around, on="lid")
    assert set(omissions(around)) >= {"contact_face", "friction_disc"}
    assert "contact_face" not in draw_pictures(around, None)


@pytest.fixture(scope="module")
def stacked():
    """Three blocks; the middle one is pulled to the right, so that the lower and the upper joint slip two ways."""
    boxes = {name: ((0, 1), (0, 1), (z, z + 0.5)) for name, z in (("low", 0.0), ("middle", 0.5), ("top", 1.0))}
    mesh = vx.meshes.bodies({name: vx.meshes.cubes((4, 4, 2), box) for name, box in boxes.items()})
    joints = ["low|middle", "middle|top"]
    pull = vx.PrescribedDisplacement(lambda x, t: [0.1 * t, 0.0, 0.0], on="middle.right")
    held = vx.Clamp(on=["low.bottom", "top.top"])
    contact = vx.BilateralContact(on=joints), vx.TrescaFriction(0.5, on=joints)
    return vx.simulate(vx.Scene(vx.Elasticity(200.0, 0.3), held, pull, *contact), mesh, [0.0, 0.5, 1.0])


@pytest.mark.long
def test_interfaces_that_lie_over_each_other_have_a_panel_each(stacked):
    """The lower block slips to the left against the middle one, which slips to the right against the upper one."""
    figure = contact_face(stacked)
    ways = {}
    for ax in figure.axes:
        (arrows,) = [drawn for drawn in ax.collections if hasattr(drawn, "U")]
        ways[ax.get_title().split(",")[0]] = set(np.sign(arrows.U))
        assert len(arrows.U) > 10
    assert ways == {"low|middle": {-1.0}, "middle|top": {1.0}}
    assert_drawn_within_the_page(figure)
    assert [len(friction_disc(stacked, on=on).axes) for on in (None, "low|middle")] == [2, 1]
    for draw in (contact_face, friction_disc):
        with pytest.raises(vx.HistoryError, match="one pair of axes; give on=, of 'low|middle', 'middle|top'"):
            draw(stacked, ax=new_figure().add_subplot())
    alone = contact_face(stacked, on="middle|top", show="pressure", ax=new_figure().add_subplot())
    assert alone.axes[0].get_title().startswith("t = 1")


@pytest.mark.long
def test_without_pyvista_bodies_are_left_out_and_said(history, without_pyvista, tmp_path):
    with pytest.raises(vx.VemcvxError, match=r"needs PyVista, which is not installed: pip install 'vemcvx\[view\]'$"):
        deformed_body(history)
    assert list(omissions(history)) == ["deformed_body"]
    names = {path.stem for path in write_plots(history, tmp_path)}
    assert names == {"contact_face", "friction_disc", "energy_ledger", "forces_over_time", "hysteresis_loop"}


def inked(image):
    return (np.asarray(image) < 250).any(axis=2)


@pytest.mark.long
def test_the_body_is_drawn_without_a_display(history, tmp_path, capfd):
    pytest.importorskip("pyvista")
    first, last = (deformed_body(history, step, limits=(0, 10)).axes[0].images[0].get_array() for step in (0, -1))
    assert first.shape == last.shape
    assert inked(last).mean() > 0.4
    assert (first != last).any(axis=2).mean() > 0.1
    names = {path.stem for path in write_plots(history, tmp_path)}
    assert names == {"deformed_body", "contact_face", "friction_disc", "energy_ledger"}
    assert capfd.readouterr() == ("", "")


@pytest.mark.slow
def test_a_film_of_a_body(history, tmp_path):
    pytest.importorskip("pyvista")
    film = history.animate(tmp_path / "body.gif", seconds=1.0)
    assert film.read_bytes().startswith(b"GIF8")
