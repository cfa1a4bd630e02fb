"""Drawing with matplotlib, without pyplot: figures need no window and no display."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from io import BytesIO
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from vemcvx.base.arrays import Floats, Ints
from vemcvx.base.errors import VemcvxError

if TYPE_CHECKING:
    from matplotlib.animation import AbstractMovieWriter
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import Collection, PolyCollection
    from matplotlib.colorbar import Colorbar
    from matplotlib.colors import Colormap, LinearSegmentedColormap, ListedColormap
    from matplotlib.figure import Figure
    from matplotlib.quiver import Quiver

CELL_STYLE = {"edgecolor": "0.25", "facecolor": "0.93", "linewidth": 0.5}


def new_figure(width: float | None = None, height: float | None = None) -> Figure:
    """Return an empty figure; width and height are in inches."""
    wide, high = usual_page()
    return _figure_class()(figsize=(width or wide, height or high), layout="constrained")


def usual_page() -> tuple[float, float]:
    """Return matplotlib's default width and height of figures, in inches."""
    try:
        import matplotlib.figure
    except ImportError:
        raise VemcvxError("drawing needs matplotlib, which is not installed: pip install 'vemcvx[plot]'") from None
    width, height = matplotlib.rcParams["figure.figsize"]
    return width, height


@cache
def _figure_class() -> type[Figure]:
    """Return a class of figures that Jupyter shows without pyplot."""
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        def draw(self, renderer: Any) -> None:
            # After a single pass of the layout, labels may be cut off.
            for layout in filter(None, 2 * [self.get_layout_engine()]):
                layout.execute(self)
            super().draw(renderer)

        def _repr_png_(self) -> bytes:
            return as_png(self)

        def __repr__(self) -> str:
            return in_words(self)

    return NotebookFigure


def in_words(figure: Figure) -> str:
    """Return the titles and axis labels of a figure, as alternative text."""
    titles = [figure.get_suptitle()]
    for ax in figure.axes:
        graph = " over ".join(filter(None, (ax.get_ylabel(), ax.get_xlabel())))
        titles.append(": ".join(filter(None, (ax.get_title() or ax.get_title(loc="left"), graph))))
    words = "; ".join(dict.fromkeys(filter(None, titles))) or f"{len(figure.axes)} axes without titles"
    return f"Picture: {' '.join(words.replace('$', '').split())}"


def as_png(figure: Figure, dpi: float | None = None) -> bytes:
    """Return the contents of a PNG file of a figure."""
    picture = BytesIO()
    figure.savefig(picture, format="png", dpi="figure" if dpi is None else dpi)
    return picture.getvalue()


def axes_or_new(ax: Axes | None, width: float, height: float) -> Axes:
    """Return `ax`, or the axes of a new figure."""
    return new_figure(width, height).add_subplot() if ax is None else ax


def row_of_axes(count: int, width: float, height: float) -> list[Axes]:
    """Return `count` axes side by side in a new figure."""
    return list(new_figure(count * width, height).subplots(1, count, squeeze=False)[0])


def figure_of(ax: Axes) -> Figure:
    """Return the figure of the axes."""
    return ax.figure.figure


def legend_below(ax: Axes) -> None:
    """Draw the legend, if possible below the axes."""
    figure, count = figure_of(ax), len(ax.get_legend_handles_labels()[0])
    if count and len(figure.axes) == 1 and figure.get_layout_engine() is not None:
        figure.legend(loc="outside lower center", ncols=4 if count == 4 else 3, frameon=False)
    elif count and any(drawn.get_array() is not None for drawn in ax.collections):
        legend_under(ax)
    elif count:
        ax.legend(frameon=False, fontsize="small")


def legend_under(ax: Axes, columns: int = 3) -> None:
    """Draw the legend below the axes."""
    # Tick labels and axis labels need a distance of 4.5 font sizes.
    drawn = ax.legend(frameon=False, fontsize="small", ncols=columns, loc="upper center", borderaxespad=4.5)
    drawn.set_bbox_to_anchor((0.5, 0.0), ax.transAxes)


def film_writer(kind: str, rate: int) -> AbstractMovieWriter:
    """Return matplotlib's film writer "pillow" or "ffmpeg"; `rate` is in frames per second."""
    from matplotlib.animation import writers

    if not writers.is_available(kind):
        other = "write a .gif, or install ffmpeg" if kind == "ffmpeg" else "pip install pillow"
        raise VemcvxError(f"a film of this kind needs {kind}, which is not installed: {other}")
    return writers[kind](fps=rate)


def distinct(colours: Sequence[str]) -> ListedColormap:
    """Return a colour map of distinct colours."""
    from matplotlib.colors import ListedColormap

    return ListedColormap(list(colours))


def blend_colours(colours: Sequence[str]) -> LinearSegmentedColormap:
    """Return a colour map that interpolates between colours."""
    from matplotlib.colors import LinearSegmentedColormap

    return LinearSegmentedColormap.from_list("blended", list(colours))


def light_grid(ax: Axes, *, axis: Literal["x", "y", "both"] = "both") -> None:
    """Draw grid lines behind the data."""
    ax.grid(axis=axis, color="0.9", linewidth=0.6)
    ax.set_axisbelow(True)


def plain_logarithms(axis: Axis, digits: Sequence[float] = (1.0, 2.0, 5.0)) -> None:
    """Label a logarithmic axis by plain numbers, such as 5 instead of 5 x 10^0."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=digits))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def draw_arrows(
    ax: Axes, places: Floats, vectors: Floats, *, colour: object, pivot: Literal["tip", "mid"], width: float
) -> Quiver:
    """Draw vectors as arrows, in units of the axes."""
    from matplotlib.patheffects import withStroke

    # With minlength 0, short arrows are not drawn as dots.
    look: dict[str, Any] = {"color": colour, "path_effects": [withStroke(linewidth=1.0, foreground="white")]}
    look |= {"pivot": pivot, "width": width, "minlength": 0.0, "zorder": 3}
    return ax.quiver(*places.T, *vectors.T, angles="xy", scale_units="xy", scale=1.0, **look)


def draw_polygons(ax: Axes, corners: Floats, colours: Sequence[str] | None) -> PolyCollection:
    """Fill polygons (k, n, 2) without outlines."""
    from matplotlib.collections import PolyCollection

    # Thin lines close the seams between neighbouring polygons.
    drawn = PolyCollection(list(corners), facecolors=colours, edgecolors="face", linewidths=0.3, zorder=1)
    ax.add_collection(drawn)
    return drawn


PointedEnds = Literal["neither", "both", "min", "max"]
"""The ends of a colour bar beyond which some values lie."""


def find_pointed_ends(values: Floats, ends: tuple[float, float]) -> PointedEnds:
    """Return the ends of a colour scale beyond which some values lie."""
    slack = 1e-6 * (ends[1] - ends[0])
    below, above = (bool((sign * (values - end) > slack).any()) for sign, end in zip((-1, 1), ends, strict=True))
    return "both" if below and above else "min" if below else "max" if above else "neither"


def colour_bar(ax: Axes, mapped: ScalarMappable, label: str, extend: PointedEnds = "neither") -> None:
    """Draw a labelled colour bar beside the axes."""
    ax.figure.colorbar(mapped, ax=ax, shrink=0.75, extend=extend).set_label(label, fontsize="small")


def scale_of(colours: str | Colormap, limits: tuple[float, float]) -> ScalarMappable:
    """Return a map from the numbers between `limits` to colours."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(*limits), colours)


def draw_cells(
    points: Floats, offsets: Ints, vertices: Ints, values: Floats | None, ax: Axes | None, style: Mapping[str, object]
) -> Axes:
    """Draw the cells of a mesh, with a colour bar if there are values."""
    width, height = np.ptp(points, axis=0)
    if ax is None:
        wide = usual_page()[0]
        ax = new_figure(wide, float(np.clip(wide * height / width, 1.6, 9.0))).add_subplot()
    from matplotlib.cbook import normalize_kwargs
    from matplotlib.collections import PolyCollection

    polygons = np.split(points[vertices], offsets[1:-1])
    cells = PolyCollection(polygons, **{**CELL_STYLE, **normalize_kwargs(dict(style), PolyCollection)})
    ax.add_collection(cells)
    ax.set_aspect("equal")
    ax.autoscale_view()
    if values is not None:
        cells.set_array(values)
        bar_beside(ax, cells)
    return ax


def bar_beside(ax: Axes, cells: Collection, extend: PointedEnds = "neither") -> Colorbar:
    """Draw and return a colour bar as high as the axes."""
    from matplotlib.ticker import MaxNLocator

    # Beside flat bodies, five tick labels would overlap.
    ticks = MaxNLocator(2 if 3 * np.ptp(ax.get_ylim()) <= np.ptp(ax.get_xlim()) else 5)
    return figure_of(ax).colorbar(cells, cax=ax.inset_axes((1.03, 0.0, 0.04, 1.0)), ticks=ticks, extend=extend)
