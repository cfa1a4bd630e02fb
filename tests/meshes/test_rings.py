"""Rings, discs, tubes and cylinders."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import mostly_long

import vemcvx as vx
from vemcvx.meshes import ring

TURN = 2 * np.pi


@pytest.mark.parametrize("radii", [[0.0, 1.0], [0.0, 0.5, 1.5], [0.4, 1.0], [0.4, 0.6, 1.0]])
@pytest.mark.parametrize("angles", [(0.0, TURN), (-0.3, 1.9), (1.0, 1.0 + 1.5 * np.pi), (0.0, np.pi / 2)])
def test_a_ring_has_the_area_and_the_sides_of_its_polygons(radii, angles):
    s, is_whole = 7, np.isclose(angles[1] - angles[0], TURN)
    mesh, step = ring(radii, s, angles=angles), (angles[1] - angles[0]) / s
    area = s * np.sin(step) / 2 * (radii[-1] ** 2 - radii[0] ** 2)
    assert mesh.areas.sum() == pytest.approx(area, rel=1e-13)
    assert mesh.n_cells == s * (len(radii) - 1)
    sides = {"outer": s} | ({} if radii[0] == 0 else {"inner": s})
    sides |= {} if is_whole else {"first": len(radii) - 1, "last": len(radii) - 1}
    assert {name: len(edges) for name, edges in mesh.boundaries.items()} == sides | {"boundary": sum(sides.values())}
    for name, radius in (("outer", radii[-1]), ("inner", radii[0])):
        if name in sides:
            at = np.linalg.norm(mesh.points[np.unique(mesh.boundaries[name])], axis=1)
            assert at == pytest.approx(radius, rel=1e-14)
    for name, angle in (("first", angles[0]), ("last", angles[1])):
        if name in sides:
            at = mesh.points[np.unique(mesh.boundaries[name])]
            assert at @ [-np.sin(angle), np.cos(angle)] == pytest.approx(0.0, abs=1e-14)
            assert (at @ [np.cos(angle), np.sin(angle)] >= -1e-15).all()
    vx.PolygonMesh(mesh.points, mesh.cells)  # raises an error if the mesh is invalid
    if angles == (0.0, np.pi / 2):
        for name, axis in (("first", 1), ("last", 0)):
            assert (mesh.points[np.unique(mesh.boundaries[name]), axis] == 0).all()


@mostly_long("radii, kinds", [([0.5, 1.0], {6}), ([0.0, 0.5, 1.0], {5, 6})], 1)
def test_prisms_over_rings_are_tubes_and_cylinders(radii, kinds):
    """Cells are hexahedra or wedges. Conversion to meshio and back keeps the nodes."""
    solid = ring(radii, 8).extruded([0.0, 0.5, 1.0])
    assert set(np.diff(solid.cell_offsets)) == kinds
    assert {"outer", "bottom", "top"} <= set(solid.boundaries)
    again = vx.meshes.convert(solid.to("meshio"))
    assert np.array_equal(again.points, solid.points)
    assert again.n_cells == solid.n_cells


def test_invalid_rings_are_refused():
    for make, subject in (
        (lambda: ring([1.0], 4), r"^ring: radii must be .* got \[1\.0\]"),
        (lambda: ring([-1.0, 1.0], 4), "^ring: radii must be"),
        (lambda: ring([0, 1e61], 9), r"^ring: radii must be .* from 0 to 1e\+60; got"),
        (lambda: ring([0, 1], 9, angles=(0.0, 7.0)), "^ring: angles must be"),
        (lambda: ring([0, 1], 1, angles=(0.0, np.pi)), "^sectors must be .* at least 2"),
    ):
        with pytest.raises(vx.MeshError, match=subject):
            make()
