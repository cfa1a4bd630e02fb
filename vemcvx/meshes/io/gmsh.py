"""Reading of Gmsh files. meshio reads points and cells, and this module reads physical groups.

meshio loses groups that share a name or an entity, and fails at entities without a group (Mesh.SaveAll).
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vemcvx.base.errors import MeshError
from vemcvx.meshes.io.blocks import GEOMETRICAL, Group, cells_of, take_groups
from vemcvx.meshes.io.grid import PHYSICAL, Grid
from vemcvx.meshes.polygons import same_rows

FORMAT = re.compile(rb"\$MeshFormat\s+([\d.]+)\s+([01])\s+([48])\s")


def read_gmsh(path: Path) -> Grid:
    """Read a Gmsh file, with physical groups as named sets."""
    import meshio

    data = path.read_bytes()
    found = FORMAT.search(data[:10_000])
    if not found:
        raise MeshError("it does not begin with $MeshFormat as Gmsh files do.")
    version, binary = float(found[1]), found[2] == b"1"
    if version == 4.0:  # Gmsh writes "4", which meshio takes for 4.1
        data = data[: found.start(1)] + b"4.0" + data[found.end(1) :]
    if b"$PartitionedEntities" in data:
        raise MeshError("its mesh is partitioned, and groups of partitions are not read; unpartition it before saving.")
    if b"$ParametricNodes" in data:
        raise MeshError("its nodes have parametric coordinates: save without them (Mesh.SaveParametric = 0).")
    names, data = _without(data, b"PhysicalNames")
    entities, data = _without(data, b"Entities")
    lines = re.findall(rb'^\s*(\d)\s+(\d+)\s+"(.*)"', names, re.MULTILINE)
    called = {(int(dim), int(tag)): name.decode("utf-8", "replace") for dim, tag, name in lines}
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "mesh.msh"
        file.write_bytes(data)
        grid = cells_of(meshio.gmsh.read(file))
    numbers = grid.data.pop(PHYSICAL, None)
    if version >= 4.0 and entities:
        take_groups(grid, grid.data.pop(GEOMETRICAL), called, _groups(entities, version, found[3], binary=binary))
    elif numbers is not None:
        take_groups(grid, numbers, called)
    first, number = same_rows(grid.offsets, grid.vertices)
    if len(first) == len(number):
        return grid
    # Files of version 2 repeat a cell that belongs to several groups.
    together = {name: np.bincount(number, chosen) > 0 for name, chosen in grid.sets.items()}
    grid = grid.select(first)
    grid.sets = together
    return grid


def _without(data: bytes, section: bytes) -> tuple[bytes, bytes]:
    """Return the contents of a section, and the file without the section."""
    start, end = data.find(b"$" + section), data.find(b"$End" + section)
    if start < 0 or end < 0:
        return b"", data
    inside, after = data.find(b"\n", start) + 1, data.find(b"\n", end)
    return data[inside:end], data[:start] + (data[after + 1 :] if after >= 0 else b"")


def _groups(section: bytes, version: float, width: bytes, *, binary: bool) -> Mapping[Group, list[int]]:
    """Return the physical groups of geometrical entities (dimension, number)."""
    words, at = [] if binary else section.split(), 0

    def take(kind: str, count: int) -> list[Any]:
        nonlocal at
        start, step = at, count * np.dtype(kind).itemsize if binary else count
        at += step
        if binary:
            return np.frombuffer(section, kind, count, start).tolist()
        return [int(word) if kind[0] != "f" else 0 for word in words[start:at]]

    size, groups = f"u{width.decode()}", dict[Group, list[int]]()
    for dim, count in enumerate(take(size, 4)):
        for _ in range(count):
            (tag,) = take("i4", 1)
            take("f8", 3 if dim == 0 and version > 4.0 else 6)  # skips the bounding box
            groups[dim, tag] = [abs(group) for group in take("i4", take(size, 1)[0])]  # the sign is an orientation
            if dim:
                take("i4", take(size, 1)[0])  # skips the bounding entities
    return groups
