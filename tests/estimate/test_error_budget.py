"""The error budget: estimates of mesh errors on all mesh families, certified errors of the solver, and refusals."""

from __future__ import annotations

import numpy as np
import pytest
from scenes import FAMILIES, OF_TRIANGLES, few_families, mostly_slow, paper_scene, small

import manufactured_full_slip as full_slip
import vemcvx as vx
from vemcvx.estimate.budget import error_budget

pytestmark = pytest.mark.arithmetic

LEAST, MOST = 1.0, 5.0
"""Bounds of the effectivity, (estimated total) / (true error)."""


def measure_effectivity(poisson, family, n):
    lam = full_slip.lame(poisson)
    scene = full_slip.scene(poisson, pulled=poisson > 0.4)
    # Near incompressibility, rounding limits the accuracy.
    solver = vx.Newton(accuracy=1e-6 if poisson > 0.49 else 1e-8)
    history = vx.simulate(scene, full_slip.mesh(n, family), np.linspace(0, 1, 9), store="last", solver=solver)
    true = vx.measures.energy_error(history, lambda x, t: full_slip.strain(x[:, 0], x[:, 1], t, lam))
    budget = error_budget(history)
    assert budget.time[-1] <= 1e-10, "steps are exact for data proportional to time"
    return budget.largest["total"] / true.relative


@pytest.mark.long
@few_families
@pytest.mark.parametrize(
    ("poisson", "sizes"),
    [(0.3, (8,)), *(pytest.param(nu, (6, 12, 24, 48), marks=pytest.mark.slow) for nu in (0.0, 0.3, 0.4999995))],
)
def test_effectivity_on_manufactured_full_slip(family, poisson, sizes):
    """Linear triangles lock near incompressibility, and are left out."""
    if family in OF_TRIANGLES and poisson > 0.4:
        return
    found = [measure_effectivity(poisson, family, n) for n in sizes]
    assert min(found) >= LEAST
    assert max(found) <= MOST
    # The effectivity hardly depends on h.
    assert max(found) / min(found) < 1.5


def crossed_squares(n):
    """Return a mesh of squares that both diagonals cut into triangles."""
    grid = vx.meshes.squares(n)
    corner = np.concatenate([[[cell[k], cell[(k + 1) % 4]] for k in range(4)] for cell in grid.cells])
    cells = np.column_stack([corner, np.repeat(grid.n_nodes + np.arange(grid.n_cells), 4)])
    mesh = vx.PolygonMesh(np.vstack([grid.points, grid.centroids]), cells)
    for k, (name, edge) in enumerate({"left": 0.0, "right": 1.0, "bottom": 0.0, "top": 1.0}.items()):
        mesh = mesh.with_boundary(name, lambda x, axis=k // 2, edge=edge: np.abs(x[:, axis] - edge) < 1e-9)
    return mesh


@mostly_slow("name", ["crossed squares", *FAMILIES])
@pytest.mark.long
def test_effectivity_on_the_paper_scene(name):
    mesh = crossed_squares(8) if name == "crossed squares" else small(name, 8)
    truth = vx.simulate(paper_scene(), vx.meshes.squares(96), np.linspace(0, 1, 3), store="last")
    history = vx.simulate(paper_scene(), mesh, np.linspace(0, 1, 17), store="last")
    true = vx.measures.energy_distance(history, truth).relative
    assert LEAST <= error_budget(history).largest["total"] / true <= MOST


@pytest.mark.long
def test_the_error_of_the_solver_is_certified():
    loose = vx.simulate(paper_scene(), vx.meshes.squares(4), np.linspace(0, 1, 9), solver=vx.Clarabel(accuracy=1e-3))
    budget = error_budget(loose)
    assert budget.algebra[-1] == pytest.approx(loose.certificate_total[-1])
    assert budget.algebra[-1] > 1e-9
    assert budget.total == pytest.approx(budget.algebra + budget.space + budget.time)


@pytest.mark.long
def test_squared_errors_of_parts_and_of_cells_add_up():
    budget = error_budget(vx.simulate(paper_scene(), small("voronoi", 4), [0.0, 1.0]))
    assert set(budget.parts) == {"volume", "jumps", "boundary", "stabilisation", "data"}
    assert np.sqrt(sum(part[0] ** 2 for part in budget.parts.values())) == pytest.approx(budget.space[0])
    assert np.sqrt((budget.cells**2).sum()) == pytest.approx(budget.space[0])


PRESS = vx.Traction((0.0, -2.0), on="top")
ROLLERS = vx.Elasticity(young=200.0, poisson=0.0), vx.Symmetry(on=["left", "right"]), PRESS
STEEL = vx.Elasticity(young=200.0, poisson=0.3)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:supports. nothing but friction or one-sided contact")
@pytest.mark.parametrize(
    "effects",
    [
        (STEEL, vx.Symmetry(on=["left", "bottom"]), vx.Traction((3.0, 0.0), on="right"), vx.Pressure(-2.0, on="top")),
        (*ROLLERS, vx.ElasticFoundation(normal=50.0, on="bottom")),
        (*ROLLERS, vx.UnilateralContact(on="bottom")),
    ],
)
def test_constant_stress_leaves_no_residual_on_any_family(effects):
    """The body is pulled uniformly, or pressed on springs or on a rigid floor."""
    for family in FAMILIES:
        history = vx.simulate(vx.Scene(*effects), small(family, 4), [0.0, 1.0], initial="settled")
        assert history.energy[-1] > 0
        assert error_budget(history).space.max() < 1e-12


def test_a_body_that_supports_hold_at_rest_against_a_constant_traction_has_no_error():
    """The energy is zero, so rounding of tractions would be a relative error of 1."""
    scene = vx.Scene(vx.Elasticity(100.0, 0.3), vx.Clamp(on="boundary"), vx.Traction((0.1, 0.3), on="right"))
    assert vx.error_budget(vx.simulate(scene, vx.meshes.squares(3), [0.0, 1.0])).largest["total"] == 0.0


def test_histories_from_files_have_no_estimate(tmp_path):
    vx.simulate(paper_scene(), vx.meshes.squares(2), [0.0, 1.0]).write(tmp_path)
    with pytest.raises(vx.HistoryError, match="read from files"):
        error_budget(vx.read_history(tmp_path))


def test_a_run_of_one_instant_has_no_error_in_time():
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="left"), vx.Pressure(1.0, on="right"))
    budget = vx.error_budget(vx.simulate(scene, vx.meshes.squares(2), [1.0], initial="settled"))
    assert budget.time.max() == 0.0 < budget.space.max()
