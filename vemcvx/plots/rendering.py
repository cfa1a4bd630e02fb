"""Surfaces in space as images: the one file of pictures that knows PyVista, which draws without a display."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Floats, Ints
from vemcvx.errors import VemcvxError

MISSING = "drawing bodies in space needs PyVista, which is not installed: pip install 'vemcvx[view]'"
UP = (0.0, 0.0, 1.0)
LARGEST, MARGIN = 1000, 1.03
LOOK = {"show_edges": True, "edge_color": "#505050", "line_width": 1.0, "lighting": False}


def has_pyvista() -> bool:
    """Whether there is something to draw with."""
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
