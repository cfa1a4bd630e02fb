"""Nastran's files, read by meshio after a preparation of their text: one card a line, in fields between commas.

What would be read wrongly is refused by name: points in other coordinate systems, and elements that are not read.
Materials, properties, loads and supports are passed over.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from pathlib import Path

from vemcvx.base.errors import MeshError
from vemcvx.meshes.io.blocks import cells_of
from vemcvx.meshes.io.grid import Grid

CORNERS = {"CTRIA3": 3, "CTRIAR": 3, "CTRIA6": 3, "CQUAD4": 4, "CQUADR": 4, "CQUAD8": 4, "CSHEAR": 4, "CTETRA": 4}
CORNERS |= {"CPYRAM": 5, "CPYRA": 5, "CPENTA": 6, "CHEXA": 8, "CBAR": 2, "CBEAM": 2, "CROD": 2}
MOST = {"CTRIA6": 6, "CQUAD8": 8, "CTETRA": 10, "CPYRAM": 13, "CPYRA": 13, "CPENTA": 15, "CHEXA": 20}
"""Elements -> how many of their nodes are corners, which come first, and how many there may be."""
REFUSED = "GRDSET", "INCLUDE", "SPOINT"


def read_nastran(path: Path) -> Grid:
    """Return the points and cells of a file; MeshError where some would be lost or misplaced."""
    import meshio

    lines, grids, elements, curved = ["BEGIN BULK"], 0, 0, set[str]()
    for name, fields in _cards(path.read_bytes().decode("utf-8", "replace")):
        at, system = fields[0], fields[1]
        if name == "GRID":
            if system not in ("", "0"):
                raise MeshError(f"GRID {at} is in the coordinate system {system}; export nodes in the basic one, 0.")
            lines.append(",".join(["GRID", at, "", *(_real(x) for x in fields[2:5])]))
            grids += 1
        elif name in CORNERS:
            n = CORNERS[name]
            if not all(fields[2 : 2 + n]):
                raise MeshError(f"its card {name} {at} has fewer than {n} nodes.")
            if any(fields[2 + n : 2 + MOST.get(name, n)]):
                curved.add(name)
            first = name.replace("6", "3") if n == 3 else name.replace("8", "4") if n == 4 else name
            lines.append(",".join([first, at, system or at, *fields[2 : 2 + n]]))
            elements += 1
        elif (name.startswith("C") and not name.startswith(("CORD", "CEND"))) or name in REFUSED:
            raise MeshError(
                f"its card {name} {at} is not read; export without it. Read are GRID, {', '.join(CORNERS)}."
            )
    grid = cells_of(meshio.nastran.read(io.StringIO("\n".join([*lines, "ENDDATA", ""]))))
    if (len(grid.points), len(grid.kinds)) != (grids, elements):
        found = f"{len(grid.points)} and {len(grid.kinds)}"
        raise MeshError(f"it has {grids} points and {elements} cells; {found} were read.")
    if curved:
        grid.notes = (f"cells of second order ({', '.join(sorted(curved))}) are read by their corners.",)
    return grid


def _cards(text: str) -> Iterator[tuple[str, list[str]]]:
    """Yield the cards of the bulk data: their names, and their fields but for names and marks of continuations."""
    upper = text.upper()
    bulk = re.split(r"^\s*BEGIN\s+BULK.*$", upper, maxsplit=1, flags=re.MULTILINE)[-1]
    card: list[str] = []
    for line in re.split(r"^ENDDATA", bulk, maxsplit=1, flags=re.MULTILINE)[0].splitlines():
        line = line.partition("$")[0].expandtabs(8).rstrip()
        if "," in line:
            head, *fields = (field.strip() for field in line.split(","))
            width = 4 if head.endswith("*") else 8
            fields = fields if len(fields) > width + 1 else fields[:width]
        else:
            head, step = line[:8].strip(), 16 if "*" in line[:8] else 8
            width = 64 // step
            fields = [line[at : at + step].strip() for at in range(8, 72, step)]
        if not line or (not head and not any(fields)):
            continue
        if head and head[0] not in "+*":
            if card:
                yield card[0], [*card[1:], "", "", "", "", ""]
            card = [head.rstrip("*")]
        card += [*fields, *[""] * (width - len(fields))]
    if card:
        yield card[0], [*card[1:], "", "", "", "", ""]


def _real(field: str) -> str:
    """Return a number as Python spells it: 1.5D-3 and 2.5-3 are numbers, too, and nothing is zero."""
    return re.sub(r"^([+-]?[\d.]+)([+-]\d+)$", r"\1E\2", field.replace("D", "E")) or "0."
