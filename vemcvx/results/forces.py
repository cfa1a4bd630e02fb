"""The forces of effects on the boundary.

Let u be the displacements of all nodes, A the stiffness matrix, A_1 the viscosity matrix, and f the loads. The vector
B^ u contains the slips, D^ u the displacements towards obstacles, and A_s u the displacements held by supports and
bilateral contact. The vectors lam, p and mu are the forces of friction, obstacles and supports. The nodal forces are

    R = A u + A_1 du/dt - f = A_s' mu - B^' lam - D^' p.

The matrix H of :mod:`vemcvx.scene.supports` has A_s H = I, so mu = H'(R + B^' lam + D^' p). Springs to the ground are
a part K_s of A and exert the forces -K_s u.

The adjacent sides share the force at a node in proportion to integrals of the hat function. If a support acts along the
normals of some sides, only these sides share the force of the support.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from vemcvx.base.arrays import Bools, Floats, Ints, are_among, brief, one_point, sum_columns
from vemcvx.base.errors import SceneError
from vemcvx.base.outline import ArrayRecord
from vemcvx.effects import ContactSurface, Effect, MaterialLaw
from vemcvx.meshes import Mesh
from vemcvx.meshes.polygons import find_all_in
from vemcvx.scene import Scene
from vemcvx.scene.pose import PosedScene
from vemcvx.scene.rows import ContactRows
from vemcvx.stepping import Trajectory
from vemcvx.vem import Space
from vemcvx.vem.elasticity import rigid_modes
from vemcvx.vem.tensors import AXISYMMETRIC

log = logging.getLogger("vemcvx")
NOWHERE, ACROSS = -1, -2
"""Placeholders for a side: NOWHERE at nodes without a side, ACROSS on the second body of an interface."""


@dataclass(frozen=True, kw_only=True, repr=False)
class BoundaryForces(ArrayRecord):
    """The forces of effects, one row per node and side."""

    causes: Annotated[Ints, "acting 2", ""]  # effect numbers, -1 for none
    ends: Annotated[Ints, "acting 2", ""]  # pairs (node, side), where a side is a face, or the other node of an edge
    held: Annotated[Bools, "acting", ""]  # True for supports
    force: Annotated[Floats, "S acting dim", "force"]
    loads: Annotated[Floats, "S loads dim", "force"]  # total force of each load
    load_causes: Annotated[Ints, "loads", ""]  # number of the effect of each load

    def through(self, names: Ints) -> Bools:
        """Return a mask of the rows whose `ends` are in `names`."""
        return are_among(self.ends, names)


class _Rows(NamedTuple):
    causes: Ints
    ends: Ints
    held: bool
    force: Floats


def boundary_forces(posed: PosedScene, trajectory: Trajectory, u: Floats, forces: Floats) -> BoundaryForces:
    """Return the forces of effects; the argument `forces` (S, n_nodes, dim) is R."""
    S, dim = len(u), u.shape[2]
    instants: list[float] = trajectory.times[trajectory.stored].tolist()
    rubbing = -np.einsum("smb,mbd->smd", trajectory.multipliers, posed.terms.tangents)
    pressing = -trajectory.pressures[:, :, None] * posed.obstacles.normals
    found = [
        *_list_contact(posed, posed.terms, posed.terms.frictions, "frictions", rubbing),
        *_list_contact(posed, posed.obstacles, posed.stops, "obstacles", pressing),
        *_list_supports(posed, trajectory, forces),
        *_list_springs(posed, u),
        *_list_joints(posed, instants),
    ]
    none = np.zeros((0, 2), dtype=np.int64)
    causes, ends = (np.concatenate([none, *(getattr(rows, name) for rows in found)]) for name in ("causes", "ends"))
    held = np.concatenate([np.zeros(0, dtype=bool), *(np.full(len(rows.ends), rows.held) for rows in found)])
    force = np.concatenate([np.zeros((S, 0, dim)), *(rows.force for rows in found)], axis=1)
    keys, row = np.unique(np.column_stack([held, causes, ends]), axis=0, return_inverse=True)
    given = [(cause, load) for cause, load in posed.caused_loads if not load.between]
    loads = [[load.forces(t).sum(axis=0) for _, load in given] for t in instants]
    return BoundaryForces(
        causes=keys[:, 1:3],
        ends=keys[:, 3:],
        held=keys[:, 0].astype(bool),
        force=sum_columns(force, row.ravel(), len(keys)),
        loads=np.array(loads).reshape(S, -1, dim),
        load_causes=np.array([cause for cause, _ in given], dtype=np.int64),
    )


def _list_contact(
    posed: PosedScene, rows: ContactRows, parts: Sequence[ContactSurface], kind: str, force: Floats
) -> Iterator[_Rows]:
    each = rows.ends.tocoo()
    share = each.data / rows.lengths[each.row]
    causes = _owners(rows.nodes[each.row], rows.partners[each.row], rows.names[each.col, 1], parts, posed.causes[kind])
    shared = force[:, each.row] * share[:, None]
    yield _Rows(causes, rows.names[each.col], False, shared)
    joined = rows.partners[each.row] >= 0
    other = rows.partners[each.row[joined]]
    ends = np.column_stack([other, np.full(len(other), ACROSS)])
    yield _Rows(causes[joined], ends, False, -shared[:, joined])


def _owners(nodes: Ints, partners: Ints, beyond: Ints, parts: Sequence[ContactSurface], causes: Ints) -> Ints:
    found = np.full((len(nodes), 2), -1)
    wanted = np.column_stack([nodes, partners, beyond])
    for part, cause in zip(parts, causes.tolist(), strict=True):
        table = ContactRows.from_parts([part], part.normals.shape[1])
        each = table.ends.tocoo()
        own = np.column_stack([table.nodes[each.row], table.partners[each.row], table.names[each.col, 1]])
        _, number = np.unique(np.concatenate([own, wanted]), axis=0, return_inverse=True)
        mine = np.isin(number.ravel()[len(own) :], number.ravel()[: len(own)])
        second = mine & (found[:, 0] >= 0) & (found[:, 0] != cause)
        found[second & (found[:, 1] < 0), 1] = cause
        found[mine & (found[:, 0] < 0), 0] = cause
    return found


def _list_supports(posed: PosedScene, trajectory: Trajectory, forces: Floats) -> Iterator[_Rows]:
    supports, S = posed.supports, len(forces)
    own = np.flatnonzero(np.diff(supports.H.indptr))
    rest = forces.reshape(S, -1)[:, own] + trajectory.multipliers.reshape(S, -1) @ posed.terms.rows[:, own]
    rest += trajectory.pressures @ posed.obstacles.rows[:, own]
    mu, first = np.asarray(rest @ supports.H[own]), 0
    for support, cause in zip(supports.given, posed.causes["supports"].tolist(), strict=True):
        along = mu[:, first : (first := first + len(support.nodes))]
        # Pins and the axis of revolution are not supports of the scene.
        if cause < 0 or isinstance(posed.scene.canonical[cause], MaterialLaw):
            continue
        force = along[:, :, None] * support.directions
        held = not support.contact
        yield _distribute(posed, cause, support.nodes, force, held=held, directions=support.directions)
        if support.partners is not None:
            joined = support.partners >= 0
            ends = np.column_stack([support.partners[joined], np.full(joined.sum(), ACROSS)])
            yield _Rows(np.tile([cause, -1], (len(ends), 1)), ends, held, -force[:, joined])


def _list_springs(posed: PosedScene, u: Floats) -> Iterator[_Rows]:
    for cause, K in posed.caused_springs:
        nodes = np.unique(K.indices // u.shape[2])
        force = -(u.reshape(len(u), -1) @ K.T).reshape(u.shape)
        yield _distribute(posed, cause, nodes, force[:, nodes])


def _list_joints(posed: PosedScene, instants: Sequence[float]) -> Iterator[_Rows]:
    for cause, load in ((cause, load) for cause, load in posed.caused_loads if load.between):
        force = np.stack([load.vector(t) for t in instants]).reshape(len(instants), -1, posed.space.dim)
        nodes: Ints = np.unique(load.matrix.nonzero()[0] // posed.space.dim).astype(np.int64)
        effect: Any = posed.scene.canonical[cause]
        own = np.isin(nodes, posed.space.part(effect.on, "force", contact=True).nodes)
        yield _distribute(posed, cause, nodes[own], force[:, nodes[own]])
        ends = np.column_stack([nodes[~own], np.full((~own).sum(), ACROSS)])
        yield _Rows(np.tile([cause, -1], (len(ends), 1)), ends, False, force[:, nodes[~own]])


def _distribute(
    posed: PosedScene, cause: int, nodes: Ints, force: Floats, held: bool = False, directions: Floats | None = None
) -> _Rows:
    row, names, share = _shares(posed, cause, nodes, directions)
    return _Rows(np.tile([cause, -1], (len(names), 1)), names, held, force[:, row] * share[:, None])


def _shares(posed: PosedScene, cause: int, nodes: Ints, directions: Floats | None) -> tuple[Ints, Ints, Floats]:
    """Return positions in `nodes`, pairs (node, side) and shares of the force."""
    effect: Effect = posed.scene.canonical[cause]
    named = [on for on in np.atleast_1d(getattr(effect, "on", "boundary")) if on in posed.space.mesh.boundaries]
    ends = posed.space.part(named or "boundary", type(effect).__name__, contact=True).ends
    row, end = find_all_in(ends.nodes, nodes)
    weight = ends.lengths[end]
    if directions is not None:
        normal = np.abs(np.einsum("ed,ed->e", ends.normals[end], directions[row])) > np.sqrt(0.5)
        some = np.zeros(len(nodes), dtype=bool)
        np.logical_or.at(some, row, normal)
        weight = np.where(some[row] & ~normal, 0.0, weight)
    weight = np.where(np.bincount(row, weight, minlength=len(nodes))[row] > 0, weight, 1.0)
    share = weight / np.bincount(row, weight, minlength=len(nodes))[row]
    bare = np.flatnonzero(np.bincount(row, minlength=len(nodes)) == 0)
    row, beyond = np.append(row, bare), np.append(ends.beyond[end], np.full(len(bare), NOWHERE))
    return row, np.column_stack([nodes[row], beyond]), np.append(share, np.ones(len(bare)))


def support_shares(posed: PosedScene, name: str, axis: Floats) -> Floats:
    """Return the vector d such that d . mu is the reaction of a boundary along an axis."""
    ends, found = posed.space.part(name, "reaction", contact=True).names, [np.zeros(0)]
    for support, cause in zip(posed.supports.given, posed.causes["supports"].tolist(), strict=True):
        own = np.zeros(len(support.nodes))
        if cause >= 0 and not support.contact and not isinstance(posed.scene.canonical[cause], MaterialLaw):
            row, names, share = _shares(posed, cause, support.nodes, support.directions)
            through = are_among(names, ends)
            np.add.at(own, row[through], share[through])
            own *= support.directions @ axis
        found.append(own)
    if not np.concatenate(found).any():
        raise SceneError(f"reaction: no support holds {name!r} along this axis; name a boundary that a support holds.")
    return np.concatenate(found)


Cause = str | Effect | type[Effect]


class ActingForces:
    """The methods of a history for forces and moments."""

    mesh: Mesh
    scene: Scene | None
    effects: tuple[str, ...]
    acting: BoundaryForces
    moduli: Floats

    @property
    def is_axisymmetric(self) -> bool:
        """True for a body of revolution, with forces and energies of the full turn."""
        return len(self.moduli) == AXISYMMETRIC

    @cached_property
    def _space(self) -> Space:
        return Space(self.mesh, axisymmetric=self.is_axisymmetric)

    def reaction(self, name: str) -> Floats:
        """Return the total force (S, dim) that the supports of a boundary exert on the body.

        Two boundaries share the force at a common node (:mod:`vemcvx.results.forces`).

        Raises
        ------
        SceneError
            The mesh has no such boundary.
        """
        through = self._through(name, "reaction")
        held = through & self.acting.held
        if through.any() and not held.any():
            words = "reaction: 0, because no support acts on %r; history.force(%r) is the contact force."
            log.warning(words, name, name)
        return _total(self.acting.force[:, held])

    def force(self, of: Cause) -> Floats:
        """Return the total force (S, dim) that effects exert on the body.

        Parameters
        ----------
        of : str, effect or class of effects
            An effect of the scene, or a class such as ``vx.TrescaFriction`` for all effects of the class. The name of a
            boundary stands for contact, friction and springs. On an interface, the force acts on the first body.

        Raises
        ------
        SceneError
            The boundary or effect does not exist, or two effects share the force on some sides.
        """
        if isinstance(of, str):
            return _total(self.acting.force[:, self._through(of, "force") & ~self.acting.held])
        causes = self._numbers(of, "force")
        loads = np.isin(self.acting.load_causes, causes)
        rows = self._rows_of_effects(causes, "force")
        return _total(self.acting.force[:, rows]) + _total(self.acting.loads[:, loads])

    def moment(self, of: Cause, about: ArrayLike | None = None) -> Floats:
        """Return the total moment of effects, except loads: (S,) in the plane, (S, 3) in space.

        Parameters
        ----------
        of : str, effect or class of effects
            As for `force`. The name of a boundary stands for the supports, too.
        about : (dim,) point, optional
            By default the origin. Moments are positive counter-clockwise.

        Raises
        ------
        SceneError
            As in `force`, or the effect is a load, or the body is a body of revolution.
        """
        self._space.refuse_revolution("moment")
        points = self.mesh.points
        centre = 0.0 if about is None else one_point(about, points.shape[1], "moment: about")
        if isinstance(of, str):
            rows = self._through(of, "moment")
        else:
            causes = self._numbers(of, "moment")
            rows = self._rows_of_effects(causes, "moment")
            if np.isin(self.acting.load_causes, causes).any():
                raise SceneError(
                    "moment: found a load, whose distribution is unknown; history.force returns its total."
                )
        return moments(points[self.acting.ends[rows, 0]] - centre, self.acting.force[:, rows])

    @cached_property
    def resultants(self) -> dict[str, Floats]:
        """The nonzero forces (S, dim) on named boundaries, by names such as "reaction of right"."""
        acting, found = self.acting, {}
        for name, sides in self.mesh.boundaries.items():
            if name == "boundary" or not len(sides):
                continue
            through = self._through(name, "force")
            for words, rows in (("reaction", through & acting.held), ("force", through & ~acting.held)):
                if acting.force[:, rows].any():
                    found[f"{words} of {name}"] = _total(acting.force[:, rows])
        return found

    def _through(self, name: str, subject: str) -> Bools:
        return self.acting.through(self._space.part(name, subject, contact=True).names)

    def _rows_of_effects(self, causes: Ints, subject: str) -> Bools:
        acting = self.acting
        mine = np.isin(acting.causes, causes)
        apart = (mine & (acting.causes >= 0)).any(axis=1) & ~(mine | (acting.causes < 0)).all(axis=1)
        if apart.any():
            one, other = (self.effects[i] for i in acting.causes[np.argmax(apart)])
            raise SceneError(
                f"{subject}: two effects share the force on some sides: {one}; and {other}. Give the name of the "
                "boundary."
            )
        return mine.any(axis=1) & (acting.ends[:, 1] != ACROSS)

    def _numbers(self, of: Effect | type[Effect], subject: str) -> Ints:
        if isinstance(of, Effect):
            words = of.describe_body(self._space.in_plane)
            known = self.scene.canonical if self.scene else ()
            found = [i for i, effect in enumerate(known) if effect is of or effect == of]
            found = found or [i for i, effect in enumerate(self.effects) if effect == words]
        elif isinstance(of, type) and issubclass(of, Effect) and self.scene is not None:
            found = [i for i, effect in enumerate(self.scene.canonical) if isinstance(effect, of)]
        else:
            raise SceneError(
                f"{subject}: found {brief(of)}; wanted the name of a boundary, an effect, or a class of effects. A "
                "history that was read from files knows no classes."
            )
        if not found:
            raise SceneError(
                f"{subject}: found {brief(of)}; the effects of this history are {'; '.join(self.effects)}."
            )
        return np.array(found)


def largest(forces: Floats) -> int:
    """Return the row of the largest force in `forces` (S, dim)."""
    return int(np.argmax(np.linalg.norm(forces, axis=1)))


def moments(arms: Floats, forces: Floats) -> Floats:
    """Return the total moments of forces (S, k, dim) at arms (k, dim)."""
    sums: Floats = forces.reshape(len(forces), -1) @ rigid_modes(arms)[:, arms.shape[1] :]
    return sums[:, 0] if sums.shape[1] == 1 else sums


def _total(forces: Floats) -> Floats:
    return np.asarray(forces.sum(axis=1))
