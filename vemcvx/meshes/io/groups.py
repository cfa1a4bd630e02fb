"""Named groups of cells in files: physical groups of Gmsh, cell sets of other programs.

Groups of what bounds cells (lines; surfaces, where there are solids) name parts of the boundary, groups of cells become
cell data: 1 in the group, 0 outside.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Ints
from vemcvx.meshes.io.blocks import PHYSICAL, POLYGONS, SOLIDS, Blocks, Data


def _kinds(blocks: Blocks) -> tuple[int, tuple[str, ...], tuple[str, ...]]:
    """Dimension of the cells, their kinds, and the kinds of what bounds them."""
    if any(kind in SOLIDS for kind, _ in blocks.cells):
        return 3, SOLIDS, POLYGONS
    return 2, POLYGONS, ("line",)


def physical_groups(blocks: Blocks) -> tuple[Data, dict[str, Ints]]:
    """Data that put every named block into a physical group, and the numbers (tag, dimension) of their names.

    Other data stay behind: meshio writes them into a Gmsh file in a way that it cannot read.
    """
    dimension, inner, _ = _kinds(blocks)
    tags = [np.zeros(len(cells), dtype=np.int64) for _, cells in blocks.cells]
    for number, parts in enumerate(blocks.sides.values(), start=1):
        for tag, part in zip(tags, parts, strict=True):
            tag[part] = number
    for tag, (kind, _), given in zip(tags, blocks.cells, blocks.data.get(PHYSICAL, ()), strict=False):
        if kind in inner and not tag.any():
            tag[:] = given
    names = {name: np.array([number, dimension - 1]) for number, name in enumerate(blocks.sides, start=1)}
    return {PHYSICAL: tags, "gmsh:geometrical": tags}, names


def take_physical_groups(blocks: Blocks, names: Mapping[str, NDArray[Any]]) -> None:
    """Physical groups of a Gmsh file: those of sides by name or number, those of cells by name."""
    tags = blocks.data.get(PHYSICAL)
    blocks.data.pop("gmsh:geometrical", None)
    if tags is None:
        return
    dimension, inner, outer = _kinds(blocks)
    called = {(int(value[1]), int(value[0])): name for name, value in names.items() if np.shape(value) == (2,)}
    kinds = [kind for kind, _ in blocks.cells]
    on_sides = [part for part, kind in zip(tags, kinds, strict=True) if kind in outer]
    for tag in np.unique(np.concatenate(on_sides)).tolist() if on_sides else ():
        if tag:  # 0 is no group
            blocks.sides[called.get((dimension - 1, tag), str(tag))] = [part == tag for part in tags]
    for (rank, tag), name in called.items():
        if rank == dimension:
            blocks.sets[name] = [part == tag for part in tags]
    if not any(part.any() for part, kind in zip(tags, kinds, strict=True) if kind in inner):
        del blocks.data[PHYSICAL]


def take_sets(blocks: Blocks, sets: Mapping[str, list[Any]]) -> None:
    """Named sets of cells: those of sides are boundaries, those of cells cell data; a cell may be in several."""
    _, inner, outer = _kinds(blocks)
    for name, members in sets.items():
        if name.startswith("gmsh:"):
            continue
        parts = [np.zeros(len(cells), dtype=bool) for _, cells in blocks.cells]
        for part, chosen in zip(parts, members, strict=True):
            if chosen is not None:
                part[np.asarray(chosen, dtype=np.int64)] = True
        chosen_kinds = {kind for (kind, _), part in zip(blocks.cells, parts, strict=True) if part.any()}
        if chosen_kinds & set(outer):
            blocks.sides[name] = parts
        elif chosen_kinds & set(inner):
            blocks.sets[name] = parts
