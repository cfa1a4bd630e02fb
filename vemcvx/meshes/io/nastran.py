"""Reading of Nastran files. Cards are rewritten with commas, and meshio reads the result.

Elements with the same property form a set. The name of the set is the number of the property.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np

from vemcvx.base.errors import MeshError
from vemcvx.meshes.io.blocks import cells_of
from vemcvx.meshes.io.grid import Grid

CORNERS = {"CTRIA3": 3, "CTRIAR": 3, "CTRIA6": 3, "CQUAD4": 4, "CQUADR": 4, "CQUAD8": 4, "CSHEAR": 4, "CTETRA": 4}
CORNERS |= {"CPYRAM": 5, "CPYRA": 5, "CPENTA": 6, "CHEXA": 8, "CBAR": 2, "CBEAM": 2, "CROD": 2}
"""Element -> number of corners, which are the first nodes."""
FIRST_ORDER = {"CTRIA6": "CTRIA3", "CQUAD8": "CQUAD4"}
SOLIDS = "CTETRA", "CPYRAM", "CPYRA", "CPENTA", "CHEXA"  # of first or second order


def read_nastran(path: Path) -> Grid:
    """Read the points and cells of a file, or raise MeshError."""
    import meshio

    lines, curved = list[str](), set[str]()
    for card in _cards(path.read_bytes().decode("utf-8", "replace").upper()):
        name, at, system, *fields = (*card, *[""] * 5)
        n = CORNERS.get(name, 0)
        if name == "GRID" and system not in ("", "0"):
            raise MeshError(f"GRID {at} is in the coordinate system {system}; export nodes in the basic one, 0.")
        if name == "GRID":
            lines.append(f"GRID,{at},,{','.join(map(_real, fields[:3]))}")
        elif n and not all(fields[:n]):
            raise MeshError(f"its card {name} {at} has fewer than {n} nodes.")
        elif n:
            if name in (*FIRST_ORDER, *SOLIDS) and any(fields[n : 2 * n if name in FIRST_ORDER else None]):
                curved.add(name)
            lines.append(",".join([FIRST_ORDER.get(name, name), at, system or at, *fields[:n]]))
        elif re.match("C(?!ORD|END)|GRDSET|SPOINT|INCLUDE", name):
            raise MeshError(
                f"its card {name} {at} is not supported; export without it. Supported are GRID, {', '.join(CORNERS)}."
            )
    grid = cells_of(meshio.nastran.read(io.StringIO("\n".join(["BEGIN BULK", *lines, "ENDDATA", ""]))))
    if len(grid.points) + len(grid.kinds) != len(lines):
        raise MeshError(f"of {len(lines)} cards, only {len(grid.points)} points and {len(grid.kinds)} cells were read.")
    properties = grid.data.get("nastran:ref", grid.offsets[:0])
    grid.sets = {str(number): properties == number for number in np.unique(properties)}
    grid.bodies = tuple(name for name, chosen in grid.sets.items() if (chosen & grid.bounding[0]).any())
    if curved:
        grid.notes = (f"cells of higher order ({', '.join(sorted(curved))}) are read as their corners.",)
    return grid


def _cards(text: str) -> list[list[str]]:
    bulk = re.split(r"^\s*BEGIN\s+BULK.*$", text, maxsplit=1, flags=re.MULTILINE)[-1]
    cards: list[list[str]] = []
    for raw in re.split(r"^ENDDATA", bulk, maxsplit=1, flags=re.MULTILINE)[0].splitlines():
        line = raw.partition("$")[0].expandtabs(8).rstrip()
        head, *fields = line[:8].strip(), *(line[k : k + 8].strip() for k in range(8, 72, 8))
        if "," in line:
            head, *fields = (field.strip() for field in line.split(","))
        elif "*" in head:
            fields = [line[k : k + 16].strip() for k in range(8, 72, 16)]
        width = 4 if "*" in head else 8
        if len(fields) == width + 1:
            fields = fields[:width]  # drops the continuation mark
        if head and head[0] not in "+*":
            cards.append([head.rstrip("*")])
        if cards and (head or any(fields)):
            cards[-1] += [*fields, *[""] * (width - len(fields))]
    return cards


def _real(field: str) -> str:
    """Return a number such as 1.5D-3 or 2.5-3 in Python's notation."""
    return re.sub(r"^([+-]?[\d.]+)([+-]\d+)$", r"\1E\2", field.replace("D", "E")) or "0."
