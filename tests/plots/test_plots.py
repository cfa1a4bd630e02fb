"""Pictures show the numbers of the history, entirely and inside the page."""

from __future__ import annotations

import re

import numpy as np
import pytest
from scenes import cyclic, mostly_long, paper_scene, small

import vemcvx as vx
from vemcvx.base.canvas import blend_colours, new_figure
from vemcvx.plots import (
    along_contact,
    deformed_mesh,
    energy_ledger,
    forces_over_time,
    friction_traction,
    hysteresis_loop,
    stick_slip_map,
    stressed_body,
    wear,
    write_plots,
)
from vemcvx.plots.contact import contact_line, directions, pressures
from vemcvx.plots.pictures import draw_pictures
from vemcvx.plots.style import OPEN_AREA, SIGNED, SLIP_AREA, STICK_AREA, round_down

matplotlib = pytest.importorskip("matplotlib")
TIMES = np.linspace(0.0, 1.0, 25)
WRITTEN = {
    "deformed_mesh",
    "stressed_body",
    "contact_pressure",
    "contact_slip",
    "friction_traction",
    "stick_slip_map",
    "wear",
    "energy_ledger",
    "hysteresis_loop",
    "forces_over_time",
}
"""Names of the files that a plane history with contact, under forces, has."""


def bound(x, t):
    return 1.0 + 3.0 * x[:, 0]


@pytest.fixture(scope="module")
def history():
    return vx.simulate(paper_scene(cyclic, bound=bound), small("voronoi", 8), TIMES, solver=vx.Newton())


@pytest.fixture(scope="module")
def squeezed():
    """Contact above and below, which no axis holds."""
    push = vx.BodyForce(lambda x, t: np.column_stack([8 * t + 0 * x[:, 0], 0 * x[:, 0]]))
    sides = ["top", "bottom"]
    contact = vx.BilateralContact(on=sides), vx.TrescaFriction(bound=2.0, on=sides)
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="right"), push, *contact)
    return vx.simulate(scene, vx.meshes.squares((12, 6), box=((0, 2), (0, 1))), TIMES)


@pytest.fixture(scope="module")
def loose():
    """No contact at all."""
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="right"), vx.BodyForce(lambda x, t: t + 0 * x))
    return vx.simulate(scene, small("squares", 3), [0.0, 1.0])


def magnification(ax):
    return float(re.search(r"displacements × (\S+?)(,|\n|$)", ax.get_title())[1])


def lines(ax):
    return {line.get_label(): line.get_xydata() for line in ax.lines}


@pytest.mark.long
def test_the_mesh_is_drawn_where_it_moves_to(history):
    ax = deformed_mesh(history).axes[0]
    u, mesh = history.displacement[history.row(None)], history.mesh
    factor = magnification(ax)
    assert 0.05 < factor * np.linalg.norm(history.displacement, axis=2).max() <= 0.15
    cells = ax.collections[0]
    size = np.linalg.norm(u, axis=1)
    for cell, path, colour in zip(mesh.cells, cells.get_paths(), cells.get_array(), strict=True):
        assert path.vertices[: len(cell)] == pytest.approx(mesh.points[cell] + factor * u[cell], abs=1e-15)
        assert colour == pytest.approx(size[cell].mean(), rel=1e-14)


def test_arrows_are_the_friction_forces_to_scale(history):
    arrows = deformed_mesh(history, -1).axes[0].collections[1:]
    traction, sticks = history.contact.traction[-1], history.contact.sticking[-1]
    # The dashed outline is no collection: all that follows the cells are arrows.
    drawn = np.concatenate([np.column_stack([arrow.U, arrow.V]) for arrow in arrows])
    assert len(drawn) >= 8
    # Every arrow is the traction of some contact node, all at one scale.
    scale = np.abs(drawn[:, 0]).max() / np.abs(traction[:, 0]).max()
    assert np.linalg.norm(drawn[:, None] - scale * traction, axis=2).min(axis=1).max() < 1e-12 * scale
    colours = {matplotlib.colors.to_hex(arrow.get_facecolor()[0]).upper() for arrow in arrows}
    assert sticks.any()
    assert not sticks.all()
    assert colours == {"#0072B2", "#D55E00"}


def test_magnification_is_a_round_number_that_shows_something():
    for largest in np.logspace(-9, 9, 200):
        factor = round_down(0.15 * 3, largest)
        assert 0.15 * 3 / 2.5 * (1 - 1e-8) <= factor * largest <= 0.15 * 3 * (1 + 1e-8)
        digits = f"{factor:e}"
        assert digits.startswith(("1.000000", "2.000000", "5.000000"))
    assert round_down(0.15 * 3, 0.0) == 1.0


@pytest.mark.parametrize("step", [-1, 3, 9])
def test_friction_is_drawn_against_its_bound(history, step):
    figure = friction_traction(history, step)
    ax, contact = figure.axes[0], history.contact
    x, row = contact.points[:, 0], history.row(step)
    order = np.argsort(x)
    drawn = lines(ax)
    expected = np.column_stack([x, contact.traction[row][:, 0]])[order]
    assert np.array_equal(ax.lines[2].get_xydata(), expected)
    assert drawn["bound $\\pm g$"] == pytest.approx(np.column_stack([x, bound(contact.points, 0)])[order], rel=1e-13)
    for word, chosen in (("stick", contact.sticking[row]), ("slip", ~contact.sticking[row])):
        assert chosen.any() == (word in drawn)
        if chosen.any():
            assert np.array_equal(drawn[word], expected[chosen[order]])
    assert (np.abs(expected[:, 1]) <= bound(contact.points[order], 0) * (1 + 1e-12)).all()


def test_shading_covers_what_sticks_and_what_slips(history):
    ax, contact = friction_traction(history, 3).axes[0], history.contact
    line = contact_line(history, "test")
    shaded, width = {}, 0.0
    for patch in ax.patches:
        span = patch.get_path().transformed(patch.get_patch_transform()).get_extents()
        inside = (contact.points[:, 0] >= span.x0) & (contact.points[:, 0] <= span.x1)
        shaded.setdefault(matplotlib.colors.to_hex(patch.get_facecolor()).upper(), []).extend(np.flatnonzero(inside))
        width += span.width
    sticks = contact.sticking[history.row(3)]
    assert 0 < sticks.sum() < len(sticks)
    assert set(shaded["#0072B2"]) == set(np.flatnonzero(sticks))
    assert set(shaded["#D55E00"]) == set(np.flatnonzero(~sticks))
    assert width == pytest.approx(np.ptp(line.limits), rel=1e-12)


def test_the_map_shows_every_node_and_step(history):
    figure = stick_slip_map(history)
    contact = history.contact
    order = np.argsort(contact.points[:, 0])
    increments = np.diff(contact.slip[:, order, 0], axis=0)
    way = np.where(contact.sticking[1:, order], 0, np.sign(increments))
    assert set(np.unique(way)) == {-1, 0, 1}
    drawn = figure.axes[0].collections[0].get_array()
    assert np.array_equal(drawn[:, ::2], way)
    assert {text.get_text() for text in figure.legends[0].get_texts()} == {
        "stick",
        "slip towards larger $x_1$",
        "slip towards smaller $x_1$",
    }


@pytest.mark.long
@pytest.mark.parametrize("store", ["last", 7])
def test_a_band_reaches_from_one_stored_instant_to_the_next(history, store):
    some = vx.simulate(history.scene, history.mesh, TIMES, store=store)
    ax = stick_slip_map(some).axes[0]
    mesh, every = ax.collections[0], stick_slip_map(history).axes[0].collections[0]
    steps = some.stored[some.stored > 0]
    assert np.array_equal(mesh.get_array()[:, ::2], every.get_array()[:, ::2][steps - 1])
    assert np.array_equal(mesh.get_coordinates()[:, 0, 1], TIMES[[0, *steps]])
    assert f"each band: its last step ({24 - len(steps)} of 24 steps not stored)" in ax.get_title()
    assert not mesh.get_array().mask[:, ::2].any()


@pytest.mark.long
def test_the_ledger_adds_up(history):
    left, right = energy_ledger(history).axes
    drawn, certificates = lines(left), lines(right)
    assert np.array_equal(drawn["work done on the body"], np.column_stack([TIMES, history.work]))
    assert np.array_equal(drawn["dissipated by friction"][:, 1], history.dissipated)
    assert np.array_equal(drawn["stored"][:, 1], history.energy - history.energy[0])
    parts = [drawn[name][:, 1] for name in ("stored", "dissipated by friction", "lost by time stepping")]
    assert np.sum(parts, axis=0) == pytest.approx(history.work, abs=1e-14)
    assert np.array_equal(certificates["each step"], np.column_stack([TIMES, history.certified])[1:])
    assert np.array_equal(certificates["all steps so far"][:, 1], history.certified_total[1:])
    assert right.get_yscale() == "log"


def test_two_contacts_make_two_parts_of_one_line(squeezed):
    line = contact_line(squeezed, "test")
    assert line.label == "arc length $s$"
    assert sorted(line.order) == list(range(len(squeezed.contact.nodes)))
    assert len(line.gaps) == 1
    # Each part misses the half edge that its clamped end owns.
    assert np.diff(line.limits, axis=1).sum() == pytest.approx(4.0 - 2 * (2 / 12) / 2)
    x = squeezed.contact.points[line.order]
    below = x[:, 1] == 0
    assert np.array_equal(
        line.along(squeezed.contact.traction)[:, below], squeezed.contact.traction[:, line.order[below], 0]
    )
    assert np.array_equal(
        line.along(squeezed.contact.traction)[:, ~below], -squeezed.contact.traction[:, line.order[~below], 0]
    )
    for part in (below, ~below):
        assert np.abs(np.diff(line.position[part])) == pytest.approx(np.linalg.norm(np.diff(x[part], axis=0), axis=1))


def test_a_ceiling_reads_from_left_to_right():
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.Clamp(on="right"),
        vx.BodyForce(lambda x, t: np.column_stack([9 * t + 0 * x[:, 0], 0 * x[:, 0]])),
        vx.BilateralContact(on="top"),
        vx.TrescaFriction(bound=1.0, on="top"),
    )
    history = vx.simulate(scene, small("squares", 4), [0.0, 1.0])
    line = contact_line(history, "test")
    assert line.label == "$x_1$"
    assert line.position == pytest.approx([0.0, 0.25, 0.5, 0.75])
    assert line.limits == pytest.approx(np.array([[0, 1], [1, 3], [3, 5], [5, 7]]) / 8)
    assert np.array_equal(line.along(history.contact.traction), history.contact.traction[:, line.order, 0])


@pytest.mark.long
@pytest.mark.parametrize(("suffix", "begins"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".pdf", b"%PDF")])
def test_what_there_is_to_show_is_written(history, loose, tmp_path, suffix, begins):
    written = write_plots(history, tmp_path, suffix)
    assert {path.name for path in written} == {f"{name}{suffix}" for name in WRITTEN}
    assert all(path.read_bytes().startswith(begins) for path in written)
    # They are known as ours, and replaced; others' are not.
    fewer = {f"{name}{suffix}" for name in ("deformed_mesh", "stressed_body", "forces_over_time", "energy_ledger")}
    assert {path.name for path in write_plots(loose, tmp_path, suffix)} == fewer
    assert {path.name for path in tmp_path.iterdir()} == fewer
    start = vx.simulate(loose.scene, loose.mesh, [0.0])
    assert len(write_plots(start, tmp_path, suffix)) == 2
    (tmp_path / f"wear{suffix}").write_bytes(b"a thesis")
    with pytest.raises(vx.HistoryError, match="not drawn by this version"):
        write_plots(history, tmp_path, suffix)
    with pytest.raises(vx.HistoryError, match="write_plots: found suffix '.jpg'; there are '.png', '.svg' and '.pdf'"):
        write_plots(history, tmp_path, ".jpg")


def test_wear_is_friction_work_and_ever_darker(history):
    ax, contact = wear(history, [8, 24]).axes[0], history.contact
    order = np.argsort(contact.points[:, 0])
    for line, step in zip(ax.lines, (8, 24), strict=True):
        assert np.array_equal(line.get_xydata(), np.column_stack([contact.points[:, 0], contact.wear[step]])[order])
    assert [text.get_text() for text in ax.figure.legends[0].get_texts()] == ["t = 0.3333", "t = 1"]
    assert [line.get_xydata()[:, 1].max() for line in wear(history).axes[0].lines] == pytest.approx(
        contact.wear[[6, 18, 24]].max(axis=1)
    )
    with pytest.raises(vx.HistoryError, match="wear: found 5 steps; it draws 1 to 4 of them"):
        wear(history, [1, 2, 3, 4, 5])


@pytest.mark.long
def test_all_steps_share_one_scale(history):
    """Frames laid side by side: the same magnification, colours, arrows and view, whatever the step."""
    frames = [deformed_mesh(history, step).axes[0] for step in (1, 6, 24)]
    assert len({magnification(ax) for ax in frames}) == 1
    assert len({ax.collections[0].get_clim() for ax in frames}) == 1
    assert len({(ax.get_xlim(), ax.get_ylim()) for ax in frames}) == 1
    scales = set()
    for ax, step in zip(frames, (1, 6, 24), strict=True):
        drawn = np.concatenate([np.column_stack([a.U, a.V]) for a in ax.collections[1:]])
        scales.add(
            round(np.linalg.norm(drawn, axis=1).max() / np.linalg.norm(history.contact.traction[step], axis=1).max(), 9)
        )
    assert len(scales) == 1
    assert len({friction_traction(history, step).axes[0].get_ylim() for step in (1, 6, 24)}) == 1
    bodies = [stressed_body(history, step).axes[0] for step in (1, 6, 24)]
    assert len({(ax.collections[0].get_clim(), ax.collections[0].get_cmap().name) for ax in bodies}) == 1


@pytest.mark.long
def test_magnified_as_asked_with_the_units_and_limits_of_the_reader(history):
    units = {"length": "mm", "force": "N", "time": "s"}
    figure = new_figure()
    axes = figure.subplots(2, 3).ravel()
    deformed_mesh(history, -1, ax=axes[0], magnify=0.5, limits=(0, 7), units=units)
    assert axes[0].collections[0].get_paths()[0].vertices[0] == pytest.approx(
        (history.mesh.points + 0.5 * history.displacement[-1])[history.mesh.cells[0][0]]
    )
    assert axes[0].collections[0].get_clim() == (0, 7)
    assert axes[0].get_title().startswith("t = 1 s, displacements × 0.5, friction at most ")
    assert " N/mm" in axes[0].get_title()
    assert friction_traction(history, ax=axes[1], limits=(-9, 9), units=units) is figure
    assert axes[1].get_ylim() == (-9, 9)
    assert axes[1].get_ylabel() == "friction on the body\n(N/mm)"
    stick_slip_map(history, ax=axes[2], units=units)
    assert (axes[2].get_xlabel(), axes[2].get_ylabel()) == ("$x_1$ (mm)", "t (s)")
    wear(history, ax=axes[3], limits=(0, 1), units=units)
    assert axes[3].get_ylabel() == "friction work\n(N mm/mm)"
    energy_ledger(history, ax=axes[4], limits=(-1, 1), units=units)
    assert (axes[4].get_ylim(), axes[4].get_ylabel()) == ((-1, 1), "energy (N mm), per thickness")
    stressed_body(history, ax=axes[5], magnify=2, limits=(-1, 1), units={**units, "force per area": "MPa"})
    assert "displacements × 2," in axes[5].get_title()
    assert axes[5].collections[0].get_clim() == (-1, 1)
    for wrong, words in (
        ({"magnify": 0}, "magnify: found 0; wanted a positive number"),
        ({"magnify": "much"}, "magnify: found 'much'; wanted a positive number"),
        ({"limits": (2, 1)}, r"limits: found \(2, 1\); wanted two numbers"),
        ({"limits": "all"}, "limits: found 'all'; wanted two numbers"),
        ({"units": "mm"}, "units: found 'mm'; wanted a mapping"),
        ({"units": {"mass": "kg"}}, "units: found 'mass': 'kg'; wanted words for 'length', 'force', "),
    ):
        with pytest.raises(vx.HistoryError, match=words):
            deformed_mesh(history, **wrong)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"window": "x"}, "window: found 'x'"),
        ({"window": [1, 2]}, r"window: found an array of shape \(2,\); wanted \(\(low, high\), \(low, high\)\)"),
        ({"window": ((0, 0), (0, 1))}, r"window: found \(\(0, 0\), \(0, 1\)\); wanted"),
        ({"window": ((5, 6), (0, 1))}, r"window: .*, which shows no cell; the body is within \(\(0, 1\), \(0, 1\)\)"),
        ({"stretch": 0}, "stretch: found 0; wanted a positive number"),
        ({"mirrors": None}, "mirrors: found None"),
        ({"mirrors": [(2, 1)]}, r"mirrors: found \[\(2, 1\)\]; wanted pairs of signs"),
    ],
)
def test_what_is_no_part_of_the_plane_is_refused(history, wrong, words):
    with pytest.raises(vx.VemcvxError, match=words):
        stressed_body(history, **wrong)


def test_a_thin_layer_is_not_turned_inside_out():
    """In SI: steel pressed by a thousandth of its thickness, under a block a hundred times as wide as it is thick."""
    scene = vx.Scene(
        vx.Elasticity(210e9, 0.3),
        vx.Clamp(on="bottom"),
        vx.PrescribedDisplacement(lambda x, t: np.tile([0.0, -1e-6 * t], (len(x), 1)), on="top"),
    )
    history = vx.simulate(scene, vx.meshes.squares((40, 4), box=((0, 0.1), (0, 0.001))), [0.0, 1.0])
    ax = deformed_mesh(history).axes[0]
    factor = magnification(ax)
    heights = [np.ptp(path.vertices[:, 1]) for path in ax.collections[0].get_paths()]
    # The body's width alone would allow 10,000.
    assert 100 <= factor <= 500
    assert min(heights) > 0.4 * 0.001 / 4


@pytest.mark.long
def test_pictures_say_what_they_miss(history, loose, tmp_path):
    for draw in (friction_traction, stick_slip_map, along_contact, wear):
        with pytest.raises(vx.VemcvxError, match=f"{draw.__name__}: this history has no contact nodes"):
            draw(loose)
    start = vx.simulate(history.scene, history.mesh, [0.0])
    for draw in (energy_ledger, stick_slip_map, along_contact, wear):
        with pytest.raises(vx.VemcvxError, match=f"{draw.__name__}: this history has no step"):
            draw(start)
    (tmp_path / "taken").write_text("a file")
    with pytest.raises(vx.VemcvxError, match="taken: cannot write pictures there"):
        write_plots(loose, tmp_path / "taken")


@pytest.mark.long
def test_a_body_is_coloured_by_its_stress_and_pushed_by_its_contact(history):
    figure = new_figure()
    stressed_body(history, 9, ax=figure.subplots(1, 2)[0], stress="xy", mirrors=[(-1, 1)])
    body, (row, contact) = figure.axes[0], (history.row(9), history.contact)
    cells, image, *arrows = body.collections
    assert np.array_equal(cells.get_array(), history.stress(9)[:, 2])
    assert np.array_equal(image.get_array(), cells.get_array())
    for path, mirrored in zip(cells.get_paths(), image.get_paths(), strict=True):
        assert set(map(tuple, path.vertices * [-1, 1])) == set(map(tuple, mirrored.vertices))
    drawn = np.concatenate([np.column_stack([some.U, some.V]) for some in arrows])
    force = contact.traction[row] - contact.pressure[row][:, None] * contact.normals
    scale = np.linalg.norm(drawn, axis=1).max() / np.linalg.norm(force, axis=1).max()
    assert len(drawn) == len(force)
    assert np.linalg.norm(drawn[:, None] - scale * force, axis=2).min(axis=1).max() < 1e-12 * scale
    assert f"at most {np.linalg.norm(force, axis=1).max():.3g}" in body.get_title()
    # What sticks has thick arrows, what slips thin ones.
    sticks = contact.sticking[row]
    assert [len(some.U) for some in arrows] == [sticks.sum(), (~sticks).sum()]
    assert arrows[0].width > arrows[1].width
    for friction in stressed_body(history, forces="friction").axes[0].collections[1:]:
        assert np.abs(friction.V).max(initial=0.0) == 0.0
    assert len(stressed_body(history, forces="none").axes[0].collections) == 1
    for wrong in ({"stress": "zz"}, {"forces": "weight"}):
        (name, value) = next(iter(wrong.items()))
        with pytest.raises(vx.VemcvxError, match=f"stressed_body: found {name} '{value}'; there are '(xx|contact)', "):
            stressed_body(history, **wrong)


@pytest.mark.long
def test_open_contact_neither_sticks_nor_slips():
    """A lifted edge was counted, marked and coloured as slip, with friction zero."""
    scene = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: t * (x[:, :1] * [0.0, 0.04] + [0.02, -0.02]), on="top"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(0.3, on="bottom"),
    )
    history = vx.simulate(scene, vx.meshes.squares(8), TIMES)
    contact = history.contact
    opened, slips = int(contact.open_count[-1]), int(contact.slip_count[-1])
    assert opened > 0
    figure = friction_traction(history)
    title = figure.axes[0].get_title()
    assert title.endswith(f"{contact.stick_count[-1]} contact nodes stick, {slips} slip, {opened} are open")
    states = directions(history, contact_line(history, "stick_slip_map"))
    assert np.isnan(states[-1]).sum() == opened


def stressed_body_alone(history, **options):
    figure = new_figure(4, 3)
    stressed_body(history, ax=figure.add_subplot(), **options)
    return figure


@pytest.fixture(scope="module")
def rubbed():
    """A pad pressed on a floor and rubbed to and fro once and a quarter."""

    def plate(x, t):
        return np.tile([0.1 * np.sin(2 * np.pi * t), -0.02], (len(x), 1))

    floor = vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom")
    scene = vx.Scene(vx.Elasticity(10.0, 0.45), vx.PrescribedDisplacement(plate, on="top"), *floor)
    mesh = vx.meshes.squares((8, 4), box=((0, 2), (0, 1)))
    return vx.simulate(scene, mesh, np.linspace(0.0, 1.25, 41), initial="settled")


@pytest.mark.long
def test_pressure_slip_and_wear_are_drawn_along_the_contact(rubbed):
    contact = rubbed.contact
    order = np.argsort(contact.points[:, 0])
    pressure = contact.pressure_recovered
    for show, values in (("pressure", pressure), ("slip", contact.slip[:, :, 0]), ("wear", contact.wear)):
        ax = along_contact(rubbed, show, [10, 30]).axes[0]
        for line, step in zip(ax.lines, (10, 30), strict=True):
            assert np.array_equal(line.get_xydata(), np.column_stack([contact.points[:, 0], values[step]])[order])
        low, high = ax.get_ylim()
        assert low <= values.min()
        assert high > values.max()
    assert [line.get_label() for line in along_contact(rubbed, "slip", 30).axes[0].lines] == ["t = 0.9375"]
    assert along_contact(rubbed, "slip").axes[0].get_ylabel() == "slip towards larger $x_1$\n(length)"
    with pytest.raises(
        vx.HistoryError, match="along_contact: found show 'gap'; there are 'pressure', 'slip' and 'wear'"
    ):
        along_contact(rubbed, "gap")


@pytest.mark.long
def test_pressures_that_are_rounding_are_drawn_as_zero():
    """A strip without Poisson's effect is pulled along a plane: nothing presses, and 1e-17 filled the axis."""
    ends = vx.Symmetry(on="left"), vx.BilateralContact(on="bottom")
    scene = vx.Scene(
        vx.Elasticity(10.0, 0.0), *ends, vx.Traction(lambda x, t: np.tile([t, 0.0], (len(x), 1)), on="right")
    )
    pulled = vx.simulate(scene, small("voronoi", 6, seed=2), [0.0, 0.5, 1.0])
    assert 0 < np.abs(pulled.contact.pressure_recovered).max() < 1e-12
    assert not pressures(pulled).any()
    figure = along_contact(pulled)
    assert figure.axes[0].get_ylim() == pytest.approx((0.0, 1.0))
    assert "contact_pressure" not in draw_pictures(pulled, None)


@pytest.mark.long
def test_the_loop_is_the_reaction_against_the_motion_of_what_is_prescribed(rubbed):
    ax = hysteresis_loop(rubbed).axes[0]
    u, force = ax.lines[0].get_xydata().T
    assert u == pytest.approx(0.1 * np.sin(2 * np.pi * rubbed.times), abs=1e-15)
    assert np.array_equal(force, rubbed.reaction("top")[:, 0])
    # A cycle encloses the work that it takes; the sides of the loop are straight between the instants.
    cycle = slice(8, 41)
    work = float(np.sum(0.5 * (force[cycle][1:] + force[cycle][:-1]) * np.diff(u[cycle])))
    assert work == pytest.approx(np.ptp(rubbed.work_second_order[cycle][[0, -1]]), rel=1e-2)
    assert [text.get_text() for text in ax.figure.legends[0].get_texts()] == ["t = 0", "t = 1.25"]
    assert "bottom" in hysteresis_loop(rubbed, "bottom").axes[0].get_title()


def test_forces_over_time_are_the_resultants_and_the_largest_comes_first(rubbed):
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
def test_a_loop_needs_something_that_moves(history, rubbed, tmp_path):
    words = r"hysteresis_loop: no driven boundary is known; give on=, one of '"
    assert "Load of left along $x_1$" in hysteresis_loop(history).axes[0].get_title()
    loaded = vx.read_history(history.write(tmp_path / "loaded"))
    with pytest.raises(vx.HistoryError, match=words):
        hysteresis_loop(loaded)
    read = vx.read_history(rubbed.write(tmp_path / "read"))
    lines = hysteresis_loop(read).axes[0].lines
    assert np.array_equal(lines[0].get_xydata(), hysteresis_loop(rubbed).axes[0].lines[0].get_xydata())
    with pytest.raises(vx.SceneError, match="hysteresis_loop: .*'lid'"):
        hysteresis_loop(read, "lid")


@pytest.mark.long
def test_stresses_that_engineers_quote(rubbed):
    found = {
        "von_mises": rubbed.von_mises(-1),
        "max_principal": rubbed.principal_stresses(-1)[:, 0],
        "min_principal": rubbed.principal_stresses(-1)[:, 1],
    }
    for stress, values in found.items():
        ax = stressed_body(rubbed, -1, stress=stress).axes[0]
        assert np.array_equal(ax.collections[0].get_array(), values)
    low, high = stressed_body(rubbed, stress="von_mises").axes[0].collections[0].get_clim()
    assert low == 0.0 < high


@pytest.mark.long
def test_every_axis_has_the_unit_that_is_given(rubbed):
    units = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
    drawn = draw_pictures(rubbed, units)
    assert set(drawn) == WRITTEN
    for figure in drawn.values():
        words = [text.get_text() for text in figure.findobj(matplotlib.text.Text)]
        assert not [word for word in words if any(name in word for name in ("length", "force)", "time)", " per area"))]
        figure.draw_without_rendering()
        page, ink = figure.bbox_inches, figure.get_tightbbox()
        assert min(ink.x0, ink.y0) >= -0.01
        assert ink.x1 <= page.width + 0.01
        assert ink.y1 <= page.height + 0.01
    # In the plane what is per length of the boundary is per unit of thickness, too.
    assert drawn["contact_pressure"].axes[0].get_ylabel() == "contact pressure\n(MPa)"
    assert drawn["contact_slip"].axes[0].get_ylabel() == "slip towards larger $x_1$\n(mm)"
    assert drawn["hysteresis_loop"].axes[0].get_ylabel() == "reaction (N), per thickness"


def test_no_label_of_a_square_body_is_cut_off():
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="left"), vx.Traction((0.0, -0.1), on="right"))
    figure = deformed_mesh(vx.simulate(scene, vx.meshes.squares(4), [0.0], initial="settled"))
    figure.draw_without_rendering()
    ink, page = figure.get_tightbbox(), figure.bbox_inches
    assert page.contains(ink.x0, ink.y0)
    assert page.contains(ink.x1, ink.y1)


@mostly_long(
    "draw, gap, apart",
    [(deformed_mesh, -0.002, 0.02), (stressed_body_alone, 0.0, 0.0), (stressed_body_alone, 0.001, 0.01)],
    0,
    2,
)
def test_closed_contact_is_marked_though_magnified_displacements_draw_it_apart(draw, gap, apart):
    """An interference of .002 was a white gap of .02, under pressure, and a closed gap an overlap."""
    blocks = {
        "lower": vx.meshes.squares((4, 2), ((0, 2), (0, 1))),
        "upper": vx.meshes.squares((4, 2), ((0, 2), (1, 2))),
    }
    down = vx.PrescribedDisplacement(lambda x, t: np.tile([0.0, -0.004 * t], (len(x), 1)), on="upper.top")
    contact = vx.UnilateralContact(on="lower|upper", gap=gap)
    scene = vx.Scene(vx.Elasticity(100.0, 0.0), vx.Clamp(on="lower.bottom"), down, contact)
    history = vx.simulate(scene, vx.meshes.bodies(blocks), [0.0, 0.5, 1.0], initial="settled")
    assert history.contact.closed[-1].all()
    (patch,) = draw(history, magnify=10.0).axes[0].patches
    outline = patch.get_path().vertices
    x, y = outline.T
    area = 0.5 * abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))
    assert area == pytest.approx(2.0 * apart, abs=1e-9)
    # It reaches from one body, as it is drawn, to the other.
    drawn = history.mesh.points + 10.0 * history.displacement[-1]
    for node in np.concatenate([history.contact.nodes, history.contact.partners]):
        assert np.linalg.norm(outline - drawn[node], axis=1).min() < 1e-12
    if gap > 0:
        assert not draw(history, step=0, magnify=10.0).axes[0].patches


def lightness(colour):
    """From 0, black, to 1, white, as print in grey has it."""
    return float(np.dot([0.299, 0.587, 0.114], matplotlib.colors.to_rgb(colour)))


def test_in_grey_print_no_stress_looks_like_its_opposite_and_slip_not_like_stick(history):
    shades = [lightness(colour) for colour in blend_colours(SIGNED)(np.linspace(0.0, 1.0, 21))[:, :3]]
    assert np.diff(shades).max() < -0.01
    areas = sorted(map(lightness, (STICK_AREA, SLIP_AREA, OPEN_AREA)))
    assert np.diff(areas).min() > 0.1
    hatched = {
        matplotlib.colors.to_hex(p.get_facecolor()): p.get_hatch()
        for p in friction_traction(history, 3).axes[0].patches
    }
    assert {colour.upper(): bool(hatch) for colour, hatch in hatched.items()} == {"#0072B2": False, "#D55E00": True}
    assert len({line.get_marker() for line in wear(history, [3, 6, 12, 24]).axes[0].lines}) == 4
