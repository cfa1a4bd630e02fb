"""Guaranteed bounds enclose the exact error closely, for single steps and for histories."""

from __future__ import annotations

import json
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from bounds import beside_refined, circle_of, error_from, strain_at
from random_scenes import coarse_mesh, random_scene
from scenes import few_families, mostly_slow, paper_scene, small
from typer.testing import CliRunner

import hertz_contact
import hertz_two_cylinders
import manufactured_full_slip as full_slip
import missed_reversal
import vemcvx as vx
from vemcvx.bound.skeleton import instant
from vemcvx.cli import app

pytestmark = pytest.mark.arithmetic

STEEL = vx.Elasticity(young=200.0, poisson=0.3)


def slipping(poisson):
    """Return the scene of manufactured full slip. The body is held on the left side only."""
    lam = full_slip.lame(poisson)

    def moved(x, t):
        return full_slip.displacement(x[:, 0], x[:, 1], t, lam)

    def pull(x, t):
        x, y = x.T
        xx, _, xy = np.moveaxis(full_slip.strain(x, y, t, lam), -1, 0)
        # The sum e_xx + e_yy would lose digits of lambda div u.
        return np.column_stack([2.0 * xx + lam / (1.0 + lam) * (1.0 + x * y) * np.exp(x * y) * t / 3.0, xy])

    scene = full_slip.scene(poisson, pulled=True).without(vx.PrescribedDisplacement)
    return scene.with_(vx.PrescribedDisplacement(moved, on="left"), vx.Traction(pull, on="right"))


def slipped(poisson, family, n, times=(0.0, 1.0)):
    return vx.simulate(slipping(poisson), small(family, n), times)


def measure_error(history, poisson, u=None):
    lam, u = full_slip.lame(poisson), history.displacement[-1] if u is None else u
    strain = lambda x: full_slip.strain(x[:, 0], x[:, 1], 1.0, lam)  # noqa: E731
    return error_from(circle_of(history), u, 1.0, strain)


def integrate_energy(poisson):
    """Return 1/2 a(u, u) of the closed form."""
    lam = full_slip.lame(poisson)
    s, w = np.polynomial.legendre.leggauss(12)
    x, y = (0.5 + 0.5 * one.ravel() for one in np.meshgrid(s, s))
    e = full_slip.strain(x, y, 1.0, lam)
    volume = (1.0 + x * y) * np.exp(x * y) / 3.0 / (1.0 + lam)
    density = 2.0 * (e[:, 0] ** 2 + e[:, 1] ** 2 + 0.5 * e[:, 2] ** 2) + lam * volume**2
    return float(0.5 * (0.25 * np.outer(w, w).ravel()) @ density)


@pytest.mark.long
@few_families
@pytest.mark.filterwarnings("ignore:Elasticity")
@mostly_slow("poisson, n", [(0.3, 6), (0.0, 16), (0.49, 16), (0.4999, 16), (0.4999995, 16)])
def test_bounds_enclose_the_error_of_full_slip(family, poisson, n):
    history = slipped(poisson, family, n)
    bound, error = vx.error_bound(history, step=-1), measure_error(history, poisson)
    # Near incompressibility, lambda div u has a rounding error.
    rounding = 1e-9 + 1e-15 * full_slip.lame(poisson) / error
    assert error * (1.0 - rounding) <= bound.upper <= (1.2 if n == 6 else 1.05) * error
    locks = family == "triangles" and poisson > 0.4
    assert (0.88 if n == 6 else 0.9 if locks else 0.95) * error <= bound.lower <= error * (1.0 + rounding)
    assert np.isclose(bound.cells.sum(), bound.upper**2)
    # The loads are exponential functions, so the bound contains an estimate.
    assert bound.kind == "bound for data as read at points"
    if n == 6:
        assert bound.energy[0] <= integrate_energy(poisson) <= bound.energy[1]
        assert 0.0 < bound.parts["data"] < 0.1 * error


@pytest.mark.long
@mostly_slow("seed", range(12))
def test_bounds_hold_for_wrong_solutions(seed):
    """Nodal values and multipliers have random errors."""
    rng, history = np.random.default_rng(seed), slipped(0.3, "voronoi", 4)
    run, posed = history.trajectory, circle_of(history).posed
    y = run.state * (1.0 + 0.1 * rng.normal(size=run.state.shape))
    u = np.stack(
        [(posed.supports.P @ y[k] + posed.supports.motion(t)).reshape(-1, 2) for k, t in enumerate((0.0, 1.0))]
    )
    lam = run.multipliers * (1.0 + rng.normal(size=run.multipliers.shape))
    wrong = replace(history, displacement=u, trajectory=replace(run, state=y, multipliers=lam))
    bound, error = vx.error_bound(wrong, step=-1), measure_error(history, 0.3, u[1])
    assert error > 3.0 * measure_error(history, 0.3)
    assert error <= bound.upper <= 1.4 * error
    assert bound.lower <= error


# Single steps, compared with runs on much finer meshes.


def tilted(*contact):
    """Return a block whose load presses the left half on the floor and lifts the right half."""

    def load(x, t):
        return np.column_stack([np.full(len(x), 8.0 * t), (12.0 - 28.0 * x[:, 0]) * t])

    return vx.Scene(STEEL, vx.Clamp(on="left"), vx.Traction(load, on="top"), *contact)


TRESCA = vx.TrescaFriction(2.0, on="bottom", while_closed=False)
LIFTED = tilted(vx.UnilateralContact(on="bottom"), TRESCA)
WARM = vx.Scene(
    STEEL,
    vx.Clamp(on="left"),
    vx.ThermalStrain(1e-3, lambda x, t: np.full(len(x), 10.0 * t)),
    vx.BilateralContact(on="bottom"),
    vx.TrescaFriction(0.5, on="bottom"),
)
CONTRAST = vx.Scene(
    vx.Elasticity(young=lambda x: np.where(x[:, 1] < 0.5, 200.0, 2.0), poisson=0.3),
    vx.Clamp(on="right"),
    vx.Traction(lambda x, t: np.tile([0.08 * t, -0.01 * t], (len(x), 1)), on="left"),
    vx.BilateralContact(on="bottom"),
    vx.TrescaFriction(0.02, on="bottom"),
)
SCENES = {
    "paper": paper_scene(),
    "lifted": LIFTED,
    "compliant": tilted(vx.NormalCompliance(500.0, on="bottom"), TRESCA),
    "warm": WARM,
    "contrast": CONTRAST,
    "held by friction": vx.Scene(
        STEEL,
        vx.Traction(lambda x, t: np.column_stack([8.0 * t * (1.5 - x[:, 1]), np.zeros(len(x))]), on="left"),
        vx.BilateralContact(on="bottom"),
        vx.TrescaFriction(lambda x, t: 6.0 + 6.0 * x[:, 0], on="bottom"),
    ),
    "held by contact": vx.Scene(
        STEEL,
        vx.Symmetry(on="left"),
        vx.Pressure(lambda x, t: 5.0 * t * (1.0 + x[:, 0]), on="top"),
        vx.BodyForce(lambda x, t: np.tile([0.0, -2.0 * t], (len(x), 1))),
        vx.UnilateralContact(on="bottom"),
        vx.TrescaFriction(1.0, on="bottom", while_closed=False),
    ),
}


def one_step(seed):
    """Return a random scene and the end of the step. Every third scene has Tresca's friction."""
    scene, turn = random_scene(seed)
    if seed % 3 < 2:
        return scene, turn
    bound = scene.effects[0].young * np.random.default_rng(9000 + seed).uniform(0.002, 0.02)
    return scene.without(vx.CoulombFriction).with_(vx.TrescaFriction(bound, on="bottom", while_closed=False)), turn


def check_beside_refined(coarse):
    """Compare the bounds of a run with a much finer run."""
    bound = vx.error_bound(coarse, step=-1)
    apart, own, ahead = beside_refined(coarse, 0.05)
    assert apart >= 20.0 * own
    assert bound.lower - own <= apart <= bound.upper + own
    assert bound.potential[0] <= ahead.potential[0] <= ahead.potential[1] <= bound.potential[1]
    return bound, apart, own, ahead


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(200))
def test_bounds_hold_in_random_scenes(seed):
    """The stiffnesses span six decades. The meshes belong to all families."""
    scene, turn = one_step(seed)
    bound, apart, own, ahead = check_beside_refined(vx.simulate(scene, coarse_mesh(seed), [0.0, turn]))
    # The potential J of the computed v and the exact u satisfies J(v) - J(u) >= |u - v|^2 / 2.
    most = np.sqrt(2.0 * (bound.potential[1] - ahead.potential[0]) + bound.lower**2)
    assert apart - own <= most <= bound.upper
    assert bound.upper <= 1.35 * (apart + own)
    assert bound.upper <= 1.6 * bound.lower


def stacked(n):
    """Return a mesh of two stacked blocks with different nodes."""
    lower, upper = vx.meshes.squares(n, box=((0, 2), (0, 1))), vx.meshes.squares(n + 1, box=((0.5, 1.5), (1, 2)))
    return vx.meshes.bodies({"lower": lower, "upper": upper})


def pushed(*contact):
    def push(x, t):
        return np.tile([0.02 * t, -0.05 * t], (len(x), 1))

    return vx.Scene(STEEL, vx.Clamp(on="lower.bottom"), vx.PrescribedDisplacement(push, on="upper.top"), *contact)


STACKS = {
    "one-sided": pushed(
        vx.UnilateralContact(on="lower|upper"), vx.TrescaFriction(2.0, on="lower|upper", while_closed=False)
    ),
    "bilateral": pushed(vx.BilateralContact(on="lower|upper"), vx.TrescaFriction(2.0, on="lower|upper")),
    "frictionless": pushed(vx.BilateralContact(on="lower|upper")),
    "compliant": pushed(vx.NormalCompliance(400.0, on="lower|upper")),
    "press fit": pushed(
        vx.UnilateralContact(on="lower|upper", gap=lambda x, t: np.full(len(x), -0.02 * t)),
        vx.TrescaFriction(2.0, on="lower|upper", while_closed=False),
    ),
}


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:supports")
@pytest.mark.parametrize("name", [*SCENES, *STACKS])
def test_bounds_of_two_meshes_agree_on_the_least_energy_of_a_step(name):
    scene, meshes = {**SCENES, **STACKS}[name], (vx.meshes.squares(4), vx.meshes.squares(8))
    meshes = (stacked(3), stacked(6)) if name in STACKS else meshes
    found = [vx.error_bound(vx.simulate(scene, mesh, [0.0, 1.0]), step=-1) for mesh in meshes]
    (low, high), (least, most) = (bound.potential for bound in found)
    assert max(low, least) <= min(high, most)
    assert most - least < high - low
    assert all(bound.upper <= 1.6 * bound.lower for bound in found)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a parabolic cylinder", "two cylinders", "press fit", "one-sided"])
def test_bounds_of_contact_hold_against_much_finer_meshes(name):
    hertz = {"a parabolic cylinder": hertz_contact, "two cylinders": hertz_two_cylinders}.get(name)
    scene, mesh = (STACKS[name], stacked(4)) if hertz is None else (hertz.scene(), hertz.mesh(4))
    check_beside_refined(vx.simulate(scene, mesh, [0.0, 1.0]))


def test_bounds_with_coulomb_s_law_are_for_the_given_friction():
    scene = tilted(vx.UnilateralContact(on="bottom"), vx.CoulombFriction(0.3, on="bottom"))
    bound = vx.error_bound(vx.simulate(scene, vx.meshes.squares(8), [0.0, 1.0]), step=-1)
    assert bound.kind == "bound for the given friction"
    assert bound.lower <= bound.upper <= 1.3 * bound.lower


@pytest.mark.long
def test_bodies_inside_obstacles_have_no_bound():
    history = vx.simulate(LIFTED, vx.meshes.squares(6), [0.0, 1.0])
    u = history.displacement.copy()
    u[-1, history.contact.nodes, 1] -= 1e-3
    deep = replace(history, displacement=u)
    with pytest.raises(vx.SceneError, match="inside a rigid obstacle"):
        vx.error_bound(deep, step=-1)


# Whole histories, compared with runs on finer meshes in more steps.


def triangular(t):
    return np.minimum(t, 1.0 - t) * 2.0


def zigzag(t):
    return np.interp(t, [0.0, 0.25, 0.75, 1.0], [0.0, 1.0, -1.0, 0.0])


def sine(t):
    return np.sin(2.0 * np.pi * t)


def measure_effectivities(scene, times, n, finer, parts):
    """Return the ratios of upper bounds to distances from a finer run, at up to four steps.

    The finer run has `parts` steps between successive instants of `vx.instants`.
    """
    mesh, wanted = vx.meshes.squares(n), np.unique(np.linspace(1, len(times) - 1, 4).astype(int))
    fine_times = [np.linspace(a, b, parts + 1) for a, b in pairwise(vx.instants(scene, mesh, times))]
    fine_times = np.unique(np.concatenate(fine_times))
    at = np.searchsorted(fine_times, times[wanted] - 1e-12)
    coarse = vx.simulate(scene, mesh, times)
    fine = vx.simulate(scene, vx.meshes.squares(finer), fine_times, store=at.tolist())
    bound, circle, ahead = vx.error_bound(coarse), circle_of(coarse), circle_of(fine)
    found = []
    for step, row in zip(wanted.tolist(), at.tolist(), strict=True):
        now = instant(fine, fine.row(row))
        apart = error_from(ahead, now.u, now.t, partial(strain_at, circle, coarse.displacement[step], now.t))
        found.append(bound.upper[step] / apart)
    assert (bound.lower == 0.0).all()
    assert np.isclose(bound.cells.sum(), bound.upper.max() ** 2)
    return np.array(found)


def case(scene, steps, most):
    return pytest.param(scene, steps, 8, 32, 16 if steps < 10 else 8, most, marks=pytest.mark.slow)


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "steps", "n", "finer", "parts", "most"),
    [
        (paper_scene(), 4, 4, 16, 4, 2.2),
        (paper_scene(triangular), 3, 4, 16, 4, 6.0),
        case(paper_scene(), 16, 2.3),
        *(case(paper_scene(triangular), steps, 5.5) for steps in (4, 9, 16)),
        *(case(missed_reversal.scene(course=zigzag), steps, 12.0) for steps in (5, 9, 17)),
        case(paper_scene(sine), 16, 10.0),
        case(paper_scene(lambda t: sine(5.0 * t)), 100, 35.0),
    ],
)
def test_bounds_of_histories_contain_the_errors_of_mesh_and_steps(scene, steps, n, finer, parts, most):
    """If the load reverses inside a step, the bound contains an estimate."""
    found = measure_effectivities(scene, np.linspace(0.0, 1.0, steps + 1), n, finer, parts)
    assert found.min() >= 1.0
    assert found.max() <= most


@pytest.mark.long
def test_a_reversal_inside_a_step_causes_a_warning_and_vx_instants_includes_it(caplog):
    scene, mesh, times = paper_scene(zigzag), vx.meshes.squares(4), np.linspace(0.0, 1.0, 6)
    missed = vx.simulate(scene, mesh, times)
    with caplog.at_level("WARNING", logger="vemcvx"):
        bound = vx.error_bound(missed)
    assert np.allclose(bound.bends, [0.25, 0.75])
    assert "at t = 0.25, 0.75" in caplog.text
    assert "t = 0.25" in repr(bound)
    assert bound.kind == "bound for data as read at instants"
    placed = vx.instants(scene, mesh, times)
    assert np.allclose(placed, np.union1d(times, [0.25, 0.75]))
    caplog.clear()
    with caplog.at_level("WARNING", logger="vemcvx.bound"):
        met = vx.error_bound(vx.simulate(scene, mesh, placed))
    assert len(met.bends) == 0
    assert "inside steps" not in caplog.text
    assert met.kind == "bound"
    assert met.upper[-1] < bound.upper[-1]


@pytest.mark.long
def test_a_load_that_begins_and_ends_within_a_step_is_in_the_bound():
    """The load vanishes at all instants of the run, but friction keeps some strain."""
    history = vx.simulate(paper_scene(triangular), vx.meshes.squares(4), [0.0, 1.0])
    fine = vx.simulate(paper_scene(triangular), vx.meshes.squares(4), [0.0, 0.5, 1.0])
    assert vx.error_bound(history).upper[-1] > np.sqrt(2.0 * fine.energy[-1]) > 0.0


# Runs with bound=True, and commands.


PRESSED = vx.Scene(
    STEEL,
    vx.Clamp(on="right"),
    vx.Traction((1.0, -5.0), on="top"),
    vx.UnilateralContact(on="bottom"),
    vx.CoulombFriction(0.3, on="bottom"),
)


@pytest.mark.long
@pytest.mark.parametrize(
    ("scene", "steps", "kind"),
    [(paper_scene(lambda t: np.sin(np.pi * t)), 3, "bound"), (PRESSED, 1, "bound for the given friction")],
)
def test_runs_keep_the_largest_bound_of_their_steps_and_its_kind(scene, steps, kind, tmp_path):
    times = np.linspace(0.0, 1.0, steps + 1)
    history = vx.simulate(scene, vx.meshes.squares(4), times, initial="settled", bound=True)
    bounds = [vx.error_bound(history, step=n + 1) for n in range(steps)]
    worst = max(bounds, key=lambda one: one.upper)
    assert history.bound["kind"] == worst.kind
    assert worst.kind == kind
    kept = {name: history.bound[name] for name in ("upper", "lower", "step")}
    assert kept == {"upper": worst.upper, "lower": worst.lower, "step": worst.steps}
    assert f"step {worst.steps}" in history.summary()
    assert f"if the step before is exact; {worst.kind}" in history.summary()
    folder = history.write(tmp_path / "run")
    assert vx.read_history(folder).bound == history.bound
    assert vx.read_history(folder).summary() == history.summary()
    kept = json.loads((folder / "summary.json").read_text())
    assert [kept[f"bound_{name}"] for name in ("upper", "lower", "kind")] == [worst.upper, worst.lower, worst.kind]


@pytest.mark.long
def test_the_command_line_prints_the_bound(tmp_path):
    arguments = ["run", "feng_han_huang", "--n", "4", "--steps", "2", "--bound", "--report", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0, done.output
    kept = json.loads((tmp_path / "summary.json").read_text())
    assert 0.0 < kept["bound_lower"] < kept["bound_upper"]
    assert f"{kept['bound_lower']:.4g} ... {kept['bound_upper']:.4g}" in done.output
    assert "the error of the mesh in step 2" in (tmp_path / "report.html").read_text()
