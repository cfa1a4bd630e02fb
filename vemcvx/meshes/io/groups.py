"""Named groups of cells in files: physical groups of Gmsh, cell sets of other programs.

Groups of lines name parts of the boundary, groups of surfaces become cell data: 1 in the group, 0 outside.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from vemcvx.arrays import Ints
from vemcvx.meshes.io.blocks import PHYSICAL, POLYGONS, Blocks, Data


def physical_groups(blocks: Blocks) -> tuple[Data, dict[str, Ints]]:
    """Data that put every named block of lines into a physical group, and the numbers (tag, dimension) of their names.

    Other data stay behind: meshio writes them into a Gmsh file in a way that it cannot read.
    """
    tags = [np.zeros(len(cells), dtype=np.int64) for _, cells in blocks.cells]
    for number, parts in enumerate(blocks.lines.values(), start=1):
        for tag, part in zip(tags, parts, strict=True):
            tag[part] = number
    for tag, (kind, _), given in zip(tags, blocks.cells, blocks.data.get(PHYSICAL, ()), strict=False):
        if kind != "line":
            tag[:] = given
    names = {name: np.array([number, 1]) for number, name in enumerate(blocks.lines, start=1)}
    return {PHYSICAL: tags, "gmsh:geometrical": tags}, names


def take_physical_groups(blocks: Blocks, names: Mapping[str, NDArray[Any]]) -> None:
    """Physical groups of a Gmsh file: lines by name or number, surfaces by name."""
    tags = blocks.data.get(PHYSICAL)
    blocks.data.pop("gmsh:geometrical", None)
    if tags is None:
        return
    called = {(int(value[1]), int(value[0])): name for name, value in names.items() if np.shape(value) == (2,)}
    kinds = [kind for kind, _ in blocks.cells]
    on_lines = [part for part, kind in zip(tags, kinds, strict=True) if kind == "line"]
    for tag in np.unique(np.concatenate(on_lines)).tolist() if on_lines else ():
        if tag:  # 0 is no group
            blocks.lines[called.get((1, tag), str(tag))] = [part == tag for part in tags]
    for (dimension, tag), name in called.items():
        if dimension == 2:
            blocks.surfaces[name] = [part == tag for part in tags]
    if not any(part.any() for part, kind in zip(tags, kinds, strict=True) if kind in POLYGONS):
        del blocks.data[PHYSICAL]


def take_sets(blocks: Blocks, sets: Mapping[str, list[Any]]) -> None:
    """Named sets of cells: those of lines are boundaries, those of polygons cell data; a cell may be in several."""
    for name, members in sets.items():
        if name.startswith("gmsh:"):
            continue
        parts = [np.zeros(len(cells), dtype=bool) for _, cells in blocks.cells]
        for part, chosen in zip(parts, members, strict=True):
            if chosen is not None:
                part[np.asarray(chosen, dtype=np.int64)] = True
        chosen_kinds = {kind for (kind, _), part in zip(blocks.cells, parts, strict=True) if part.any()}
        if "line" in chosen_kinds:
            blocks.lines[name] = parts
        elif chosen_kinds & set(POLYGONS):
            blocks.surfaces[name] = parts
