"""What meshes of the plane and of space have in common: points, names, data on cells, copies, how they are shown."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar, Self

from numpy.typing import ArrayLike, NDArray

from vemcvx.arrays import Bools, Floats, Ints, read_only
from vemcvx.errors import MeshError
from vemcvx.meshes.box import Box, SpaceBox
from vemcvx.meshes.checks.names import check_cell_data, check_datum_name, chosen_parts
from vemcvx.meshes.interfaces import Interface
from vemcvx.outline import Outline, in_a_line


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Mesh(ABC):
    """Points, and cells that kinds of meshes describe by further arrays; immutable."""

    points: Floats
    cell_data: Mapping[str, NDArray[Any]]
    interfaces: Mapping[str, Interface]
    node_map: Ints | None
    _named: Mapping[str, Ints]
    _box: Box | SpaceBox | None

    ARRAYS: ClassVar[tuple[str, ...]]
    """Names of the arrays that make it."""
    PARTS: ClassVar[str]
    """What its boundary is made of."""

    @property
    @abstractmethod
    def n_cells(self) -> int:
        """Number of cells."""

    @property
    @abstractmethod
    def diameters(self) -> Floats:
        """Largest distance of two vertices of each cell, (n_cells,)."""

    @property
    @abstractmethod
    def boundaries(self) -> Mapping[str, Ints]:
        """Named parts of the boundary."""

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.points)

    @cached_property
    def h(self) -> float:
        """Mesh size: the largest cell diameter."""
        return float(self.diameters.max())

    @property
    @abstractmethod
    def _choice(self) -> tuple[Ints, Floats]:
        """The parts of the boundary that no interface has, and their middles (m, dim)."""

    @abstractmethod
    def _checked_parts(self, boundaries: Mapping[str, Any] | None, node_map: Ints | None = None) -> dict[str, Ints]:
        """Named parts of the boundary, or MeshError; `node_map` if their nodes have been numbered anew since."""

    def with_boundary(self, name: str, predicate: Callable[[Floats], Bools]) -> Self:
        """Return this mesh with one more named part of its boundary.

        Parameters
        ----------
        name : str
            Its name; a part of that name is replaced, and parts may overlap.
        predicate : callable
            Takes the midpoints (m, 2) of all boundary edges, interfaces left out, in space the centroids (m, 3) of all
            boundary faces; returns which belong: bool (m,).

        Raises
        ------
        MeshError
            The name is reserved, that of an interface or no string, the answer is not (m,) bool, or it selects nothing.
        """
        parts, middles = self._choice
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
        added = check_cell_data({check_datum_name(name): values}, self.n_cells)
        return self._replace(cell_data=MappingProxyType({**self.cell_data, **added}))

    def _fill(self, *arrays: Floats | Ints, **others: object) -> None:
        fields = {
            **{name: read_only(array) for name, array in zip(self.ARRAYS, arrays, strict=True)},
            "cell_data": MappingProxyType({}),
            "interfaces": MappingProxyType({}),
            "node_map": None,
            "_named": {},
            "_box": None,
            **others,
        }
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def _replace(self, **fields: object) -> Self:
        """Return a mesh that shares everything, also what is already computed, but the given fields."""
        mesh = object.__new__(type(self))
        mesh.__dict__.update({key: value for key, value in self.__dict__.items() if key != "boundaries"})
        mesh.__dict__.update(fields)
        return mesh

    def __getstate__(self) -> dict[str, object]:
        kept = {name: getattr(self, name) for name in (*self.ARRAYS, "node_map", "_named", "_box")}
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
