"""Pictures of plane bodies show all data of the history, and stay within the page."""

from __future__ import annotations

import re

import numpy as np
import pytest
from pages import assert_drawn_within_the_page
from scenes import cyclic, mostly_long, mostly_slow, paper_scene, small

import vemcvx as vx
from vemcvx.base.canvas import new_figure
from vemcvx.plots import (
    along_contact,
    deformed_mesh,
    energy_ledger,
    forces_over_time,
    friction_traction,
    hysteresis_loop,
    stick_slip_map,
    stressed_body,
    write_plots,
)
from vemcvx.plots.contact import contact_line, directions, pressures
from vemcvx.plots.pictures import draw_pictures

matplotlib = pytest.importorskip("matplotlib")
TIMES = np.linspace(0.0, 1.0, 25)
STEEL = vx.Elasticity(200.0, 0.3)
WRITTEN = {"deformed_mesh", "stressed_body", "contact_pressure", "contact_slip", "friction_traction", "stick_slip_map"}
WRITTEN |= {"wear", "energy_ledger", "hysteresis_loop", "forces_over_time"}
"""Names of the pictures that are written for a plane history with contact."""
STICK, SLIP = "#0072B2", "#D55E00"


def bound(x, t):
    return 1.0 + 3.0 * x[:, 0]


@pytest.fixture(scope="module")
def history():
    return vx.simulate(paper_scene(cyclic, bound=bound), small("voronoi", 8), TIMES, solver=vx.Newton())


@pytest.fixture(scope="module")
def loose():
    """A run without contact."""
    scene = vx.Scene(STEEL, vx.Clamp(on="right"), vx.BodyForce(lambda x, t: t + 0 * x))
    return vx.simulate(scene, small("squares", 3), [0.0, 1.0])


@pytest.fixture(scope="module")
def rubbed():
    """A pad that is pressed on a floor and moved to and fro for one and a quarter cycles."""

    def plate(x, t):
        return np.tile([0.1 * np.sin(2 * np.pi * t), -0.02], (len(x), 1))

    floor = vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom")
    scene = vx.Scene(vx.Elasticity(10.0, 0.45), vx.PrescribedDisplacement(plate, on="top"), *floor)
    mesh = vx.meshes.squares((8, 4), box=((0, 2), (0, 1)))
    return vx.simulate(scene, mesh, np.linspace(0.0, 1.25, 41), initial="settled")


def find_magnification(ax):
    return float(re.search(r"displacements × (\S+?)(,|\n|$)", ax.get_title())[1])


def find_lines(ax):
    return {line.get_label(): line.get_xydata() for line in ax.lines}


def arrows_of(collections):
    return np.concatenate([np.column_stack([arrow.U, arrow.V]) for arrow in collections])


def assert_scaled(drawn, values):
    """Check that each arrow is one of the vectors `values` times a common scale."""
    scale = np.linalg.norm(drawn, axis=1).max() / np.linalg.norm(values, axis=1).max()
    assert np.linalg.norm(drawn[:, None] - scale * values, axis=2).min(axis=1).max() < 1e-12 * scale


def colour_of(patch):
    return matplotlib.colors.to_hex(patch.get_facecolor()).upper()


def test_the_deformed_mesh_shows_displacements_and_friction_to_scale(history):
    ax = deformed_mesh(history, -1).axes[0]
    u, mesh, contact = history.displacement[-1], history.mesh, history.contact
    factor = find_magnification(ax)
    assert 0.05 < factor * np.linalg.norm(history.displacement, axis=2).max() <= 0.15
    cells, *arrows = ax.collections
    size = np.linalg.norm(u, axis=1)
    for cell, path, colour in zip(mesh.cells, cells.get_paths(), cells.get_array(), strict=True):
        assert path.vertices[: len(cell)] == pytest.approx(mesh.points[cell] + factor * u[cell], abs=1e-15)
        assert colour == pytest.approx(size[cell].mean(), rel=1e-14)
    drawn = arrows_of(arrows)
    assert len(drawn) >= 8
    assert_scaled(drawn, contact.traction[-1])
    assert 0 < contact.sticking[-1].sum() < len(contact.nodes)
    assert {matplotlib.colors.to_hex(arrow.get_facecolor()[0]).upper() for arrow in arrows} == {STICK, SLIP}


@pytest.mark.parametrize("step", [-1, 3])
def test_friction_is_drawn_with_its_bound_on_the_areas_of_stick_and_slip(history, step):
    ax, contact, row = friction_traction(history, step).axes[0], history.contact, history.row(step)
    x, sticks = contact.points[:, 0], contact.sticking[row]
    order, drawn = np.argsort(x), find_lines(ax)
    expected = np.column_stack([x, contact.traction[row][:, 0]])[order]
    assert np.array_equal(ax.lines[2].get_xydata(), expected)
    assert drawn["bound $\\pm g$"] == pytest.approx(np.column_stack([x, bound(contact.points, 0)])[order], rel=1e-13)
    for word, chosen in (("stick", sticks), ("slip", ~sticks)):
        assert np.array_equal(drawn[word], expected[chosen[order]])
    shaded, width = {STICK: [], SLIP: []}, 0.0
    for patch in ax.patches:
        span = patch.get_path().transformed(patch.get_patch_transform()).get_extents()
        shaded[colour_of(patch)].extend(np.flatnonzero((x >= span.x0) & (x <= span.x1)))
        width += span.width
    assert set(shaded[STICK]) == set(np.flatnonzero(sticks))
    assert set(shaded[SLIP]) == set(np.flatnonzero(~sticks))
    assert width == pytest.approx(np.ptp(contact_line(history, "test").limits), rel=1e-12)


@mostly_long("store", ["all", "last", 7])
def test_the_map_shows_every_node_in_a_band_for_each_stored_step(history, store):
    some = vx.simulate(history.scene, history.mesh, TIMES, store=store)
    figure, contact = stick_slip_map(some), history.contact
    order, steps = np.argsort(contact.points[:, 0]), some.stored[some.stored > 0]
    increments = np.diff(contact.slip[:, order, 0], axis=0)
    way = np.where(contact.sticking[1:, order], 0, np.sign(increments))
    assert set(np.unique(way)) == {-1, 0, 1}
    ax = figure.axes[0]
    mesh = ax.collections[0]
    assert np.array_equal(mesh.get_array()[:, ::2], way[steps - 1])
    assert np.array_equal(mesh.get_coordinates()[:, 0, 1], TIMES[[0, *steps]])
    if store == "all":
        words = {"stick", "slip towards larger $x_1$", "slip towards smaller $x_1$"}
        assert {text.get_text() for text in figure.legends[0].get_texts()} == words
    else:
        assert f"each band: its last step ({24 - len(steps)} of 24 steps not stored)" in ax.get_title()


def test_the_ledger_adds_up(history):
    left, right = energy_ledger(history).axes
    drawn, certificates = find_lines(left), find_lines(right)
    assert np.array_equal(drawn["work done on the body"], np.column_stack([TIMES, history.work]))
    assert np.array_equal(drawn["dissipated by friction"][:, 1], history.dissipated)
    assert np.array_equal(drawn["stored"][:, 1], history.energy - history.energy[0])
    parts = [drawn[name][:, 1] for name in ("stored", "dissipated by friction", "lost by time stepping")]
    assert np.sum(parts, axis=0) == pytest.approx(history.work, abs=1e-14)
    assert np.array_equal(certificates["each step"], np.column_stack([TIMES, history.certified])[1:])
    assert np.array_equal(certificates["all steps so far"][:, 1], history.certified_total[1:])
    assert right.get_yscale() == "log"


def squeeze(sides, mesh):
    """Push a block to the right between rough walls. The right side is clamped."""
    pull = vx.BodyForce(lambda x, t: np.column_stack([8 * t + 0 * x[:, 0], 0 * x[:, 0]]))
    contact = vx.BilateralContact(on=sides), vx.TrescaFriction(bound=1.0, on=sides)
    return vx.simulate(vx.Scene(STEEL, vx.Clamp(on="right"), pull, *contact), mesh, [0.0, 1.0])


def test_contact_on_two_sides_is_drawn_over_arc_length_in_two_parts():
    history = squeeze(["top", "bottom"], vx.meshes.squares((12, 6), box=((0, 2), (0, 1))))
    line = contact_line(history, "test")
    assert line.label == "arc length $s$"
    assert sorted(line.order) == list(range(len(history.contact.nodes)))
    assert len(line.gaps) == 1
    # Half an edge at the end of each part belongs to the clamp.
    assert np.diff(line.limits, axis=1).sum() == pytest.approx(4.0 - 2 * (2 / 12) / 2)
    x, traction = history.contact.points[line.order], history.contact.traction
    below = x[:, 1] == 0
    for part, sign in ((below, 1), (~below, -1)):
        assert np.array_equal(line.along(traction)[:, part], sign * traction[:, line.order[part], 0])
        assert np.abs(np.diff(line.position[part])) == pytest.approx(np.linalg.norm(np.diff(x[part], axis=0), axis=1))


@pytest.mark.long
@mostly_slow("suffix, begins", [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_pictures_are_written_and_replace_older_pictures(history, loose, tmp_path, suffix, begins):
    written = write_plots(history, tmp_path, suffix)
    assert {path.name for path in written} == {f"{name}{suffix}" for name in WRITTEN}
    assert all(path.read_bytes().startswith(begins) for path in written)
    fewer = {f"{name}{suffix}" for name in ("deformed_mesh", "stressed_body", "forces_over_time", "energy_ledger")}
    assert {path.name for path in write_plots(loose, tmp_path, suffix)} == fewer
    assert {path.name for path in tmp_path.iterdir()} == fewer
    with pytest.raises(vx.HistoryError, match=r"write_plots: .*jpg"):
        write_plots(history, tmp_path, ".jpg")


@pytest.mark.parametrize(
    ("show", "label"),
    [("pressure", "contact pressure"), ("slip", "slip towards larger $x_1$"), ("wear", "friction work")],
)
def test_pressure_slip_and_wear_are_drawn_along_the_contact(rubbed, show, label):
    contact, order = rubbed.contact, np.argsort(rubbed.contact.points[:, 0])
    values = {"pressure": contact.pressure_recovered, "slip": contact.slip[:, :, 0], "wear": contact.wear}[show]
    ax = along_contact(rubbed, show, [10, 30]).axes[0]
    for line, step in zip(ax.lines, (10, 30), strict=True):
        assert np.array_equal(line.get_xydata(), np.column_stack([contact.points[:, 0], values[step]])[order])
    low, high = ax.get_ylim()
    assert low <= values.min()
    assert high > values.max()
    assert [text.get_text() for text in ax.figure.legends[0].get_texts()] == ["t = 0.3125", "t = 0.9375"]
    assert ax.get_ylabel().startswith(label)


def test_pressures_of_the_size_of_rounding_are_drawn_as_zero():
    """Without lateral contraction, a strip that is pulled along a plane has zero pressure up to rounding."""
    ends = vx.Symmetry(on="left"), vx.BilateralContact(on="bottom")
    pull = vx.Traction(lambda x, t: np.tile([t, 0.0], (len(x), 1)), on="right")
    pulled = vx.simulate(vx.Scene(vx.Elasticity(10.0, 0.0), *ends, pull), small("voronoi", 6, seed=2), [0.0, 0.5, 1.0])
    assert 0 < np.abs(pulled.contact.pressure_recovered).max() < 1e-12
    assert not pressures(pulled).any()
    assert along_contact(pulled).axes[0].get_ylim() == pytest.approx((0.0, 1.0))
    assert "contact_pressure" not in draw_pictures(pulled, None)


@pytest.mark.long
def test_all_steps_share_one_scale(history):
    steps = 1, 6, 24
    frames = [deformed_mesh(history, step).axes[0] for step in steps]
    assert len({find_magnification(ax) for ax in frames}) == 1
    assert len({ax.collections[0].get_clim() for ax in frames}) == 1
    assert len({(ax.get_xlim(), ax.get_ylim()) for ax in frames}) == 1
    lengths = [np.linalg.norm(arrows_of(ax.collections[1:]), axis=1).max() for ax in frames]
    forces = [np.linalg.norm(history.contact.traction[step], axis=1).max() for step in steps]
    assert len(set(np.round(np.divide(lengths, forces), 9))) == 1
    assert len({friction_traction(history, step).axes[0].get_ylim() for step in steps}) == 1
    assert len({stressed_body(history, step).axes[0].collections[0].get_clim() for step in steps}) == 1


def test_a_body_is_coloured_by_its_stress_with_arrows_of_contact_forces(history):
    figure = new_figure()
    stressed_body(history, 9, ax=figure.subplots(1, 2)[0], stress="xy", mirrors=[(-1, 1)])
    body, (row, contact) = figure.axes[0], (history.row(9), history.contact)
    cells, image, *arrows = body.collections
    assert np.array_equal(cells.get_array(), history.stress(9)[:, 2])
    assert np.array_equal(image.get_array(), cells.get_array())
    for path, mirrored in zip(cells.get_paths(), image.get_paths(), strict=True):
        assert set(map(tuple, path.vertices * [-1, 1])) == set(map(tuple, mirrored.vertices))
    force = contact.traction[row] - contact.pressure[row][:, None] * contact.normals
    drawn = arrows_of(arrows)
    assert len(drawn) == len(force)
    assert_scaled(drawn, force)
    assert f"at most {np.linalg.norm(force, axis=1).max():.3g}" in body.get_title()
    # Sticking nodes have thick arrows, slipping nodes thin ones.
    sticks = contact.sticking[row]
    assert [len(some.U) for some in arrows] == [sticks.sum(), (~sticks).sum()]
    assert arrows[0].width > arrows[1].width
    for friction in stressed_body(history, forces="friction").axes[0].collections[1:]:
        assert np.abs(friction.V).max(initial=0.0) == 0.0
    assert len(stressed_body(history, forces="none").axes[0].collections) == 1
    invariants = {
        "von_mises": history.von_mises(-1),
        "max_principal": history.principal_stresses(-1)[:, 0],
        "min_principal": history.principal_stresses(-1)[:, 1],
    }
    for stress, values in invariants.items():
        assert np.array_equal(stressed_body(history, -1, stress=stress).axes[0].collections[0].get_array(), values)


def test_a_magnified_thin_layer_is_not_inverted():
    press = vx.PrescribedDisplacement(lambda x, t: np.tile([0.0, -1e-6 * t], (len(x), 1)), on="top")
    scene = vx.Scene(vx.Elasticity(210e9, 0.3), vx.Clamp(on="bottom"), press)
    history = vx.simulate(scene, vx.meshes.squares((40, 4), box=((0, 0.1), (0, 0.001))), [0.0, 1.0])
    ax = deformed_mesh(history).axes[0]
    assert 100 <= find_magnification(ax) <= 500
    assert min(np.ptp(path.vertices[:, 1]) for path in ax.collections[0].get_paths()) > 0.4 * 0.001 / 4


def test_open_contact_neither_sticks_nor_slips():
    lift = vx.PrescribedDisplacement(lambda x, t: t * (x[:, :1] * [0.0, 0.04] + [0.02, -0.02]), on="top")
    floor = vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom")
    history = vx.simulate(vx.Scene(STEEL, lift, *floor), vx.meshes.squares(8), TIMES)
    stick, slip, opened = (getattr(history.contact, f"{state}_count")[-1] for state in ("stick", "slip", "open"))
    assert opened > 0
    title = friction_traction(history).axes[0].get_title()
    assert title.endswith(f"{stick} contact nodes stick, {slip} slip, {opened} are open")
    states = directions(history, contact_line(history, "stick_slip_map"))
    assert np.isnan(states[-1]).sum() == opened


def test_the_loop_is_the_reaction_over_the_prescribed_motion(rubbed, tmp_path):
    ax = hysteresis_loop(rubbed).axes[0]
    u, force = ax.lines[0].get_xydata().T
    assert u == pytest.approx(0.1 * np.sin(2 * np.pi * rubbed.times), abs=1e-15)
    assert np.array_equal(force, rubbed.reaction("top")[:, 0])
    # The area of the loop is the work of a cycle. Between instants the loop is straight.
    cycle = slice(8, 41)
    work = float(np.sum(0.5 * (force[cycle][1:] + force[cycle][:-1]) * np.diff(u[cycle])))
    assert work == pytest.approx(np.ptp(rubbed.work_second_order[cycle][[0, -1]]), rel=1e-2)
    assert [text.get_text() for text in ax.figure.legends[0].get_texts()] == ["t = 0", "t = 1.25"]
    assert "bottom" in hysteresis_loop(rubbed, "bottom").axes[0].get_title()
    read = vx.read_history(rubbed.write(tmp_path / "read"))
    assert np.array_equal(hysteresis_loop(read).axes[0].lines[0].get_xydata(), np.column_stack([u, force]))
    with pytest.raises(vx.SceneError, match="hysteresis_loop: .*'lid'"):
        hysteresis_loop(read, "lid")


def test_the_loop_of_a_loaded_body_needs_its_scene(history, tmp_path):
    assert "Load of left along $x_1$" in hysteresis_loop(history).axes[0].get_title()
    with pytest.raises(vx.HistoryError, match="hysteresis_loop: no driven boundary is known"):
        hysteresis_loop(vx.read_history(history.write(tmp_path / "loaded")))


def test_forces_over_time_are_the_resultants_in_the_order_of_size(rubbed):
    lines = forces_over_time(rubbed, units={"force": "N"}).axes[0].lines
    largest = {name: np.abs(values).max(axis=0) for name, values in rubbed.resultants.items()}
    top = max(values.max() for values in largest.values())
    assert len(lines) == min(8, sum(int((values > 0.01 * top).sum()) for values in largest.values()))
    for line in lines:
        name, axis = line.get_label().split(", $x_")
        assert np.array_equal(line.get_ydata(), rubbed.resultants[name][:, int(axis[0]) - 1])
    assert np.abs(lines[0].get_ydata()).max() == top
    free = vx.Scene(vx.Elasticity(1.0, 0.3), vx.Clamp(on="bottom"))
    with pytest.raises(vx.HistoryError, match="forces_over_time: no force acts"):
        forces_over_time(vx.simulate(free, vx.meshes.squares(2), [0.0, 1.0]))


@pytest.mark.long
def test_every_picture_has_the_given_units_and_stays_within_the_page(rubbed):
    drawn = draw_pictures(rubbed, {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"})
    assert set(drawn) == WRITTEN
    for figure in drawn.values():
        words = [text.get_text() for text in figure.findobj(matplotlib.text.Text)]
        assert not [word for word in words if any(name in word for name in ("length", "force)", "time)", " per area"))]
        assert_drawn_within_the_page(figure)
    # In the plane, a force per length is a stress times the thickness 1.
    assert drawn["contact_pressure"].axes[0].get_ylabel() == "contact pressure\n(MPa)"
    assert drawn["hysteresis_loop"].axes[0].get_ylabel() == "reaction (N), per thickness"


def draw_stressed_body(history, **options):
    figure = new_figure(4, 3)
    stressed_body(history, ax=figure.add_subplot(), **options)
    return figure


@mostly_long(
    "draw, gap, apart",
    [(deformed_mesh, -0.002, 0.02), (draw_stressed_body, 0.0, 0.0), (draw_stressed_body, 0.001, 0.01)],
    0,
    2,
)
def test_closed_contact_is_marked_where_magnification_separates_the_bodies(draw, gap, apart):
    """Displacements are magnified by ten. The mark fills the space between the drawn faces."""
    boxes = {"lower": ((0, 2), (0, 1)), "upper": ((0, 2), (1, 2))}
    mesh = vx.meshes.bodies({name: vx.meshes.squares((4, 2), box) for name, box in boxes.items()})
    down = vx.PrescribedDisplacement(lambda x, t: np.tile([0.0, -0.004 * t], (len(x), 1)), on="upper.top")
    contact = vx.UnilateralContact(on="lower|upper", gap=gap)
    scene = vx.Scene(vx.Elasticity(100.0, 0.0), vx.Clamp(on="lower.bottom"), down, contact)
    history = vx.simulate(scene, mesh, [0.0, 0.5, 1.0], initial="settled")
    assert history.contact.closed[-1].all()
    (patch,) = draw(history, magnify=10.0).axes[0].patches
    outline = patch.get_path().vertices
    x, y = outline.T
    assert 0.5 * abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1])) == pytest.approx(2.0 * apart, abs=1e-9)
    # The mark reaches the drawn nodes of both bodies.
    drawn = history.mesh.points + 10.0 * history.displacement[-1]
    for node in np.concatenate([history.contact.nodes, history.contact.partners]):
        assert np.linalg.norm(outline - drawn[node], axis=1).min() < 1e-12
    if gap > 0:
        assert not draw(history, step=0, magnify=10.0).axes[0].patches
