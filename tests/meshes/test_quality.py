"""Quality of cells: radii of star-shapedness and shortest edges against closed forms and linear programs."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scenes import mostly_long
from scipy.optimize import linprog

import vemcvx as vx
from vemcvx.meshes.quality import LEAST_EDGE, LEAST_STAR

EVERY = {**vx.meshes.FAMILIES, **vx.meshes.SPACE_FAMILIES}


def make_polygon(n, aspect=1.0):
    """Return a regular polygon in the unit circle, stretched along x."""
    angle = 2 * np.pi * np.arange(n) / n
    return vx.PolygonMesh(np.column_stack([aspect * np.cos(angle), np.sin(angle)]), [range(n)])


def test_regular_polygons_have_the_quality_of_closed_forms():
    """Divide the inradius cos(pi / n) of an n-gon by its diameter, 2 for even n and 2 cos(pi / 2n) for odd n."""
    for n in (3, 4, 5, 6, 7, 12, 40):
        h = 2.0 if n % 2 == 0 else 2 * np.cos(np.pi / (2 * n))
        found = make_polygon(n).quality()
        assert found.star[0] == pytest.approx(np.cos(np.pi / n) / h, rel=1e-8)
        assert found.edge[0] == pytest.approx(2 * np.sin(np.pi / n) / h, rel=1e-12)


@pytest.mark.parametrize("a", [1.0, 3.0, 10.0, 1e4])
def test_boxes_have_the_quality_of_closed_forms(a):
    """Compare `star` with half the shortest side over the diagonal, and `edge` with twice this ratio."""
    for make, box in ((vx.meshes.squares, [(0, a), (0, 1)]), (vx.meshes.cubes, [(0, a), (0, 1), (0, 2 * a)])):
        mesh = make((1,) * len(box), box)
        diagonal = np.linalg.norm(np.diff(box, axis=1))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            found = mesh.quality()
        assert found.star[0] == pytest.approx(0.5 / diagonal, rel=1e-7, abs=1e-9)
        assert found.edge[0] == pytest.approx(1 / diagonal, rel=1e-12)


def solve_for_star(mesh, cell):
    """Return the radius of the largest ball in the half spaces of all sides, divided by the diameter of the cell."""
    if isinstance(mesh, vx.PolygonMesh):
        x = mesh.points[mesh.vertices[mesh.offsets[cell] : mesh.offsets[cell + 1]]]
        along = np.roll(x, -1, axis=0) - x
        normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    else:
        places = slice(mesh.cell_offsets[cell], mesh.cell_offsets[cell + 1])
        faces = mesh.cell_faces[places]
        x, normals = mesh.face_centroids[faces], mesh.face_signs[places][:, None] * mesh.face_normals[faces]
    dim = x.shape[1]
    away = np.einsum("ni,ni->n", normals, x - mesh.centroids[cell])
    rows = np.column_stack([normals, np.ones(len(x))])
    found = linprog([*np.zeros(dim), -1.0], A_ub=rows, b_ub=away, bounds=[(None, None)] * (dim + 1))
    return max(found.x[-1], 0.0) / mesh.diameters[cell]


@mostly_long("family", EVERY, "nonconvex", "hanging", "triangles", "tetrahedra", "prisms")
def test_families_have_the_quality_of_a_linear_program_and_no_poor_cell(family):
    mesh = EVERY[family](6 if family in vx.meshes.FAMILIES else 2)
    found = mesh.quality()
    for cell in range(0, mesh.n_cells, max(1, mesh.n_cells // 8)):
        assert found.star[cell] == pytest.approx(solve_for_star(mesh, cell), rel=1e-6)
    assert not found.poor.any()


CROWN = [[0, 0], [1, 0], [1, 1], [0.9, 1], [0.9, 0.1], [0.1, 0.1], [0.1, 1], [0, 1]]


def test_cells_of_poor_quality_are_reported_with_a_warning():
    """Use a hexagon stretched by ten, a cell that is not star-shaped, and a cell with an edge of 1e-5."""
    with pytest.warns(vx.MeshWarning, match=r"grow in 1 of 1 cells, .*star below 0.05; least 0\.043, cell 0"):
        found = make_polygon(6, 10.0).quality()
    assert found.star[0] == pytest.approx(np.sqrt(3) / 40, rel=1e-8)
    with pytest.warns(vx.MeshWarning, match="least 0, cell 0"):
        assert vx.PolygonMesh(CROWN, [range(8)]).quality().star[0] == 0.0
    cut = 1e-5 / np.sqrt(2)
    with pytest.warns(vx.MeshWarning, match=r"edges below 0.0001 of their diameter \(least 7.1e-06, cell 0"):
        found = vx.PolygonMesh([[0, 0], [1, 0], [1, 1 - cut], [1 - cut, 1], [0, 1]], [range(5)]).quality()
    assert found.edge[0] == pytest.approx(1e-5 / np.sqrt(2), rel=1e-4)
    assert found.poor.tolist() == [True]


@pytest.mark.long
@pytest.mark.filterwarnings("ignore::vemcvx.MeshWarning")
@pytest.mark.parametrize("aspect", [1.0, 10.0])
def test_cells_below_the_threshold_have_large_stability_constants(aspect):
    """Compare with the spectrum of the stabilisation relative to the energy, for a regular and a stretched hexagon."""
    import stabilisation_spectrum as spectrum

    least, greatest, _ = spectrum.spectrum(spectrum.hexagon(aspect))
    assert (greatest / least > 70) == (make_polygon(6, aspect).quality().star[0] < LEAST_STAR)
    assert LEAST_EDGE < 1e-3
