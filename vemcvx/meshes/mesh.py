"""A mesh: points, cells, named parts of the boundary, data on cells; immutable.

A mesh is a cell complex: cells have sides (edges in the plane, faces in space), sides have vertices, and a side belongs
to one cell, on the boundary, or to two. In the plane cells are simple polygons listed counter-clockwise, in space
polyhedra with plane faces; two cells meet in whole sides of both. A vertex may lie on a straight line between its
neighbours (a hanging node of the cell next door), a cell may have several coplanar faces, and need not be convex.

Modules that refine, cut, judge and write meshes know this one. The methods of a mesh that lead there import them when
they are called.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.base.arrays import SAME, Bools, Floats, Ints, brief, read_only
from vemcvx.base.errors import MeshError, MeshWarning
from vemcvx.base.outline import Outline, in_a_line
from vemcvx.meshes import polygons
from vemcvx.meshes.box import (
    SIDES,
    WHOLE,
    Box,
    check_cell_data,
    check_mapping,
    check_name,
    chosen_parts,
)
from vemcvx.meshes.checks.plane import Checked, lay_flat, list_of
from vemcvx.meshes.interfaces import Interface, faces_of, on_boundary

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from vemcvx.meshes.quality import Quality


class Sides(NamedTuple):
    """Edges of the cells of a mesh, in space faces."""

    offsets: Ints
    vertices: Ints  # in the order that they have in the first cell of a side
    cells: Ints  # (n_sides, 2) first and second cell; the second is -1 on the boundary


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Mesh(ABC):
    """Points, and cells that kinds of meshes describe by further arrays; immutable."""

    points: Floats
    cell_data: Mapping[str, NDArray[Any]]
    interfaces: Mapping[str, Interface]
    node_map: Ints | None
    _named: Mapping[str, Ints]

    ARRAYS: ClassVar[tuple[str, ...]]  # Names of the arrays that make it.
    NUMBERED: ClassVar[Mapping[str, str]]  # Names of arrays of numbers, and of how many there are of what they number.
    PARTS: ClassVar[str]  # Name of the parts that make its boundary, and of one of them.
    A_PART: ClassVar[str]

    @classmethod
    def unchecked(cls, *arrays: Floats | Ints, box: Box | None = None) -> Self:
        """Return a mesh of arrays known to be valid, without copy or check; its sides are named if ``box`` is given."""
        mesh = object.__new__(cls)
        mesh._fill(*arrays)
        return mesh if box is None else mesh._replace(_named=mesh._in_planes(box))

    def _fill(self, *arrays: Floats | Ints, **others: object) -> None:
        nothing: Mapping[str, Any] = MappingProxyType({})
        own = {name: read_only(array) for name, array in zip(self.ARRAYS, arrays, strict=True)}
        known = {"cell_data": nothing, "interfaces": nothing, "node_map": None, "_named": {}}
        self.__dict__.update(own, **(known | others))

    def _take(
        self, found: Checked, boundaries: Mapping[str, Any] | None, cell_data: Mapping[str, ArrayLike] | None
    ) -> None:
        """Take what was checked; sides of a box get names if the user names nothing: not even by an empty mapping."""
        self._fill(*found.arrays, node_map=found.node_map)
        for note in found.notes:
            warnings.warn(note, MeshWarning, stacklevel=3)
        named = self._checked_parts(boundaries, found.node_map)
        data = check_cell_data(cell_data, self.n_cells)
        interfaces = on_boundary(found.interfaces, self._outlines, found.node_map)
        if boundaries is None and not interfaces:
            named = straight_sides(self)
        fields = {"_named": named, "cell_data": MappingProxyType(data), "interfaces": MappingProxyType(interfaces)}
        self.__dict__.update(fields)

    @property
    @abstractmethod
    def n_cells(self) -> int:
        """Number of cells."""

    @property
    @abstractmethod
    def cell_nodes(self) -> tuple[Ints, Ints]:
        """Offsets (n_cells + 1,), and the nodes of each cell between them, once each."""

    @property
    @abstractmethod
    def _sides(self) -> Sides:
        """The edges, in space faces, of all cells."""

    @property
    @abstractmethod
    def _boundary(self) -> Ints:
        """The parts of the boundary: edges (m, 2), or numbers of faces (m,)."""

    @property
    @abstractmethod
    def _middles(self) -> Floats:
        """The middles (m, dim) of the parts of the boundary."""

    @abstractmethod
    def _places(self, parts: Ints) -> Ints:
        """Return the places of parts in the boundary; all must be there."""

    @abstractmethod
    def _measured(self) -> tuple[Floats, Floats]:
        """Return areas or volumes, and centroids."""

    @abstractmethod
    def plot(
        self,
        values: str | ArrayLike | None = None,
        ax: Axes | None = None,
        *,
        displacement: ArrayLike | None = None,
        **style: Any,
    ) -> Axes:
        """Draw the mesh."""

    @cached_property
    def _outer_sides(self) -> Ints:
        """The numbers of the sides on the boundary, in the order of their cells."""
        return np.flatnonzero(self._sides.cells[:, 1] < 0)

    @property
    def _outlines(self) -> tuple[Ints, Ints]:
        """Offsets and vertices of the parts of the boundary."""
        offsets, vertices, _ = self._sides
        return polygons.rows_in_order(offsets, vertices, self._outer_sides)

    @property
    def _owners(self) -> Ints:
        """The cell of each part of the boundary."""
        return self._sides.cells[self._outer_sides, 0]

    @cached_property
    def neighbours(self) -> Ints:
        """Pairs of cells that share an edge, in space a face, (m, 2), the smaller number first; once a side."""
        cells = self._sides.cells
        return read_only(cells[cells[:, 1] >= 0])

    @property
    def _inner_outlines(self) -> tuple[Ints, Ints]:
        """Offsets and vertices of the sides between `neighbours`, as they run in the first of these."""
        offsets, vertices, cells = self._sides
        return polygons.rows_in_order(offsets, vertices, np.flatnonzero(cells[:, 1] >= 0))

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @cached_property
    def _measures_and_centroids(self) -> tuple[Floats, Floats]:
        measures, centroids = self._measured()
        return read_only(measures), read_only(centroids)

    @property
    def measures(self) -> Floats:
        """Area of each cell, in space its volume, (n_cells,)."""
        return self._measures_and_centroids[0]

    @property
    def centroids(self) -> Floats:
        """Centroid of each cell, (n_cells, 2), in space (n_cells, 3)."""
        return self._measures_and_centroids[1]

    @cached_property
    def diameters(self) -> Floats:
        """Largest distance of two vertices of each cell, (n_cells,)."""
        return read_only(polygons.diameters(self.points, *self.cell_nodes))

    @cached_property
    def h(self) -> float:
        """Mesh size: the largest cell diameter."""
        return float(self.diameters.max())

    @cached_property
    def boundaries(self) -> Mapping[str, Ints]:
        """Named parts of the boundary: name -> edges (m, 2), in space face numbers (m,); "boundary" is all of it.

        An edge (a, b) runs as in its counter-clockwise cell: the outward normal is (y_b - y_a, x_a - x_b) / length.
        The name of an interface means its edges of the first body; "boundary" has those of both.
        """
        own = {name: faces_of(interface.edges, self._outlines) for name, interface in self.interfaces.items()}
        joints = {name: read_only(self._boundary[parts]) for name, parts in own.items()}
        return MappingProxyType({**self._named, **joints, "boundary": self._boundary})

    def beyond(self, parts: Ints) -> Ints:
        """Return the edges or faces of second bodies at interfaces, across from those of first ones among `parts`."""
        places, found = self._places(parts), [np.zeros(0, dtype=np.int64)]
        for interface in self.interfaces.values():
            first, second = (faces_of(side, self._outlines) for side in (interface.edges, interface.partners))
            found.append(second[np.isin(first, places)])
        return self._boundary[np.unique(np.concatenate(found))]

    @cached_property
    def _outer(self) -> Bools:
        """A mask of the parts of the boundary that no interface has on either side."""
        free = np.ones(len(self._boundary), dtype=bool)
        for interface in self.interfaces.values():
            for side in (interface.edges, interface.partners):
                free[faces_of(side, self._outlines)] = False
        return free

    def _in_planes(self, box: Box, tolerance: float = 0.0) -> dict[str, Ints]:
        """Return the parts of the boundary on each side of a box; families put points on its sides to the bit."""
        offsets, vertices = self._outlines
        low, high = (f.reduceat(self.points[vertices], offsets[:-1]) for f in (np.minimum, np.maximum))
        longest = np.argmax(high - low, axis=1)  # shorter than the tolerance, parts are on sides that they run along
        named = {}
        for axis, names in enumerate(SIDES[len(box.low)]):
            for name, place in zip(names, (box.low[axis], box.high[axis]), strict=True):
                off = np.maximum(np.abs(low[:, axis] - place), np.abs(high[:, axis] - place))
                named[name] = read_only(self._boundary[(off <= tolerance) & (longest != axis)])
        return named

    def _checked_parts(self, boundaries: Mapping[str, Any] | None, node_map: Ints | None = None) -> dict[str, Ints]:
        """Named parts in the order of the boundary, or MeshError; `node_map` if nodes have been numbered anew since."""
        number = np.arange(self.n_nodes) if node_map is None else node_map
        named = {}
        for name, given in check_mapping(boundaries, "boundaries", self.PARTS).items():
            name = name if name == WHOLE else check_name(name)
            parts, called = self._parts(name, given, number)
            strange = np.flatnonzero(parts < 0)
            if len(strange):
                raise MeshError(
                    f"boundary {name!r}: {called[strange[0]]} is not {self.A_PART} of the boundary "
                    f"({len(strange)} of {len(parts)} are not). Name only {self.PARTS} that belong to "
                    "exactly one cell."
                )
            chosen = np.unique(parts)
            if name != WHOLE:
                named[name] = read_only(self._boundary[chosen])
            elif len(chosen) < len(self._boundary):
                raise MeshError(
                    f"the name {WHOLE!r} is taken: it always means the whole boundary, and here it is given to "
                    f"{len(chosen)} of its {len(self._boundary)} parts. Choose another name, or leave it out."
                )
        return named

    def _parts(self, name: str, given: Any, number: Ints) -> tuple[Ints, list[str]]:
        """Return the parts of the boundary that a user names by old numbers of vertices, -1 for none, in words, too."""
        rows = list_of(given, f"boundary {name!r} must be {self.PARTS}, each the numbers of its nodes")
        if not rows:
            raise MeshError(f"boundary {name!r} has no {self.PARTS}; name one at least, or leave it out.")
        offsets, vertices = lay_flat(rows, lambda k: f"boundary {name!r}: {self.A_PART} (number {k} in the list)")
        called = [f"({', '.join(map(str, row.tolist()))})" for row in np.split(vertices, offsets[1:-1])]
        return self._found(offsets, vertices, number), called

    def _found(self, offsets: Ints, vertices: Ints, number: Ints) -> Ints:
        """Return the places in the boundary of parts with these vertices, by their new numbers; -1 for none."""
        known = (vertices >= 0) & (vertices < len(number))
        own = np.where(known, number[np.where(known, vertices, 0)], -1)
        return polygons.matching_rows(*self._outlines, offsets, own)

    def with_boundary(self, name: str, predicate: Callable[[Floats], Bools], of: str | None = None) -> Self:
        """Return this mesh with one more named part of its boundary, or of an interface.

        Parameters
        ----------
        name : str
            Its name; a part of that name is replaced, and parts may overlap.
        predicate : callable
            Takes the midpoints (m, 2) of all boundary edges, interfaces left out, in space the centroids (m, 3) of all
            boundary faces; returns which belong: bool (m,).
        of : str, optional
            The boundary or interface whose edges or faces alone are asked for. Effects of contact, friction and
            Pressure act on a part of an interface as on all of it.

        Raises
        ------
        MeshError
            The name is reserved, that of an interface or no string, the answer is not (m,) bool, or it selects nothing;
            or `of` is no boundary.
        """
        if of is not None and not (isinstance(of, str) and of in self.boundaries):
            known = ", ".join(map(repr, self.boundaries))
            raise MeshError(f"with_boundary: found of = {brief(of)}; this mesh has the boundaries {known}.")
        some = np.flatnonzero(self._outer) if of is None else self._places(self.boundaries[of])
        parts, middles = self._boundary[some], self._middles[some]
        return self._with_named({name: read_only(parts[chosen_parts(name, predicate, middles, self.PARTS)])})

    def with_boundaries(self, boundaries: Mapping[str, ArrayLike | Sequence[ArrayLike]]) -> Self:
        """Return this mesh with more named parts of its boundary.

        Parameters
        ----------
        boundaries : mapping of str to array_like
            Name -> edges (m, 2), in either direction; in space faces: their numbers (m,), or their vertices, a row a
            face, in any order.

        Raises
        ------
        MeshError
            A name is reserved or that of an interface, or an edge or face is not on the boundary.
        """
        return self._with_named(self._checked_parts(boundaries))

    def _with_named(self, added: Mapping[str, Ints]) -> Self:
        taken = [name for name in added if name in self.interfaces]
        if taken:
            raise MeshError(f"{taken[0]!r} is an interface of this mesh; choose another name.")
        return self._replace(_named={**self._named, **added})

    def with_cell_data(self, name: str, values: ArrayLike) -> Self:
        """Return this mesh with one more (or another) array (n_cells, ...) of data on cells."""
        added = check_cell_data({check_name(name, "cell datum"): values}, self.n_cells)
        return self._replace(cell_data=MappingProxyType({**self.cell_data, **added}))

    def refine(self, cells: ArrayLike | None = None, *, balance: bool = True) -> Self:
        """Return this mesh with cells split (numbers, or a bool each; None: all): :func:`vemcvx.meshes.refinement`."""
        from vemcvx.meshes.refining import refinement

        return refinement(self, cells, balance=balance).mesh

    def cut(self, name: str, sides: Mapping[str, ArrayLike]) -> Self:
        """Return this mesh with a crack: the edges, in space faces, between two sets of its cells become an interface.

        Nodes along the crack become double, the new ones last; a tip inside the mesh, in space the front, keeps its
        nodes. Cells that are on neither side are left alone, so that sets near the crack say how long it is.

        Parameters
        ----------
        name : str
            Name of the crack, as an interface and as a boundary (the edges or faces of the first side).
        sides : mapping of str to array_like
            Names of the two sides -> their cells: numbers, or a bool each.

        Raises
        ------
        MeshError
            The sides have a cell in common or nothing between them, an edge would have a tip at both ends, in space a
            face all its nodes at the front, or the name is taken.
        """
        from vemcvx.meshes.cracks import cut

        return cut(self, name, sides)

    def quality(self) -> Quality:
        """Shapes of the cells, (n_cells,): star-shapedness and shortest edges over diameters, of Assumption 3.3.

        Warns
        -----
        MeshWarning
            Cells are stretched, dented or have edges so short that the constants of the method grow; how much is
            measured in :mod:`vemcvx.meshes.quality`. What short edges cost in space is not, and nothing is said of
            them.
        """
        from vemcvx.meshes.quality import quality_of

        return quality_of(self)

    def write(self: Any, path: str | Path) -> None:
        """Write the mesh, its named boundaries and cell data; `read` gives them back to the bit from .vtu.

        Parameters
        ----------
        path : str or Path
            The suffix chooses the format. Every mesh goes into .vtu files (polyhedra as VTK has them, their boundaries
            as polygons). Files of Gmsh (.msh), Abaqus (.inp) and Nastran (.bdf, .nas, .fem) take triangles and quads;
            in space tetrahedra, hexahedra, wedges and, but for Abaqus, pyramids. Gmsh's keep names of the boundary, and
            sets of cells (data of zeros and ones) that do not overlap.

        Raises
        ------
        MeshError
            The format would lose cells or interfaces, or the file cannot be written.

        Warns
        -----
        MeshWarning
            The format does not keep some names, data or digits.
        """
        from vemcvx.meshes.io.files import write

        write(path, self)

    def to(self: Any, library: Literal["meshio", "skfem", "pyvista"]) -> Any:
        """Return the mesh as an object of another library; :func:`vemcvx.meshes.convert` is the way back.

        Parameters
        ----------
        library : {"meshio", "skfem", "pyvista"}
            Its name. Points keep their order in all of them.

        Returns
        -------
        meshio.Mesh
            As `write` puts it into a .vtu file: polygons in blocks of one vertex count; in space tetrahedra,
            hexahedra, wedges and pyramids in blocks of one kind. Blocks of lines (triangles or quadrilaterals) follow,
            of which the cell datum "boundary:<name>" marks those of a named boundary. If this permutes cells, the datum
            "vemcvx:cell" has their numbers.
        skfem.MeshTri, MeshQuad, MeshTet or MeshHex
            With named boundaries; cell data of zeros and ones are subdomains.
        pyvista.UnstructuredGrid
            Cells in their order, with their data. A named boundary is the field datum "boundary:<name>": its edges
            (m, 2); in space the vertices of its faces, a row each, filled up with -1.

        Raises
        ------
        MeshError
            The library is none of these, or has no such cells (scikit-fem: cells of one kind alone).
        VemcvxError
            The library is not installed.

        Warns
        -----
        MeshWarning
            scikit-fem keeps no other cell data.
        """
        from vemcvx.meshes.io.objects import to_object

        return to_object(self, library)

    def _replace(self, **fields: object) -> Self:
        """Return a mesh that shares everything, also what is already computed, but the given fields."""
        mesh = object.__new__(type(self))
        anew = {"boundaries", "_outer"} if "interfaces" in fields else {"boundaries"}
        mesh.__dict__.update({key: value for key, value in self.__dict__.items() if key not in anew})
        mesh.__dict__.update(fields)
        return mesh

    def __getstate__(self) -> dict[str, object]:
        kept = {name: getattr(self, name) for name in (*self.ARRAYS, "node_map", "_named")}
        # A mapping proxy cannot be pickled.
        return {**kept, "cell_data": dict(self.cell_data), "interfaces": dict(self.interfaces)}

    def __setstate__(self, state: dict[str, Any]) -> None:
        data = {name: read_only(values) for name, values in state.pop("cell_data").items()}
        named = {name: read_only(parts) for name, parts in state.pop("_named").items()}
        interfaces = MappingProxyType(state.pop("interfaces"))
        arrays = [state.pop(name) for name in self.ARRAYS]
        self._fill(*arrays, **state, cell_data=MappingProxyType(data), _named=named, interfaces=interfaces)

    def __repr__(self) -> str:
        known = list(self.boundaries)
        names = ", ".join(known if len(known) < 10 else [*known[:4], f"{len(known) - 5} more", known[-1]])
        return (
            f"{type(self).__name__}({self.n_cells} cells, {self.n_nodes} nodes, h = {self.h:.4g}, boundaries: {names})"
        )

    def _repr_html_(self) -> str:
        names = [(f'"{name}"', f"{len(parts)} {self.PARTS}") for name, parts in self.boundaries.items()]
        data = [(name, in_a_line(values)) for name, values in self.cell_data.items()]
        return Outline(f"{type(self).__name__}: {self.n_cells} cells, h = {self.h:.4g}", [*names, *data]).html()


def straight_sides(mesh: Mesh) -> dict[str, Ints]:
    """Parts of the boundary that lie where a coordinate is extreme, by the names that families give them, if any."""
    low, high = mesh.points.min(axis=0), mesh.points.max(axis=0)
    # A mesh that was moved or scaled into place has straight sides to its digits.
    rounding = SAME * float((high - low).max())
    sides = mesh._in_planes(Box(tuple(low.tolist()), tuple(high.tolist())), rounding)
    return {name: parts for name, parts in sides.items() if len(parts)}
