"""Pictures of the deformed body.

In space, PyVista renders an image of the surface without a display.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.base import canvas
from vemcvx.base.arrays import Floats, Ints, as_real_array, brief, choice
from vemcvx.base.errors import HistoryError, VemcvxError
from vemcvx.meshes import PolygonMesh, PolyhedralMesh, plane_mesh
from vemcvx.meshes.polygons import rows_in_order
from vemcvx.plots import style
from vemcvx.plots.contact import contact_line
from vemcvx.plots.style import Units, Window, common_magnification, extent, instant, label, label_axes, units_of, within
from vemcvx.results import Results, last_of_largest
from vemcvx.vem.tensors import component_names

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap
    from matplotlib.figure import Figure

Colours = tuple["str | Colormap", tuple[float, float]]
EQUIVALENT: dict[str, tuple[str, Callable[[dict[str, Floats]], Floats]]] = {
    "shear": ("largest shear stress", lambda on: 0.5 * np.ptp(on["principal_stresses"], axis=1)),
    "von_mises": ("von Mises stress", lambda on: on["von_mises"]),
    "max_principal": ("largest principal stress", lambda on: on["principal_stresses"][:, 0]),
    "min_principal": ("smallest principal stress", lambda on: on["principal_stresses"][:, -1]),
    "mean": ("mean of normal stresses", lambda on: on["principal_stresses"].mean(axis=1)),
}
"""Stress invariant -> words, and a function of the cell fields of a step."""
UNSIGNED, NUMBERS = {"shear", "von_mises"}, str.maketrans("xyz", "123")
FORCES = {"contact": "contact force", "friction": "friction", "none": ""}
CLOSED = "closed contact bold or hatched"
MISSING = "drawing bodies in space needs PyVista, which is not installed: pip install 'vemcvx[view]'"


def deformed_mesh(
    history: Results,
    step: int | None = None,
    *,
    ax: Axes | None = None,
    magnify: float | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the deformed mesh at a stored step.

    Parameters
    ----------
    history, step, ax, units : as for `friction_traction`
    magnify : float, optional
        Magnification of displacements; by default 1, 2 or 5 times a power of ten.

    Returns
    -------
    matplotlib Figure
        The colour of a cell shows the mean of |u| at the vertices. Arrows and marks are as in `stressed_body` with
        ``forces="friction"``. All steps have the same scales.

    Raises
    ------
    SceneError, HistoryError
        The body is in space, the step was not stored, or an argument is invalid.

    Examples
    --------
    >>> figure = vx.plots.deformed_mesh(history, units={"length": "mm"})
    """
    units = units_of(history, units)
    row, mesh = history.row(step), plane_mesh(history.mesh, "deformed_mesh", "deformed_body draws it")
    sizes = (np.linalg.norm(u, axis=1)[mesh.vertices] for u in history.displacement)
    means = [np.add.reduceat(size, mesh.offsets[:-1]) / np.diff(mesh.offsets) for size in sizes]
    ends = 0.0, max(float(mean.max()) for mean in means) or 1.0
    field = _Field(means, label("$|u|$", "length", units), (style.SIZE, ends))
    ax = canvas.axes_or_new(ax, *size_of_page(history))
    outline = np.insert(mesh.points[mesh.boundaries["boundary"]], 2, np.nan, axis=1).reshape(-1, 2)
    ax.plot(*outline.T, color=style.OUTLINE, linewidth=0.8, linestyle="--", zorder=2.5)
    return _draw(ax, (history, row), field, _View("friction", magnify=magnify, units=units), ["dashed: undeformed"])


def _size(points: ArrayLike) -> float:
    return float(np.ptp(points, axis=0).max())


def size_of_page(history: Results) -> tuple[float, float]:
    """Return the width and height of a page in inches."""
    if isinstance(history.mesh, PolyhedralMesh):
        return canvas.usual_page()
    width, height = np.ptp(history.mesh.points, axis=0)
    return 6.0, 1.5 + 4.0 * float(np.clip(height / width, 0.2, 1.6))


def stressed_body(
    history: Results,
    step: int | None = None,
    *,
    ax: Axes | None = None,
    stress: str = "mean",
    forces: str = "contact",
    window: Window | None = None,
    stretch: float = 1.0,
    mirrors: Sequence[tuple[int, int]] = (),
    magnify: float | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw the deformed body at a stored step, with cells coloured by stress.

    Parameters
    ----------
    history, ax, units : as for `friction_traction`
    step : int, optional
        A stored step; by default the step with the largest visible stress.
    stress : {"mean", "xx", "yy", "xy", "shear", "von_mises", "max_principal", "min_principal"}
        Principal stresses are stresses in the plane. Tension is red, and compression is blue.
    forces : {"contact", "friction", "none"}
        "contact" draws the sum of pressure and friction. Arrows are blue and thick where contact sticks, orange and
        thin where contact slips, and grey without friction.
    window : ((x0, x1), (y0, y1)), optional
        The drawn part of the plane, in units of length.
    stretch : float
        Scale factor of x_2, for slender bodies.
    mirrors : sequence of (1 or -1, 1 or -1)
        Signs of x_1 and x_2 in mirror images, which complete a half or a quarter of a body.
    magnify : as for `deformed_mesh`

    Returns
    -------
    matplotlib Figure
        Long arrows end at 1.5 times the 90 % quantile of forces. Closed contact is bold, and hatched where
        magnification separates two bodies. The colour bar covers the stresses of at least 99 % of the cells.

    Raises
    ------
    SceneError, HistoryError
        The body is in space, the step was not stored, an argument is invalid, or no cell is in the window.

    Examples
    --------
    >>> figure = vx.plots.stressed_body(history, stress="von_mises", forces="friction")
    """
    units = units_of(history, units)
    _check_stress(stress, history, "stressed_body")
    choice(forces, "stressed_body", "forces", list(FORCES), HistoryError)
    mesh = plane_mesh(history.mesh, "stressed_body", "deformed_body draws it")
    window, stretch = style.window_of(window), style.positive(stretch, "stretch: found", "a positive number")
    images = as_real_array(mirrors, "mirrors", "pairs of signs, 1 or -1")
    if images.size and (images.shape[1:] != (2,) or (np.abs(images) != 1).any()):
        raise HistoryError(f"mirrors: found {brief(mirrors)}; wanted pairs of signs, such as [(-1, 1)].")
    seen = within(mesh.centroids, window)
    if not seen.any():
        raise HistoryError(f"window: found {brief(window)}, which shows no cell of the body.")
    words, values = _stresses(history, stress)
    shown = [found[seen] for found in values]
    row = _row(history, step, shown)
    field = _Field(values, label(words, "force per area", units), colours_of(shown, stress))
    ax = canvas.axes_or_new(ax, *size_of_page(history))
    view = _View(forces, window=window, stretch=stretch, images=images, magnify=magnify, units=units)
    return _draw(ax, (history, row), field, view)


@dataclass(frozen=True)
class _Field:
    values: Sequence[Floats]  # (n_cells,) at each stored step
    label: str
    colours: Colours


@dataclass(frozen=True, kw_only=True)
class _View:
    forces: str = field(kw_only=False)
    window: Window | None = None
    stretch: float = 1.0
    images: Floats = field(default_factory=lambda: np.zeros((0, 2)))
    magnify: float | None = None
    units: Units


def _draw(ax: Axes, at: tuple[Results, int], field: _Field, view: _View, marks: Sequence[str] = ()) -> Figure:
    (history, row), (window, units) = at, (view.window, view.units)
    mesh = plane_mesh(history.mesh, "stressed_body")
    seen, size = within(mesh.centroids, window), _size(mesh.points if window is None else np.transpose(window))
    factor = common_magnification(history, size, view.magnify, within(mesh.points, window))
    places = mesh.points + factor * history.displacement[row]
    look: dict[str, Any] = {"array": field.values[row], "cmap": field.colours[0], "clim": field.colours[1]}
    line = float(np.clip(9.0 / np.sqrt(seen.sum()), 0.0, 0.5))
    PolygonMesh.unchecked(places, mesh.offsets, mesh.vertices).plot(ax=ax, linewidth=line, edgecolor="0.35", **look)
    beyond = canvas.find_pointed_ends(np.concatenate([found[seen] for found in field.values]), look["clim"])
    canvas.bar_beside(ax, ax.collections[0], beyond).set_label(field.label, fontsize="small")
    for signs in view.images:
        # The checks of `PolygonMesh` refuse coinciding nodes.
        image = PolygonMesh.unchecked(places * signs, mesh.offsets, mesh.vertices)
        image.plot(ax=ax, linewidth=0, antialiased=False, **look)
    touching = _outline_closed(history, row, places)
    rounded: dict[str, Any] = {"linewidth": 1.6, "capstyle": "round", "joinstyle": "round", "zorder": 2.2}
    for outline in (outline * signs for outline in touching for signs in ((1, 1), *view.images)):
        ax.fill(*outline.T, facecolor="white", edgecolor="0.2", hatch="///", **rounded)
    largest, cut = _arrows(ax, at, (factor, size), view)
    title = f"{instant(history.times[row], units)}, displacements × {factor:g}"
    if largest:
        words = FORCES[view.forces].replace("force", "forces")
        title += f", {words} at most {style.amount(largest, 'force per length', units)}"
    notes = [*marks, *[CLOSED] * bool(touching), *[f"arrows cut at {cut:.3g}"] * (largest > cut)]
    title += "\n" * bool(notes) + "; ".join(notes)
    ax.tick_params(labelsize="small")
    ax.locator_params(nbins=6)
    if window is None:
        for signs in ((1, 1), *view.images):
            ax.update_datalim(extent(history, factor) * signs)
        ax.autoscale_view()
    canvas.legend_below(ax)
    drawn = "" if view.stretch == 1.0 else f",\n× {view.stretch:g}"
    y = f"$x_2$ ({style.unit(units, 'length')}{drawn})"
    return label_axes(ax, label("$x_1$", "length", units), y, title, size="small", window=window, aspect=view.stretch)


def _check_stress(name: object, history: Results, picture: str) -> None:
    choice(name, picture, "stress", [*component_names(history.mesh.points.shape[1]), *EQUIVALENT], HistoryError)


def _stresses(history: Results, name: str) -> tuple[str, list[Floats]]:
    """Return words for a stress, and the values in cells at all stored steps."""
    if name == "von_mises":
        history.von_mises(int(history.stored[0]))  # An unknown stress raises an error.
    every = [history.on_cells(int(step)) for step in history.stored]
    if name in EQUIVALENT:
        words, value = EQUIVALENT[name]
        return words, [value(fields) for fields in every]
    k = component_names(history.mesh.points.shape[1]).index(name)
    return rf"$\sigma_{{{name.translate(NUMBERS)}}}$", [fields["stress"][:, k] for fields in every]


def _row(history: Results, step: int | None, stresses: Sequence[Floats]) -> int:
    return last_of_largest([np.abs(found).max() for found in stresses]) if step is None else history.row(step)


def colours_of(stresses: Sequence[Floats], name: str) -> Colours:
    """Return a colour map, and the stresses at both ends of the map."""
    low, high = (find(float(np.percentile(s, q)) for s in stresses) for find, q in ((min, 1.0), (max, 99.0)))
    # Stress at corners is unbounded, so the map ends at the 99 % quantile.
    top = max(float(np.percentile(np.abs(s), 99.0)) for s in stresses) or 1.0
    if max(float(np.ptp(s)) for s in stresses) < 0.02 * top:
        # A constant stress has the middle colour.
        top *= 2.0
    if name in UNSIGNED:
        return style.SIZE, (0.0, top)
    if low > -0.1 * top:
        return style.TENSION, (0.0, top)
    return (style.COMPRESSION, (-top, 0.0)) if high < 0.1 * top else (canvas.blend_colours(style.SIGNED), (-top, top))


def _outline_closed(history: Results, row: int, places: Floats) -> list[Floats]:
    contact = history.contact
    if not contact.closed[row].any():
        return []
    line = contact_line(history, "stressed_body")
    nodes, partners, closed = contact.nodes[line.order], contact.partners[line.order], contact.closed[row, line.order]
    near, far = places[nodes], places[np.where(partners < 0, nodes, partners)]
    parts = np.split(np.arange(len(nodes)), np.union1d(line.gaps, 1 + np.flatnonzero(closed[1:] != closed[:-1])))
    return [np.concatenate([near[part], far[part[::-1]]]) for part in parts if closed[part[0]]]


def _arrows(ax: Axes, at: tuple[Results, int], scale: tuple[float, float], view: _View) -> tuple[float, float]:
    """Draw forces; return the largest force, and the force above which arrows are cut."""
    (history, row), (factor, size), contact = at, scale, at[0].contact
    together = view.forces == "contact"
    seen = np.flatnonzero(within(contact.points, view.window))
    every = contact.traction - together * contact.pressure[:, :, None] * contact.normals
    sizes = np.linalg.norm(every[:, seen], axis=2)
    if not sizes.any() or view.forces == "none":
        return 0.0, 0.0
    # Forces at corners are unbounded, so long arrows are cut.
    loaded = [row[row > 1e-6 * sizes.max()] for row in sizes]
    cut = min(float(sizes.max()), 1.5 * max(float(np.quantile(row, 0.9)) for row in loaded if len(row)))
    order = seen[np.argsort(contact.points[seen] @ [1.0, 1e-3])]
    shown = order[np.unique(np.linspace(0, len(order) - 1, 26).round().astype(int))]
    points, longest, flat = history.mesh.points, 0.13 * size, [1.0, view.stretch]
    if not together:
        between = np.linalg.norm(np.diff(points[contact.nodes[shown]], axis=0), axis=1)
        longest = min(longest, 0.8 * between.min(initial=longest))
    lengths = every[:, shown] * longest / np.maximum(np.linalg.norm(every[:, shown], axis=2), cut)[:, :, None] / flat
    tips = (points + factor * history.displacement)[:, contact.nodes[shown]]
    places, sticks = points + factor * history.displacement[row], contact.sticking[row, shown]
    heads, arrows = tips[row], lengths[row]
    beside, joined = 0.03 * size * contact.normals[shown] / flat, contact.partners[shown] >= 0
    if not together:
        # Between two bodies, friction has an arrow in each body.
        heads = heads + np.where(joined, -1.0, 1.0)[:, None] * beside
        heads = np.concatenate([heads, places[contact.partners[shown[joined]]] + beside[joined]])
        arrows, sticks = np.concatenate([arrows, -arrows[joined]]), np.append(sticks, sticks[joined])
    kinds = [(sticks, style.STICK, 0.008, ", sticking"), (~sticks, style.SLIP, 0.004, ", slipping")]
    if not contact.bound.any():
        kinds = [(np.ones_like(sticks), style.PUSH, 0.005, "")]
    for chosen, colour, width, state in kinds:
        look: dict[str, Any] = {"colour": colour, "width": width, "pivot": "tip" if together else "mid"}
        canvas.draw_arrows(ax, heads[chosen], arrows[chosen], **look).set_in_layout(False)
        marks: dict[str, Any] = {"markersize": 14, "markeredgewidth": 250 * width, "linestyle": "none", "color": colour}
        ax.plot([], [], marker="$\\rightarrow$", label=FORCES[view.forces] + state, **marks)
    # All steps have the same margin beside the body.
    room = [*tips, *(tips - lengths)] if together else [end + 2.0 * beside for end in extent(history, factor)]
    ax.update_datalim(np.concatenate(room))
    return float(sizes[row].max(initial=0.0)), cut


def deformed_body(
    history: Results,
    step: int | None = None,
    *,
    ax: Axes | None = None,
    stress: str = "von_mises",
    view: ArrayLike = (-1.0, -1.6, 0.9),
    magnify: float | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw a deformed body in space at a stored step, coloured by stress.

    Parameters
    ----------
    history, step, ax, units : as for `stressed_body`
    stress : {"xx", "yy", "zz", "xy", "yz", "xz", "shear", "von_mises", "max_principal", "min_principal", "mean"}
        Tension is red and compression blue.
    view : (3,) vector
        Direction from the body to the viewer; x_3 points upwards.
    magnify : as for `deformed_mesh`

    Returns
    -------
    matplotlib Figure
        All steps have the same scales.

    Raises
    ------
    SceneError, HistoryError
        The body is plane, the step was not stored, or an argument is invalid.
    VemcvxError
        PyVista or matplotlib is not installed.

    Examples
    --------
    >>> scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="left"), vx.Traction((0.0, 0.0, -1.0), on="right"))
    >>> history = vx.simulate(scene, vx.meshes.cubes(2), [0.0, 1.0], initial="settled")
    >>> figure = vx.plots.deformed_body(history, stress="von_mises")  # doctest: +SKIP
    """
    units = units_of(history, units)
    mesh = history.mesh
    if not isinstance(mesh, PolyhedralMesh):
        raise HistoryError("deformed_body: this body is plane; deformed_mesh and stressed_body draw it.")
    _check_stress(stress, history, "deformed_body")
    faces = mesh.boundaries["boundary"]
    factor = common_magnification(history, _size(mesh.points), magnify)
    words, values = _stresses(history, stress)
    stresses = [found[mesh.face_cells[faces, 0]] for found in values]
    row, (colours, scale) = _row(history, step, stresses), colours_of(stresses, stress)
    points = mesh.points + factor * history.displacement[row]
    surface = points, *rows_in_order(mesh.face_offsets, mesh.face_vertices, faces)
    image = _render(surface, stresses[row], (colours, scale), extent(history, factor), _direction(view))
    across = canvas.usual_page()[0]
    ax = canvas.axes_or_new(ax, across, 0.5 + 0.8 * across * image.shape[0] / image.shape[1])
    beyond = canvas.find_pointed_ends(np.concatenate(stresses), scale)
    ax.imshow(image)
    ax.set_axis_off()
    canvas.colour_bar(ax, canvas.scale_of(colours, scale), label(words, "force per area", units), beyond)
    return label_axes(ax, "", "", f"{instant(history.times[row], units)}, displacements × {factor:g}", size="small")


def _direction(view: ArrayLike) -> Floats:
    wanted = "a vector of three finite components that is not along x_3"
    found = as_real_array(view, "deformed_body: view", wanted)
    if found.shape != (3,) or not np.isfinite(found).all() or not found[:2].any():
        raise HistoryError(f"deformed_body: found view = {brief(view)}; wanted {wanted}.")
    return found / np.linalg.norm(found)


def has_pyvista() -> bool:
    """Return True if PyVista is installed."""
    return find_spec("pyvista") is not None


def _render(
    surface: tuple[Floats, Ints, Ints], values: Floats, colours: Colours, frame: Floats, towards: Floats
) -> NDArray[np.uint8]:
    if not has_pyvista():
        raise VemcvxError(MISSING)
    import pyvista

    points, offsets, vertices = surface
    drawn = pyvista.PolyData(points, np.insert(vertices, offsets[:-1], np.diff(offsets)))
    drawn.cell_data["values"] = values
    up = (0.0, 0.0, 1.0)
    right = np.cross(up, towards)
    across = np.stack([right, np.cross(towards, right)]) / np.linalg.norm(right)
    size = 1.03 * np.abs(across) @ np.ptp(frame, axis=0)
    # Without a display, VTK prints a message and draws in memory.
    with pyvista.vtk_verbosity("off"):
        width, height = np.maximum(np.round(1000 * size / size.max()).astype(int), 1).tolist()
        plotter: Any = pyvista.Plotter(off_screen=True, window_size=[width, height])
        plotter.set_background("white")
        look = {"show_edges": True, "edge_color": "#505050", "line_width": 1.0, "lighting": False}
        plotter.add_mesh(drawn, scalars="values", cmap=colours[0], clim=colours[1], show_scalar_bar=False, **look)
        plotter.add_axes(xlabel="x1", ylabel="x2", zlabel="x3", viewport=(0.0, 0.0, 0.22, 0.22 * width / height))
        plotter.enable_anti_aliasing("ssaa")
        middle = frame.mean(axis=0)
        plotter.camera_position = [middle + 2 * np.linalg.norm(size) * towards, middle, up]
        plotter.enable_parallel_projection()
        plotter.camera.parallel_scale = 0.5 * size[1]
        plotter.reset_camera_clipping_range()
        image: NDArray[np.uint8] = plotter.screenshot(None, return_img=True)
        plotter.close()
    return image
