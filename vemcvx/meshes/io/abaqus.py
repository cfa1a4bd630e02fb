"""Reading of Abaqus input files: nodes, elements, sets and surfaces.

Sets with the same name in several instances are joined. A further set "Instance.Set" holds the elements of one
instance. A note lists unread parts of the file.
"""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from string import ascii_letters

import numpy as np

from vemcvx.base.arrays import Floats
from vemcvx.base.errors import MeshError
from vemcvx.meshes.io.grid import DIGITS, NODES, Grid, keep_corners
from vemcvx.meshes.polygons import offsets_of

TYPES = {
    r"(?:CP[ES]|CPEG|DC2D|S|M3D|SFM3D|R3D|DS|STRI)(\d)": {3: "triangle", 4: "quad", 6: "triangle6", 8: "quad8"},
    r"D?C3D(\d+)": {4: "tetra", 6: "wedge", 8: "hexahedron", 10: "tetra10", 15: "wedge15", 20: "hexahedron20"},
    r"(?:T[23]D|R2D)(\d)": {2: "line", 3: "line3"},
    r"B[23](\d)": {1: "line", 2: "line3"},
}
"""Pattern of element types -> number at the end of the type -> kind of cell."""
SIDES = {
    "triangle": ("01", "12", "20"),
    "quad": ("01", "12", "23", "30"),
    "tetra": ("012", "031", "132", "230"),
    "wedge": ("012", "354", "0143", "1254", "2035"),
    "hexahedron": ("0123", "4765", "0451", "1562", "2673", "3740"),
}
"""Kind of cell -> corners on the sides S1, S2 ..."""
REFUSED = "ELGEN", "ELCOPY", "NGEN", "NFILL", "NCOPY", "NMAP", "SYSTEM", "IMPORT"
KEYWORDS_WITH_FILES = "NODE", "ELEMENT", "NSET", "ELSET", "INCLUDE"
Block = tuple[str, dict[str, str], list[str]]  # keyword in capitals, options, lines of data


def read_abaqus(path: Path) -> Grid:
    """Read the cells and the named sets of a file."""
    deck = _Deck()
    for block in _blocks(path):
        deck.take(*block)
    for part in [name for name in deck.parts if name not in deck.placed]:
        deck.place(part, part)
    vertices = np.fromiter(chain.from_iterable(deck.rows), np.int64)
    sizes = np.array(list(map(len, deck.rows)), dtype=np.int64)
    points = np.array(deck.points, dtype=float).reshape(-1, 3)
    grid = keep_corners(Grid(points, np.array(deck.kinds, dtype=str), offsets_of(sizes), vertices))
    every = np.arange(len(deck.kinds))
    grid.sets = {name: np.isin(every, cells) for name, cells in deck.sets["ELSET"].items()}
    grid.nodes = {name: np.isin(np.arange(len(points)), nodes) for name, nodes in deck.sets["NSET"].items()}
    for name, sides in deck.sides.items():
        grid.parts[name] = offsets_of(np.array([len(side) for side in sides], dtype=np.int64)), np.concatenate(sides)
    instances = [] if deck.numbers["", "ELSET"] else list(dict.fromkeys(name for name, _ in deck.numbers if name))
    own = {name: np.isin(every, list(deck.numbers[name, "ELSET"].values())) for name in instances}
    grid.bodies = tuple(own or _largest(grid) or grid.sets)
    joined = {name: x for name, x in grid.sets.items() if sum((x & one).any() for one in own.values()) > 1}
    grid.sets |= own | {
        f"{of}.{name}": x & one for of, one in own.items() for name, x in joined.items() if (x & one).any()
    }
    if deck.unread:
        grid.notes = (*grid.notes, f"these parts of the file were not read: {', '.join(dict.fromkeys(deck.unread))}.")
    return grid


def _largest(grid: Grid) -> list[str]:
    """Return the names of sets that no larger set contains."""
    inner = grid.bounding[0]
    some = {name: x & inner for name, x in grid.sets.items() if (x & inner).any() and not x[inner].all()}
    order = sorted(some, key=lambda name: np.count_nonzero(some[name]))
    inside = {name for k, name in enumerate(order) for one in order[k + 1 :] if (some[name] <= some[one]).all()}
    return [name for name in some if name not in inside]


@dataclass
class _Deck:
    """The contents of the lines read so far."""

    points: list[list[float]] = field(default_factory=list)
    kinds: list[str] = field(default_factory=list)
    rows: list[list[int]] = field(default_factory=list)  # nodes of elements, as positions in `points`
    numbers: defaultdict[tuple[str, str], dict[int, int]] = field(default_factory=lambda: defaultdict(dict))
    """(instance or "", "NSET" or "ELSET") -> number in the file -> position in `points` or `kinds`."""
    sets: dict[str, dict[str, list[int]]] = field(default_factory=lambda: {"NSET": {}, "ELSET": {}})
    sides: dict[str, list[list[int]]] = field(default_factory=dict)  # surface -> nodes of sides
    parts: dict[str, list[Block]] = field(default_factory=dict)
    placed: set[str] = field(default_factory=set)  # parts that have an instance
    part: str = ""  # the part that is being defined
    scope: str = ""  # the instance that is being read
    moves: list[list[float]] = field(default_factory=list)  # translations (3,) and rotations (7,)
    spelt: dict[str, str] = field(default_factory=dict)  # name in capitals -> first spelling
    unread: list[str] = field(default_factory=list)

    def take(self, word: str, options: dict[str, str], lines: list[str]) -> None:
        """Read the data of a keyword, or raise MeshError."""
        strange = [name for name in ("SYSTEM", "LIBRARY") if options.get(name, "R").upper() != "R"]
        if word in REFUSED or (strange and word in ("NODE", "INSTANCE")):
            more = "".join(f", {name}={options[name]}" for name in strange)
            raise MeshError(f"its keyword *{word}{more} is not supported; write out all elements and Cartesian nodes.")
        rows = [[one.strip() for one in line.split(",")] for line in lines]
        if word in ("PART", "ENDPART"):
            self.part = self.spell(options.get("NAME", word)) if word == "PART" else ""
            self.parts |= {self.part: []} if self.part else {}
        elif self.part and word != "INSTANCE":  # a part without *END PART ends at the first instance
            self.parts[self.part].append((word, options, lines))
        elif word in ("NSET", "ELSET"):
            self._take_set(word, options, rows)
        elif word == "ENDINSTANCE":
            self.scope, self.moves = "", []
        elif taker := {
            "NODE": self._take_nodes,
            "ELEMENT": self._take_elements,
            "SURFACE": self._take_surface,
            "INSTANCE": self._take_instance,
        }.get(word):
            taker(options, rows)

    def place(self, part: str, name: str, moves: Iterable[list[float]] = ()) -> None:
        """Read a part as an instance, translated and rotated."""
        self.scope, self.moves, self.part = name, list(moves), ""
        self.placed.add(part)
        for block in self.parts.get(part, []):
            self.take(*block)

    def _take_nodes(self, options: Mapping[str, str], rows: list[list[str]]) -> None:
        known, places = self.numbers[self.scope, "NSET"], list[int]()
        x = np.array([[_real(one) for one in (*row, "", "", "")[1:4]] for row in rows], dtype=float).reshape(-1, 3)
        for move in self.moves:
            x = x + move if len(move) == 3 else _rotate(x, np.array(move))
        for (number, *_), at in zip(rows, x.tolist(), strict=True):
            places.append(known.setdefault(int(number), len(self.points)))
            self.points[places[-1] : places[-1] + 1] = [at]
        self._name("NSET", options.get("NSET", ""), places)

    def _take_elements(self, options: Mapping[str, str], rows: list[list[str]]) -> None:
        words = [one for row in rows for one in row if one]
        given = options.get("TYPE", "").upper()
        found = ((re.fullmatch(f"{pattern}[A-Z]*5?", given), kinds) for pattern, kinds in TYPES.items())
        kind = next((kinds.get(int(match[1]), "") for match, kinds in found if match), "")
        if not kind:
            self.unread.append(f"elements of the type {given}{f' in {self.scope}' if self.scope else ''}")
            return
        count = int(kind.strip(ascii_letters) or NODES[kind])
        if len(words) % (count + 1):
            raise MeshError(f"its elements of the type {given} do not all have {count} nodes.")
        (known, nodes), places = (self.numbers[self.scope, what] for what in ("ELSET", "NSET")), list[int]()
        for number, *row in np.array(words, dtype=np.int64).reshape(-1, count + 1).tolist():
            if lost := [node for node in row if node not in nodes]:
                raise MeshError(f"its element {number} has the node {lost[0]}, which does not exist.")
            known[number] = len(self.kinds)
            places.append(len(self.kinds))
            self.kinds.append(kind)
            self.rows.append([nodes[node] for node in row])
        self._name("ELSET", options.get("ELSET", ""), places)
        if kind in ("line", "line3") and words and "ELSET" not in options:
            self.unread.append(f"elements of the type {given} (lines without a name)")

    def _name(self, kind: str, name: str, places: Iterable[int]) -> None:
        if name:
            self.sets[kind].setdefault(self.spell(name), []).extend(places)

    def _take_set(self, kind: str, options: Mapping[str, str], rows: list[list[str]]) -> None:
        name, instance = options[kind], self.spell(options.get("INSTANCE", ""))
        if kind == "NSET" and "ELSET" in options:
            self.unread.append(f"the node set {self.spell(name)} of an element set")
        elif "GENERATE" in options:
            known = self.numbers[instance or self.scope, kind]
            for row in rows:
                first, last, step = (int(one or 1) for one in (*row, "", "")[:3])
                chosen = [n for n in known if first <= n <= last and (n - first) % (step or 1) == 0]
                self._name(kind, name, [known[n] for n in chosen])
        else:
            for word in (one for row in rows for one in row if one):
                self._name(kind, name, self._places(kind, word, instance, name))

    def _places(self, kind: str, word: str, instance: str, name: str) -> list[int]:
        """Return the positions of nodes or elements with a number or set name."""
        *inside, of = word.strip('"').split(".")
        instance = (self.spell(inside[0]) if inside else instance) or self.scope
        known = self.numbers[instance, kind]
        if of.isdigit():
            if kind == "NSET" and int(of) not in known:
                self.unread.append(f"nodes of {self.spell(name)} that do not exist")
            return [known[int(of)]] if int(of) in known else []
        if self.spell(of) not in self.sets[kind]:
            self.unread.append(f"the set {self.spell(of)} in {self.spell(name)} (there is no such set)")
            return []
        own = set(known.values())
        return [place for place in self.sets[kind][self.spell(of)] if not instance or place in own]

    def _take_surface(self, options: Mapping[str, str], rows: list[list[str]]) -> None:
        name, kind = self.spell(options["NAME"]), options.get("TYPE", "ELEMENT").upper()
        for target, label in ((*row, "")[:2] for row in rows):
            side = re.fullmatch(r"[SE]([1-6])", label.upper())
            if kind == "NODE" and "COMBINE" not in options:
                self._name("NSET", name, self._places("NSET", target, "", name))
            elif kind == "ELEMENT" and side and "COMBINE" not in options:
                for element in self._places("ELSET", target, "", name):
                    self.sides.setdefault(name, []).append(self._side(name, int(side[1]), element))
            else:
                self.unread.append(
                    f"the surface {name} ({', '.join(filter(None, (kind, target, label)))}; only sides S1, S2 ... of "
                    "elements, and node sets, are read)"
                )

    def _side(self, name: str, side: int, element: int) -> list[int]:
        sides = SIDES.get(kind := self.kinds[element].rstrip(DIGITS), ())
        if side > len(sides):
            raise MeshError(f"its surface {name!r} names the side S{side} of a {kind}, which does not exist.")
        return [self.rows[element][int(corner)] for corner in sides[side - 1]]

    def _take_instance(self, options: Mapping[str, str], rows: list[list[str]]) -> None:
        name, part = self.spell(options["NAME"]), self.spell(options.get("PART", ""))
        if part and part not in self.parts:
            raise MeshError(f"its instance {name} belongs to the part {part}, which does not exist.")
        lines = [",".join(row).rstrip(",").split(",") for row in rows]
        self.place(part, name, [[*map(_real, words), *[0.0] * (3 - len(words))] for words in lines])

    def spell(self, name: str) -> str:
        """Return the first spelling of a name, irrespective of case."""
        return self.spelt.setdefault(name.upper(), name)


def _real(word: str) -> float:
    """Return the value of a number such as 1.5D-3."""
    return float(word.upper().replace("D", "E") or 0)


def _rotate(x: Floats, axis: Floats) -> Floats:
    """Rotate points. `axis` (7,) has two points and an angle in degrees."""
    along, angle = (axis[3:6] - axis[:3]) / np.linalg.norm(axis[3:6] - axis[:3]), np.radians(axis[6])
    arm = x - axis[:3]
    kept = np.outer(arm @ along, along)
    return np.asarray(axis[:3] + kept + np.cos(angle) * (arm - kept) + np.sin(angle) * np.cross(along, arm))


def _lines(path: Path) -> Iterator[str]:
    """Yield the lines of a file and of included files, without comments."""
    for line in map(str.strip, path.read_bytes().decode("utf-8", "replace").splitlines()):
        word = line.partition(",")[0].lstrip("*").strip().upper()
        named = re.search(r"\bINPUT\s*=\s*\"?([^\",]+)", line, re.IGNORECASE) if word in KEYWORDS_WITH_FILES else None
        if line and not line.startswith("**") and word != "INCLUDE":
            yield line
        if named and line.startswith("*"):
            yield from _lines(path.parent / named[1].strip().replace("\\", "/"))


def _blocks(path: Path) -> Iterator[Block]:
    """Yield the blocks of a file."""
    head, data = "*", list[str]()
    for line in [*_lines(path), "*"]:
        if head.endswith(",") and not data and not line.startswith("*"):
            head += line  # after a comma, the keyword line continues on the next line
        elif not line.startswith("*"):
            data.append(line)
        else:
            word, *options = head[1:].split(",")
            pairs = [one.partition("=") for one in options]
            given = {name.replace(" ", "").upper(): value.strip().strip('"') for name, _, value in pairs}
            yield word.replace(" ", "").upper(), given, data
            head, data = line, []
