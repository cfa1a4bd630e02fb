"""Checks of a system's data: finite real matrices, functions of t that work, a symmetric stiffness."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from vemcvx.arrays import Floats, as_real_array, brief, called, shape_in_words, shaped
from vemcvx.errors import SceneError
from vemcvx.linear import direct_solver
from vemcvx.linear.factor import singular

# Products such as A'CA round (i, j) and (j, i) differently, by eps times the number of summands.
SYMMETRIC = 1e-10
SAY = "take the number of a term and say where it acts"


def at_instant(data: ArrayLike | Callable[[float], ArrayLike], t: float, subject: str) -> ArrayLike:
    """data(t), or a SceneError that says how it failed; the data where they are no function."""
    if not callable(data):
        return data
    failed = f"{subject}: its function failed when called as f(t) with t = {t:.6g}"
    value: ArrayLike = called(data, (t,), failed, "take an instant and return an array")
    return value


def checked_matrix(raw: Any, subject: str, shape: tuple[int, int] | None = None) -> sp.csr_matrix:
    """A sparse matrix of finite numbers, from a dense or sparse one; of a shape, if one is given.

    It is a copy, unless nobody may write to the entries of the one given.
    """
    sparse = sp.issparse(raw)
    if sparse and raw.dtype.kind in "biuf":
        if hasattr(raw, "check_format"):
            # SciPy's compiled code reads and writes where indices lead.
            try:
                raw.check_format(full_check=True)
            except (ValueError, TypeError, AttributeError) as error:
                raise SceneError(f"{subject}: found a sparse matrix that leads out of itself: {error}.") from error
        open_to_change = not isinstance(raw, sp.csr_matrix) or raw.data.flags.writeable
        matrix: sp.csr_matrix = sp.csr_matrix(raw, dtype=np.float64, copy=open_to_change)
    else:
        dense = as_real_array(raw, subject, "a matrix of real numbers")
        if dense.ndim != 2:
            raise SceneError(f"{subject}: found {shape_in_words(dense)}; wanted a matrix, dense or sparse.")
        matrix = sp.csr_matrix(dense)
    finite(matrix.data, subject)
    if shape is not None and matrix.shape != shape:
        raise SceneError(f"{subject}: found a matrix of shape {matrix.shape}; wanted {shape}.")
    return matrix


def check_stiffness(K: sp.csr_matrix) -> None:
    """Raise SceneError unless K is square and symmetric with a positive diagonal."""
    if K.nnz == 0 and K.shape[0] == K.shape[1]:
        return
    check_symmetric(K, "System: K")
    diagonal = K.diagonal()
    if diagonal.min() <= 0:
        i = int(np.argmin(diagonal))
        raise SceneError(f"System: found K[{i}, {i}] = {diagonal[i]:.6g}; K must be positive definite.")


def check_semidefinite(C: sp.csr_matrix, subject: str) -> None:
    """Raise SceneError unless C is square, symmetric and positive semidefinite to rounding.

    With a diagonal of ones, and SYMMETRIC added to it, its pivots must be positive; rows without a diagonal are empty.
    """
    check_symmetric(C, subject)
    diagonal = C.diagonal()
    felt = np.flatnonzero(diagonal > 0)
    unit = sp.diags_array(diagonal[felt] ** -0.5)
    scaled = sp.csr_matrix(unit @ C[felt][:, felt] @ unit + SYMMETRIC * sp.eye_array(len(felt)))
    try:
        if (diagonal < 0).any() or abs(C).sum() > abs(C[felt][:, felt]).sum():
            raise singular()
        if len(felt):
            direct_solver(len(felt)).factorise(scaled)
    except SceneError as error:
        raise SceneError(
            f"{subject}: found a matrix that is not positive semidefinite: some motion would gain energy from it."
        ) from error


def check_symmetric(K: sp.csr_matrix, subject: str) -> None:
    """Raise SceneError unless K is square and symmetric."""
    if K.shape[0] != K.shape[1]:
        raise SceneError(f"{subject}: found a matrix of shape {K.shape}; it must be square.")
    # Kx = K'x for one x without structure: a tenth of the cost of K - K', which is formed only to name the place.
    x = np.random.default_rng(0).uniform(-1.0, 1.0, K.shape[0])
    largest = max(K.data.max(initial=0.0), -K.data.min(initial=0.0))
    doubtful = np.abs(K @ x - x @ K).max() > 0.01 * SYMMETRIC * largest
    apart = abs(K - K.T).tocoo() if doubtful else sp.coo_matrix(K.shape)
    if apart.nnz and apart.data.max() > SYMMETRIC * largest:
        worst = int(np.argmax(apart.data))
        i, j = int(apart.row[worst]), int(apart.col[worst])
        raise SceneError(
            f"{subject}: found {K[i, j]:.6g} at [{i}, {j}] but {K[j, i]:.6g} at [{j}, {i}]; it must be symmetric. "
            "For the energy 1/2 y'Ky, give (K + K.T) / 2."
        )


def of_shape(raw: ArrayLike, subject: str, shape: tuple[int, ...]) -> Floats:
    """An array of real numbers of that shape, which may be given flat."""
    wanted = f"numbers of shape {shape}"
    return shaped(raw, subject, wanted, shape, (int(np.prod(shape)),)).reshape(shape)


def finite(values: Floats, subject: str) -> Floats:
    """The values, or SceneError for NaN or infinity."""
    if not np.isfinite(values).all():
        raise SceneError(f"{subject}: found NaN or infinite values; all must be finite.")
    return values


def permutation(raw: ArrayLike, n: int) -> NDArray[np.int64]:
    """An order of n unknowns."""
    wanted = f"a permutation of the {n} unknowns, or None"
    order = as_real_array(raw, "System: order", wanted)
    if order.ndim != 1 or not np.array_equal(np.sort(order), np.arange(n)):
        raise SceneError(f"System: found order = {brief(raw)}; wanted {wanted}.")
    return order.astype(np.int64)


def motions(raw: ArrayLike, n: int) -> Floats:
    """Motions (n, k) of little energy."""
    wanted = f"({n}, k) motions of little energy, one a column, or None"
    found = as_real_array(raw, "System: near_kernel", wanted)
    if found.ndim != 2 or len(found) != n or not found.shape[1] or not np.isfinite(found).all():
        raise SceneError(f"System: found near_kernel = {brief(raw)}; wanted {wanted}.")
    return found
