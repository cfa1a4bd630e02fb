"""Pictures of meshes: what is drawn, without a display, and clear words where it cannot be."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

import vemcvx as vx

pytest.importorskip("matplotlib")


@pytest.fixture
def mesh():
    return vx.meshes.hanging((2, 3), ((0.0, 2.0), (0.0, 3.0)), seed=1)


def polygons(ax):
    return [path.vertices[:-1] for path in ax.collections[0].get_paths()]


def test_draws_every_cell(mesh):
    drawn = polygons(mesh.plot())
    assert len(drawn) == mesh.n_cells
    for polygon, cell in zip(drawn, mesh.cells, strict=True):
        np.testing.assert_array_equal(polygon, mesh.points[cell])


def test_draws_displaced(mesh):
    drawn = polygons(mesh.plot(displacement=np.full((mesh.n_nodes, 2), 0.5)))
    np.testing.assert_array_equal(drawn[0], mesh.points[mesh.cells[0]] + 0.5)


@pytest.mark.parametrize("by_name", [False, True])
def test_colours_by_values(mesh, by_name):
    mesh = mesh.with_cell_data("size", mesh.areas)
    ax = mesh.plot("size" if by_name else mesh.areas, cmap="plasma", ec="black", lw=2.0)
    np.testing.assert_array_equal(ax.collections[0].get_array(), mesh.areas)
    assert ax.collections[0].get_cmap().name == "plasma"
    assert ax.collections[0].get_linewidth() == [2.0]


def test_whole_mesh_is_in_view_and_true_to_scale(mesh):
    ax = mesh.plot()
    assert ax.get_aspect() == 1.0
    (left, right), (bottom, top) = ax.get_xlim(), ax.get_ylim()
    assert left <= 0.0 < 2.0 <= right
    assert bottom <= 0.0 < 3.0 <= top


@pytest.mark.long
def test_draws_on_given_axes_and_saves(mesh, tmp_path):
    ax = mesh.plot(mesh.areas)
    assert mesh.plot(ax=ax) is ax
    assert len(ax.collections) == 2
    ax.figure.savefig(tmp_path / "mesh.png", dpi=20)
    assert (tmp_path / "mesh.png").read_bytes()[1:4] == b"PNG"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"values": np.ones(3)}, r"must hold one number .* for each of the \d+ cells; got float64 of shape \(3,\)"),
        ({"values": "young"}, "there is no cell datum 'young'; this mesh has size"),
        ({"values": "pairs"}, "there is no cell datum 'pairs'"),
        ({"displacement": np.ones((3, 2))}, r"displacement must be numbers of the shape \(\d+, 2\)"),
    ],
)
def test_misfits(mesh, options, message):
    with pytest.raises(vx.MeshError, match=message):
        mesh.with_cell_data("size", mesh.areas).plot(**options)


def test_vectors_are_no_colours(mesh):
    with pytest.raises(vx.MeshError, match="one number a cell"):
        mesh.plot(np.ones((mesh.n_cells, 2)))


def test_without_matplotlib(mesh, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(vx.VemcvxError, match=r"pip install 'vemcvx\[plot\]'"):
        mesh.plot()


@pytest.mark.long
def test_pyplot_stays_out():
    code = (
        "import sys, vemcvx as vx; vx.meshes.squares(2).plot([1, 2, 3, 4]); print('matplotlib.pyplot' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"
