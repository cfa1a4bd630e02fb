"""Bounds that the certificates of a march imply for each of its numbers, so that tests need no guessed tolerance.

Step n has the state y_n, multipliers lam_n, slips s = B (y_n - y_{n-1}), a certified duality gap gap_n and a rounding
floor floor_n; a star marks exact values. Steps with given weights w are nonexpansive, so |y_n - y_n*|_K <= E_n with
E_n = sum_{m <= n} (sqrt(2 gap_m) + sqrt(2 floor_m)). Let A = K^{-1} and mu = lam_n - lam_n*. Forces balance up to a
residual r_n with |r_n|_A <= sqrt(2 gap_n), hence

    |B'mu|_A = |r_n + K (y_n - y_n*)|_A <= sqrt(2 gap_n) + E_n <= 2 E_n.

Unknowns y_j, multipliers mu_i and slips s_i of step n therefore obey

    |y_j - y_j*| <= A_jj^{1/2} E_n,    |mu_i| <= (S_ii)^{1/2} 2 E_n,  S = (B A B')^{-1},
    |s_i - s_i*| <= (B_i A B_i')^{1/2} (E_n + E_{n-1}),   and the loss has an error of at most sum_i w_i |s_i - s_i*|.

For blocks of two and more unknowns, the largest eigenvalue of the block replaces the diagonal entry.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

EPS = np.finfo(float).eps


@dataclass(frozen=True)
class Bounds:
    """The largest errors that the certificates allow, at all instants."""

    state: np.ndarray
    """(N + 1, n) bounds of |y_j - y_j*|"""
    multipliers: np.ndarray
    """(N + 1, m) bounds of |lam_i - lam_i*|"""
    dissipated: np.ndarray
    """(N + 1,) bounds of the error of the loss"""
    energy: np.ndarray
    """(N + 1,) bounds of the error of the stored energy"""


def bounds(system, trajectory):
    """Return the bounds of a march with given weights and every step stored; they include rounding errors of sums."""
    norms, w = system.norms, system.norms.weights(0.0)
    compliance = np.linalg.inv(system.K.toarray())
    B = norms.B.toarray()
    compliance_of_rows = B @ compliance @ B.T
    per_term = np.sqrt(_largest_eigenvalues(compliance_of_rows, norms.block))
    total = np.cumsum(np.sqrt(2 * trajectory.gap) + np.sqrt(2 * trajectory.floor))
    rounding = 8 * EPS * np.arange(1.0, len(total) + 1)
    state = np.outer(total, np.sqrt(np.diag(compliance))) + np.outer(rounding, np.abs(trajectory.state).max(axis=0))
    stiff = np.sqrt(_largest_eigenvalues(np.linalg.inv(compliance_of_rows), norms.block))
    steps = np.append(0.0, total[1:] + total[:-1])
    dissipated = np.cumsum(steps) * (w @ per_term) + rounding * trajectory.dissipated[-1]
    energy = (trajectory.norm + total) * total + rounding * trajectory.energy.max()
    return Bounds(state, 2 * np.outer(total, stiff) + np.outer(rounding, w), dissipated, energy)


def ledger_bound(system, trajectory):
    """Return a bound (N + 1,) of the energy balance's residual, added up over the steps so far."""
    d = np.diff(trajectory.state, axis=0)
    size = np.sqrt(np.einsum("ni,ni->n", d, (system.K @ d.T).T))
    gap = trajectory.gap[1:] + trajectory.floor[1:]
    scale = np.maximum.accumulate(np.abs(trajectory.work) + trajectory.energy + trajectory.dissipated)
    return np.append(0.0, np.cumsum(np.sqrt(2 * gap) * size + gap)) + 32 * EPS * np.arange(len(scale)) * scale


def ledger_defect(system, trajectory):
    """Return the residual (N + 1,) of the energy balance, work - (E - E_0) - loss - sum |d|_K^2 / 2."""
    d = np.diff(trajectory.state, axis=0)
    numerical = 0.5 * np.append(0.0, np.cumsum(np.einsum("ni,ni->n", d, (system.K @ d.T).T)))
    return trajectory.work - (trajectory.energy - trajectory.energy[0]) - trajectory.dissipated - numerical


def admissible(system, trajectory):
    """Return the certified multipliers (N + 1, m, block): the stored ones, shortened to |lam_i| <= w_i."""
    lam = trajectory.multipliers
    size = np.linalg.norm(lam, axis=2)
    return lam * np.minimum(1.0, system.norms.weights(0.0) / np.maximum(size, np.finfo(float).tiny))[:, :, None]


def _largest_eigenvalues(matrix, block):
    """Return the largest eigenvalue of each diagonal block."""
    m = len(matrix) // block
    diagonal = matrix.reshape(m, block, m, block)[np.arange(m), :, np.arange(m), :]
    return np.linalg.eigvalsh(diagonal)[:, -1]
