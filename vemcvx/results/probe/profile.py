"""A field along a straight line of the body."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.arguments import is_whole
from vemcvx.arrays import Floats, as_real_array, brief
from vemcvx.errors import SceneError
from vemcvx.results.probe.places import places
from vemcvx.results.results import Results

MOST = 10**7
"""Points on a line beyond which it is a slip of the keyboard."""
ON_CELLS = ("stress", "out_of_plane_stress", "von_mises", "principal_stresses")


class Profile(NamedTuple):
    """A field along a line.

    Attributes
    ----------
    arc : (count,) array
        Distance from the start, length.
    values : (S, count, ...) array
        One row a stored step.
    """

    arc: Floats
    values: Floats


def profile(history: Results, start: ArrayLike, end: ArrayLike, count: int, field: str) -> Profile:
    """A field of a history along the line from `start` to `end`: see :meth:`vemcvx.History.along`."""
    if not isinstance(field, str) or field not in ("displacement", *ON_CELLS):
        raise SceneError(
            f"along: there is no field {field!r}; there are 'displacement', {', '.join(map(repr, ON_CELLS))}."
        )
    if not is_whole(count) or not 2 <= count <= MOST:
        raise SceneError(f"along: found count = {brief(count)}; wanted the number of points, 2 or more.")
    dim = history.mesh.points.shape[1]
    first, last = (_end(point, dim, name) for point, name in ((start, "start"), (end, "end")))
    length = float(np.linalg.norm(last - first))
    if length == 0.0:
        raise SceneError(f"along: the line begins and ends at {first}; use probe for a single point.")
    at = places(history.mesh, np.linspace(first, last, count), "along")
    if field == "displacement":
        values = at.at_nodes(history.displacement)
    else:
        values = np.stack([at.at_cells(getattr(history, field)(int(step))) for step in history.stored])
    return Profile(np.linspace(0.0, length, count), values)


def _end(point: ArrayLike, dim: int, name: str) -> Floats:
    wanted = f"a point of {dim} coordinates"
    x = as_real_array(point, f"along: {name}", wanted)
    if x.shape != (dim,) or not np.isfinite(x).all():
        raise SceneError(f"along: found {name} = {brief(point)}; wanted {wanted}, finite.")
    return x
