"""Sides of a body in the plane with the conditions and data on them, by which corners are judged."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np
import scipy.sparse as sp

from vemcvx.arrays import Bools, Floats, Ints
from vemcvx.effects import PrescribedDisplacement, data
from vemcvx.effects.effect import Load
from vemcvx.meshes import PolygonMesh
from vemcvx.outline import ArrayRecord
from vemcvx.scene.contact_table import ContactRows, pair_numbers
from vemcvx.scene.pose import PosedScene
from vemcvx.scene.supports import free_directions


@dataclass(frozen=True, kw_only=True, repr=False)
class Sides(ArrayRecord):
    """The conditions on the edges of the boundary, of which bodies in space have none, and point loads.

    Attributes
    ----------
    edges : (b, 2) int
        Each with the body on its left.
    free : (b, 4)
        Projectors (2, 2) on the directions that supports leave free, row by row.
    contact : (b,) bool
        True where the edge touches, or may touch, something rigid, or is the first body's at an interface.
    pressed : (b,) bool
        True where friction follows pressure.
    loaded : (q,) int or None
        The nodes on which forces act as on points.
    traction : (S, b, 4) or None
        The tractions given at the beginning of each edge, and at its end; None if there are none.
    moved : (S, b, 4) or None
        The displacements given there, 0 where there are none.
    """

    edges: Annotated[Ints, "sides 2", ""]
    free: Annotated[Floats, "sides 4", ""]
    contact: Annotated[Bools, "sides", ""]
    pressed: Annotated[Bools, "sides", ""]
    loaded: Annotated[Ints | None, "loaded", ""] = None
    traction: Annotated[Floats | None, "S sides 4", "force/length"] = None
    moved: Annotated[Floats | None, "S sides 4", "length"] = None

    @cached_property
    def leaving(self) -> dict[int, int]:
        """The edge that begins at a node; -1 where there are several."""
        return _once(self.edges[:, 0])

    @cached_property
    def arriving(self) -> dict[int, int]:
        """The edge that ends at a node, likewise."""
        return _once(self.edges[:, 1])


def _once(nodes: Ints) -> dict[int, int]:
    found: dict[int, int] = {}
    for k, node in enumerate(nodes.tolist()):
        found[node] = -1 if node in found else k
    return found


def sides_of(posed: PosedScene, times: Sequence[float]) -> Sides:
    """The sides of a posed scene, with tractions at these instants."""
    mesh = posed.space.mesh
    loads = [load for load in posed.loads if isinstance(load, Load) and load.cells is None and load.edges is None]
    rows = np.concatenate([np.zeros(0, np.int64), *(load.matrix.tocoo().row for load in loads)])
    loaded = np.unique(rows // mesh.points.shape[1])
    if not isinstance(mesh, PolygonMesh):
        none = np.zeros(0, dtype=bool)
        return Sides(
            edges=np.zeros((0, 2), dtype=np.int64), free=np.zeros((0, 4)), contact=none, pressed=none, loaded=loaded
        )
    edges, terms = mesh.boundaries["boundary"], posed.terms
    laws = [friction.law is not None and friction.law.pressed for friction in terms.frictions]
    follows = np.repeat(np.array(laws, dtype=float), [len(friction.nodes) for friction in terms.frictions])
    pressed, soft = np.flatnonzero(terms.gather @ follows > 0), posed.obstacles.compliance > 0
    return Sides(
        edges=edges,
        free=free_directions(posed.supports.P, edges.ravel(), np.repeat(np.arange(len(edges)), 2), 2).reshape(-1, 4),
        # What gives way presses with a force that has a limit, as a load.
        contact=_owned(posed.surface, edges) & ~_owned(posed.obstacles[np.flatnonzero(soft)], edges),
        pressed=_owned(terms[pressed], edges),
        loaded=loaded,
        traction=_tractions(posed, edges, times),
        moved=_displacements(posed, edges, times),
    )


def _ends(posed: PosedScene, edges: Ints, of: Ints) -> tuple[Ints, Floats]:
    """The numbers of edges `of` some datum among those of the boundary, and the points (2 q, 2) at their ends."""
    place = {(a, b): k for k, (a, b) in enumerate(edges.tolist())}
    at = np.array([place[a, b] for a, b in np.unique(of, axis=0).tolist()], dtype=np.int64)
    ends = posed.space.mesh.points[edges[at]]
    inside = 1e-4 * (ends[:, 1] - ends[:, 0])  # Data may jump at nodes, or beside them.
    return at, np.stack([ends[:, 0] + inside, ends[:, 1] - inside], axis=1).reshape(-1, 2)


def _tractions(posed: PosedScene, edges: Ints, times: Sequence[float]) -> Floats | None:
    """The tractions (S, b, 4) at the ends of edges; None if there are none."""
    loads = [load for load in posed.loads if isinstance(load, Load) and load.edges is not None]
    total = np.zeros((len(times), len(edges), 4))
    for load in loads:
        assert load.edges is not None
        at, x = _ends(posed, edges, load.edges)
        along = x[1::2] - x[::2]
        inward = np.repeat(np.column_stack([-along[:, 1], along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None], 2, 0)
        # Data that cannot be read there, beside the points of quadrature, leave the corner unknown, and the run whole.
        with suppress(Exception):
            for row, t in enumerate(times):
                values = load.at(x, t)
                # A scalar is a pressure.
                total[row, at] += (values[:, None] * inward if values.ndim == 1 else values).reshape(-1, 4)
    return total if loads else None


def _displacements(posed: PosedScene, edges: Ints, times: Sequence[float]) -> Floats | None:
    """The whole displacements (S, b, 4) given at the ends of edges; None if there are none, or constants alone."""
    effects = [one for one in posed.scene.canonical if isinstance(one, PrescribedDisplacement)]
    effects = [one for one in effects if one.direction is None and callable(one.value)]
    total = np.zeros((len(times), len(edges), 4))
    for effect in effects:
        at, x = _ends(posed, edges, posed.space.part(effect.on, "PrescribedDisplacement").sides)
        with suppress(Exception):
            for row, t in enumerate(times):
                total[row, at] = data.vector(effect.value, x, t, "PrescribedDisplacement").reshape(-1, 4)
    return total if effects else None


def _owned(rows: ContactRows, edges: Ints) -> Bools:
    """Whether some row owns an end of each edge."""
    names, most = rows.names[np.unique(sp.csr_matrix(rows.ends).indices)], int(edges.max())
    known, one, other = (pair_numbers(pairs[:, 0], pairs[:, 1], most) for pairs in (names, edges, edges[:, ::-1]))
    return np.isin(one, known) | np.isin(other, known)
