"""The error budget: space within a factor of the truth on every family, time bounded from above, algebra certified."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scenes import FAMILIES, OF_TRIANGLES, few_families, mostly_long, paper_scene, small

import manufactured_full_slip as full_slip
import vemcvx as vx
from vemcvx.effects import Contribution, Friction
from vemcvx.estimate.budget import error_budget
from vemcvx.scene import pose_scene
from vemcvx.vem import strains, stresses

pytestmark = pytest.mark.arithmetic

LEAST, MOST = 1.0, 5.0
"""Between these the estimated total stands to the true error: one declared constant for all meshes and scenes."""


def ratio_of(poisson, family, n):
    lam = full_slip.lame(poisson)
    scene = full_slip.scene(poisson, pulled=poisson > 0.4)
    # Rounding allows no more where a body hardly changes its volume.
    solver = vx.Newton(accuracy=1e-6 if poisson > 0.49 else 1e-8)
    history = vx.simulate(scene, full_slip.mesh(n, family), np.linspace(0, 1, 9), store="last", solver=solver)
    true = vx.measures.energy_error(history, lambda x, t: full_slip.strain(x[:, 0], x[:, 1], t, lam))
    budget = error_budget(history)
    assert budget.time[-1] <= 1e-10, "data grow in proportion: no step loses anything"
    return budget.largest["total"] / true.relative


@pytest.mark.long
@few_families
@pytest.mark.parametrize(
    ("poisson", "sizes"),
    [(0.3, (8,)), *(pytest.param(nu, (6, 12, 24, 48), marks=pytest.mark.slow) for nu in (0.0, 0.3, 0.4999995))],
)
def test_effectivity_on_manufactured_full_slip(family, poisson, sizes):
    """Linear triangles lock where the body hardly changes its volume; all others are as good there."""
    if family in OF_TRIANGLES and poisson > 0.4:
        return
    found = [ratio_of(poisson, family, n) for n in sizes]
    assert min(found) >= LEAST
    assert max(found) <= MOST
    # One constant: halving h three times changes the ratio by little.
    assert max(found) / min(found) < 1.5


@pytest.fixture(scope="module")
def truth():
    """The paper's scene on squares of 1/256, whose own error is a third of that of 1/64."""
    return vx.simulate(paper_scene(), vx.meshes.squares(256), np.linspace(0, 1, 3), store="last")


@pytest.mark.slow
@pytest.mark.parametrize("family", FAMILIES)
def test_effectivity_on_the_paper_s_scene(family, truth):
    for n in (8, 16, 32):
        history = vx.simulate(paper_scene(), small(family, n), np.linspace(0, 1, n * n + 1), store="last")
        true = vx.measures.energy_distance(history, truth).relative
        assert LEAST <= error_budget(history).largest["total"] / true <= MOST


def crossed(n):
    """Squares that both diagonals cut into triangles."""
    grid = vx.meshes.squares(n)
    corner = np.concatenate([[[cell[k], cell[(k + 1) % 4]] for k in range(4)] for cell in grid.cells])
    cells = np.column_stack([corner, np.repeat(grid.n_nodes + np.arange(grid.n_cells), 4)])
    mesh = vx.PolygonMesh(np.vstack([grid.points, grid.centroids]), cells)
    for k, (name, edge) in enumerate({"left": 0.0, "right": 1.0, "bottom": 0.0, "top": 1.0}.items()):
        mesh = mesh.with_boundary(name, lambda x, axis=k // 2, edge=edge: np.abs(x[:, axis] - edge) < 1e-9)
    return mesh


@pytest.mark.long
def test_effectivity_on_crossed_triangles():
    """The widths of a cell are the heights of a triangle: with less, estimates were .94 of the error here."""
    truth = vx.simulate(paper_scene(), vx.meshes.squares(96), np.linspace(0, 1, 3), store="last")
    history = vx.simulate(paper_scene(), crossed(8), np.linspace(0, 1, 17), store="last")
    true = vx.measures.energy_distance(history, truth).relative
    assert LEAST <= error_budget(history).largest["total"] / true <= MOST


def triangular(t):
    """Up to 1 at t = 1/2 and down again."""
    return np.minimum(t, 1.0 - t) * 2.0


@pytest.mark.long
@pytest.mark.parametrize(("steps", "most"), [(6, np.inf), (48, np.inf), (9, 1.5), (33, 1.5)])
def test_the_time_estimate_bounds_the_error_of_the_steps(steps, most):
    """On one mesh; odd numbers of steps miss the turn by half a step: of first order, as the truth is."""
    mesh = vx.meshes.squares(4)
    coarse, fine = (vx.simulate(paper_scene(triangular), mesh, np.linspace(0, 1, n + 1)) for n in (steps, 16 * steps))
    apart = fine.trajectory.state[::16] - coarse.trajectory.state
    K = pose_scene(coarse.scene, mesh).system.K
    true = np.sqrt(np.einsum("ni,ni->n", apart, (K @ apart.T).T)) / coarse.trajectory.norm.max()
    time = error_budget(coarse).time
    assert (true[1:] <= time + 1e-12).all()
    assert time.max() <= most * true.max()


@pytest.mark.slow
def test_effectivity_is_printed():
    """What `problems/effectivity.py` prints, in its small setting."""
    import effectivity as command

    ratios = [one.ratio for one in command.main(["--small"])]
    assert min(ratios) >= LEAST
    assert max(ratios) <= MOST


@pytest.mark.long
def test_nothing_is_lost_where_nothing_changes_its_mind():
    """Once everything slips, steps of any length lose nothing."""
    history = vx.simulate(paper_scene(bound=0.01), vx.meshes.squares(4), [0.0, 0.5, 0.6, 1.0])
    assert error_budget(history).added.max() <= 1e-12


@pytest.mark.long
def test_the_algebra_is_certified():
    loose = vx.simulate(paper_scene(), vx.meshes.squares(4), np.linspace(0, 1, 9), solver=vx.Clarabel(accuracy=1e-3))
    budget = error_budget(loose)
    assert budget.algebra[-1] == pytest.approx(loose.certificate_total[-1])
    assert budget.algebra[-1] > 1e-9
    assert budget.total == pytest.approx(budget.algebra + budget.space + budget.time)


@pytest.mark.long
def test_parts_and_cells_add_up():
    budget = error_budget(vx.simulate(paper_scene(), small("voronoi", 4), [0.0, 1.0]))
    assert set(budget.parts) == {"volume", "jumps", "boundary", "stabilisation", "data"}
    assert np.sqrt(sum(part[0] ** 2 for part in budget.parts.values())) == pytest.approx(budget.space[0])
    assert np.sqrt((budget.cells**2).sum()) == pytest.approx(budget.space[0])


MATERIALS = [
    (vx.Elasticity(young=200.0, poisson=0.3),),
    (vx.Elasticity(young=200.0, poisson=0.3, stabilisation="unit"),),
    # At 45 degrees the shear entry of the elastic matrix is that of the fibres.
    (vx.Orthotropic(young=(1000.0, 10.0), poisson=0.3, shear=2.0, angle=np.pi / 4),),
    (
        vx.Elasticity(young=200.0, poisson=0.3, plane="stress", stabilisation="unit", on="one"),
        vx.Orthotropic(young=(1000.0, 10.0), poisson=0.3, shear=2.0, angle=0.3, on="other"),
    ),
]


@mostly_long("materials", MATERIALS, 0, 3)
def test_the_stabilisation_is_that_of_the_stiffness(materials):
    """Of u'Au, what the projected strains do not store."""
    mesh = small("voronoi", 4)
    one = (mesh.centroids[:, 0] < 0.5).astype(float)
    mesh = mesh.with_cell_data("one", one).with_cell_data("other", 1.0 - one)
    posed = pose_scene(vx.Scene(*materials, vx.Clamp(on="left")), mesh)
    u = np.random.default_rng(0).normal(size=mesh.points.shape)
    strain = strains(posed.space, u)
    projected = np.sum(mesh.areas[:, None] * strain * stresses(posed.material.moduli, strain))
    energy = projected + posed.material.stabilisation_energies(posed.space, u).sum()
    assert energy == pytest.approx(u.ravel() @ (posed.A @ u.ravel()), rel=1e-12)


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
def test_a_constant_stress_has_no_residual(effects):
    """Pulled uniformly, on springs, and on a rigid floor, on every mesh: nothing is missed in any part."""
    for family in FAMILIES:
        history = vx.simulate(vx.Scene(*effects), small(family, 4), [0.0, 1.0], initial="settled")
        assert history.energy[-1] > 0
        assert error_budget(history).space.max() < 1e-12


class Rubs(vx.Effect):
    """Friction that does not say on which edges it acts."""

    def contribute(self, space):
        friction = Friction.from_rows(space.part("bottom", "Rubs", contact=True).node_normals, "Rubs")
        return Contribution(frictions=(replace(friction, weights=lambda t: friction.lengths, ends=None),))

    def describe(self):
        return "Rubs"


def test_what_has_no_estimate_says_so(tmp_path):
    free = paper_scene().without(vx.TrescaFriction)
    for effect, subject in (
        (vx.Viscosity(shear=1.0), "Viscosity"),
        (vx.PointLoad(lambda x, t: [[0.1 * t, 0.0]], at=(0.0, 1.0)), "PointLoad"),
        (Rubs(), "Rubs, .* by ends="),
    ):
        history = vx.simulate(free.with_(effect), vx.meshes.squares(2), [0.0, 1.0])
        with pytest.raises(vx.SceneError, match=f"no estimate for .*{subject}"):
            error_budget(history)
    history = vx.simulate(free, vx.meshes.squares(2), [0.0, 1.0])
    for steps in ([], "last", [0.5], [[1]]):
        with pytest.raises(vx.HistoryError, match=r"^error_budget: found steps = "):
            error_budget(history, steps)
    assert error_budget(history, -1).steps.tolist() == [1]
    history.write(tmp_path)
    for given, said in ((3, "found 3; wanted a History"), (vx.read_history(tmp_path), "read from files")):
        with pytest.raises(vx.HistoryError, match=said):
            error_budget(given)


def test_a_run_of_a_single_instant_has_a_budget_without_an_error_in_time():
    scene = vx.Scene(vx.Elasticity(200.0, 0.3), vx.Clamp(on="left"), vx.Pressure(1.0, on="right"))
    budget = vx.error_budget(vx.simulate(scene, vx.meshes.squares(2), [1.0], initial="settled"))
    assert budget.time.max() == 0.0 < budget.space.max()
