"""The proximal point method on anchors, by which solvers of definite programs solve semidefinite ones.

The theory stands in :mod:`vemcvx.program.kernel`. Each proximal point is judged by the gap of the program that was
posed, in the seminorm of K.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from vemcvx.arrays import Floats, Ints, lengths
from vemcvx.program.operators import Operators
from vemcvx.program.step_program import Answer, StepProgram, fitting
from vemcvx.program.tolerances import UNSEEN
from vemcvx.solvers.solver import Solver

MOST_MOVES = 2.0**40
"""Lengths of the last move that a centre may go at a time; its inverse is the part of a way that is rounding."""


class ProximalPoints:
    """A solver of positive definite programs, prepared for semidefinite ones.

    Iteration goes on below the target while one point in six halves the gap. With a solver that does not count its
    iterations, each of which may be long, it stops at the target, or when two points do not halve the gap.

    The solver is asked programs of ``operators.regular`` only. Where the body `follows` the ground, iteration begins at
    the rigid motion nearest to b, instead of at rest.
    """

    def __init__(self, solver: Solver, operators: Operators, follows: bool):
        self._solver, self._regular, self._follows = solver, operators.regular, follows
        self._prepared, self._most = solver.prepare(self._regular), solver.max_iterations

    def solve(self, program: StepProgram, target: float, lam: Floats, p: Floats | None = None) -> Answer:
        enough, patience = (UNSEEN**2 * target, 6) if self._most < np.inf else (target, 2)
        d = _motion_nearest_to_b(program) if self._follows else np.zeros(len(program.g))
        p = np.zeros_like(program.e) if p is None else p
        best = Answer(d, lam, 0, "nothing answered", p=p)
        least, waited, iterations, safeguards, carried = np.inf, 0, 0, 0, False
        anchor = program.operators.anchor
        centres = _Centres(np.flatnonzero(np.zeros(len(d)) if anchor is None else anchor))
        for _ in range(200):
            near, solver = program.proximal(d), self._solver.after(iterations)
            prepared = self._prepared if solver is self._solver else solver.prepare(self._regular)
            answer = fitting(prepared.solve(near, target, lam, p), near, solver.name)
            iterations, safeguards = iterations + answer.iterations, safeguards + answer.safeguards
            centre = d
            d, lam, p = program.admissible_point(answer.d, answer.lam, answer.p)
            gap = program.duality_gap(d, lam, p)
            waited = 0 if gap <= 0.5 * least else waited + (not carried)
            if gap < least:
                best, least = replace(answer, d=d, lam=lam, p=p), gap
            if least <= enough or waited >= patience or iterations >= self._most:
                break
            ahead = centres.next(centre, d)
            carried = centres.steady and not _presses(program, v := _without_energy(program, d - centre))
            moves = _moves_to_least_energy(program, d, v) if carried else 0.0
            if moves >= MOST_MOVES:
                break
            d = d + moves * v if carried else ahead
        return replace(best, iterations=iterations, safeguards=safeguards)


def _motion_nearest_to_b(program: StepProgram) -> Floats:
    """The rigid motion whose slips are nearest to b."""
    N = program.operators.kernel
    if N is None or program.operators.count == 0:
        return np.zeros(len(program.g))
    B = program.operators.B
    # Motions of which rows of B read less than 1e-9 of their largest entries are across these rows.
    felt, rounding = B @ N, 1e-9 * abs(B).max() * np.abs(N).max()
    # Of motions across them rows read rounding, by which b is not to be divided.
    if (size := np.linalg.norm(felt, 2)) <= rounding:
        return np.zeros(len(program.g))
    motion: Floats = N @ np.linalg.lstsq(felt, program.b, rcond=rounding / size)[0]
    return motion


def _without_energy(program: StepProgram, move: Floats) -> Floats:
    """The part of a move (n,) that K does not feel."""
    N = program.operators.kernel
    return move if N is None else N @ (N.T @ move)


def _presses(program: StepProgram, v: Floats) -> bool:
    """Return True if a motion v changes how far limits with compliance are exceeded, and so the force that moves it."""
    operators = program.operators
    read = np.abs(operators.limits.read(v)) > 1e-9 * np.abs(v).max(initial=0.0)
    return bool((read & (operators.compliance > 0)).any())


def _moves_to_least_energy(program: StepProgram, d: Floats, v: Floats) -> float:
    """s >= 0 of the point d + s v of least energy along a motion that K does not feel: only terms and bounds count.

    MOST_MOVES where nothing ends it.
    """
    operators = program.operators
    slip, way, felt = program.slip(d), operators.blocks(operators.rows.read(v)), operators.limits.read(v)
    excess, bound, work = program.excess(d), (operators.compliance == 0) & (felt > 0), float(program.g @ v)

    def falls(s: float) -> bool:
        at = slip + s * way
        size = lengths(at)
        against = program.w @ (np.einsum("ij,ij->i", at, way) / np.where(size > 0, size, 1.0))
        return bool(against < work and not ((excess + s * felt)[bound] > 0).any())

    near, far = 0.0, 1.0
    while far < MOST_MOVES and falls(far):
        near, far = far, 2.0 * far
    while far * MOST_MOVES > 1.0 and near < (middle := 0.5 * (near + far)) < far:
        near, far = (middle, far) if falls(middle) else (near, middle)
    return far


class _Centres:
    """Anderson's acceleration of the proximal points' centres, in as many unknowns as anchors.

    The map from centre to proximal point is piecewise affine, so that secants through its last k + 1 values find its
    fixed point as soon as no term changes sets any more. A centre that does worse than the one before starts anew.
    """

    def __init__(self, anchored: Ints):
        self._at = anchored
        self._centres: list[Floats] = []
        self._moves: list[Floats] = []
        self.steady = False
        """True if the last move was like the one before."""

    def next(self, centre: Floats, d: Floats) -> Floats:
        """The next centre (n,), after the proximal point d of `centre`."""
        x, move = centre[self._at], (d - centre)[self._at]
        if self._moves and np.linalg.norm(move) > 2 * np.linalg.norm(self._moves[-1]):
            self._centres, self._moves = [], []
        self._centres, self._moves = [*self._centres, x][-len(x) - 1 :], [*self._moves, move][-len(x) - 1 :]
        ahead, self.steady = d.copy(), False
        if len(self._moves) > 1:
            dx, df = np.diff(self._centres, axis=0).T, np.diff(self._moves, axis=0).T
            length = np.linalg.norm(move)
            # A move that changes by less than .01 comes from a constant force: no term is near a kink, and the centre
            # goes on along it up to the next one.
            self.steady = bool(np.linalg.norm(df[:, -1]) < 0.01 * length and np.linalg.norm(x) < MOST_MOVES * length)
            step = move - (dx + df) @ np.linalg.lstsq(df, move, rcond=1e-10)[0]
            # Where points diverge, secants of them are rounding: no more than four lengths of the last move.
            size, far = np.linalg.norm(step), 4.0 * np.linalg.norm(dx[:, -1])
            ahead[self._at] = x + (step * (far / size) if size > far else step)
        return ahead
