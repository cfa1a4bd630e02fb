"""The virtual element space V^h of (3.11): two displacement components at every node of a polygonal mesh.

On each cell a component is harmonic with continuous, edgewise linear boundary values, so the vertex values
determine it and traces on edges are linear. Component a of node i is the unknown 2 i + a.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from vemcvx.arrays import Floats, Ints, read_only
from vemcvx.errors import SceneError
from vemcvx.meshes import PolygonMesh
from vemcvx.vem.boundary import BoundaryPart


@dataclass(frozen=True, eq=False)
class CellGroup:
    """Cells with equally many vertices, so that one array operation serves them all."""

    cells: Ints
    """(c,) cell numbers"""
    nodes: Ints
    """(c, n) their vertices, counter-clockwise"""
    points: Floats
    """(n_nodes, 2) the points of the whole mesh"""

    @property
    def corners(self) -> Floats:
        """Vertex coordinates (c, n, 2) relative to the first vertex of each cell.

        Differences of neighbouring coordinates are exact, products of coordinates near 1e6 are not: with
        this origin a body far away from (0, 0) loses nothing more than its points were rounded by.
        """
        corners = self.points[self.nodes]
        return corners - corners[:, :1]

    def chunks(self, entries: int) -> Iterator[CellGroup]:
        """The group in pieces whose local n x n matrices hold about `entries` numbers together."""
        size = max(1, entries // self.nodes.shape[1] ** 2)
        for start in range(0, len(self.cells), size):
            piece = slice(start, start + size)
            yield CellGroup(self.cells[piece], self.nodes[piece], self.points)


@dataclass(frozen=True, eq=False)
class Space:
    """V^h on a mesh."""

    mesh: PolygonMesh

    @property
    def n_unknowns(self) -> int:
        """Nodal values before any support: 2 n_nodes."""
        return 2 * self.mesh.n_nodes

    @cached_property
    def groups(self) -> tuple[CellGroup, ...]:
        """The cells by number of vertices, ascending; cell numbers ascend within a group."""
        mesh = self.mesh
        counts = np.diff(mesh.offsets)
        groups = []
        for n in np.unique(counts):
            cells = np.flatnonzero(counts == n)
            nodes = mesh.vertices[mesh.offsets[cells][:, None] + np.arange(n)]
            groups.append(CellGroup(read_only(cells), read_only(nodes), mesh.points))
        return tuple(groups)

    def part(self, on: str | Sequence[str], subject: str, *, contact: bool = False) -> BoundaryPart:
        """The closed set of the boundary edges named by `on`.

        Parameters
        ----------
        on : str or sequence of str
            Boundary names; an edge that several of them contain counts once.
        subject : str
            Who asks, for the error message.
        contact : bool
            Whether interfaces between bodies may be among them.

        Raises
        ------
        SceneError
            `on` names no boundary, one that the mesh does not have or that has no edges, or an interface, for what is
            no contact.
        """
        mesh = self.mesh
        names = [on] if isinstance(on, str) else list(on) if isinstance(on, Sequence) else [on]
        known = ", ".join(repr(name) for name in mesh.boundaries)
        if not names:
            raise SceneError(f"{subject}: on= names no boundary; this mesh has {known}.")
        for name in names:
            if not isinstance(name, str) or name not in mesh.boundaries:
                turned = "|".join(reversed(name.split("|"))) if isinstance(name, str) else ""
                what = (
                    f"this interface is named {turned!r}"
                    if turned in mesh.interfaces
                    else (f"this mesh has {known}; add one with mesh.with_boundary(name, predicate)")
                )
                raise SceneError(f"{subject}: there is no boundary named {name!r}; {what}.")
            if len(mesh.boundaries[name]) == 0:
                raise SceneError(f"{subject}: the boundary {name!r} of this mesh has no edges; it has {known}.")
        edges = np.unique(np.concatenate([mesh.boundaries[name] for name in names]), axis=0)
        across = self._across(edges)
        if across is not None and not contact and (across >= 0).any():
            raise SceneError(
                f"{subject}: on={on!r} has edges of an interface ({', '.join(mesh.interfaces)}) between two bodies, "
                "where contact and friction act and nothing else; name boundaries that are on the outside."
            )
        return BoundaryPart(read_only(edges), mesh.points, across)

    def _across(self, edges: Ints) -> Ints | None:
        """Of each edge (m, 2), as its first body runs along it, the nodes of the other body; -1 where it is alone."""
        joints = self.mesh.interfaces.values()
        if not joints:
            return None
        across = np.full(edges.shape, -1)
        n = self.mesh.n_nodes
        key = edges[:, 0] * n + edges[:, 1]
        for joint in joints:
            mine = joint.edges[:, 0] * n + joint.edges[:, 1]
            order = np.argsort(mine)
            place = np.minimum(np.searchsorted(mine[order], key), len(mine) - 1)
            found = mine[order][place] == key
            across[found] = joint.partners[order][place[found]]
        return read_only(across)
