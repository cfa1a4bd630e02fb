"""What every solver must satisfy: one list of sentences, run over every solver that the package exports.

Of the solvers that cvxpy finds on a machine, those without a class of their own come through ThroughCvxpy; they may
refuse (cvxpy calls some of their wrong answers optimal), but by name, and never return what is not certified.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable

import cvxpy
import numpy as np
import pytest
import scipy.sparse as sp
from scenes import small

import vemcvx as vx
from vemcvx.program.operators import ABSOLUTE_VALUES, QUADRATIC, SECOND_ORDER_CONES, Operators
from vemcvx.program.step_program import StepProgram
from vemcvx.scene.pose import pose_scene

pytestmark = pytest.mark.arithmetic

OWN = {
    "Newton": vx.Newton(),
    "Clarabel": vx.Clarabel(),
    "Clarabel, polished": vx.Clarabel(accuracy=1e-8, polish=True),
    "OSQP": vx.OSQP(),
    "Direct": vx.Direct(),
    "ThroughCvxpy": vx.ThroughCvxpy("CLARABEL", accuracy=1e-3),
}
"""Solvers that must answer."""
FOUND = {
    name: vx.ThroughCvxpy(name, accuracy=1e-3) for name in cvxpy.installed_solvers() if name not in ("CLARABEL", "OSQP")
}
FOUND = {name: solver for name, solver in FOUND.items() if QUADRATIC in solver.accepts}
"""Solvers that answer or refuse; those of linear programs accept no step at all (tests/test_cli_compare.py)."""
SOLVERS = OWN | FOUND

TIMES = np.linspace(0.0, 1.0, 7)
NORMAL_FORCE = -0.01


def slips(solver):
    """Whether the solver takes friction."""
    return ABSOLUTE_VALUES in solver.accepts


def scene(solver, length=1.0, stress=1.0, bound=4.0):
    """The paper's scene under a load that reverses, without friction for solvers that take none."""

    def pull(x, t):
        along = 8 * (1.25 - x[:, 1] / length) * np.sin(6 * t)
        return stress * np.column_stack([along, np.full(len(x), NORMAL_FORCE * np.sin(6 * t))])

    friction = [vx.TrescaFriction(bound=bound * stress, on="bottom")] if slips(solver) else []
    return vx.Scene(
        vx.Elasticity(young=200.0 * stress, poisson=0.3),
        vx.Clamp(on="right"),
        vx.Traction(pull, on="left"),
        vx.BilateralContact(on="bottom"),
        *friction,
    )


def sliders(n=6, block=1):
    """Unconnected sliders of different stiffness and threshold under a load that grows, reverses and rests."""
    rng = np.random.default_rng(0)
    k, w = rng.uniform(1, 3, n), rng.uniform(0.2, 1.5, n)
    push = rng.uniform(-1, 1, (n, block))
    push /= np.linalg.norm(push, axis=1)[:, None]

    def load(t):
        return (2 * np.sin(5 * t) * push).ravel()

    stiffness = np.repeat(k, block)
    return k, w, load, vx.System(np.diag(stiffness), load, vx.Norms(np.eye(n * block), w, block=block))


def outcome(ask):
    """What `ask` returns and None, or None and the solver's refusal."""
    try:
        return ask(), None
    except (vx.NotCertified, vx.NotAccepted) as refusal:
        return None, refusal


def answered(solver, ask):
    """What `ask` returns; a solver that is not ours may refuse, by name."""
    answer, refusal = outcome(ask)
    if refusal is not None:
        assert solver not in OWN.values(), refusal
        assert solver.name in str(refusal)
        pytest.skip(f"{solver.name} refuses: {refusal}")
    return answer


def simulated(solver, mesh=None, times=TIMES, **options):
    return answered(
        solver, lambda: vx.simulate(scene(solver), mesh or small("squares", 4), times, solver=solver, **options)
    )


def distance(history, other, scale=1.0):
    """Energy norms of the differences of two histories on one mesh, over the largest energy norm."""
    A = pose_scene(history.scene, history.mesh).A
    apart = (history.displacement - other.displacement / scale).reshape(len(history.times), -1)
    return np.sqrt(np.maximum(np.einsum("ni,ni->n", apart, (A @ apart.T).T), 0.0) / (2 * history.energy.max()))


def claimed(*histories):
    """What the certificates of the last instant, which accumulate all before, allow for the distance at any."""
    return sum(h.certificate_total[-1] + h.certificate_floor.sum() for h in histories)


# The sentences: "every solver ..."


def is_frozen_and_keeps_no_state(solver):
    for setting in dataclasses.fields(solver):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(solver, setting.name, None)
    before = repr(solver), dict(vars(solver))
    simulated(solver)
    assert (repr(solver), dict(vars(solver))) == before


def refuses_an_accuracy_that_means_nothing(solver):
    for wrong in (0, 1, 0.0, -1e-6, 2, np.nan, np.inf, "x", None):
        with pytest.raises(
            vx.SceneError, match=rf"^{solver.name}: found accuracy = .*{wrong}.* between 0 and 1, such as 1e-6\.$"
        ):
            dataclasses.replace(solver, accuracy=wrong)


def answers_within_its_accuracy_where_some_stick_and_some_slip(solver):
    history = simulated(solver)
    assert history.certificate.max() <= solver.accuracy
    assert history.solver == repr(solver)
    if slips(solver):
        sticks = history.contact.sticking[1:]
        assert sticks.any()
        assert not sticks.all()
    # A run that took another way: all unknowns, and the hand-written method (its own judge: Clarabel).
    other = vx.Clarabel(accuracy=1e-7) if isinstance(solver, vx.Newton) else vx.Newton()
    reference = vx.simulate(history.scene, history.mesh, TIMES, solver=other, condense=False)
    assert distance(history, reference).max() <= claimed(history, reference)


def answers_sliders_in_closed_form(solver):
    """k u + w sign(u') = f: u_n = clip(u_{n-1}, (f_n - w) / k, (f_n + w) / k)."""
    if not slips(solver):
        return
    k, w, load, system = sliders()
    u = np.zeros((len(TIMES), len(k)))
    for n in range(1, len(TIMES)):
        f = load(TIMES[n])
        u[n] = np.clip(u[n - 1], (f - w) / k, (f + w) / k)
    moves = np.diff(u, axis=0) != 0
    assert moves.any()
    assert not moves.all()
    history = answered(solver, lambda: vx.march(system, TIMES, solver=solver))
    error = np.sqrt((history.state - u) ** 2 @ k)
    scale = np.maximum.accumulate(np.sqrt(u**2 @ k))
    bound = history.certificate_total + history.certificate_floor.sum()
    # The scale of the certificates is that of the answer, which differs from the exact one by themselves.
    assert (error <= bound * scale * (1 + 2 * solver.accuracy) + 1e-300).all()


def never_returns_an_uncertified_answer_silently(solver):
    """An accuracy beyond round-off is refused with the numbers, or reached; asked to go on, it is admitted."""
    greedy = dataclasses.replace(solver, accuracy=1e-30)
    mesh = small("voronoi", 3)
    history, refusal = outcome(lambda: vx.simulate(scene(solver), mesh, TIMES, solver=greedy))
    if refusal is None:
        assert history.certificate.max() <= 1e-30
        return
    assert isinstance(refusal, vx.NotCertified)
    assert f"{solver.name} reached a certified relative energy error of" in str(refusal)
    assert refusal.reached > refusal.asked == 1e-30
    history = vx.simulate(scene(solver), mesh, TIMES, solver=greedy, check=False)
    assert history.certificate.max() > 1e-30
    if np.isfinite(history.certificate).all():
        reference = vx.simulate(history.scene, mesh, TIMES, solver=vx.Newton())
        assert distance(history, reference).max() <= claimed(history, reference)


def gives_the_same_answer_twice(solver):
    first = simulated(solver)
    simulated(solver, small("voronoi", 3))
    again = simulated(solver)
    for name in ("displacement", "certificate", "dissipated", "iterations"):
        assert np.array_equal(getattr(again, name), getattr(first, name)), name
    assert np.array_equal(again.contact.traction, first.contact.traction)


def answers_a_step_with_zero_load_by_not_moving(solver):
    calm = vx.Scene(*(e for e in scene(solver) if not isinstance(e, vx.Traction)))
    history = vx.simulate(calm, small("squares", 4), TIMES, solver=solver)
    assert not history.displacement.any()
    assert not history.certificate.any()
    assert not history.dissipated.any()
    # The solver itself, which was not even asked above.
    rng = np.random.default_rng(1)
    root = rng.normal(size=(6, 6))
    rows = sp.csr_matrix(np.eye(6)[:4] if slips(solver) else np.zeros((0, 6)))
    operators = Operators(root @ root.T + np.eye(6), rows)
    rest = StepProgram(operators, np.zeros(6), np.ones(operators.count), np.zeros(operators.count))
    answer = answered(solver, lambda: solver.prepare(operators)).solve(rest, 1e-12, np.zeros((operators.count, 1)))
    certificate = rest.certify(answer.d, answer.lam)
    # A certificate of the answer 0: half of |d|^2 in the norm of K.
    assert 0.5 * answer.d @ operators.K @ answer.d <= certificate.gap + certificate.floor
    assert certificate.gap <= 1e-6


def says_by_name_what_it_does_not_accept(solver):
    for feature, block in ((ABSOLUTE_VALUES, 1), (SECOND_ORDER_CONES, 2)):
        _, _, _, system = sliders(block=block)
        if feature in solver.accepts:
            history = answered(solver, lambda system=system: vx.march(system, TIMES[:3], solver=solver))
            assert history.certificate.max() <= solver.accuracy
            continue
        able = "Newton, OSQP, Clarabel" if block == 1 else "Newton, Clarabel"
        with pytest.raises(
            vx.NotAccepted,
            match=rf"^solver {solver.name}: the program has {feature}, which it does not accept; it accepts .*quadratic"
            rf".*These accept the program: {able}\.$",
        ):
            vx.march(system, TIMES, solver=solver)


def works_on_plain_matrices(solver):
    """K, B, w and a load, dense or sparse, of no mesh; B has rows that read several unknowns."""
    K = [[4.0, -1.0, 0.0], [-1.0, 3.0, -1.0], [0.0, -1.0, 5.0]]
    B = [[1.0, -1.0, 0.0], [0.0, 0.6, 0.8]]
    norms = vx.Norms(B, [0.3, 0.5]) if slips(solver) else None

    def load(t):
        return [3 * t, -t, 2 * t * (1 - t)]

    answers = []
    for matrix, rows in (
        (K, norms),
        (sp.coo_array(np.array(K)), norms and vx.Norms(sp.csc_array(np.array(B)), [0.3, 0.5])),
    ):
        system = vx.System(matrix, load, rows)
        answers.append(answered(solver, lambda system=system: vx.march(system, TIMES, solver=solver)))
    assert answers[0].certificate.max() <= solver.accuracy
    assert np.array_equal(answers[0].state, answers[1].state)
    # Equilibrium of the whole, from the answer alone.
    pulled = np.einsum("tib,in->tn", answers[0].multipliers, np.array(B)) if slips(solver) else 0.0
    force = np.array([load(t) for t in TIMES]) - answers[0].state @ np.array(K) - pulled
    stiff = np.linalg.eigvalsh(np.array(K)).max()
    # |K (d - d*)| <= |K|^{1/2} |d - d*|_K, certified by accuracy times the largest energy norm, step upon step.
    scale = np.sqrt(stiff) * np.sqrt(2 * answers[0].energy.max())
    assert np.abs(force).max() <= len(TIMES) * solver.accuracy * scale + 1e-14 * stiff


def gives_the_same_answer_on_the_full_program(solver):
    condensed = simulated(solver)
    full = answered(solver, lambda: vx.simulate(condensed.scene, condensed.mesh, TIMES, solver=solver, condense=False))
    assert distance(condensed, full).max() <= claimed(condensed, full)


UNITS = [(10, 0), (0, 7), (-7, 31), (13, -21), (-30, -24)]
"""Lengths times 2^a, stresses times 2^b: steel in SI is (0, 37) away from a modulus of one."""


def knows_no_units(solver):
    """Powers of two change no digit of data, so that they may change none of the answer."""
    square = small("squares", 4)

    def run(length, stress):
        edges = {name: part for name, part in square.boundaries.items() if name != "boundary"}
        mesh = vx.PolygonMesh(square.points * length, square.cells, boundaries=edges)
        return answered(solver, lambda: vx.simulate(scene(solver, length, stress), mesh, TIMES, solver=solver))

    plain = run(1.0, 1.0)
    for a, b in UNITS:
        length, stress = 2.0**a, 2.0**b
        other = run(length, stress)
        # Relative numbers pass through square roots of 2^b: one rounding.
        assert np.allclose(other.certificate, plain.certificate, rtol=1e-14, atol=0)
        assert np.allclose(other.energy, stress * length**2 * plain.energy, rtol=1e-14, atol=0)
        if isinstance(solver, (vx.Newton, vx.Direct)):
            assert np.array_equal(other.displacement, length * plain.displacement)
            assert np.array_equal(other.contact.traction, stress * plain.contact.traction)
            assert np.array_equal(other.forces, stress * length * plain.forces)
        assert distance(plain, other, length).max() <= claimed(plain, other)


SENTENCES: list[Callable[[vx.Solver], None]] = [
    is_frozen_and_keeps_no_state,
    refuses_an_accuracy_that_means_nothing,
    answers_within_its_accuracy_where_some_stick_and_some_slip,
    answers_sliders_in_closed_form,
    never_returns_an_uncertified_answer_silently,
    gives_the_same_answer_twice,
    answers_a_step_with_zero_load_by_not_moving,
    says_by_name_what_it_does_not_accept,
    works_on_plain_matrices,
    gives_the_same_answer_on_the_full_program,
    knows_no_units,
]


@pytest.mark.parametrize("solver", SOLVERS.values(), ids=SOLVERS)
@pytest.mark.parametrize("sentence", SENTENCES, ids=lambda f: f.__name__)
def test_every_solver(sentence, solver):
    sentence(solver)


def test_no_exported_solver_is_missing_from_the_samples():
    exported = {
        thing
        for space in (vx, vx.solvers)
        for thing in vars(space).values()
        if isinstance(thing, type) and issubclass(thing, vx.Solver) and not inspect.isabstract(thing)
    }
    assert exported == {type(solver) for solver in OWN.values()}
    assert {kind.__name__ for kind in exported} <= set(vx.__all__)


@dataclasses.dataclass(frozen=True)
class Liar(vx.Solver):
    """A solver of one's own that spoils Newton's answers, and says they converged."""

    spoil: Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
    accuracy: float = 1e-6
    accepts = vx.Newton.accepts

    def prepare(self, operators):
        honest, spoil = vx.Newton().prepare(operators), self.spoil

        class Prepared:
            def solve(self, program, target, lam, p=None):
                answer = honest.solve(program, target, lam)
                d, lam = spoil(answer.d, answer.lam)
                return dataclasses.replace(answer, d=d, lam=lam, status="converged")

        return Prepared()


def spoils():
    return {
        "honest": lambda d, lam: (d, lam),
        "nothing moves": lambda d, lam: (0 * d, lam),
        "a hundredth more": lambda d, lam: (1.01 * d, lam),
        "no multipliers": lambda d, lam: (d, 0 * lam),
        "multipliers turned": lambda d, lam: (d, -lam),
        "not a number": lambda d, lam: (d * np.nan, lam),
    }


@pytest.mark.parametrize(("lie", "spoil"), spoils().items(), ids=spoils())
def test_a_solver_is_believed_in_nothing(lie, spoil):
    solver, mesh = Liar(spoil), small("squares", 4)
    if lie == "honest":
        assert vx.simulate(scene(solver), mesh, TIMES, solver=solver).certificate.max() <= 1e-6
        return
    with pytest.raises(vx.NotCertified, match=r"^step 1 at t = .*Liar reached .*asked was 1\.0e-06"):
        vx.simulate(scene(solver), mesh, TIMES, solver=solver)


def test_the_smallest_solver_that_accepts_is_chosen_and_named(caplog):
    caplog.set_level("INFO", logger="vemcvx")
    frictionless = vx.simulate(scene(vx.Direct()), small("squares", 2), TIMES)
    assert frictionless.solver == repr(vx.Direct())
    assert "solver: Direct" in caplog.text
    assert vx.simulate(scene(vx.Newton()), small("squares", 2), TIMES).solver == repr(vx.Newton())
    assert "solver: Newton, the smallest that accepts absolute values, quadratic" in caplog.text
