"""A film of a history: one picture after another, all of one scale."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from vemcvx.arrays import brief, number
from vemcvx.canvas import film_writer, new_figure
from vemcvx.errors import HistoryError
from vemcvx.meshes import PolyhedralMesh
from vemcvx.owned_files import path_of
from vemcvx.plots.body_in_plane import deformed_mesh, size_of_page
from vemcvx.plots.body_in_space import SIZE, deformed_body
from vemcvx.plots.style import Units
from vemcvx.results.results import Results

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KINDS = {".gif": "pillow", ".mp4": "ffmpeg"}
DPI = 110


def animate(
    history: Results,
    path: str | Path,
    *,
    seconds: float = 5.0,
    magnify: float | None = None,
    limits: ArrayLike | None = None,
    units: Units | None = None,
) -> Path:
    """Write a film of the deformed mesh through all stored steps.

    Magnification, colours, arrows and view are those of `deformed_mesh`, in space of `deformed_body`, the same in all
    frames.

    Parameters
    ----------
    history : History
    path : str or Path
        ``.gif`` (written by pillow, which comes with matplotlib) or ``.mp4`` (where ffmpeg is installed). A file of
        that name is replaced.
    seconds : float
        How long the film takes, with 1 to 50 frames a second, a whole number of them.
    magnify, limits, units
        See :func:`vemcvx.plots.body_in_plane`, or `deformed_body`.

    Returns
    -------
    Path
        The file.

    Raises
    ------
    HistoryError
        The suffix is another, or the file cannot be written.
    VemcvxError
        matplotlib, or what writes such a film, is not installed.
    """
    path = path_of(path, "animate")
    if path.suffix not in KINDS:
        raise HistoryError(f"animate: found {brief(str(path))}; films end in .gif or .mp4.")
    rate = _rate(seconds, len(history.stored))
    figure = new_figure(*(SIZE if isinstance(history.mesh, PolyhedralMesh) else size_of_page(history)))
    writer = film_writer(KINDS[path.suffix], rate)
    frames = _frames(history, figure, (magnify, limits, units))
    # The first frame tells whether all is as it should be before a file of that name is replaced.
    next(frames)
    try:
        with writer.saving(figure, path, DPI):
            writer.grab_frame()
            for _ in frames:
                writer.grab_frame()
    except OSError as error:
        raise HistoryError(f"{path}: cannot write a film there: {error}.") from error
    return path


def _rate(seconds: float, frames: int) -> int:
    """Frames a second."""
    length = number(seconds, "animate: found seconds", "a positive number")
    if length <= 0:
        raise HistoryError(f"animate: found seconds = {brief(seconds)}; wanted a positive number.")
    return round(min(max(frames / length, 1.0), 50.0))


def _frames(
    history: Results, figure: Figure, how: tuple[float | None, ArrayLike | None, Units | None]
) -> Iterator[None]:
    """Draw one stored step after another on the figure."""
    magnify, limits, units = how
    draw = deformed_body if isinstance(history.mesh, PolyhedralMesh) else deformed_mesh
    for step in history.stored:
        figure.clear()
        ax = figure.add_subplot()
        draw(history, int(step), ax=ax, magnify=magnify, limits=limits, units=units)
        yield
