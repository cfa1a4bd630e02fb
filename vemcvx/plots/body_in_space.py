"""The deformed body in space, coloured by a stress, drawn by PyVista without a display."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.arrays import Floats, Ints, as_real_array, brief, choice
from vemcvx.canvas import axes_or_new, figure_of, show_image
from vemcvx.errors import HistoryError, VemcvxError
from vemcvx.meshes import PolyhedralMesh
from vemcvx.meshes.polygons.topology import rows_in_order
from vemcvx.plots.body_in_plane import colours_of
from vemcvx.plots.style import Units, common_magnification, extent, instant, unit, value_range
from vemcvx.results.results import Results
from vemcvx.vem import equivalent

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


# Surfaces in space as images: the one file of pictures that knows PyVista, which draws without a display.


MISSING = "drawing bodies in space needs PyVista, which is not installed: pip install 'vemcvx[view]'"
UP = (0.0, 0.0, 1.0)
LARGEST, MARGIN = 1000, 1.03
LOOK = {"show_edges": True, "edge_color": "#505050", "line_width": 1.0, "lighting": False}


def has_pyvista() -> bool:
    """Return True if there is something to draw with."""
    try:
        import pyvista  # noqa: F401
    except ImportError:
        return False
    return True


def rendered(
    surface: tuple[Floats, Ints, Ints],
    values: Floats,
    *,
    colours: str,
    limits: tuple[float, float],
    frame: Floats,
    view: Floats,
) -> NDArray[np.uint8]:
    """Draw polygons in space, with one value each, in parallel projection.

    Parameters
    ----------
    surface : points (n, 3), offsets (k + 1,), vertices
        Polygon i has the corners ``points[vertices[offsets[i]:offsets[i + 1]]]``.
    values : (k,)
    colours, limits
        A colour map and the values at its ends.
    frame : (2, 3)
        Lowest and highest corner of the box that fills the image.
    view : (3,)
        The direction in which the viewer is, not along x_3, which points upwards.

    Returns
    -------
    (height, width, 3) uint8

    Raises
    ------
    VemcvxError
        PyVista is not installed.
    """
    try:
        import pyvista
    except ImportError:
        raise VemcvxError(MISSING) from None
    points, offsets, vertices = surface
    drawn = pyvista.PolyData(points, np.insert(vertices, offsets[:-1], np.diff(offsets)))
    drawn.cell_data["values"] = values
    towards = view / np.linalg.norm(view)
    size = _size(frame, towards)
    # Where there is no display, VTK says so and draws in memory.
    with pyvista.vtk_verbosity("off"):
        width, height = np.maximum(np.round(LARGEST * size / size.max()).astype(int), 1).tolist()
        plotter: Any = pyvista.Plotter(off_screen=True, window_size=(width, height))
        plotter.set_background("white")
        plotter.add_mesh(drawn, scalars="values", cmap=colours, clim=limits, show_scalar_bar=False, **LOOK)
        plotter.add_axes(xlabel="x1", ylabel="x2", zlabel="x3", viewport=(0.0, 0.0, 0.22, 0.22 * width / height))
        plotter.enable_anti_aliasing("ssaa")
        middle = frame.mean(axis=0)
        plotter.camera_position = [middle + 2 * np.linalg.norm(size) * towards, middle, UP]
        plotter.enable_parallel_projection()
        plotter.camera.parallel_scale = 0.5 * size[1]
        plotter.reset_camera_clipping_range()
        image: NDArray[np.uint8] = plotter.screenshot(None, return_img=True)
        plotter.close()
    return image


def _size(frame: Floats, towards: Floats) -> Floats:
    """Width and height of a box seen from afar."""
    right = np.cross(UP, towards)
    across = np.stack([right / np.linalg.norm(right), np.cross(towards, right) / np.linalg.norm(right)])
    size: Floats = MARGIN * np.abs(across) @ np.ptp(frame, axis=0)
    return size


# The deformed body in space, coloured by a stress, drawn by PyVista.


UNSIGNED = "von_mises"
STRESSES: dict[str, tuple[str, Callable[[Floats], Floats]]] = {
    UNSIGNED: ("von Mises stress", equivalent),
    "mean": (r"$(\sigma_{11}+\sigma_{22}+\sigma_{33})/3$", lambda s: s[:, :3].mean(axis=1)),
    "xx": (r"$\sigma_{11}$", lambda s: s[:, 0]),
    "yy": (r"$\sigma_{22}$", lambda s: s[:, 1]),
    "zz": (r"$\sigma_{33}$", lambda s: s[:, 2]),
    "xy": (r"$\sigma_{12}$", lambda s: s[:, 3]),
    "yz": (r"$\sigma_{23}$", lambda s: s[:, 4]),
    "xz": (r"$\sigma_{13}$", lambda s: s[:, 5]),
}
SIZE = 6.4, 4.6
"""Of a page, in inches."""
VIEW = (-1.0, -1.6, 0.9)


def deformed_body(
    history: Results,
    step: int = -1,
    *,
    ax: Axes | None = None,
    stress: str = UNSIGNED,
    view: ArrayLike = VIEW,
    magnify: float | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Figure:
    """Draw a body in space deformed at a stored step, each face of its surface in the stress of its cell.

    Magnification, colours and what is shown are the same at all steps. No display is needed.

    Parameters
    ----------
    history, step, ax, units : as of `friction_traction`
    stress : str
        Which: one of `STRESSES`. Tension is red and compression blue.
    view : (3,) vector
        From where the body is looked at, with x_3 upwards.
    magnify : float, optional
        How many times larger displacements are drawn than they are; by default 1, 2 or 5 times a power of ten.
    limits : (low, high), optional
        Ends of the colour scale; by default the same for all stored steps.

    Raises
    ------
    HistoryError
        The body is plane, or there is no stress of that name.
    VemcvxError
        PyVista or matplotlib is not installed.
    """
    row, mesh = history.row(step), history.mesh
    if not isinstance(mesh, PolyhedralMesh):
        raise HistoryError("deformed_body: this body is plane; deformed_mesh and stressed_body draw it.")
    label, part = STRESSES[choice(stress, "deformed_body", "stress", list(STRESSES), HistoryError)]
    faces = mesh.boundaries["boundary"]
    cells = mesh.face_cells[faces, 0]
    factor = common_magnification(history, float(np.ptp(mesh.points, axis=0).max()), magnify)
    stresses = [part(history.stress(int(n)))[cells] for n in history.stored]
    colours, ends = colours_of(stresses, stress == UNSIGNED)
    scale = value_range(limits, ends)
    drawn = rows_in_order(mesh.face_offsets, mesh.face_vertices, faces)
    image = rendered(
        (mesh.points + factor * history.displacement[row], *drawn),
        stresses[row],
        colours=colours,
        limits=scale,
        frame=extent(history, factor),
        view=_direction(view),
    )
    height, width = image.shape[:2]
    ax = axes_or_new(ax, SIZE[0], 0.5 + 0.8 * SIZE[0] * height / width)
    show_image(ax, image, colours, scale, f"{label} ({unit(units, 'force per area')})")
    ax.set_title(f"{instant(history.times[row], units)}, displacements × {factor:g}", fontsize="small")
    return figure_of(ax)


def _direction(view: ArrayLike) -> Floats:
    wanted = "a vector of three finite components that is not along x_3"
    found = as_real_array(view, "deformed_body: view", wanted)
    if found.shape != (3,) or not np.isfinite(found).all() or not found[:2].any():
        raise HistoryError(f"deformed_body: found view = {brief(view)}; wanted {wanted}.")
    return found
