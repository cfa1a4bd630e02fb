"""The conformance suite of linear solvers."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial

import numpy as np
import pytest
import scipy.sparse as sp

from vemcvx.base.arrays import Floats
from vemcvx.base.errors import SceneError
from vemcvx.effects import BilateralContact, Elasticity, TrescaFriction, Viscosity
from vemcvx.linear import Factor, LinearSolver, SuperLU
from vemcvx.program import Norms, System
from vemcvx.program.kernel import Kernel
from vemcvx.program.operators import energy_norm
from vemcvx.stepping import Trajectory, march
from vemcvx.testing.solvers import TIMES, block

RUBBING = BilateralContact(on="bottom"), TrescaFriction(4.0, on="bottom")
KINDS = {
    "friction": block(*RUBBING, family="voronoi", n=8),
    "no friction": block(BilateralContact(on="bottom"), family="voronoi", n=8),
    "viscosity": block(*RUBBING, Viscosity(0.1, 0.1), family="voronoi", n=8),
    "nearly incompressible": block(*RUBBING, of=Elasticity(1.0, 0.4999999), family="voronoi", n=8),
    "a free body": block(*RUBBING, held=False, family="voronoi", n=8),
}
"""Systems for the comparison of runs. Iterative solvers run only the systems in `EASY`."""
EASY = ("friction", "no friction", "viscosity")
INDEFINITE = {
    "indefinite": [[1.0, 2.0], [2.0, 1.0]],
    "singular but for rounding": [[1.0, 1.0], [1.0, 1.0 + 2.0**-52]],
    "a stiff part and a soft one": [[1e12, 1e6, 0.0], [1e6, 1.0 - 1e-9, 0.0], [0.0, 0.0, 1.0]],
}
"""Matrices that have positive diagonals, but are not positive definite."""
REFUSED = "singular or indefinite.*the K of a System must be positive definite"


@cache
def _reference(kind: str, condense: bool) -> Trajectory:
    return march(KINDS[kind](), TIMES, linear=SuperLU(), condense=condense)


def _factor(linear: LinearSolver) -> tuple[sp.csr_matrix, Factor]:
    system = KINDS["friction"]()
    return system.K, linear.factorise(system.K, system.near_kernel)


def _random(*shape: int) -> Floats:
    return np.random.default_rng(shape[0]).normal(size=shape)


def solves(linear: LinearSolver) -> None:
    K, factor = _factor(linear)
    x = _random(K.shape[0], 2)
    # Inexact solvers stop at relative residuals of 1e-12.
    assert np.abs(factor.solve(K @ x[:, 0]) - x[:, 0]).max() < 1e-7
    assert np.abs(factor.solve(np.ascontiguousarray(K @ x)) - x).max() < 1e-7
    assert not factor.solve(np.zeros(K.shape[0])).any()
    b = K @ x[:, 0]
    assert 0.99 < factor.energy(b) / (b @ x[:, 0]) < 2.0
    assert factor.energy(0 * b) == 0.0


def gives_the_same_answer_twice(linear: LinearSolver) -> None:
    (K, one), (_, other) = _factor(linear), _factor(linear)
    b = _random(K.shape[0])
    assert np.array_equal(one.solve(b), other.solve(b))
    assert one.energy(b) == other.energy(b)


def refuses_indefinite_matrices(linear: LinearSolver) -> None:
    for rows in INDEFINITE.values():
        for norms in (None, Norms(np.eye(1, len(rows)), 0.1)):
            system = System(rows, np.ones(len(rows)).__mul__, norms)
            for condense in (True, False):
                with pytest.raises(SceneError, match=REFUSED):
                    march(system, [0, 1], linear=linear, condense=condense)


def runs_agree_within_their_certificates(kind: str, linear: LinearSolver) -> None:
    system = KINDS[kind]()
    for condense in (True, False):
        one, two = _reference(kind, condense), march(system, TIMES, linear=linear, condense=condense)
        apart = [energy_norm(system.K, y - z) for y, z in zip(one.state, two.state, strict=True)]
        bounds = [run.certified * np.asarray(run.unit) for run in (one, two)]
        assert (apart <= np.cumsum(bounds[0] + bounds[1])).all()
        assert two.certificate.max() <= 1e-8


def gives_the_schur_complement(linear: LinearSolver) -> None:
    """Check that S (K^{-1})_cc = I for the Schur complement S of unknowns c."""
    system, chain = KINDS["friction"](), sp.diags_array([-1.0, 2.5, -1.0], offsets=[-1, 0, 1], shape=(20, 20))
    n, order, mixed = system.n, system.elimination_order(), np.random.default_rng(7).permutation(system.n)
    assert order is not None
    cases = [(system.K, way, mixed[: int(part * n)]) for part in (0, 0.02, 0.5, 1) for way in (order, np.arange(n))]
    odd = [np.setdiff1d(np.arange(20), np.arange(0, 20, 2)[:inner]) for inner in (0, 1, 10)]
    for K, way, last in [*cases, *((sp.csr_matrix(chain), np.arange(20), last) for last in odd)]:
        factor, S = linear.eliminate(K, way, last)
        assert S.shape == (len(last), len(last))
        assert np.array_equal(S, S.T)
        assert np.abs(S @ np.linalg.inv(K.toarray())[np.ix_(last, last)] - np.eye(len(last))).max(initial=0) < 1e-10
        x = _random(K.shape[0], 3)
        b = K @ x
        b.flags.writeable = False
        assert np.abs(factor.solve(b) - x).max() < 1e-9
        assert np.array_equal(factor.solve(b[:, 1]), factor.solve(b[:, 1].copy()))
        assert factor.energy(b[:, 0]) == pytest.approx(x[:, 0] @ b[:, 0], rel=1e-10)


def refuses_diagonals_with_missing_entries(linear: LinearSolver) -> None:
    K = sp.csr_matrix(np.array([[2, 0.1, 0, 0], [0.1, 0, 1, 0], [0, 1, 3, 0.2], [0, 0, 0.2, 3]]))
    for last in ([], [0]):
        with pytest.raises(SceneError, match=REFUSED):
            linear.eliminate(K, np.arange(4), np.array(last, dtype=np.int64))


def refuses_indefinite_matrices_with_a_kernel(linear: LinearSolver) -> None:
    chain = np.diag([1.0, 2.0, 2.0, 1.0]) - np.eye(4, k=1) - np.eye(4, k=-1)
    stiffness, motions = np.linalg.eigh(chain)
    kernel = Kernel(np.ones((4, 1)), ("translation",))

    def system(K: Floats) -> System:
        return System(K, lambda t: t * np.array([1.0, 0.0, 0.0, -1.0]), Norms(np.eye(4), 1.0), kernel=kernel)

    assert march(system(chain), [0, 1], linear=linear).certificate.max() < 1e-8
    for gain in (1e-2, 1e-6):
        K = chain - (stiffness[1] + gain) * np.outer(motions[:, 1], motions[:, 1])
        with pytest.raises(SceneError, match=REFUSED):
            march(system(K), [0, 1], linear=linear)


Property = Callable[[LinearSolver], None]
PROPERTIES: list[Property] = [solves, gives_the_same_answer_twice, refuses_indefinite_matrices]
ELIMINATION_PROPERTIES: list[Property] = [
    gives_the_schur_complement,
    refuses_diagonals_with_missing_entries,
    refuses_indefinite_matrices_with_a_kernel,
]


def linear_properties(linear: LinearSolver) -> Iterator[tuple[str, Property]]:
    """Yield the name and the check of each property of linear solvers."""
    for check in PROPERTIES + ELIMINATION_PROPERTIES * linear.eliminates:
        yield check.__name__, check
    for kind in KINDS if linear.eliminates else EASY:
        yield f"runs agree: {kind}", partial(runs_agree_within_their_certificates, kind)
