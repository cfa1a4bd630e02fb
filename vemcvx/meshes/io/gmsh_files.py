"""Gmsh's files: what is checked before meshio reads one, because it believes all counts and numbers of nodes.

It makes arrays of as many entries as the file claims, and one of as many as the largest number of a node: nine digits
are gigabytes. Kept is what a section has room for.
"""

from __future__ import annotations

import re

import numpy as np

from vemcvx.errors import MeshError

FORMAT = re.compile(rb"\$MeshFormat\s+(\S+)\s+1\s")  # of binary files, and their version
SECTION = re.compile(rb"^\$(Nodes|Elements|NodeData|ElementData|ElementNodeData)[ \t\r]*\n", re.MULTILINE)
LONG = re.compile(rb"(?<![\d.eE+-])\d{9,}(?![\d.eE])")
LARGEST = 10**8
NODES = {1: 2, 2: 3, 3: 4, 4: 4, 5: 8, 6: 6, 7: 5, 15: 1}
"""Of Gmsh's types of elements, those of first order."""


def check_gmsh(data: bytes) -> None:
    """MeshError if a section claims more than the file has room for, or numbers nodes by more than eight digits."""
    if not data[:100].lstrip().startswith(b"$"):
        raise MeshError("it does not begin as Gmsh's files do, with $MeshFormat.")
    binary = FORMAT.search(data[:10_000])
    for head in SECTION.finditer(data):
        name, at = head.group(1).decode(), head.end()
        if name.endswith("Data"):
            _check_tags(name, data[at:].splitlines(), len(data))
        elif binary and binary[1].startswith(b"4"):
            _check_blocks(name, data, at, newest=binary[1] != b"4.0")
        else:
            end = data.find(b"$End", at)
            _check_count(name, data[at:].split(b"\n", 1)[:1], len(data), "entries")
            long = None if binary else LONG.search(data, at, end if end >= 0 else len(data))
            if long:
                raise _too_large(name, int(long[0][:30]))


def _check_blocks(name: str, data: bytes, at: int, *, newest: bool) -> None:
    """Of a binary file of version 4: blocks of one entity each, which say how many entries they have."""
    blocks, count = np.frombuffer(data, "<u8", 2, at).tolist()
    _check_room(name, max(blocks, count), len(data), "entries")
    at += 32 if newest else 16
    for _ in range(blocks):
        kind, count = (int.from_bytes(data[at + i : at + j], "little") for i, j in ((8, 12), (12, 20)))
        _check_room(name, count, len(data), "entries")
        at += 20
        if name == "Nodes":
            numbers = (
                np.frombuffer(data, "<u8", count, at) if newest else np.frombuffer(data, "<i4", 7 * count, at)[::7]
            )
            if numbers.max(initial=0) >= LARGEST:
                raise _too_large(name, int(numbers.max()))
            at += count * (32 if newest else 28)
        elif kind in NODES:
            at += count * (1 + NODES[kind]) * (8 if newest else 4)
        else:
            raise MeshError(f"it holds elements of Gmsh's type {kind}; export elements of first order.")


def _check_tags(name: str, lines: list[bytes], most: int) -> None:
    """The counts of words and numbers before data, and that of the data."""
    place = 0
    for kind in ("strings", "reals", "integers"):
        count = _check_count(name, lines[place : place + 1], len(lines), kind)
        if kind == "integers":
            _check_count(name, lines[place + 3 : place + 4], most, "entries")
        place += count + 1


def _check_count(name: str, line: list[bytes], most: int, what: str) -> int:
    """The number on a line, 0 if there is none: the reader then says what is wrong."""
    word = line[0].strip() if line else b""
    count = int(word[:30]) if word.isdigit() else 0
    _check_room(name, count, most, what)
    return count


def _check_room(name: str, count: int, most: int, what: str) -> None:
    if count > most:
        raise MeshError(f"its section ${name} claims {count} {what}; there is room for {most}.")


def _too_large(name: str, number: int) -> MeshError:
    return MeshError(
        f"its section ${name} has the number {number}; nodes and elements have less than {LARGEST:,}: renumber them."
    )
