"""Weights that depend on slip, of the step and before it, with forces or not: a fixed point, and when it is proven."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cvxpy as cp
import meshio
import numpy as np
import pytest

import vemcvx as vx
from slip_weakening import SlipWeakening
from vemcvx.effects import ContactSurface, Contribution, Friction

STEEL, HELD = vx.Elasticity(200.0, 0.3), vx.Clamp(on="right")
TOUCHING = vx.BilateralContact(on="bottom")
TIMES = np.linspace(0.0, 1.0, 7)


def to_and_fro(x, t):
    return np.column_stack([12 * np.sin(5 * t) * (1.3 - x[:, 1]), -2 * t + 0 * x[:, 0]])


@dataclass(frozen=True)
class Law(vx.Effect):
    """Friction with any slip law, per length."""

    bound: object
    softening: float | None = None
    pressed: bool = False
    on: str = "bottom"
    slope: object = None

    def contribute(self, space):
        rows = space.part(self.on, "Law", contact=True).node_normals
        lengths = rows.lengths

        def weights(t, forces, before, slip):
            return self.bound(t, forces / lengths if self.pressed else forces, before, slip) * lengths

        softening = None if self.softening is None else self.softening * lengths
        friction = replace(Friction.of(rows, "Law"), law=vx.Law(weights, softening, self.pressed, self.slope))
        return Contribution(frictions=(friction,), surfaces=(ContactSurface.of(rows),))

    def describe(self):
        return f"Law: on {self.on}"


def weakening(t, pressure, before, slip):
    return np.maximum(4.0 - 30.0 * (before + slip), 1.0)


def simulate(*friction, solver=None, times=TIMES, load=to_and_fro, contact=TOUCHING, **options):
    scene = vx.Scene(STEEL, HELD, vx.Traction(load, on="left"), contact, *friction)
    return vx.simulate(scene, vx.meshes.voronoi(4), times, solver=solver or vx.Newton(1e-9), **options)


@pytest.mark.long
def test_solvers_agree_within_their_certificates():
    """Each is as near as it says to the solution of every step for its own slips; errors grow by 1 / (1 - rho)."""
    runs = [simulate(Law(weakening, 30.0), solver=solver) for solver in (vx.Newton(1e-9), vx.Clarabel(1e-6))]
    assert {run.certificate_kind for run in runs} == {"for the given friction"}
    assert runs[0].contact.accumulated_slip[-1].max() > 0.01
    apart = np.abs(np.sqrt(2 * runs[0].energy) - np.sqrt(2 * runs[1].energy))
    totals = sum(np.cumsum(np.sqrt(2 * run.trajectory.gap)) for run in runs)
    assert (apart <= 3 * totals).all()
    assert totals[-1] < 1e-5 * np.sqrt(2 * runs[0].energy.max())


@pytest.mark.long
def test_a_law_of_the_slip_before_takes_one_convex_program_a_step():
    """Step by step it is Tresca's friction with the bounds that the slip has left."""

    def before_alone(t, pressure, before, slip):
        return np.maximum(4.0 - 300.0 * before, 1.0)

    lagged = simulate(Law(before_alone, softening=0.0))
    assert lagged.iterations.max() < 10
    contact = lagged.contact
    bounds = before_alone(0.0, None, contact.accumulated_slip, None)
    assert np.array_equal(contact.bound[1:], bounds[:-1])
    place = contact.points[:, 0]

    def given(x, t):
        row = round((t - TIMES[0]) / (TIMES[1] - TIMES[0]))
        order = np.argsort(place)
        return np.interp(x[:, 0], place[order], contact.bound[row][order])

    told = simulate(vx.TrescaFriction(given, on="bottom"))
    scale = np.abs(lagged.displacement).max()
    assert np.abs(told.displacement - lagged.displacement).max() < 1e-8 * scale


@pytest.mark.long
def test_coulomb_with_a_coefficient_that_wears_off():
    """A block pressed by p and sheared: friction mu(A) p, with A its slip, at every instant and node."""
    young, height, p, k = 26.0, 0.5, 2.0, 5.0
    times, stiff = np.linspace(0.0, 1.0, 11), young / 2 / height
    q, a = np.zeros(len(times)), np.zeros(len(times))
    for n, U in enumerate(0.12 * times[1:], start=1):
        slip = max(stiff * (U - a[n - 1]) - (0.5 - k * a[n - 1]) * p, 0.0) / (stiff - k * p)
        if 0.5 - k * (a[n - 1] + slip) < 0.2:
            slip = max(U - a[n - 1] - 0.2 * p / stiff, 0.0)
        a[n] = a[n - 1] + slip
        q[n] = stiff * (U - a[n])

    def bound(t, pressure, before, slip):
        return np.maximum(0.5 - k * (before + slip), 0.2) * np.maximum(pressure, 0.0)

    def shear(x, t):
        return np.column_stack([0 * x[:, 0], np.where(x[:, 0] > 0.5, 1.0, -1.0) * np.interp(t, times, q)])

    scene = vx.Scene(
        vx.Elasticity(young, 0.0),
        vx.PrescribedDisplacement(lambda x, t: np.tile([0.12 * t, -p * height / young], (len(x), 1)), on="top"),
        vx.Traction(shear, on=["left", "right"]),
        vx.UnilateralContact(on="bottom"),
        Law(bound, pressed=True),
    )
    mesh = vx.meshes.squares(3, box=((0, 1), (0, height)))
    history = vx.simulate(scene, mesh, times, initial="settled", solver=vx.Newton(1e-9))
    # An accuracy of 1e-9 of the energy in which it is pressed, over ten steps.
    assert np.abs(-history.contact.traction[:, :, 0] - q[:, None]).max() < 1e-7
    assert np.abs(history.contact.slip[:, :, 0] - a[:, None]).max() < 1e-7
    assert 0 < q[-1] < 0.6 * q.max()


def worn(t, pressure, before, slip):
    return np.maximum(0.6 - 20.0 * before, 0.2) * np.maximum(pressure, 0.0)


def worn_slope(t, forces, before):
    return np.maximum(0.6 - 20.0 * before, 0.2) * (forces >= 0)


PRESSED = {"contact": vx.UnilateralContact(on="bottom"), "load": lambda x, t: to_and_fro(x, t) - [0.0, 9.0 * t]}


@pytest.mark.long
@pytest.mark.parametrize("solver", [vx.Newton(1e-9), vx.Clarabel(1e-6)], ids=["Newton", "Clarabel"])
def test_coulomb_with_a_coefficient_of_the_slip_before(solver):
    """A law of pressure and the slip before the step alone is Coulomb's, with that coefficient in each step."""
    history = simulate(Law(worn, pressed=True, slope=worn_slope), solver=solver, **PRESSED)
    assert history.certificate_kind == "for the given friction"
    contact = history.contact
    before = np.vstack([0 * contact.bound[:1], contact.accumulated_slip[:-1]])
    asked = worn(0.0, contact.pressure, before, None)
    slack = 1e-4 if isinstance(solver, vx.Clarabel) else 1e-9
    assert np.abs(contact.bound - asked)[1:].max() < slack * asked.max()
    assert contact.bound[-1].max() < 0.5 * contact.pressure[-1].max()
    without = simulate(Law(worn, pressed=True), **PRESSED)
    scale = np.abs(history.displacement).max()
    assert np.abs(without.displacement - history.displacement).max() < 10 * max(slack, 1e-7) * scale


@pytest.mark.long
def test_a_coefficient_that_stays_is_coulombs():
    kept = simulate(
        Law(lambda t, p, a, s: 0.3 * np.maximum(p, 0), pressed=True, slope=lambda t, p, a: np.where(p >= 0, 0.3, 0.0)),
        **PRESSED,
    )
    known = simulate(vx.CoulombFriction(0.3, on="bottom"), **PRESSED)
    scale = np.abs(known.displacement).max()
    assert np.abs(kept.displacement - known.displacement).max() < 1e-8 * scale


def test_a_slope_of_a_law_that_reads_the_slip_of_the_step_is_told():
    def reads_it(t, pressure, before, slip):
        return np.maximum(0.6 - 20.0 * (before + slip), 0.2) * np.maximum(pressure, 0.0)

    with pytest.raises(
        vx.SceneError, match=r"friction: at node \d+ .* but its law has a slope, which is for laws that"
    ):
        simulate(Law(reads_it, pressed=True, slope=worn_slope), **PRESSED)


@pytest.mark.parametrize("pressed", [False, True])
def test_a_law_without_the_contact_that_it_reads_is_refused(pressed):
    def coulomb(t, pressure, before, slip):
        return 0.3 * np.maximum(pressure, 0.0)

    said = "no pressure is known" if pressed else "p is empty without pressed=True"
    with pytest.raises(vx.SceneError, match=said):
        simulate(Law(coulomb, pressed=pressed))


WRONG = {
    "a wrong shape": (
        lambda t, p, a, s: np.ones(3),
        r"Law: law of friction: found an array of|Law: its law of friction failed when",
    ),
    "a negative weight": (
        lambda t, p, a, s: 1.0 - 1e3 * (a + s),
        "Law: found the weight -.* at node .* laws of friction",
    ),
    "NaN": (lambda t, p, a, s: np.where(a + s > 1e-4, np.nan, 1.0), "Law: found the weight nan at node .* in it; laws"),
    "infinity": (lambda t, p, a, s: np.inf + s, "Law: found the weight inf"),
    "words": (lambda t, p, a, s: "rough", "Law: its law of friction failed when called as f"),
    "an error": (lambda t, p, a, s: 1 / 0, "Law: its law of friction failed when called as f.* ZeroDivisionError"),
    "writing": (lambda t, p, a, s: a.__iadd__(1.0), "Law: its law of friction failed when called as f.*read-only"),
}


@pytest.mark.parametrize("name", WRONG)
def test_laws_that_give_no_weights_are_told(name):
    bound, said = WRONG[name]
    with pytest.raises(vx.SceneError, match=said):
        simulate(Law(bound))


@pytest.mark.parametrize("wrong", [lambda n: n[:-1], lambda n: 2.0 * n, lambda n: n[:, 0]])
def test_directions_are_unit_vectors(wrong):
    @dataclass(frozen=True)
    class Astray(Law):
        def contribute(self, space):
            part = super().contribute(space)
            (friction,) = part.frictions
            return replace(part, frictions=(replace(friction, directions=wrong(friction.normals)),))

    with pytest.raises(vx.SceneError, match="Law: found directions of shape .* one unit vector a row"):
        simulate(Astray(weakening))


@pytest.mark.parametrize(("softening", "said"), [(-1.0, "found softening -"), (np.nan, "softening nan")])
def test_a_softening_that_is_none_is_told(softening, said):
    with pytest.raises(vx.SceneError, match=said):
        simulate(Law(weakening, softening))


def test_softening_of_a_law_that_reads_forces_is_told():
    with pytest.raises(vx.SceneError, match="found softening .* and pressed=True"):
        simulate(Law(weakening, 30.0, pressed=True), contact=vx.UnilateralContact(on="bottom"))


def block(distance):
    """A block sheared over a floor; its softening over stiffness is .3 / distance."""
    k = 0.6 / distance
    return vx.Scene(
        vx.Elasticity(26.0, 0.3),
        vx.PrescribedDisplacement(lambda x, t: np.tile([0.1 * t, 0.0], (len(x), 1)), on="top"),
        vx.PrescribedDisplacement(0.0, on=["left", "right"], direction=(0.0, 1.0)),
        TOUCHING,
        SlipWeakening(1.0, 0.4, distance, on="bottom"),
    ), k * 0.5 / 10.0


@pytest.mark.long
@pytest.mark.parametrize("rise", [10.0, 100.0, 1e5])
def test_friction_that_hardens_is_convex_however_steep(rise):
    """A sheared block, g = g_0 + h A: a = (mu U / H - g_0) / (mu / H + h); plain iteration needs h < mu / H = 20."""
    scene, _ = block(0.1)
    hard = Law(lambda t, pressure, before, slip: 0.2 + rise * (before + slip), softening=0.0)
    scene = scene.without(SlipWeakening).with_(hard)
    history = vx.simulate(scene, vx.meshes.squares(3, box=((0, 1), (0, 0.5))), [0.0, 0.4, 1.0], solver=vx.Newton(1e-9))
    stiff = 10.0 / 0.5
    a = np.maximum(stiff * 0.1 * history.times - 0.2, 0.0) / (stiff + rise)
    assert np.abs(history.contact.slip[:, :, 0] - a[:, None]).max() < 1e-7 * a.max()


@pytest.mark.long
def test_what_settles_before_the_first_instant_is_no_slip():
    history = simulate(Law(weakening, 30.0), load=lambda x, t: to_and_fro(x, 0.3 + t), initial="settled")
    assert (history.contact.accumulated_slip[0] == 0).all()
    assert (
        history.contact.bound[1:][history.contact.sticking[1:] & (history.contact.accumulated_slip[1:] == 0)] == 4
    ).all()


@pytest.mark.long
@pytest.mark.parametrize("condense", [True, False])
def test_programs_of_steps_have_the_weights_that_their_slip_has_left(condense):
    history = simulate(Law(weakening, 30.0))
    for n in (2, 5):
        program = history.program(n, condense=condense)
        assert program.certificate.error < 1e-6 * program.norm
        assert np.array_equal(np.sort(program.w), np.sort(history.trajectory.weights[n]))


@pytest.mark.long
def test_in_space_the_slip_is_that_of_a_disc():
    """A block sheared along a circle wears off alike in all of its nodes, and as fast as its path is long."""

    def around(x, t):
        return np.tile([0.08 * np.cos(3 * t) - 0.08, 0.08 * np.sin(3 * t), 0.0], (len(x), 1))

    scene = vx.Scene(
        vx.Elasticity(26.0, 0.3),
        vx.PrescribedDisplacement(around, on="top"),
        vx.PrescribedDisplacement(0.0, on=["left", "right", "front", "back"], direction=(0.0, 0.0, 1.0)),
        TOUCHING,
        SlipWeakening(1.0, 0.4, 0.1, on="bottom"),
    )
    times, stiff = np.linspace(0.0, 1.5, 7), 10.0 / 0.5
    mesh = vx.meshes.cubes(2, box=((0, 1), (0, 1), (0, 0.5)))
    history = vx.simulate(scene, mesh, times, solver=vx.Newton(1e-8))
    a, way = np.zeros((len(times), 2)), np.zeros(len(times))
    for n, t in enumerate(times[1:], start=1):
        pull = stiff * (around(np.zeros((1, 3)), t)[0, :2] - a[n - 1])
        size = np.linalg.norm(pull)
        step = max(size - max(1 - 6 * way[n - 1], 0.4), 0.0) / (stiff - 6)
        if way[n - 1] + step > 0.1:
            step = max(size - 0.4, 0.0) / stiff
        a[n], way[n] = a[n - 1] + step * pull / size, way[n - 1] + step
    assert np.abs(history.contact.slip[:, :, :2] - a[:, None]).max() < 1e-6
    assert np.abs(history.contact.accumulated_slip - way[:, None]).max() < 1e-6
    assert way[-1] > 0.1


def test_directions_may_be_any():
    """On a block that is sheared and pressed, rows along e = (3, 4) / 5 resist as far as their bound: lam = +-g e."""

    @dataclass(frozen=True)
    class Slanted(Law):
        def contribute(self, space):
            part = super().contribute(space)
            (friction,) = part.frictions
            return replace(
                part, frictions=(replace(friction, directions=np.tile([0.6, 0.8], (len(friction.nodes), 1))),)
            )

    bound, held = 1.0, vx.PrescribedDisplacement(lambda x, t: np.tile([0.3 * t, 0.4 * t], (len(x), 1)), on="top")
    friction = Slanted(lambda t, pressure, before, slip: bound, softening=0.0)
    history = vx.simulate(vx.Scene(STEEL, held, friction), vx.meshes.squares(3), [0.0, 0.5, 1.0])
    contact = history.contact
    assert not contact.sticking[1:].any()
    # Along the normal it is pressure, compression positive; e . n = -.8 on the floor.
    assert contact.traction[-1] == pytest.approx(np.tile([-0.6 * bound, 0.0], (4, 1)), abs=1e-9)
    assert contact.pressure[-1] == pytest.approx(-0.8 * bound, abs=1e-9)
    assert contact.bound[1:] == pytest.approx(bound, abs=1e-12)
    along = np.linalg.norm(history.reaction("top"), axis=1)
    assert along[-1] == pytest.approx(bound, abs=1e-9)
    moved = np.abs(np.diff(history.displacement[:, contact.nodes] @ [0.6, 0.8], axis=0)).sum(axis=0)
    assert contact.accumulated_slip[-1] == pytest.approx(moved, rel=1e-9)


@pytest.mark.long
def test_the_slip_so_far_is_written_and_read_for_both_bodies(tmp_path):
    lower, upper = vx.meshes.hexagons(2, box=((0, 1), (0, 1))), vx.meshes.squares(3, box=((0, 1), (1, 2)))
    scene = vx.Scene(
        STEEL,
        vx.Clamp(on="lower.bottom"),
        vx.PrescribedDisplacement(lambda x, t: np.tile([0.3 * np.sin(5 * t), 0.0], (len(x), 1)), on="upper.top"),
        vx.BilateralContact(on="lower|upper"),
        Law(lambda t, pressure, before, slip: np.maximum(4.0 - 15.0 * (before + slip), 1.0), 15.0, on="lower|upper"),
    )
    history = vx.simulate(scene, vx.meshes.bodies({"lower": lower, "upper": upper}), TIMES)
    slip = history.contact.accumulated_slip
    assert slip[-1].max() > 0.01
    history.write(tmp_path)
    assert np.array_equal(vx.read_history(tmp_path).contact.accumulated_slip, slip)
    assert np.array_equal(history.table("contact")["accumulated_slip"], slip.ravel())
    written = meshio.read(tmp_path / "step_0006.vtu").point_data["accumulated_slip"]
    for nodes in (history.contact.nodes, history.contact.partners):
        assert np.array_equal(written[nodes], slip[-1])


@pytest.mark.long
def test_there_is_no_error_budget_of_such_laws():
    with pytest.raises(vx.SceneError, match="error_budget: there is no estimate for Law: its weights depend on slip"):
        vx.error_budget(simulate(Law(weakening, 30.0)))
    with pytest.raises(vx.SceneError, match="adapt: there is no estimate for SlipWeakening"):
        vx.adapt(block(0.1)[0], vx.meshes.squares(4), [0.0, 1.0], target=0.1)


# An independent program: each step's energy minimised by cvxpy, its law followed until nothing changes.


def random_system(rng, n=6, healing=False):
    """A small body with m sliders whose bounds fall, level off, and may heal in time; and the law of their weights."""
    m = n - 1
    root = rng.normal(size=(n, n))
    K = root @ root.T / n + 0.5 * np.eye(n)
    B = rng.normal(size=(m, n))
    push, turn = rng.normal(size=(2, n))
    peak = rng.uniform(0.3, 1.0, m)
    rest, k = peak * rng.uniform(0.1, 0.8, m), rng.uniform(0.1, 1.0, m)
    worst = np.linalg.eigvalsh(np.sqrt(k)[:, None] * (B @ np.linalg.solve(K, B.T)) * np.sqrt(k))[-1]
    k *= rng.uniform(0.2, 0.8) / worst
    heal = rng.uniform(0.0, 1.0, m) if healing else np.zeros(m)

    def law(t, p, past, slip):
        return np.maximum(peak - k * (past + slip), rest) + heal * t

    def load(t):
        return 3.0 * np.sin(4 * t) * push + t * turn

    return vx.System(K, load, vx.Norms(B, peak, law=vx.Law(law, softening=k))), law


def marched_by_cvxpy(system, law, times):
    """States of a march, each step's fixed point with programs of cvxpy; how far the last iterates were apart."""
    B, y, past, left = system.B.toarray(), np.zeros(system.n), np.zeros(system.norms.count), 0.0
    K, f, w = system.K.toarray(), cp.Parameter(system.n), cp.Parameter(system.norms.count, nonneg=True)
    d, states = cp.Variable(system.n), [np.zeros(system.n)]
    posed = cp.Problem(cp.Minimize(0.5 * cp.sum_squares(np.linalg.cholesky(K).T @ d) - f @ d + w @ cp.abs(B @ d)))
    for t in times[1:]:
        slip, last = np.zeros(len(past)), None
        for _ in range(60):
            f.value, w.value = system.force(t) - K @ y, law(t, None, past, slip)
            posed.solve(solver=cp.CLARABEL, tol_gap_abs=1e-12, tol_gap_rel=1e-12, tol_feas=1e-12)
            slip = np.abs(B @ d.value)
            moved = np.inf if last is None else np.abs(d.value - last).max()
            last = d.value
            if moved < 1e-8:
                break
        left, y, past = max(left, moved), y + last, past + slip
        states.append(y)
    return np.array(states), left


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(2, 40))])
def test_random_laws_against_an_independent_fixed_point(seed):
    """States differ by what certificates and the other's iteration leave; errors of a step grow by less than 20."""
    rng = np.random.default_rng(seed)
    system, law = random_system(rng, n=int(rng.integers(2, 7)), healing=seed % 2 == 1)
    times = np.linspace(0.0, 1.5, 5)
    run = vx.march(system, times, solver=vx.Newton(1e-7))
    assert run.certificate.max() <= 1e-7
    found, left = marched_by_cvxpy(system, law, times)
    slack = 20 * np.sqrt(2 * run.gap).sum() + 100 * left + 1e-6
    assert left < 1e-6
    assert np.abs(run.state - found).max() < slack < 1e-3
    way = np.abs(np.diff(run.state @ system.B.T.toarray(), axis=0)).cumsum(axis=0)
    assert run.slipped[1:] == pytest.approx(way, abs=1e-12 * np.abs(run.state).max())
    made = np.diff(run.slipped, axis=0)
    asked = np.array([law(t, None, run.slipped[n], made[n]) for n, t in enumerate(times[1:])])
    assert run.weights[1:] == pytest.approx(asked, abs=1e-9)
