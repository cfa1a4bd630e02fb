"""Forces and moments across a plane through the body, and mean values of fields.

Let u be the displacement, A the stiffness without springs, and T sigma_0 the nodal forces of the stresses sigma_0 at
zero strain. The nodal forces of the stresses are q = A u + T sigma_0. Let the part ahead of a plane move by a unit
translation or rotation w, while the part behind rests. The virtual work of the stresses is the sum of q . w over the
nodes ahead. This work is a component of the force or moment that the part ahead exerts on the part behind.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import Bools, Floats, choice, one_point
from vemcvx.base.errors import HistoryError, SceneError
from vemcvx.effects import cells_of
from vemcvx.results.forces import moments
from vemcvx.results.probe import FIELDS
from vemcvx.results.results import Results
from vemcvx.vem import Space, stress_load
from vemcvx.vem.elasticity import stiffness_of
from vemcvx.vem.loads import mean_weights


class Section(NamedTuple):
    """The resultants that the part ahead of a plane exerts on the part behind it."""

    force: Floats
    """(S, dim), at S stored instants"""
    moment: Floats
    """(S,), in space (S, 3), about the given point of the plane"""


def section(history: Results, point: ArrayLike, normal: ArrayLike, on: str | Sequence[str] | None) -> Section:
    """Return the resultants across a plane: see :meth:`vemcvx.History.section`."""
    x, space = history.mesh.points, history._space
    space.refuse_revolution("section")
    p, n = (one_point(raw, space.dim, f"section: {name}") for raw, name in ((point, "point"), (normal, "normal")))
    if not n.any():
        raise SceneError("section: found a normal of length 0; give a nonzero vector, such as (1, 0).")
    some = cells_of(space, on, "section")
    used = np.zeros(len(x), dtype=bool)
    for group in space.groups:
        used[group.nodes[some[group.cells]]] = True
    ahead = ((x - p) @ n > 0) & used
    if not ahead.any() or np.array_equal(ahead, used):
        raise SceneError(f"section: the plane through {p} with normal {n} does not cut {on or 'the body'}.")
    forces = _inner_forces(history, space, some)[:, ahead]
    return Section(forces.sum(axis=1), moments(x[ahead] - p, forces))


def mean(history: Results, field: str, on: str | Sequence[str] | None) -> Floats:
    """Return the mean of a field: see :meth:`vemcvx.History.mean`."""
    choice(field, "mean", "field", FIELDS)
    space = history._space
    space.refuse_revolution("mean")
    some, sizes = cells_of(space, on, "mean"), history.mesh.measures
    if field == "displacement":
        found = np.einsum("n,snd->sd", mean_weights(space, some)[0], history.displacement)
        return np.asarray(found / sizes[some].sum())
    each = np.stack([getattr(history, field)(int(step))[some] for step in history.stored])
    return np.asarray(np.einsum("c,sc...->s...", sizes[some], each) / sizes[some].sum())


def _inner_forces(history: Results, space: Space, some: Bools) -> Floats:
    """Return the nodal forces q (S, n_nodes, dim) of the stresses in some cells."""
    if history.trajectory.velocity is not None:
        raise SceneError("section: a history does not keep the stresses of viscosity; use history.force instead.")
    if history.stabilisation is None:
        raise HistoryError("section: files do not keep a user-defined stabilisation; simulate the scene again.")
    A = stiffness_of(space, history.moduli * some, history.stabilisation)
    q = np.stack([A @ u.ravel() for u in history.displacement])
    if history.prestress is not None:
        T = stress_load(space)
        q += np.stack([T @ (sigma * some[:, None]).ravel() for sigma in history.prestress])
    return q.reshape(history.displacement.shape)
