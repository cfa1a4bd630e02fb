"""K with a kernel N: motions that cost no energy, held by norm terms alone (a body that only friction keeps in place).

A step min 1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i| then has a solution if and only if no motion Nc pays,

    c'N'g <= sum_i w_i |B_i N c|   for all c,   that is   N'g = N'B'lam for some |lam_i| <= w_i,

and K d* is unique while d* need not be: errors are measured in the seminorm |.|_K. Stiffness rho on k unknowns
(*anchors*) that the motions move makes K positive definite; the proximal point method (Rockafellar 1976),

    d_{j+1} = argmin  1/2 d'Kd - g'd + sum_i w_i |B_i d - b_i| + rho/2 |d - d_j|^2 on the anchors,

needs only such programs, stops at once where the anchors stick, and else gains a factor rho / (rho + stiffness).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import qr

from vemcvx.errors import SceneError

Floats = NDArray[np.float64]
Point = tuple[float, Floats, Floats]

# The anchors' stiffness in parts of K's diagonal: small, so that proximal points come close in a few steps; not so
# small that K loses digits (eight bits of 53 here).
ANCHOR = 2.0**-8
MOST_NEWTON = 60
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Kernel:
    """The motions that K does not feel.

    Parameters
    ----------
    modes : (n, k) array
        Independent motions with K modes = 0.
    names : (k,) sequence of str
        The motions in words, for messages.
    """

    modes: Floats
    names: tuple[str, ...]


def anchors(modes: Floats, diagonal: Floats) -> Floats:
    """(m,) stiffness at as many unknowns as there are modes (m, k), those that tell them apart best; else zero."""
    picked = qr(modes.T, mode="economic", pivoting=True)[2][: modes.shape[1]]
    stiffness = np.zeros(len(modes))
    stiffness[picked] = ANCHOR * np.ldexp(1.0, np.frexp(diagonal[picked])[1])
    return stiffness


def nearest(lam: Floats, w: Floats, grip: Floats, push: Floats) -> tuple[Floats, Floats]:
    """The multipliers nearest to `lam` with |lam_i| <= w_i and grip'lam = push, and what is left, push - grip'lam.

    lam(c) = P_w(lam + grip c) with c the minimiser of a convex, piecewise smooth function of k unknowns whose gradient
    is grip'lam(c) - push: a line-searched Newton method. Where no such lam exists, c grows without bound and what is
    left points along a motion that the weights cannot hold.

    Parameters
    ----------
    lam : (m, block) array
    w : (m,) array
    grip : (m, block, k) array
        B_i N.
    push : (k,) array
        N'g.
    """
    lift = 1e-6 * np.eye(len(push)) * np.einsum("ijk,ijk->", grip, grip)
    spread = float(np.einsum("ij,ij->", lam, lam) + w @ w)
    c = np.zeros(len(push))
    here = _projection(lam, w, grip, push, c)
    for _ in range(MOST_NEWTON):
        _, left, slope = here
        size = np.abs(push) + np.einsum("ijk,ij->k", np.abs(grip), np.abs(_clip(lam + grip @ c, w)[0]))
        if (np.abs(left) <= EPS * size).all() or _separates(left, w, grip, push):
            break
        # Where (almost) everything is cut the second derivative vanishes; elsewhere the lift is not wanted.
        step = np.linalg.solve(slope + lift if np.linalg.cond(slope) > 1e6 else slope, left)
        length, ahead = 1.0, _projection(lam, w, grip, push, c + step)
        while length > 1e-12 and not _better(ahead, here, length * float(left @ step), spread):
            length *= 0.5
            ahead = _projection(lam, w, grip, push, c + length * step)
        c, here = c + length * step, ahead
    return _clip(lam + grip @ c, w)[0], here[1]


def _better(ahead: Point, here: Point, descent: float, spread: float) -> bool:
    """Armijo's rule; near the end the value changes by less than its rounding, but what is left still tells."""
    level = abs(ahead[0] - here[0]) <= 64 * EPS * spread
    nearer = np.abs(ahead[1]).max() <= 0.5 * np.abs(here[1]).max()
    return bool(ahead[0] <= here[0] - 1e-4 * descent or (level and nearer))


def unheld(w: Floats, grip: Floats, push: Floats) -> Floats | None:
    """A motion c (k,) with c'push > sum_i w_i |grip_i c|, if nothing can hold the load; else None."""
    left = nearest(np.zeros(grip.shape[:2]), w, grip, push)[1]
    return left if _separates(left, w, grip, push) else None


def refuse_unheld(kernel: Kernel, motion: Floats, w: Floats, push: float, grip: Floats, n: int, t: float) -> None:
    """Raise SceneError for a load that pushes along `motion` (k,) harder than the weights can hold.

    Parameters
    ----------
    push : float
        Work of the load per unit of the motion's largest displacement.
    grip : (m,) array
        |B_i N c| per unit of it.
    """
    parts = [name for name, c in zip(kernel.names, motion, strict=True) if abs(c) > 1e-3 * np.abs(motion).max()]
    holds = float(w @ grip)
    raise SceneError(
        f"step {n} at t = {t:.6g}: only friction holds the body against {' with '.join(parts)}. The load pushes it "
        f"there with a force of {push:.6g} and friction holds {holds:.6g} at most: {push - holds:.6g} are lacking, and "
        "there is no equilibrium. Lower the load, raise the bound, add a support, or move the body by "
        "PrescribedDisplacement instead."
    )


def _separates(c: Floats, w: Floats, grip: Floats, push: Floats) -> bool:
    """Whether the load wins on the motion c: no multipliers can balance it."""
    return bool(c @ push > w @ np.linalg.norm(grip @ c, axis=1) * (1 + 1e-12))


def _clip(q: Floats, w: Floats) -> tuple[Floats, Floats, Floats]:
    """P_w(q), |q|, and which blocks were cut."""
    size = np.linalg.norm(q, axis=1)
    cut = size > w
    share = np.ones_like(size)
    share[cut] = w[cut] / size[cut]
    return q * share[:, None], size, cut


def _projection(lam: Floats, w: Floats, grip: Floats, push: Floats, c: Floats) -> Point:
    """The convex function at c, minus its gradient, and its (generalised) second derivative."""
    q = lam + grip @ c
    held, size, cut = _clip(q, w)
    value = 0.5 * float(size @ size - np.maximum(size - w, 0.0) @ np.maximum(size - w, 0.0)) - float(push @ c)
    share = np.where(cut, w / np.where(size > 0, size, 1.0), 1.0)
    unit = np.where(cut[:, None], q / np.where(size > 0, size, 1.0)[:, None], 0.0)
    across = grip - unit[:, :, None] * np.einsum("ij,ijk->ik", unit, grip)[:, None, :]
    slope = np.einsum("i,ijk,ijl->kl", share, across, across)
    return value, push - np.einsum("ijk,ij->k", grip, held), slope
