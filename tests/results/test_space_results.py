"""Results in space: tables, programs with discs, reactions of what is dragged; what exists in the plane only."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hysteresis_in_space import BOUND, BOX, SIZE, curve
from identical import same
from solids import SOLIDS, solid

import vemcvx as vx
from vemcvx import plots
from vemcvx.results import places
from vemcvx.results.files import read_archive, write_archive

AREA = SIZE[0] * SIZE[1]
ONLY = "exists in the plane only, and this mesh consists of polyhedra"


@pytest.fixture(scope="module")
def history():
    path = curve()
    return vx.simulate(path.scene(), vx.meshes.prisms(2, BOX), path.times)


def test_tables_have_a_column_for_each_axis(history):
    table = history.table("contact")
    count = len(history.stored) * len(history.contact.nodes)
    for name in ("slip", "traction", "normal"):
        assert [len(table[f"{name}_{axis}"]) for axis in "xyz"] == [count] * 3
    assert np.array_equal(table["slip_z"], history.contact.slip[:, :, 2].ravel())
    assert history.summary().startswith(f"{history.mesh.n_cells} cells, {history.mesh.n_nodes} nodes")


@pytest.mark.long
def test_programs_have_discs_that_other_solvers_take(history):
    program = history.program(3)
    assert program.operators.block == 2
    posed = program.to_cvxpy()
    posed.problem.solve(solver="CLARABEL")
    assert program.certify(posed.d.value, posed.lam, posed.p).error < 1e-3


def test_friction_against_what_drags_a_block_is_a_reaction_of_the_side_that_drags(history):
    """A block pulled by a side, which moves nodes of the floor, too: the floor's friction is all that it takes."""
    pulled = vx.Scene(
        vx.Elasticity(200.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: t, on="left", direction=(1.0, 0.0, 0.0)),
        vx.Symmetry(on="front"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(BOUND, on="bottom"),
    )
    run = vx.simulate(pulled, history.mesh, [0.0, 1.0, 2.0])
    assert not run.contact.sticking[-1].any()
    assert run.reaction("left")[-1, 0] == pytest.approx(BOUND * AREA, rel=1e-6)
    assert run.force(vx.TrescaFriction)[-1, 0] == pytest.approx(-BOUND * AREA, rel=1e-6)


@pytest.mark.long
def test_runs_in_a_folder_and_resumes(history, tmp_path):
    path = curve()
    vx.simulate(path.scene(), history.mesh, path.times, stream=tmp_path / "run")
    again = vx.simulate(path.scene(), history.mesh, path.times, stream=tmp_path / "run", resume=True)
    assert np.array_equal(again.displacement, history.displacement)
    assert np.array_equal(again.contact.traction, history.contact.traction)


@pytest.mark.long
def test_the_archive_keeps_every_bit(history, tmp_path):
    swollen = vx.Scene(*path_free(history), vx.ThermalStrain(1e-4, lambda x, t: t * x[:, 2]))
    run = vx.simulate(swollen, history.mesh.with_cell_data("zone", np.arange(history.mesh.n_cells)), [0.0, 1.0])
    write_archive(run, tmp_path / "history.npz")
    read = read_archive(tmp_path / "history.npz")
    for name in run.mesh.ARRAYS:
        assert np.array_equal(getattr(read.mesh, name), getattr(run.mesh, name)), name
    assert same(dict(read.mesh.boundaries), dict(run.mesh.boundaries))
    assert same(read.mesh.cell_data, run.mesh.cell_data)
    for field in dataclasses.fields(read):
        if field.name not in ("mesh", "scene"):
            assert same(getattr(read, field.name), getattr(run, field.name)), field.name
    assert np.array_equal(read.stress(-1), run.stress(-1))
    assert np.array_equal(read.reaction("top"), run.reaction("top"))


def path_free(history):
    """The block with its top at rest."""
    held = vx.Clamp(on="top"), vx.BilateralContact(on="bottom"), vx.TrescaFriction(BOUND, on="bottom")
    return (*(effect for effect in history.scene if isinstance(effect, vx.Elasticity)), *held)


USUAL = "voronoi3", "hanging faces"


@pytest.fixture(params=[pytest.param(name, marks=[] if name in USUAL else [pytest.mark.slow]) for name in SOLIDS])
def mesh(request):
    return solid(request.param, 2, BOX)


def test_probes_are_exact_for_linear_fields_and_at_nodes(mesh, history):
    gradient, shift = np.array([[0.3, -1.2, 0.4], [0.7, 0.4, 0.1], [-0.2, 0.5, 0.6]]), np.array([5.0, -2.0, 1.0])
    u = mesh.points @ gradient.T + shift
    inside = np.random.default_rng(1).uniform(size=(100, 3)) * SIZE
    edges = 0.3 * mesh.points[mesh.face_vertices[:-1]] + 0.7 * mesh.points[mesh.face_vertices[1:]]
    for x in (inside, mesh.centroids, mesh.face_centroids, edges, SIZE * [[1.0, 0.1 + 0.2, 0.5]]):
        at = places(mesh, x, "test")
        assert np.abs(at.at_nodes(u[None])[0] - (x @ gradient.T + shift)).max() < 1e-14 * 20
    at = places(mesh, mesh.centroids, "test")
    assert np.array_equal(at.at_cells(np.arange(mesh.n_cells)), np.arange(mesh.n_cells))
    rough = np.random.default_rng(2).normal(size=(1, mesh.n_nodes, 3))
    assert np.array_equal(places(mesh, mesh.points, "test").at_nodes(rough), rough)
    # Between the nodes of an edge a function is linear, whatever it does elsewhere.
    first, second = mesh.face_vertices[mesh.face_offsets[:-1]], mesh.face_vertices[mesh.face_offsets[:-1] + 1]
    x = 0.3 * mesh.points[first] + 0.7 * mesh.points[second]
    found = places(mesh, x, "test").at_nodes(rough)
    assert np.abs(found - (0.3 * rough[:, first] + 0.7 * rough[:, second])).max() < 1e-13


def test_probes_lines_and_tables_of_a_run(history):
    path = curve()
    x = np.array([[0.5, 0.6, 0.45], [0.2, 0.1, 0.0]])
    exact = path.displacement(x)
    assert np.abs(history.probe(x) - exact).max() < 1e-8
    arc, values = history.along([0.1, 0.1, 0.0], [0.1, 0.1, 0.9], count=4)
    assert arc == pytest.approx([0.0, 0.3, 0.6, 0.9])
    assert np.abs(values - path.displacement(np.column_stack([np.full((4, 2), 0.1), arc]))).max() < 1e-8
    stress = history.along([0.1, 0.1, 0.1], [0.5, 0.5, 0.5], count=3, field="stress").values
    assert stress.shape == (len(history.stored), 3, 6)
    assert list(history.table("probes", x))[3:] == ["x", "y", "z", "displacement_x", "displacement_y", "displacement_z"]


@pytest.mark.parametrize("x", [[9.0, 9.0, 9.0], [0.5, 0.5, -1e-6]])
def test_a_probe_outside_says_so(history, x):
    with pytest.raises(vx.SceneError, match=r"^probe: point 1 at .* lies outside the body; .* inside the polyhedra"):
        history.probe([[0.5, 0.5, 0.5], x])


PLANE_ONLY = {
    "history: out_of_plane_stress": lambda h: h.out_of_plane_stress(1),
    "deformed_mesh": lambda h: plots.deformed_mesh(h),
    "friction_traction": lambda h: plots.friction_traction(h),
    "stick_slip_map": lambda h: plots.stick_slip_map(h),
    "wear": lambda h: plots.wear(h),
    "stressed_body": lambda h: plots.stressed_body(h),
}


@pytest.mark.parametrize("name", PLANE_ONLY)
def test_what_exists_in_the_plane_only_says_so(history, name):
    with pytest.raises(vx.SceneError, match=f"^{name}: {ONLY}"):
        PLANE_ONLY[name](history)
