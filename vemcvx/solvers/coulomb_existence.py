"""Proof that a solution of Coulomb's law lies near the answer of sets, where discs slip and no system is linear.

Let x_0 = (lam, p) solve the system M x = r of some sets (:mod:`vemcvx.solvers.coulomb_sets`), which takes terms that
slip by their directions q_i and curvatures h_i. What it misses of the law are, on these terms,

    psi_i(s, p) = W_i(p) s_i / |s_i| - q_i (W(p_0) + J (p - p_0))_i - h_i (I - q_i q_i') s_i,

and (Q) on the sets is x = x_0 + G psi(s, p), with G the columns of M^{-1} for the rows of these terms. At x_0 let
v_i = |s_i|, u_i = s_i / v_i, delta_i = |u_i - q_i|; let A_ij, C_ij and P_ji be the norms of the blocks by which s_i
along u_i, s_i across it and p_j answer psi_j. For bounds t_j on |psi_j| let

    alpha = A t,    gamma = C t,    pi = P t,    turn_i = gamma_i / (v_i - alpha_i),
    L_i = |W_i / v_i - h_i| gamma_i + W_i turn_i ((alpha_i + gamma_i) / v_i + turn_i / 2)
          + h_i delta_i (alpha_i + gamma_i) + (|J| pi)_i (delta_i + turn_i).

Theorem. If for some t >= 0: alpha_i < v_i and |psi_i(s_0, p_0)| + L_i <= t_i, W is affine on |p - p_0| <= pi, and the
inequalities of the sets hold at x_0 + G psi for all |psi| <= t, then (Q) has a solution d with |d - d_0|_K <=
sum_j n_j t_j, n_j the largest energy norm of an answer to a unit psi_j.

Proof. Let s_i move by a along u_i and by c across it, |a| <= alpha_i, |c| <= gamma_i. Its angle with u_i is at most
arctan turn_i, and its direction is c / |s_i| across u_i and at least 1 - turn_i^2 / 2 along it, where c / |s_i|
differs from c / v_i by at most turn_i (alpha_i + gamma_i) / v_i. From W_i times that psi_i takes h_i times
(I - q q')(a u + c), which differs from c by at most delta_i (alpha_i + gamma_i), as |uu' - qq'| <= |u - q|. With what W
adds along u - q, psi changes by at most L. So (s, p) -> what x_0 + G psi(s, p) has for them is continuous and maps
this convex compact set into itself: Brouwer gives a fixed point, and x_0 + G psi there solves (Q).  QED

That bounds the distance to *a* solution, as the theorem of absolute values does, where psi = 0; no coefficient need be
small. (A contraction would prove that there is no other. With forces of bounds lifted into the body by E, D E = 1 and
B E = 0, weights contract where the largest eigenvalues of mu E'KE mu and of B K^{-1} B' have a product below 1: on a
clamped block of n^3 cubes for coefficients below .18, .11, .08 and .07 at n = 2, 4, 6, 8.) Rounding, of x_0 and in
inequalities, is treated as there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from vemcvx.arrays import EPS, Bools, Floats
from vemcvx.program.step_program import StepProgram
from vemcvx.solvers.coulomb_system import ROUNDINGS, Found, WeightLaw
from vemcvx.solvers.response import Response
from vemcvx.solvers.sets import Sets

TRIALS = 8
"""Of t, each twice what the one before leads to: where psi changes little, the first does."""


@dataclass(frozen=True)
class _Answers:
    """How slips, multipliers and energy answer psi on the k terms that slip: norms of blocks."""

    slips: Floats
    """(m, k)"""
    along: Floats
    """(k, k), A"""
    across: Floats
    """(k, k), C"""
    multipliers: Floats
    """(m, k)"""
    forces: Floats
    """(r, k), P"""
    excess: Floats
    """(r, k)"""
    energy: Floats
    """(k,), n"""

    @staticmethod
    def of(found: Found, response: Response, slides: Bools, u: Floats) -> _Answers:
        """The answers to psi on the terms `slides` (m,), of directions u (k, block)."""
        block = u.shape[1]
        rows = np.flatnonzero(np.repeat(slides, block))
        unit = np.zeros((len(response.compliance), len(rows)))
        unit[rows, np.arange(len(rows))] = 1.0
        G = found.inverse(unit)
        moved = response.matrix @ G
        norms, limits = response.norms, response.limits
        energy = np.einsum("ij,ij->j", G, moved).reshape(-1, block).sum(axis=1)
        own = moved[rows].reshape(len(u), block, -1)
        along = np.einsum("ib,ibj->ij", u, own)
        across = (own - u[:, :, None] * along[:, None]).reshape(len(rows), -1)
        return _Answers(
            slips=_blocks(moved[norms], block),
            along=np.linalg.norm(along.reshape(len(u), -1, block), axis=2),
            across=_blocks(across, block),
            multipliers=_blocks(G[norms], block),
            forces=np.linalg.norm(G[limits].reshape(len(G[limits]), -1, block), axis=2),
            excess=np.linalg.norm(moved[limits].reshape(len(G[limits]), -1, block), axis=2),
            energy=np.sqrt(np.maximum(energy, 0.0)),
        )


def _blocks(matrix: Floats, block: int) -> Floats:
    """(m, k) Frobenius norms of blocks, which are no smaller than their spectral ones."""
    rows, columns = (n // block for n in matrix.shape)
    return np.asarray(np.linalg.norm(matrix.reshape(rows, block, columns, block), axis=(1, 3)))


def distance_to_a_solution(
    program: StepProgram, law: WeightLaw, sets: Sets, found: Found, response: Response
) -> float | None:
    """A bound on |d - d*|_K to a solution d* of (Q), from what the sets miss of it; None if there is no proof."""
    p, s = np.where(found.sets.act, np.maximum(found.point.p, 0.0), 0.0), program.slip(found.point.d)
    w, J, v = law.weights(p), law.slope(p), np.linalg.norm(s, axis=1)
    blur = found.motions.max(initial=0.0)
    # What slips by no more than rounding is held by others, wherever lam_i points.
    slides, held = ~sets.stick & (w > 0) & (v > blur), ~sets.stick & (w > 0) & (v <= blur)
    if not slides.any():
        return 0.0 if found.holds(program, law, sets) else None
    u, q, h = s[slides] / v[slides, None], sets.direction[slides], sets.curvature[slides]
    answers = _Answers.of(found, response, slides, u)
    W, v, steep = w[slides], v[slides], abs(J)[slides]
    missed = np.linalg.norm(found.point.lam[slides] - W[:, None] * u, axis=1) + found.forces + W * blur / v
    delta, off = np.linalg.norm(u - q, axis=1), np.abs(W / v - h)
    t = 2.0 * missed
    for _ in range(TRIALS):
        alpha, gamma, pi = answers.along @ t, answers.across @ t, answers.forces @ t
        if (alpha >= v).any():
            return None
        turn, far = gamma / (v - alpha), alpha + gamma
        changed = off * gamma + W * turn * (far / v + turn / 2) + h * delta * far + (steep @ pi) * (delta + turn)
        if (missed + changed <= t).all():
            moved = (answers.slips[held] @ t).max(initial=0.0)
            proven = moved <= blur and _hold(program, law, sets, found, (answers, t))
            return float(answers.energy @ t) if proven else None
        t = 2.0 * np.maximum(t, missed + changed)
    return None


def _hold(program: StepProgram, law: WeightLaw, sets: Sets, found: Found, ball: tuple[_Answers, Floats]) -> bool:
    """Whether the sets' inequalities hold, to rounding, wherever psi is at most t, and the law is affine there."""
    answers, t = ball
    act, pressure, pi = found.sets.act, found.point.p, answers.forces @ t
    pi[~act] = 0.0
    p, z = np.where(act, np.maximum(pressure, 0.0), 0.0), program.excess(found.point.d) + answers.excess @ t
    low, high = (law.slope(np.maximum(p + sign * pi, 0.0)) for sign in (-1.0, 1.0))
    w, J = law.weights(p), law.slope(p)
    affine = abs(low - J).sum() == 0 and abs(high - J).sum() == 0
    size = np.linalg.norm(found.point.lam, axis=1) + answers.multipliers @ t
    within = ~sets.stick | (size <= w - abs(J) @ pi + found.forces)
    # What others hold does not answer at all, but for the rounding of the answers.
    blur = found.motions[program.b.size :] + ROUNDINGS * EPS * (answers.excess.max(axis=0, initial=0.0) @ t)
    pressed = np.where(sets.act, pressure - pi >= -found.forces, z <= blur)
    silent = sets.stick | (w > 0) | (abs(J) @ pi == 0)
    still = ~sets.stick | (np.linalg.norm(program.slip(found.point.d), axis=1) <= found.motions.max(initial=0.0))
    return bool(affine and within.all() and pressed.all() and silent.all() and still.all())
