"""The virtual element space V^h, (3.11) of the paper named in :mod:`vemcvx`.

On a polygon, each component of a displacement in V^h is harmonic. On the boundary of the polygon, each component is
continuous, and linear on edges. Therefore, nodal values determine the displacement. For polyhedra see
:mod:`vemcvx.vem.projection`. Component a at node i is the unknown with the number dim * i + a.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Bools, Floats, Ints, read_only
from vemcvx.base.errors import SceneError
from vemcvx.meshes import Mesh, PolyhedralMesh, plane_mesh
from vemcvx.meshes.polygons import cell_of_corner, smallest_linked, spans
from vemcvx.vem.boundary import MirrorPlanes, Part, edge_part, face_part
from vemcvx.vem.projection import CellGroup, cell_groups
from vemcvx.vem.tensors import COMPONENTS


@dataclass(frozen=True, eq=False)
class Space:
    """The space V^h on a mesh.

    Attributes
    ----------
    mesh : Mesh
    mirrors : MirrorPlanes or None
        Planes of symmetry.
    axisymmetric : bool
        True for a body of revolution, where integrals have the weight 2 pi r.

    Examples
    --------
    >>> vx.vem.Space(vx.meshes.squares(2)).n_unknowns
    18
    """

    mesh: Mesh
    mirrors: MirrorPlanes | None = None
    axisymmetric: bool = False

    @property
    def dim(self) -> int:
        """The number of components of a displacement."""
        return int(self.mesh.points.shape[1])

    @property
    def n_unknowns(self) -> int:
        """The number n_u = dim * n_nodes of displacement components."""
        return self.mesh.points.size

    @property
    def in_plane(self) -> bool:
        """True for a plane mesh, also of a body of revolution."""
        return self.dim == 2

    @property
    def components(self) -> int:
        """The number of stress components, including the hoop stress."""
        return len(COMPONENTS[self.dim]) + self.axisymmetric

    @cached_property
    def groups(self) -> tuple[CellGroup, ...]:
        """The groups of cells by number of vertices, in ascending order."""
        return cell_groups(self.mesh, self.axisymmetric)

    @property
    def incidences(self) -> tuple[Ints, Ints]:
        """The cells and the nodes of all pairs (cell, node), ordered by cell."""
        offsets, nodes = self.mesh.cell_nodes
        return cell_of_corner(offsets), nodes

    @cached_property
    def pieces(self) -> tuple[Ints, Ints]:
        """The pieces and the nodes of all pairs (connected piece, node), ordered by piece."""
        mesh, (cell, node) = self.mesh, self.incidences
        label = np.unique(smallest_linked(mesh.neighbours, mesh.n_cells), return_inverse=True)[1]
        shape = (mesh.n_nodes, int(label.max()) + 1)
        meets = sp.csr_matrix((np.ones(len(node), dtype=np.int8), (node, label[cell])), shape=shape).tocsc()
        return np.repeat(np.arange(shape[1]), np.diff(meets.indptr)), meets.indices.astype(np.int64)

    def project_values(self, x: Floats, point: Ints, cell: Ints) -> sp.csr_matrix:
        """Return the matrix from nodal values v to the projection Pi v at x, where cell[k] contains x[point[k]]."""
        total = sp.csr_matrix((len(x), self.mesh.n_nodes))
        for group in self.groups:
            place = np.minimum(np.searchsorted(group.cells, cell), len(group.cells) - 1)
            mine = group.cells[place] == cell
            if not mine.any():
                continue
            some = group.part(place[mine])
            values = some.values_at((x[point[mine]] - self.mesh.points[some.nodes[:, 0]])[:, None])[:, 0]
            rows = np.repeat(point[mine], values.shape[1])
            total = total + sp.csr_matrix((values.ravel(), (rows, some.nodes.ravel())), shape=total.shape)
        return total

    def require_plane(self, subject: str, instead: str) -> None:
        """Raise SceneError in space, where `subject` is not available."""
        plane_mesh(self.mesh, subject, instead)

    def refuse_revolution(self, subject: str) -> None:
        """Raise SceneError for a body of revolution."""
        if self.axisymmetric:
            found = f'{subject}: found a body of revolution (plane="axisymmetric")'
            raise SceneError(f"{found}; available only for plane bodies and bodies in space.")

    def part(self, on: str | Sequence[str], subject: str, *, contact: bool = False) -> Part:
        """Return the part of the boundary with these names.

        Parameters
        ----------
        on : str or sequence of str
            Boundary names. A side in several boundaries counts once.
        subject : str
            The subject of error messages.
        contact : bool
            True if `on` may contain interfaces between bodies.

        Returns
        -------
        Part

        Raises
        ------
        SceneError
            `on` is empty, a boundary does not exist or has no sides, or an interface is not allowed.
        """
        mesh = self.mesh
        names = [on] if isinstance(on, str) else list(on) if isinstance(on, Sequence) else [on]
        known = ", ".join(repr(name) for name in mesh.boundaries)
        if not names:
            raise SceneError(f"{subject}: on= names no boundary; this mesh has {known}.")
        for name in names:
            if not isinstance(name, str) or name not in mesh.boundaries:
                bodies = set(name.split("|")) if isinstance(name, str) else set()
                called = [repr(one) for one, found in mesh.interfaces.items() if set(found.bodies) == bodies]
                apart = [repr(one) for one in mesh.boundaries if one.endswith(f".{name}")]
                what = f"this mesh has {known}; add one with mesh.with_boundary(name, predicate)"
                if apart:
                    gap = (
                        "if two bodies should touch there, their gap exceeds tolerance= of meshes.read or meshes.bodies"
                    )
                    what = f"outside interfaces it is named {' or '.join(apart)}; {gap}"
                what = f"this interface is named {' or '.join(called)}" if called else what
                raise SceneError(f"{subject}: there is no boundary named {name!r}; {what}.")
            if len(mesh.boundaries[name]) == 0:
                raise SceneError(f"{subject}: the boundary {name!r} has no {mesh.PARTS}; the mesh has {known}.")
        sides = np.unique(np.concatenate([mesh.boundaries[name] for name in names]), axis=0)
        across = self._across(sides) if mesh.interfaces else None
        if across is not None and not contact and (across >= 0).any():
            raise SceneError(
                f"{subject}: on={on!r} has {mesh.PARTS} of an interface ({', '.join(mesh.interfaces)}) between two "
                "bodies. Only contact, friction, Pressure and PrescribedSlip may act there; name outer boundaries."
            )
        return self._part(read_only(sides), across)

    def both_sides(self, on: str | Sequence[str], subject: str) -> list[Part]:
        """Return the named part, and the opposite part across interfaces."""
        part = self.part(on, subject, contact=True)
        beyond = self.mesh.beyond(part.sides) if self.mesh.interfaces else part.sides[:0]
        return [part, self._part(beyond, None)] if len(beyond) else [part]

    def _part(self, sides: Ints, across: Ints | None) -> Part:
        if isinstance(self.mesh, PolyhedralMesh):
            return face_part(sides, self.mesh, across, self.mirrors)
        inside = self._inside(sides, across)
        return edge_part(sides, self.mesh.points, across, self.mirrors, inside, axisymmetric=self.axisymmetric)

    def _inside(self, edges: Ints, across: Ints | None) -> Bools:
        """Return a mask (m, 2) of nodes in only one cell of the first body."""
        cells, nodes = self.incidences
        outline = edges
        if across is not None:
            first, beside = np.full(self.mesh.n_nodes, self.mesh.n_cells), across.reshape(edges.shape)
            np.minimum.at(first, nodes, cells)
            outline = np.where((beside >= 0) & (first[beside] < first[edges]), beside, edges)
        return np.bincount(nodes, minlength=self.mesh.n_nodes)[outline] == 1

    def _across(self, sides: Ints) -> Ints:
        """Return, for each vertex, the coinciding node of the second body, or -1."""
        mesh = self.mesh
        offsets, vertices = mesh._outlines
        counts, across = np.diff(offsets), np.full(len(vertices), -1)
        for name, joint in mesh.interfaces.items():
            own = mesh._places(mesh.boundaries[name])
            across[spans(offsets[own], counts[own])] = joint.partners[joint.partners >= 0]
        chosen = mesh._places(sides)
        return read_only(across[spans(offsets[chosen], counts[chosen])])
