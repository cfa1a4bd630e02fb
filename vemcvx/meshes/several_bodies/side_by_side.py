"""The meshes of several bodies side by side in one list of nodes and cells; hanging vertices put into them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from vemcvx.arrays import Floats, Ints
from vemcvx.meshes.polygons.topology import cell_of_corner, directed_edges, offsets_of, shared_edges
from vemcvx.meshes.tessellation import Tessellation


@dataclass(frozen=True, eq=False)
class SideBySide:
    """Several bodies, which share no node.

    Attributes
    ----------
    names : tuple of str
        Names of the bodies.
    points : (n, 2) float
    offsets, vertices : (n_cells + 1,) int, (n_corners,) int
        As of a `PolygonMesh`, cells of the bodies one after the other.
    body : (n,) int
        The body of each node.
    """

    names: tuple[str, ...]
    points: Floats
    offsets: Ints
    vertices: Ints
    body: Ints

    @classmethod
    def of(cls, meshes: Mapping[str, Tessellation]) -> SideBySide:
        """Lay meshes side by side: nodes and cells in their order."""
        each = list(meshes.values())
        nodes = np.array([mesh.n_nodes for mesh in each])
        return cls(
            names=tuple(meshes),
            points=np.concatenate([mesh.points for mesh in each]),
            offsets=offsets_of(np.concatenate([np.diff(mesh.offsets) for mesh in each])),
            vertices=np.concatenate([m.vertices + s for m, s in zip(each, offsets_of(nodes), strict=False)]),
            body=np.repeat(np.arange(len(each)), nodes),
        )

    @cached_property
    def corners(self) -> Ints:
        """Corners at which the edges of the boundary start."""
        return shared_edges(self.offsets, self.vertices, len(self.points)).alone

    @cached_property
    def ends(self) -> Ints:
        """The edges of the boundary, as they run in their cells, in the order of these."""
        return directed_edges(self.offsets, self.vertices)[self.corners]

    @property
    def body_of_edge(self) -> Ints:
        """The body of each edge of the boundary."""
        return self.body[self.ends[:, 0]]

    @property
    def body_of_cell(self) -> Ints:
        """The body of each cell."""
        return self.body[self.vertices[self.offsets[:-1]]]

    def with_hanging(self, points: Floats, edge: Ints) -> SideBySide:
        """The bodies with one more node at each of the points: hanging vertices on edges of the boundary, in order."""
        corner = self.corners[edge]
        counts = np.diff(self.offsets) + np.bincount(
            cell_of_corner(self.offsets)[corner], minlength=len(self.offsets) - 1
        )
        return replace(
            self,
            points=np.concatenate([self.points, points]),
            offsets=offsets_of(counts),
            vertices=np.insert(self.vertices, corner + 1, len(self.points) + np.arange(len(points))),
            body=np.concatenate([self.body, self.body_of_edge[edge]]),
        )
