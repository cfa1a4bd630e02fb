"""Abaqus' input files, read by meshlane after a preparation of their text; what is not read is named.

meshlane finds nodes by their numbers and moves instances. Before, the text is rewritten: files that are included stand
in it, each element stands on a line with a type that meshlane knows, and each list of numbers in a set, or behind a
surface, becomes a set of its own, called by its number among the pieces. Sets are put together from these pieces here.
"""

from __future__ import annotations

import io
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vemcvx.base.arrays import Bools, Ints
from vemcvx.base.errors import MeshError
from vemcvx.meshes.io.blocks import cells_of, to_meshio
from vemcvx.meshes.io.grid import Grid
from vemcvx.meshes.polygons import offsets_of

PLANE, SOLID = "(?:CP[ES]|CPEG|DC2D|S|M3D|SFM3D|R3D|DS|STRI)", "(?:C3D|DC3D)"
TYPES = {f"{PLANE}3": ("CPS3", 3), f"{PLANE}4": ("CPS4", 4), f"{PLANE}65?": ("STRI65", 6), f"{PLANE}8": ("S8R", 8)}
TYPES |= {SOLID + str(n): (f"C3D{n}", n) for n in (4, 6, 8, 10, 15, 20)}
TYPES |= {"(?:T[23]D|R2D)2|B[23]1": ("T3D2", 2), "T[23]D3|B[23]2": ("T3D3", 3)}
"""Patterns of types of elements, which letters may follow -> a type of that shape, and how many nodes it has."""
SIDES = {
    "triangle": ("01", "12", "20"),
    "quad": ("01", "12", "23", "30"),
    "tetra": ("012", "031", "132", "230"),
    "wedge": ("012", "354", "0143", "1254", "2035"),
    "hexahedron": ("0123", "4765", "0451", "1562", "2673", "3740"),
}
"""The sides S1, S2 ... of elements, by their corners."""
SCOPES = "PART", "ENDPART", "INSTANCE", "ENDINSTANCE", "ASSEMBLY", "ENDASSEMBLY"
REFUSED = "ELGEN", "ELCOPY", "NGEN", "NFILL", "NCOPY", "NMAP", "SYSTEM", "IMPORT"
FILES = "NODE", "ELEMENT", "NSET", "ELSET", "INCLUDE"


def read_abaqus(path: Path) -> Grid:
    """Return the cells of a file: element sets as named sets, node sets and surfaces as parts of the boundary."""
    deck = _Deck()
    for word, options, lines in _blocks(path):
        deck.take(word, options, lines)
    mesh = _meshlane().read(io.StringIO("\n".join([*deck.lines, ""])))
    grid = cells_of(mesh)
    block = np.repeat(np.arange(len(mesh.cells)), [len(one) for one in mesh.cells])
    # Parts without an instance come last, where they are.
    placed = {} if "" in deck.blocks else {**deck.placed, **dict.fromkeys(deck.parts)}
    counts = [deck.blocks[name] + (deck.blocks[part] if part else 0) for name, part in placed.items()]
    at = offsets_of(np.array(counts, dtype=np.int64))
    own = {name: (block >= at[k]) & (block < at[k + 1]) for k, name in enumerate(placed)}
    _take_sets(grid, deck, own)
    grid.bodies = tuple(own or _largest(grid) or grid.sets)
    grid.sets |= own
    if deck.unread:
        grid.notes = (*grid.notes, f"it has, and not read are, {', '.join(dict.fromkeys(deck.unread))}.")
    return grid


def _largest(grid: Grid) -> list[str]:
    """Return the names of sets of some, not all, of the cells that no other such set has in it; of equals the last."""
    inner = grid.bounding[0]
    some = {name: x & inner for name, x in grid.sets.items() if (x & inner).any() and not x[inner].all()}
    order = sorted(some, key=lambda name: np.count_nonzero(some[name]))
    inside = {name for k, name in enumerate(order) for one in order[k + 1 :] if (some[name] <= some[one]).all()}
    return [name for name in some if name not in inside]


def write_abaqus(path: Path, grid: Grid) -> None:
    """Write points and cells alone."""
    _meshlane().write(path, to_meshio(grid, in_order=True))


def _meshlane() -> Any:
    try:
        from meshlane import abaqus
    except ImportError:
        raise MeshError(".inp files need meshlane, which is not installed: pip install meshlane") from None
    return abaqus


class Piece(NamedTuple):
    """A part of a set or surface: the elements or nodes of the piece's own number, or those of another set."""

    kind: str  # "ELSET" or "NSET"
    name: str
    side: int = 0  # of a surface: which side of the elements
    of: str = ""  # the name of another set
    instance: str = ""  # where the other set is meant


@dataclass
class _Deck:
    """The text for meshlane, and what meshlane does not tell."""

    lines: list[str] = field(default_factory=list)
    pieces: list[Piece] = field(default_factory=list)
    scope: str = ""  # the part or instance that is being defined
    blocks: dict[str, int] = field(default_factory=dict)  # part or instance -> its own blocks of elements
    parts: dict[str, None] = field(default_factory=dict)  # that have no instance yet
    placed: dict[str, str | None] = field(default_factory=dict)  # instance -> its part, if that has another name
    largest: int = 0  # of all numbers
    spelt: dict[str, str] = field(default_factory=dict)  # names in capitals -> as they were spelt at first
    internal: set[str] = field(default_factory=set)  # names of sets that no user has made
    unread: list[str] = field(default_factory=list)

    def take(self, word: str, options: dict[str, str], lines: list[str]) -> None:
        """Take a keyword with its data; MeshError where nodes or elements would be lost or misplaced."""
        strange = [name for name in ("SYSTEM", "LIBRARY") if options.get(name, "R").upper() != "R"]
        if word in REFUSED or (strange and word in ("NODE", "INSTANCE")):
            more = "".join(f", {name}={options[name]}" for name in strange)
            raise MeshError(
                f"its keyword *{word}{more} is not read; write all nodes, in Cartesian coordinates, and elements out."
            )
        rows = [[one.strip() for one in line.split(",")] for line in lines]
        if word == "NODE":
            self._take_nodes(options, rows)
        elif word == "ELEMENT":
            self._take_elements(options, [one for row in rows for one in row if one])
        elif word in ("NSET", "ELSET"):
            self._take_set(word, options, rows)
        elif word == "SURFACE":
            self._take_surface(options, rows)
        elif word in SCOPES:
            self._take_scope(word, options, rows)

    def _take_nodes(self, options: Mapping[str, str], rows: list[list[str]]) -> None:
        numbers = [int(row[0]) for row in rows]
        self.lines.append("*NODE")
        for number, row in zip(numbers, rows, strict=True):
            x = [one.upper().replace("D", "E") or "0" for one in (*row[1:4], "", "", "")[:3]]
            self.lines.append(f"{number}, {', '.join(x)}")
        self._counted("NSET", options, numbers)

    def _take_elements(self, options: Mapping[str, str], words: list[str]) -> None:
        kind = options.get("TYPE", "").upper()
        shape = next((found for pattern, found in TYPES.items() if re.fullmatch(f"(?:{pattern})[A-Z]*5?", kind)), None)
        if shape is None:
            self.unread.append(f"elements of the type {kind}")
        elif len(words) % (shape[1] + 1):
            raise MeshError(f"its elements of the type {kind} do not all have {shape[1]} nodes.")
        elif words:
            rows = np.array(words, dtype=np.int64).reshape(-1, shape[1] + 1).tolist()
            self.lines += [f"*ELEMENT, TYPE={shape[0]}", *(", ".join(map(str, row)) for row in rows)]
            self.blocks[self.scope] = self.blocks.get(self.scope, 0) + 1
            self._counted("ELSET", options, [row[0] for row in rows])
            if shape[0] in ("T3D2", "T3D3") and "ELSET" not in options:
                self.unread.append(f"elements of the type {kind} (lines without a name)")

    def _counted(self, kind: str, options: Mapping[str, str], numbers: list[int]) -> None:
        self.largest = max([self.largest, *numbers])
        if kind in options:
            self._add(Piece(kind, self.spell(options[kind])), numbers)

    def _add(self, piece: Piece, numbers: list[int]) -> None:
        """Add a piece; its numbers become a set for meshlane, of an instance where that is told."""
        if numbers:
            where = f", INSTANCE={piece.instance}" if piece.instance else ""
            self.lines.append(f"*{piece.kind}, {piece.kind}={len(self.pieces)}{where}")
            self.lines += map(str, numbers)
        self.pieces.append(piece)

    def _take_set(self, kind: str, options: Mapping[str, str], rows: list[list[str]]) -> None:
        name, instance = self.spell(options[kind]), self.spell(options.get("INSTANCE", ""))
        if "INTERNAL" in options:
            self.internal.add(name)
        if kind == "NSET" and "ELSET" in options:
            self.unread.append(f"the node set {name} of an element set")
        elif "GENERATE" in options:
            steps = [[int(one or 1) for one in (*row, "", "")[:3]] for row in rows]
            ranges = [range(first, min(last, self.largest) + 1, step or 1) for first, last, step in steps]
            self._add(Piece(kind, name, instance=instance), [number for some in ranges for number in some])
        else:
            words = [one.strip('"') for row in rows for one in row if one]
            self._add(Piece(kind, name, instance=instance), [int(one) for one in words if one.isdigit()])
            for word in (one for one in words if not one.isdigit()):
                *inside, of = word.split(".")
                self._add(Piece(kind, name, 0, self.spell(of), self.spell(inside[0]) if inside else instance), [])

    def _take_surface(self, options: Mapping[str, str], rows: list[list[str]]) -> None:
        name, kind = self.spell(options["NAME"]), options.get("TYPE", "ELEMENT").upper()
        for target, label in ((*row, "")[:2] for row in rows):
            side = re.fullmatch(r"[SE]([1-6])", label.upper()) if kind == "ELEMENT" else re.fullmatch("()", "")
            if not side or kind not in ("ELEMENT", "NODE") or "COMBINE" in options:
                self.unread.append(f"the surface {name} ({', '.join(filter(None, (kind, target, label)))})")
                continue
            *inside, of = target.strip('"').split(".")
            piece = Piece(
                "ELSET" if kind == "ELEMENT" else "NSET", name, int(side[1] or 0), "", self.spell("".join(inside[:1]))
            )
            self._add(*((piece, [int(of)]) if of.isdigit() else (piece._replace(of=self.spell(of)), [])))

    def _take_scope(self, word: str, options: Mapping[str, str], rows: list[list[str]]) -> None:
        name, part = self.spell(options.get("NAME", word)), self.spell(options.get("PART", ""))
        if part and part not in self.blocks:
            raise MeshError(f"its instance {name} is of the part {part}, which is not there.")
        self.lines.append(f"*{word.replace('END', 'END ')}, NAME={name}" + f", PART={part}" * bool(part))
        if rows and len(rows[0]) > 3:
            rows = [["0"] * 3, *rows]  # It is turned, and not moved before.
        self.lines += [", ".join(one or "0" for one in (*row, "", "")[: max(3, len(row))]) for row in rows]
        self.scope = name if word in ("PART", "INSTANCE") else ""
        if self.scope:
            self.blocks.setdefault(name, 0)
        if word == "PART":
            self.parts[name] = None
        if word == "INSTANCE":
            self.parts.pop(part, None)
            self.placed[name] = part if part != name else None

    def spell(self, name: str) -> str:
        """Return a name as it was spelt at first: capitals do not matter."""
        return self.spelt.setdefault(name.upper(), name)


def _take_sets(grid: Grid, deck: _Deck, own: Mapping[str, Bools]) -> None:
    """Put sets and surfaces together from their pieces."""
    emitted = {"ELSET": grid.sets, "NSET": grid.nodes}
    found: dict[str, dict[str, Bools]] = {"ELSET": {}, "NSET": {}}
    for number, (kind, name, side, of, instance) in enumerate(deck.pieces):
        chosen = found[kind].get(of) if of else emitted[kind].get(str(number))
        if chosen is None:
            deck.unread += [f"the set {of} in {name}"] if of else []
            continue
        if of and instance in own:
            inside = np.zeros(len(grid.points), dtype=bool)
            inside[grid.vertices[np.repeat(own[instance], np.diff(grid.offsets))]] = True
            chosen = chosen & (own[instance] if kind == "ELSET" else inside)
        if side:
            _add_sides(grid, name, side, np.flatnonzero(chosen))
        else:
            found[kind][name] = found[kind].get(name, False) | chosen
    for kept in found.values():
        for name in deck.internal.intersection(kept):
            del kept[name]
    grid.sets, grid.nodes = found["ELSET"], found["NSET"]


def _add_sides(grid: Grid, name: str, side: int, cells: Ints) -> None:
    """Add a side of some cells to a named part of the boundary."""
    for kind in np.unique(grid.kinds[cells]).tolist():
        if side > len(SIDES.get(kind, ())):
            raise MeshError(f"its surface {name!r} is to have the side S{side} of a {kind}, which has none.")
        corners = np.array(list(map(int, SIDES[kind][side - 1])))
        rows = grid.vertices[grid.offsets[cells[grid.kinds[cells] == kind], None] + corners]
        offsets, vertices = grid.parts.get(name, (np.zeros(1, dtype=np.int64), rows[:0].ravel()))
        counts = np.concatenate([np.diff(offsets), np.full(len(rows), len(corners))])
        grid.parts[name] = offsets_of(counts), np.concatenate([vertices, rows.ravel()])


def _lines(path: Path) -> Iterator[str]:
    """Yield the lines of a file without comments, those of other files that it names in their place."""
    data = path.read_bytes()
    try:
        text = data.decode()
    except UnicodeDecodeError:
        text = data.decode("latin-1")
    for line in map(str.strip, text.splitlines()):
        word = line.partition(",")[0].lstrip("*").strip().upper()
        named = re.search(r"\bINPUT\s*=\s*\"?([^\",]+)", line, re.IGNORECASE) if word in FILES else None
        if line and not line.startswith("**") and word != "INCLUDE":
            yield line
        if named and line.startswith("*"):
            other = path.parent / named[1].strip().replace("\\", "/")
            if not other.is_file():
                raise MeshError(f"it names the file {other}, which is not there.")
            yield from _lines(other)


def _blocks(path: Path) -> Iterator[tuple[str, dict[str, str], list[str]]]:
    """Yield keywords in capitals without blanks, their options, and the lines of their data."""
    head, data = "*", list[str]()
    for line in [*_lines(path), "*"]:
        if head.endswith(",") and not data and not line.startswith("*"):
            head += line  # A line of a keyword goes on after a comma.
        elif not line.startswith("*"):
            data.append(line)
        else:
            word, *options = head[1:].split(",")
            pairs = [one.partition("=") for one in options]
            given = {name.replace(" ", "").upper(): value.strip().strip('"') for name, _, value in pairs}
            yield word.replace(" ", "").upper(), given, data
            head, data = line, []
