"""Hostile mesh files: whatever is in them, reading gives a mesh or a MeshError, soon, and in little memory."""

from __future__ import annotations

import resource
import subprocess
import sys
import textwrap
import warnings
from pathlib import Path

import numpy as np
import polydata
import pytest

import vemcvx as vx

ROOT = Path(vx.__file__).parent.parent
SOUND = {".vtu": vx.meshes.voronoi, ".vtk": vx.meshes.hexagons}
SOUND |= dict.fromkeys(
    (".msh", ".obj", ".inp", ".ply", ".bdf", ".mesh", ".vol", ".dat", ".mdpa", ".avs"), vx.meshes.triangles
)
POLYDATA = {
    ".vtp": polydata.xml,
    ".appended.vtp": lambda mesh: polydata.xml(mesh, appended=True),
    ".old.vtk": lambda mesh: polydata.legacy(mesh, "4.2"),
    ".new.vtk": lambda mesh: polydata.legacy(mesh, "5.1"),
}
SPACE = {".kelvin.vtu": vx.meshes.kelvin, ".tetrahedra.msh": vx.meshes.tetrahedra, ".cubes.vtk": vx.meshes.cubes}
SOUND |= POLYDATA | SPACE | {".theirs.vtu": None}
MEMORY = 3 * 2**30
SECONDS = 20
"""For a batch of files; a sound one takes milliseconds."""

STRANGE = (b"1000000000000", b"-1", b"nan", b"inf", b"1e400", b"99999999999999999999", b"", b"\xff\xfe")
READER = textwrap.dedent(
    """
    import resource, sys, warnings
    from pathlib import Path
    resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[1]),) * 2)
    import vemcvx as vx
    warnings.simplefilter("ignore")
    for path in sys.argv[2:]:
        print("reading", path, flush=True)
        try:
            vx.meshes.read(path)
        except vx.MeshError as error:
            assert str(error).startswith(path), error
    print("done")
    """
)


def read_all(paths):
    """Read files in a process of their own, with little memory and little time."""
    command = [sys.executable, "-c", READER, str(MEMORY), *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, cwd=ROOT, check=False)
    assert done.stdout.endswith("done\n"), f"{done.stdout[-300:]}\n{done.stderr[-1500:]}"


def sound(suffix, folder):
    if suffix == ".theirs.vtu":
        return polydata.POLYHEDRA.encode()
    if suffix in POLYDATA:
        return POLYDATA[suffix](vx.meshes.voronoi(2))
    path = folder / f"sound{suffix}"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        SOUND[suffix](1 if suffix in SPACE else 2).write(path)
    return path.read_bytes()


def mutated(data, rng):
    """One of the ways in which files go wrong."""
    at, kind = int(rng.integers(len(data))), rng.integers(7)
    if kind == 0:
        return data[:at]
    if kind == 1:
        return data[:at] + bytes([rng.integers(256)]) + data[at + 1 :]
    if kind == 2:
        lines = data.split(b"\n")
        i, j = rng.integers(len(lines), size=2)
        lines[i], lines[j] = lines[j], lines[i]
        return b"\n".join(lines)
    if kind == 3:
        return data[:at] + data[at // 2 :]
    words = data.split(b" ")
    i = int(rng.integers(len(words)))
    words[i] = STRANGE[rng.integers(len(STRANGE))]
    if kind == 4:
        return b" ".join(words)
    if kind == 5:
        return data[:at] + bytes(rng.integers(256, size=16).tolist()) + data[at:]
    digits = [k for k, c in enumerate(data) if 48 <= c <= 57]
    if not digits:
        return b""
    k = digits[int(rng.integers(len(digits)))]
    return data[:k] + bytes([48 + rng.integers(10)]) * int(rng.integers(1, 14)) + data[k + 1 :]


def broken(suffix, folder, count, seed):
    """Paths of mutated files."""
    rng = np.random.default_rng(seed)
    data, paths = sound(suffix, folder), [folder / f"broken{k}{suffix}" for k in range(count)]
    for path in paths:
        path.write_bytes(mutated(data, rng))
    return paths


def test_hostile_files(tmp_path):
    read_all([path for suffix in SOUND for path in broken(suffix, tmp_path, 12, seed=0)])


@pytest.mark.slow
@pytest.mark.parametrize("suffix", SOUND)
def test_many_hostile_files(suffix, tmp_path):
    paths = broken(suffix, tmp_path, 250, seed=1)
    for start in range(0, len(paths), 50):
        read_all(paths[start : start + 50])


BOMB = (
    b'<?xml version="1.0"?><!DOCTYPE b [<!ENTITY a "aaaaaaaaaa">'
    + b"".join(b'<!ENTITY %c "%s">' % (98 + k, b"&%c;" % (97 + k) * 10) for k in range(9))
    + b']><VTKFile type="UnstructuredGrid">&j;</VTKFile>'
)


@pytest.mark.parametrize("suffix", SOUND)
@pytest.mark.parametrize(
    "data",
    [b"", b"\n" * 1000, b"\x00" * 5000, BOMB, b"<" * 100_000, b"$MeshFormat\n4.1 0 8\n$EndMeshFormat\n", b"9" * 4000],
    ids=["empty", "blank", "zeros", "bomb", "brackets", "header", "digits"],
)
def test_files_of_nothing(suffix, data, tmp_path):
    path = tmp_path / f"nothing{suffix}"
    path.write_bytes(data)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(vx.MeshError, match="nothing"):
        vx.meshes.read(path)
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 400_000


def test_what_is_no_file(tmp_path):
    for path in (tmp_path, tmp_path / "missing.vtu", tmp_path / "missing" / "mesh.vtk"):
        with pytest.raises(vx.MeshError):
            vx.meshes.read(path)
