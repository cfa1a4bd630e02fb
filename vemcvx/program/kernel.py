"""K with a kernel N: motions that cost no energy, held by norm terms and limits alone.

That is a body without supports, held by friction, or by its weight on an obstacle.

A step min 1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i| subject to Dd <= e then has a solution if no motion Nc pays,

    c'N'g < sum_i w_i |B_i N c|   for all c with DNc <= 0,   so that   N'g = N'B'lam + N'D'p,  |lam_i| <= w_i,  p >= 0,

and K d* is unique while d* need not be: errors are measured in the seminorm |.|_K. Stiffness on k unknowns (*anchors*)
that the motions move makes K positive definite, so that it can be factorised. Newton's method has the motions
themselves as unknowns (:mod:`vemcvx.program.forces`); solvers that do not take a semidefinite K are refused.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.linalg import qr

from vemcvx.base.arrays import EPS, Floats, as_real_array, brief, called, function, power_of_two
from vemcvx.base.errors import SceneError


@dataclass(frozen=True)
class Kernel:
    """The motions that K does not feel.

    Parameters
    ----------
    modes : (n, k) array
        Independent motions with K modes = 0.
    names : (k,) sequence of str
        The motions in words, for messages.
    in_words : callable (k,) -> str, optional
        A combination of the motions in words, the way it goes; by default the names of those that take part.
    """

    modes: Floats
    names: tuple[str, ...]
    in_words: Callable[[Floats], str] | None = None

    def __post_init__(self) -> None:
        modes = as_real_array(self.modes, "Kernel: modes", "(n, k) motions, one a column")
        names = self.names if isinstance(self.names, (tuple, list)) else ()
        if modes.ndim != 2 or len(names) != modes.shape[1] or not all(isinstance(name, str) for name in names):
            raise SceneError(
                f"Kernel: found modes of shape {modes.shape} and names = {brief(self.names)}; wanted one column of "
                "numbers, and one name, a motion."
            )
        if not np.isfinite(modes).all():
            raise SceneError("Kernel: modes: found NaN or infinite values; all must be finite.")
        function(self.in_words, "Kernel: found in_words", "a function of (k,) shares of the motions")
        object.__setattr__(self, "modes", modes)
        object.__setattr__(self, "names", tuple(names))

    @cached_property
    def basis(self) -> Floats:
        """(n, k) orthonormal motions that span those of `modes`."""
        return np.linalg.qr(self.modes)[0]

    def name(self, c: Floats) -> str:
        """The motion modes @ c in words, the way it goes."""
        if self.in_words is not None:
            return str(called(self.in_words, (c,), "Kernel: in_words failed", "say which motion they make"))
        large = np.flatnonzero(np.abs(c) > 1e-3 * np.abs(c).max())
        return " with ".join(self.names[i] if c[i] > 0 else f"the reverse of {self.names[i]}" for i in large)


def rank_on(rows: sp.csr_matrix, modes: Floats) -> int:
    """The number of motions `modes` (n, k) that rows feel by more than rounding."""
    read, size = np.asarray(abs(rows).sum(axis=1)).ravel(), np.abs(modes).max(axis=0, initial=0.0)
    seen = (rows @ modes)[read > 0] / read[read > 0, None] / np.where(size > 0, size, 1.0)
    return int(np.linalg.matrix_rank(seen, tol=8 * EPS * max(len(seen), 1)))


def anchors(modes: Floats, diagonal: Floats) -> Floats:
    """(m,) stiffness at as many unknowns as there are modes (m, k), those that tell them apart best; else zero.

    It is of the size of K's diagonal: soft anchors would cost W = A K^{-1}A' digits.
    """
    picked = qr(modes.T, mode="economic", pivoting=True)[2][: modes.shape[1]]
    stiffness = np.zeros(len(modes))
    stiffness[picked] = power_of_two(diagonal[picked])
    return stiffness


@dataclass(frozen=True)
class KernelBalance:
    """The balance on a kernel: how norm terms and limits feel its motions N and hold a load there."""

    friction_modes: Floats
    """(m, block, k) B_i N"""
    contact_modes: Floats
    """(r, k) D N"""

    def nearest(
        self, lam: Floats, p: Floats, w: Floats, push: Floats, inverse_metric: tuple[Floats, Floats]
    ) -> tuple[Floats, Floats, Floats]:
        """The multipliers nearest to (lam, p) with |lam_i| <= w_i, p >= 0 and G'lam + H'p = push; what is left.

        In the metric sum |dlam_i|^2 / a_i + sum dp_j^2 / b_j, with G the friction modes and H the contact modes:
        lam(c) = P_w(lam + a G c), p(c) = (p + b H c)_+ with c the minimiser of a convex, piecewise smooth function of
        k unknowns whose gradient is G'lam(c) + H'p(c) - push: a line-searched Newton method. Where there are no such
        multipliers, c grows without bound, and the remainder is a motion that friction and limits cannot hold. `push`
        (k,) is N'g; the larger a (m,) and b (r,), the inverse metric, the less it costs to change a multiplier.
        """
        at, (a, b) = partial(self._at, lam, p, w=w, push=push, inverse_metric=inverse_metric), inverse_metric
        c = np.zeros(len(push))
        here = at(c=c)
        if here.balanced:
            return here.lam, here.p, here.left
        spread = float(np.einsum("ij,ij->i", lam, lam) @ (1 / a) + p * p @ (1 / b) + w * w @ (1 / a))
        # Of all second derivatives the largest: nothing is cut and everything pressed.
        most = np.einsum("i,ijk->k", a, self.friction_modes**2) + b @ self.contact_modes**2
        lift = 1e-6 * most.sum() * np.eye(len(most))
        units = 1 / np.sqrt(most + 1e-12 * most.sum())
        for _ in range(60):
            left = here.left
            if here.balanced or self.is_mechanism(left, w, push):
                break
            slope = self._slope(here, w, inverse_metric)
            length, flat = 1.0, np.linalg.eigvalsh(units[:, None] * slope * units)[0] <= 1e-12
            # Where (almost) everything is cut the second derivative vanishes, and the lift makes far too long a step.
            step = np.linalg.solve(slope + lift if flat else slope, left)
            ahead = at(c=c + step)
            while length > 1e-12 and not ahead.better(here, length * float(left @ step), spread):
                length *= 0.125 if flat else 0.5
                ahead = at(c=c + length * step)
            if ahead.level(here, spread) and np.abs(ahead.left).max() >= 0.9 * np.abs(left).max():
                break
            c, here = c + length * step, ahead
        return here.lam, here.p, here.left

    def is_mechanism(self, c: Floats, w: Floats, push: Floats) -> bool:
        """True if c is a collapse mechanism: it runs into no limit, and the load does more work than friction takes."""
        into = self.contact_modes @ c
        # A motion along all obstacles may be the sum of two that run into them, known to their rounding.
        rounding = 1e-12 * (np.abs(self.contact_modes) @ np.abs(c)).max(initial=0.0)
        if (into > max(1e-9 * np.abs(into).max(initial=0.0), rounding)).any():
            return False
        return bool(c @ push > w @ np.linalg.norm(self.friction_modes @ c, axis=1) * (1 + 1e-12))

    def unbalanced_motion(self, w: Floats, push: Floats) -> Floats | None:
        """A motion c (k,) that nothing holds against the load; None if there is none."""
        none = np.zeros(self.friction_modes.shape[:2]), np.zeros(len(self.contact_modes))
        lam, p, left = self.nearest(*none, w, push, (np.ones(len(w)), np.ones(len(self.contact_modes))))
        if self.is_mechanism(left, w, push):
            return left
        if (np.abs(left) <= self.imbalance(lam, p, push, np.abs(push))[1]).all():
            return None
        motion = self._most_powerful(w, push)
        return motion if motion is not None and self.is_mechanism(motion, w, push) else None

    def _most_powerful(self, w: Floats, push: Floats) -> Floats | None:
        """The motion c (k,), |c_a| <= 1, that runs into no limit and gains most: push . c - sum w_i |B_i N c|.

        A linear program in c and t_i >= q . B_i N c, for more and more unit vectors q; of absolute values two do.
        """
        from scipy.optimize import linprog

        m, block, k = self.friction_modes.shape
        # The solver takes gains below 1e-7 for none: forces are scaled such that the largest is 1e5.
        cost = np.concatenate([-push, w]) * (1e5 / (np.abs(push).max(initial=0.0) or 1.0))
        bounds = [(-1.0, 1.0)] * k + [(0.0, np.inf)] * m
        cuts = [sp.csr_matrix(np.pad(self.contact_modes, ((0, 0), (0, m))))]
        towards = [sign * np.tile(axis, (m, 1)) for axis in np.eye(block) for sign in (1.0, -1.0)]
        for _ in range(1 if block == 1 else 20):
            felt_along = [np.einsum("ij,ijk->ik", q, self.friction_modes) for q in towards]
            cuts += [sp.csr_matrix(sp.hstack([sp.csr_matrix(rows), -sp.identity(m)])) for rows in felt_along]
            A: Any = sp.csr_matrix(sp.vstack(cuts))
            x = linprog(cost, A_ub=A, b_ub=np.zeros(A.shape[0]), bounds=bounds).x
            if x is None or self.is_mechanism(x[:k], w, push):
                break
            s = self.friction_modes @ x[:k]
            size = np.linalg.norm(s, axis=1, keepdims=True)
            towards = [np.divide(s, size, out=np.zeros_like(s), where=size > 0)]
        return None if x is None else np.asarray(x[:k])

    def imbalance(self, lam: Floats, p: Floats, push: Floats, pushed: Floats) -> tuple[Floats, Floats]:
        """push - G'lam - H'p (k,), and what rounding may leave of it; `pushed` is |N|'|g|."""
        modes, x = self._modes, np.concatenate([lam.ravel(), p])
        absolute: Floats = np.abs(x) @ self._absolute
        return push - x @ modes, 8 * EPS * (pushed + absolute)

    @cached_property
    def _modes(self) -> Floats:
        """(m * block + r, k) what all multipliers feel."""
        return np.concatenate([self.friction_modes.reshape(-1, self.contact_modes.shape[1]), self.contact_modes])

    @cached_property
    def _absolute(self) -> Floats:
        return np.abs(self._modes)

    def _at(
        self, lam: Floats, p: Floats, w: Floats, push: Floats, inverse_metric: tuple[Floats, Floats], c: Floats
    ) -> _Point:
        a, b = inverse_metric
        q = lam + a[:, None] * (self.friction_modes @ c)
        pressed = np.maximum(p + b * (self.contact_modes @ c), 0.0)
        size = np.sqrt(np.einsum("ij,ij->i", q, q))
        share = np.where(size > w, w / np.where(size > 0, size, 1.0), 1.0)
        held, over = q * share[:, None], np.maximum(size - w, 0.0)
        value = 0.5 * float((size * size - over * over) @ (1 / a) + pressed * pressed @ (1 / b))
        left, blur = self.imbalance(held, pressed, push, np.abs(push))
        return _Point(lam=held, p=pressed, q=q, value=value - float(push @ c), left=left, size=blur / (8 * EPS))

    def _slope(self, at: _Point, w: Floats, inverse_metric: tuple[Floats, Floats]) -> Floats:
        """(k, k) the (generalised) second derivative at a point."""
        a, b = inverse_metric
        size = np.sqrt(np.einsum("ij,ij->i", at.q, at.q))
        cut, known = size > w, np.where(size > 0, size, 1.0)
        unit = (at.q * (cut / known)[:, None])[:, :, None]
        across = self.friction_modes - unit * (unit * self.friction_modes).sum(axis=1, keepdims=True)
        share = np.where(cut, w / known, 1.0)
        across = (np.sqrt(a * share)[:, None, None] * across).reshape(-1, len(at.left))
        against = self.contact_modes * np.sqrt(b * (at.p > 0))[:, None]
        slope: Floats = across.T @ across + against.T @ against
        return slope


@dataclass(frozen=True)
class _Point:
    """The multipliers at a point, q before they were cut; the convex function, minus its gradient, and sizes in it."""

    lam: Floats
    p: Floats
    q: Floats
    value: float
    left: Floats
    size: Floats

    @property
    def balanced(self) -> bool:
        """True if nothing is left but rounding."""
        return bool((np.abs(self.left) <= 8 * EPS * self.size).all())

    def better(self, before: _Point, descent: float, spread: float) -> bool:
        """Armijo's rule; where the value changes by less than its rounding, the gradient must halve instead."""
        nearer = np.abs(self.left).max() <= 0.5 * np.abs(before.left).max()
        return bool(self.value <= before.value - 1e-4 * descent or (self.level(before, spread) and nearer))

    def level(self, before: _Point, spread: float) -> bool:
        """Return True if the values differ by no more than their rounding."""
        return abs(self.value - before.value) <= 64 * EPS * spread
