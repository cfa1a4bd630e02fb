"""Hostile mesh files: whatever is in them, reading gives a mesh or a MeshError, soon, and in little memory."""

from __future__ import annotations

import resource
import warnings

import numpy as np
import polydata
import pytest
from hostile import mutated, read_all

import vemcvx as vx

SOUND = {".vtu": vx.meshes.voronoi, ".vtk": vx.meshes.hexagons}
SOUND |= dict.fromkeys((".msh", ".inp", ".bdf", ".nas", ".fem"), vx.meshes.triangles)
POLYDATA = {
    ".vtp": polydata.xml,
    ".appended.vtp": lambda mesh: polydata.xml(mesh, appended=True),
    ".old.vtk": lambda mesh: polydata.legacy(mesh, "4.2"),
    ".new.vtk": lambda mesh: polydata.legacy(mesh, "5.1"),
}
SPACE = {".kelvin.vtu": vx.meshes.kelvin, ".tetrahedra.msh": vx.meshes.tetrahedra, ".cubes.vtk": vx.meshes.cubes}
SOUND |= POLYDATA | SPACE | {".theirs.vtu": None}


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


def broken(suffix, folder, count, seed):
    """Paths of mutated files."""
    rng = np.random.default_rng(seed)
    data, paths = sound(suffix, folder), [folder / f"broken{k}{suffix}" for k in range(count)]
    for path in paths:
        path.write_bytes(mutated(data, rng))
    return paths


@pytest.mark.long
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
