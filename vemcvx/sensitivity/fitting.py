"""Parameters of a scene that explain measurements, by least squares with the derivatives of the run.

With measurements m, values q(theta) of quantities, and a given regularisation L, we minimise

    |r|^2 + |L theta|^2,    r = (q - m) / sigma,

by SciPy's trust-region method (Branch, Coleman and Li, SIAM J. Sci. Comput. 21 (1999)). The noise of m has the standard
deviation s sigma. If the caller gives sigma, s = 1. Otherwise sigma is the largest |m_i| of each quantity, and

    s^2 = |r|^2 / (number of measurements - trace of J H^{-1} J'),    J = dr/dtheta,    H = J'J + L'L.

The covariance of theta is s^2 H^{-1}, for a linearised model with independent noise.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import SAME, Bools, Floats, as_real_array, as_shaped_array, brief
from vemcvx.base.errors import SceneError
from vemcvx.base.outline import Outline, Outlined
from vemcvx.history import History
from vemcvx.meshes import Mesh
from vemcvx.scene import Scene
from vemcvx.sensitivity.derivatives import Sensitivities, read_parameters, sensitivities
from vemcvx.solvers import Solver
from vemcvx.stepping import check_times

log = logging.getLogger("vemcvx")
TOLERANCE = 1e-10
"""Relative change of the sum of squares, and of the parameters, at which a fit ends."""
UNDETERMINED = 1e-8
"""Largest relative singular value of dr/dtheta at which a combination of parameters is undetermined."""


@dataclass(frozen=True, kw_only=True, repr=False, eq=False)
class Fit(Outlined):
    """Fitted parameters with their standard errors.

    Attributes
    ----------
    theta : (P,) array
        The fitted parameters.
    errors : (P,) array
        The standard errors of `theta`, infinite for parameters that the measurements do not determine.
    covariance : (P, P) array
    noise : dict of str to float
        The standard deviation of the noise of each quantity, given or estimated, in the unit of the quantity.
    values, measured : dict of str to (N + 1,) array
        The quantities of the fitted run, and the measurements.
    names : tuple of str
        The names of the parameters.
    misfit : float or None
        The root mean square of the residuals relative to the given noise; None if the noise is estimated. A misfit much
        larger than 1 means a wrong model or a local minimum.
    history : History
        The fitted run.
    runs : int
        The number of simulated runs.
    ending : str
        Why the search ended, in SciPy's words.

    Examples
    --------
    >>> def scene_of(theta):
    ...     pull = vx.Traction((3.0, 0.0), on="right")
    ...     return vx.Scene(vx.Elasticity(theta[0], 0.0), vx.Clamp(on="left"), pull)
    >>> measured = {"displacement at (1, 0) x": [np.nan, 0.02]}
    >>> found = vx.fit(scene_of, [100.0], vx.meshes.squares(2), [0.0, 1.0], measured, noise=1e-4, initial="settled")
    >>> found.theta.round(6).tolist(), found.errors.round(6).tolist()  # E = F / u and E noise / u
    ([150.0], [0.75])
    """

    theta: Floats
    errors: Floats
    covariance: Floats
    noise: dict[str, float]
    values: dict[str, Floats]
    measured: dict[str, Floats]
    names: tuple[str, ...]
    misfit: float | None
    history: History
    runs: int
    ending: str

    def outline(self) -> Outline:
        """Return the summary for prompts and notebooks: parameters with their errors, and the noise."""
        count = sum(int(np.isfinite(row).sum()) for row in self.measured.values())
        title = f"{len(self.theta)} parameters fitted to {count} values of {', '.join(self.measured)}: {self.runs} runs"
        rows = zip(self.names, self.theta, self.errors, strict=True)
        lines = [(name, f"{value:.6g} with standard error {error:.2g}") for name, value, error in rows]
        noise = ", ".join(f"{size:.3g} in {name}" for name, size in self.noise.items())
        if self.misfit is not None:
            lines += [("misfit", f"residuals are {self.misfit:.3g} times the noise")]
        lines += [("noise", f"standard deviation {noise}"), ("ended", self.ending)]
        return Outline(title, lines)


def fit(
    scene_of: Callable[[Floats], Scene],
    theta_0: ArrayLike,
    mesh: Mesh,
    times: ArrayLike,
    measured: Mapping[str, ArrayLike],
    *,
    noise: float | Mapping[str, float] | None = None,
    bounds: tuple[Any, Any] = (-np.inf, np.inf),
    shapes: Callable[[Floats], ArrayLike] | None = None,
    penalty: ArrayLike | None = None,
    names: Sequence[str] | None = None,
    initial: ArrayLike | str | None = None,
    solver: Solver | None = None,
) -> Fit:
    """Find the parameters of a scene that explain measurements best, with standard errors.

    Parameters
    ----------
    scene_of, mesh, times, shapes, initial, solver
        As for :func:`vemcvx.sensitivities`.
    theta_0 : (P,) array
        The parameters with which the search begins.
    measured : dict of str to (N + 1,) array
        Measured values at all instants, NaN where missing, by quantity (see :func:`vemcvx.sensitivities`).
    noise : number, or dict of str to number, optional
        The standard deviation of the noise, in the unit of the quantity. By default, an estimated fraction of the
        largest measured value.
    bounds : pair of numbers or (P,) arrays
        The smallest and largest parameters, such as ``(0.0, np.inf)``.
    penalty : (k, P) array, optional
        The regularisation L: |L theta|^2 is added to the sum of (residual / noise)^2.
    names : sequence of str, optional
        Names of the parameters for the summary; by default theta[0], theta[1], ...

    Returns
    -------
    Fit

    Raises
    ------
    SceneError, NotCertified
        As for :func:`vemcvx.sensitivities`; an argument has a wrong value or shape; or there are too few measurements.

    Examples
    --------
    >>> def scene_of(theta):
    ...     pull = vx.Traction((theta[0], 0.0), on="right")
    ...     return vx.Scene(vx.Elasticity(200.0, 0.0), vx.Clamp(on="left"), pull)
    >>> measured = {"reaction of left x": [np.nan, -3.0]}
    >>> found = vx.fit(scene_of, [1.0], vx.meshes.squares(2), [0.0, 1.0], measured, noise=0.1, initial="settled")
    >>> found.theta.round(9)
    array([3.])
    """
    from scipy.optimize import least_squares

    start = read_parameters(theta_0, "fit: theta_0")
    m, of, count = _read_measured(measured, check_times(times).shape), tuple(measured), len(start)
    known, names = ~np.isnan(m), _read_names(names, count)
    low, high = as_shaped_array(bounds, "fit: bounds", "smallest and largest parameters", (2,), (2, count))
    L = np.zeros((0, count)) if penalty is None else as_real_array(penalty, "fit: penalty", "an array (k, P)")
    L = as_shaped_array(L, "fit: penalty", f"rows of {count} numbers", (L.size // max(count, 1), count))
    if noise is None and known.sum() <= count and not len(L):
        raise SceneError(f"fit: {known.sum()} values cannot determine {count} parameters and the noise; give noise=.")
    sigma = _read_noise(noise, of, m)

    @lru_cache(maxsize=1)
    def run(raw: bytes) -> Sensitivities:
        theta = np.frombuffer(raw)
        log.info("fit: theta = %s", brief(theta))
        try:
            return sensitivities(scene_of, theta, mesh, times, of, shapes=shapes, initial=initial, solver=solver)
        except SceneError as error:
            if (theta == start).all():
                raise
            hint = f"The search of fit came to theta = {brief(theta)}; keep it in range by bounds=."
            raise SceneError(f"{error} {hint}") from error

    def residuals(theta: Floats) -> Floats:
        return np.append(((run(theta.tobytes()).values - m) / sigma[:, None])[known], L @ theta)

    def derivatives(theta: Floats) -> Floats:
        return np.vstack([(run(theta.tobytes()).jacobian / sigma[:, None, None])[known], L])

    scale = np.where(start != 0, np.abs(start), 1.0)
    try:
        found = least_squares(
            residuals, start, derivatives, (low, high), x_scale=scale, ftol=TOLERANCE, xtol=TOLERANCE, gtol=None
        )
    except ValueError as error:
        wanted = "lower bounds < upper bounds, theta_0 between the bounds, measurements finite or NaN, a finite penalty"
        raise SceneError(f"fit: {error} Wanted: {wanted}.") from error
    best, r, J, data = run(found.x.tobytes()), found.fun, np.asarray(found.jac), int(known.sum())
    inverse, free = _invert(J, scale)
    used = float(((J[:data] @ inverse) * J[:data]).sum())
    misfit = float(np.sqrt(r[:data] @ r[:data] / max(data - used, 1.0)))
    spread = 1.0 if noise is not None else misfit
    inverse[free, free] = np.inf
    return Fit(
        theta=found.x,
        errors=spread * np.sqrt(np.diag(inverse)),
        covariance=spread**2 * inverse,
        noise=dict(zip(of, (spread * sigma).tolist(), strict=True)),
        values=dict(zip(of, best.values, strict=True)),
        measured=dict(zip(of, m, strict=True)),
        names=names,
        history=best.history,
        misfit=None if noise is None else misfit,
        runs=run.cache_info().misses,
        ending=found.message,
    )


def _read_measured(measured: Mapping[str, ArrayLike], shape: tuple[int, ...]) -> Floats:
    """Return the measurements (Q, N + 1)."""
    if not isinstance(measured, Mapping) or not measured:
        raise SceneError(f"fit: found measured = {brief(measured)}; wanted a dict of names to values.")
    m = np.array([as_shaped_array(row, f"fit: {name}", f"values {shape}", shape) for name, row in measured.items()])
    if np.isnan(m).all():
        raise SceneError("fit: found no measured value.")
    return m


def _read_names(names: Sequence[str] | None, count: int) -> tuple[str, ...]:
    names = tuple(f"theta[{j}]" for j in range(count)) if names is None else names
    if not isinstance(names, (list, tuple)) or [type(name) for name in names] != [str] * count:
        raise SceneError(f"fit: found names = {brief(names)}; wanted a name for each of {count} parameters.")
    return tuple(names)


def _read_noise(noise: float | Mapping[str, float] | None, of: Sequence[str], m: Floats) -> Floats:
    """Return given standard deviations, or the largest |m| of each quantity."""
    if noise is None:
        largest = np.nan_to_num(np.abs(m)).max(axis=1)
        return np.where(largest > 0, largest, 1.0)
    each = [noise.get(name, np.nan) for name in of] if isinstance(noise, Mapping) else noise
    sigma = np.full(len(of), as_shaped_array(each, "fit: noise", "standard deviations", (), (len(of),)))
    if not ((sigma > 0) & (sigma < np.inf)).all():
        raise SceneError(f"fit: noise: found {brief(sigma)} for {', '.join(of)}; wanted a number > 0 for each.")
    return sigma


def _invert(J: Floats, scale: Floats) -> tuple[Floats, Bools]:
    """Return a pseudoinverse of J'J, and a mask of undetermined parameters."""
    size, V = np.linalg.svd(np.vstack([J * scale, np.zeros((len(scale),) * 2)]))[1:]
    known = size > UNDETERMINED * size.max()
    each = scale * V[known] / size[known, None]
    return each.T @ each, (np.abs(V[~known]) > SAME).any(axis=0)
