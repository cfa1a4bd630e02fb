"""Results at stored instants: displacements, forces, stresses; and how they come from a march in free unknowns."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from operator import attrgetter
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from vemcvx.base.arrays import CHUNK_SIZE, SAME, ArrayField, Floats, Ints, array_fields, brief, is_whole, sum_columns
from vemcvx.base.errors import WORTH_A_WORD, HistoryError, SceneError, SceneWarning
from vemcvx.base.outline import coordinates
from vemcvx.effects import Effect
from vemcvx.meshes import Mesh, PolyhedralMesh
from vemcvx.meshes.polygons import cell_of_corner
from vemcvx.program import SolvedProgram
from vemcvx.results import quoted
from vemcvx.results.contact import Contact, contact_history
from vemcvx.results.corners import Corners, Sides, sides_of
from vemcvx.results.forces import BoundaryForces, boundary_forces, force, moment, reaction, resultants
from vemcvx.scene import Scene
from vemcvx.scene.pose import PosedScene, pose_scene, suppress_scene_warnings
from vemcvx.scene.rows import ContactRows, distinct_pairs
from vemcvx.stepping import Storage, Trajectory, programs_of_trajectory
from vemcvx.vem import (
    Space,
    Stabilisation,
    VertexWeights,
    equivalent,
    mean_weights,
    principal,
    rigid_modes,
    strains,
    stresses,
)

log = logging.getLogger("vemcvx")

SPREAD = {2: ("length", "force/length"), 3: ("area", "force/length²")}
"""By dimension: the extent that forces of contact are spread over, and the unit of such a force."""


@dataclass(frozen=True, kw_only=True, repr=False)
class Results:
    """The arrays of a simulation: what a :class:`vemcvx.History`, whose docstring says all of them, is made of."""

    mesh: Mesh
    scene: Scene | None
    effects: tuple[str, ...]
    displacement: Annotated[Floats, "S nodes dim", "length"]
    forces: Annotated[Floats, "S nodes dim", "force"]
    contact: Contact
    acting: BoundaryForces
    moduli: Annotated[Floats, "constants cells", "force/area"]
    trajectory: Trajectory
    seconds: dict[str, float]
    prestress: Annotated[Floats | None, "S cells components", "force/area"] = None
    out_of_plane: Annotated[Floats | None, "cells 3", "force/area"] = None
    out_of_plane_prestress: Annotated[Floats | None, "S cells", "force/area"] = None
    inactive: tuple[str, ...] = ()
    errors: dict[str, float] | None = None
    bound: dict[str, Any] | None = None
    sides: Sides | None = None
    growth: dict[str, str] | None = None
    quantities: dict[str, quoted.Quantity] | None = None
    dissipated_error: Annotated[Floats | None, "N", "energy"] = None
    work_error: Annotated[Floats | None, "N", "energy"] = None
    energy_bounds: Annotated[Floats | None, "N 2", "energy"] = None
    cell_bounds: Annotated[Floats | None, "cells", "force length"] = None
    force_bounds: Annotated[Floats | None, "N 2", "force"] = None
    bounded_force: dict[str, int] | None = None
    stabilisation: Stabilisation | None = None

    @property
    def steps(self) -> int:
        """The number of steps N, stored or not."""
        return len(self.trajectory.times) - 1

    @property
    def stored(self) -> Ints:
        """(S,) numbers of the stored steps; 0 is the initial instant."""
        return self.trajectory.stored

    @property
    def times(self) -> Floats:
        """(S,) stored instants."""
        return self.trajectory.times[self.stored]

    @property
    def energy(self) -> Floats:
        """(S,) 1/2 a^h(u, u): what the body stores, and springs with it, where no stress precedes strain."""
        return self.trajectory.energy[self.stored]

    @property
    def dissipated(self) -> Floats:
        """(S,) energy lost to friction since the initial instant, and to dashpots (:class:`vemcvx.Viscosity`)."""
        return self.trajectory.dissipated[self.stored]

    @property
    def work(self) -> Floats:
        """(S,) sum of end-of-step forces and reactions times increments since the initial instant.

        Obstacles whose gap changes work, too, and ground that moves. What is left of it after `energy` and `dissipated`
        is never negative: 1/2 a^h(du, du) of every step, and pressures times the gaps that they closed.
        """
        return self.trajectory.work[self.stored]

    @property
    def dissipated_second_order(self) -> Floats:
        """(S,) energy lost to friction, with the bounds of both ends of every step: of second order in its length.

        Where slip turns in space it is of first. Quote it, and `work_second_order`, rather than `dissipated` and
        `work`: these make up the balance of backward Euler and are of first order, even where the states at the
        instants are exact. What dashpots lose is in both alike, of first order.
        """
        return self.trajectory.dissipated_second_order[self.stored]

    @property
    def work_second_order(self) -> Floats:
        """(S,) work of forces, reactions and obstacles by the balance of energies, of second order likewise."""
        return self.trajectory.work_second_order[self.stored]

    @property
    def certificate(self) -> Floats:
        """(S,) certified relative energy error of each stored step, given the step before."""
        return self.trajectory.certificate[self.stored]

    @property
    def certificate_kind(self) -> str:
        """The kind of `certificate`: "bound", or "for the given friction" where that follows the answer.

        Under Coulomb's law, and laws of slip, it bounds the distance to the solution of the program whose bounds of
        friction are those of the answer's own pressure and slip.
        """
        return self.trajectory.certificate_kind

    @property
    def certificate_floor(self) -> Floats:
        """(S,) what round-off alone may account for in `certificate`."""
        return self.trajectory.certificate_floor[self.stored]

    @property
    def certified(self) -> Floats:
        """(S,) the bound on the relative energy error of a step, rounding included: certificate and floor together."""
        return self.trajectory.certified[self.stored]

    @property
    def certified_total(self) -> Floats:
        """(S,) `certified`, the errors of all steps so far added up."""
        return self.trajectory.certified_total[self.stored]

    @property
    def certificate_total(self) -> Floats:
        """(S,) certified relative energy error, the errors of all steps so far added up."""
        return self.trajectory.certificate_total[self.stored]

    @property
    def iterations(self) -> Ints:
        """(S,) iterations of the solver."""
        return self.trajectory.iterations[self.stored]

    @property
    def safeguards(self) -> Ints:
        """(S,) calls of the safeguard, where Newton's active sets came back: projected gradients, at last Clarabel."""
        return self.trajectory.safeguards[self.stored]

    @property
    def solver(self) -> str:
        """Name and settings of the solver that answered."""
        return self.trajectory.solver

    @cached_property
    def _space(self) -> Space:
        return Space(self.mesh)

    def reaction(self, name: str) -> Floats:
        """(S, dim) total force of supports on a boundary of the body.

        Forces go with the effect that causes them: a block pulled by its side over a floor shows all friction as
        reaction of that side, and `force` of the floor has it, too. A node that one support holds on two boundaries
        shares its force between them: see :mod:`vemcvx.results.forces`.

        Raises
        ------
        SceneError
            The mesh has no such boundary.
        """
        return reaction(self, name)

    def force(self, of: str | Effect | type[Effect]) -> Floats:
        """(S, dim) total force of an effect on the body, or of all but supports on a boundary.

        Parameters
        ----------
        of : str, effect or class of effects
            The name of a boundary, for the force of contact, friction and springs there; an effect of the scene, loads
            included; or a class such as ``vx.TrescaFriction``, for that of all effects of this class. At an interface
            it is the force on the body that is named first.

        Raises
        ------
        SceneError
            There is no such boundary or effect; or two effects act on the same sides, whose force is one.
        """
        return force(self, of)

    def moment(self, of: str | Effect | type[Effect], about: ArrayLike | None = None) -> Floats:
        """(S,) the moment on the body, in space (S, 3), of an effect, or of all that acts on a boundary but loads.

        Parameters
        ----------
        of : str, effect or class of effects
            As of `force`; on a boundary supports count, too.
        about : (dim,) point, optional
            By default the origin. Moments are positive counter-clockwise.

        Raises
        ------
        SceneError
            As of `force`, or for loads.
        """
        return moment(self, of, about)

    def stress(self, step: int) -> Floats:
        """(n_cells, 3) stresses (xx, yy, xy) of Pi u, and those at zero strain, at a stored step; tension positive.

        In space (n_cells, 6): xx, yy, zz, xy, yz, xz.

        Raises
        ------
        SceneError
            That step was not stored.
        """
        return self.on_cells(step)["stress"]

    def out_of_plane_stress(self, step: int) -> Floats:
        """(n_cells,) stress zz across the plane at a stored step; tension positive.

        0 in plane stress. In plane strain lam (e_xx + e_yy) = nu (xx + yy), of an orthotropic material as its E3, nu13
        and nu23 say, minus what blocked eigenstrains cost there (E alpha theta of a body free in the plane). A
        Prestress has no component across the plane and counts as 0 there.

        Raises
        ------
        SceneError
            That step was not stored, the material does not say, or the body is in space, where `stress` has it.
        """
        self._space.require_plane("history: out_of_plane_stress", "take the third column of stress(step)")
        self.row(step)
        if self.out_of_plane is None:
            raise SceneError(
                "history: the stress across the plane is not determined, because a material gives its law in the plane "
                "only (Material.out_of_plane); principal_stresses(step) and stress(step) do not need it."
            )
        return self.on_cells(step)["out_of_plane_stress"]

    def von_mises(self, step: int) -> Floats:
        """(n_cells,) von Mises' equivalent stress at a stored step, the stress across the plane included.

        See :mod:`vemcvx.vem.tensors` for the formula, `out_of_plane_stress` for that component and its errors.
        """
        fields = self.on_cells(step)
        return fields["von_mises"] if "von_mises" in fields else self.out_of_plane_stress(step)

    def principal_stresses(self, step: int) -> Floats:
        """(n_cells, 2) principal stresses in the plane at a stored step, the larger one first; tension positive.

        In space (n_cells, 3), the largest first.

        Raises
        ------
        SceneError
            That step was not stored.
        """
        return self.on_cells(step)["principal_stresses"]

    def on_cells(self, step: int) -> dict[str, Floats]:
        """The fields of a stored step on cells, from one strain, each as the method of its name gives it.

        Stress, principal stresses, the strain energy per area 1/2 eps : C eps, and, where it is determined, the stress
        across the plane and von Mises' stress.

        Raises
        ------
        SceneError
            That step was not stored.
        """
        row = self.row(step)
        strain = strains(self._space, self.displacement[row])
        elastic = stresses(self.moduli, strain)
        stress = elastic if self.prestress is None else elastic + self.prestress[row]
        energy = 0.5 * np.einsum("ci,ci->c", elastic, strain)
        fields = {"stress": stress, "principal_stresses": principal(stress), "strain_energy": energy}
        if not self._space.in_plane:
            return fields | {"von_mises": equivalent(stress)}
        if self.out_of_plane is None:
            return fields
        across: Floats = np.einsum("ck,ck->c", self.out_of_plane, strain)
        if self.out_of_plane_prestress is not None:
            across = across + self.out_of_plane_prestress[row]
        return fields | {"out_of_plane_stress": across, "von_mises": equivalent(stress, across)}

    @cached_property
    def extremes(self) -> tuple[quoted.Extreme, ...]:
        """The largest displacement, stresses, slip, friction and pressure over all stored steps, where and when.

        Displacements are those of nodes, stresses those of cells, Pi u's, at their centroids, and slips, friction and
        pressure, raw and recovered, those of contact nodes. Signs are kept: the smallest principal stress is the
        largest compression. `Extreme.unbounded` says of those at corners and point loads that they may grow without
        limit as the mesh is refined (:mod:`vemcvx.results.corners`), unless half of the field is within a percent of
        them: no corner is loaded then. Found once, when first asked for.
        """
        corners, grew, found = Corners(self.mesh, self.contact, self.sides), self.growth or {}, []
        given = not self.trajectory.given_friction.any()
        for one, k, even in largest_values(self):
            # Slip is bounded at all corners, and friction where its bound is given.
            bounded = one.key == "slip" or (one.key == "friction" and given)
            near, row = [] if even or bounded else _near(self, corners, one.key, k), self.row(one.step)
            said = corners.at_load(near) if one.key == "displacement" else corners.sentence(near, row)
            found.append(replace(one, unbounded="; ".join(filter(None, (said, grew.get(one.key, ""))))))
        return tuple(found)

    @cached_property
    def resultants(self) -> dict[str, Floats]:
        """The forces (S, dim) on every named boundary on which something acts, such as "reaction of right".

        Found once, when first asked for.
        """
        return resultants(self)

    @cached_property
    def peak(self) -> int:
        """The stored step of the largest elastic energy, which pictures and tables show by default.

        It is the last one whose energy is within a percent of the largest.
        """
        return int(self.stored[last_of_largest(self.energy)])

    @cached_property
    def turns(self) -> Ints:
        """Stored steps at which the motion turns back: that of a step is against that of the step before.

        Motions below the accuracy of a step do not count. Found once, when first asked for.
        """
        u, before, found = self.displacement, np.zeros(()), list[int]()
        least = self.trajectory.accuracy * max(float(np.linalg.norm(row)) for row in u)
        for row in range(1, len(u)):
            moved = u[row] - u[row - 1]
            if np.linalg.norm(moved) > least:
                if float((moved * before).sum()) < 0:
                    found.append(int(self.stored[row - 1]))
                before = moved
        return np.array(found, dtype=np.int64)

    def telling(self, most: int) -> Ints:
        """Return at most so many stored steps, 2 or more, that tell the course of a run, the peak among them.

        They are the first turn, the last turns and the last step; where nothing turns back, steps evenly apart.
        """
        later = self.stored[self.stored > 0]
        evenly = np.unique(np.linspace(0, len(later), min(most, len(later)) + 1)[1:].round().astype(int)) - 1
        steps = np.union1d(self.turns, later[-1:]) if len(self.turns) else later[evenly]
        chosen = np.union1d(steps[:1], steps[1 - most :])
        return chosen if self.peak in chosen else np.union1d(chosen[int(len(chosen) == most) :], self.peak)

    def row(self, step: int | None) -> int:
        """The row of a step in the arrays; negative steps count from the end, and None is the peak."""
        step = self.peak if step is None else step
        wanted = step if not is_whole(step) or step >= 0 else step + self.steps + 1
        stored: list[int] = self.stored.tolist()
        if not is_whole(step) or wanted not in stored:
            kept = np.array2string(self.stored, threshold=8)
            raise SceneError(f"history: step {brief(step)} was not stored; stored are {kept} of 0 ... {self.steps}.")
        return stored.index(wanted)


ALIKE = 0.99
"""Part of the largest value above which others are as large."""


def last_of_largest(sizes: ArrayLike) -> int:
    """Return the last place in sizes (S,) of a value within a percent of the largest."""
    values = np.nan_to_num(sizes)
    return int(np.flatnonzero(values >= ALIKE * values.max())[-1])


def largest_values(history: Results) -> Iterator[tuple[quoted.Extreme, int, bool]]:
    """The extremes, each with its node or cell, and whether half of the field at its instant is within a percent."""
    found: dict[str, tuple[quoted.Extreme, int, Floats]] = {}
    # Squares beyond the largest number are infinite, as are the extremes then.
    with np.errstate(over="ignore", invalid="ignore"):
        for row, step in enumerate(history.stored.tolist()):
            for key, (name, unit, values, points) in _fields(history, row, step):
                signed = -values if key.startswith("smallest") else values
                k = int(np.argmax(signed))
                if key not in found or signed[k] > found[key][2][found[key][1]]:
                    at = {"place": points[k], "time": float(history.times[row]), "step": step}
                    found[key] = quoted.Extreme(key, name, float(values[k]) + 0.0, unit, **at), k, signed
    for one, k, signed in found.values():
        yield one, k, bool(np.median(signed) >= ALIKE * signed[k])


def _near(history: Results, corners: Corners, key: str, k: int) -> list[int]:
    """The nodes of a cell and of those around it, or a contact node and those next to it, at which an extreme is."""
    mesh = history.mesh
    if key == "displacement":
        return [k]
    if key in quoted.ON_CONTACT:
        node = int(history.contact.nodes[k])
        beside = [node] if corners.sides is None else corners.sides.beside(node)
        return np.intersect1d(beside, history.contact.nodes).tolist()
    if isinstance(mesh, PolyhedralMesh):
        return np.unique(np.concatenate([*mesh.cells[k]])).tolist()
    offsets, vertices = mesh.cell_nodes
    cells = cell_of_corner(offsets)
    around = np.isin(cells, cells[np.isin(vertices, vertices[offsets[k] : offsets[k + 1]])])
    return np.unique(vertices[around]).tolist()


def _fields(history: Results, row: int, step: int) -> Iterator[tuple[str, tuple[str, str, Floats, Floats]]]:
    """Every field that has extremes, at a stored step: its key, and its name, unit, values and places."""
    mesh, contact = history.mesh, history.contact
    size, stress = np.linalg.norm(history.displacement[row], axis=1), "force/length²"
    yield "displacement", ("largest displacement", "length", size, mesh.points)
    cells = history.on_cells(step)
    # A material of the plane that does not give the stress across it has no von Mises stress.
    if "von_mises" in cells:
        yield "von_mises", ("largest von Mises stress", stress, cells["von_mises"], mesh.centroids)
    principal = cells["principal_stresses"]
    yield "largest_principal_stress", ("largest principal stress", stress, principal[:, 0], mesh.centroids)
    yield "smallest_principal_stress", ("smallest principal stress", stress, principal[:, -1], mesh.centroids)
    if len(contact.nodes):
        over, unit = SPREAD[mesh.points.shape[1]]
        slip, friction = np.linalg.norm(contact.slip[row], axis=1), np.linalg.norm(contact.traction[row], axis=1)
        yield "slip", ("largest slip", "length", slip, contact.points)
        yield "friction", (f"largest friction per {over}", unit, friction, contact.points)
        yield "pressure", (f"largest contact pressure per {over}", unit, contact.pressure[row], contact.points)
        smooth = f"largest recovered contact pressure per {over}"
        yield "pressure_recovered", (smooth, unit, contact.pressure_recovered[row], contact.points)


RECORDS: dict[str, type] = {
    "": Results,
    "contact.": Contact,
    "acting.": BoundaryForces,
    "trajectory.": Trajectory,
    "sides.": Sides,
    "stabilisation.": VertexWeights,
}
"""Records whose arrays make up a history, under the first part of the names that their arrays have in files."""


def labelled(history: Results) -> Iterator[tuple[str, NDArray[Any], ArrayField]]:
    """Give every array of a history with its name and what there is to say of it."""
    for prefix, kind in RECORDS.items():
        record = attrgetter(prefix[:-1])(history) if prefix else history
        for name, of in array_fields(type(record)).items() if isinstance(record, kind) else ():
            if (values := getattr(record, name)) is not None:
                yield prefix + name, values, of


def record(posed: PosedScene, trajectory: Trajectory, assembled: float, storage: Storage) -> Results:
    """Return the results of a posed scene."""
    _warn_of_friction_where_open(posed, trajectory)
    times, material, prestress = trajectory.times[trajectory.stored].tolist(), posed.material, posed.prestress

    def in_time(name: str, shape: tuple[int, ...], value: Callable[[float], Floats | None]) -> Floats:
        rows = storage.array(name, (len(times), *shape))
        for row, t in enumerate(times):
            rows[row] = value(t)
        return rows

    shape = posed.space.mesh.points.shape
    centred = without_mean_motion(posed.space) if posed.pins else lambda u: u
    u, forces = (storage.array(name, (len(times), *shape)) for name in ("displacement", "forces"))
    for row, t in enumerate(times):
        u[row] = displacement(posed, trajectory.state[row], t).reshape(shape)
        u[row] = centred(u[row])
        stressed = posed.A @ u[row].ravel() + _damped(posed, trajectory, row)
        forces[row] = (stressed - posed.force(t)).reshape(shape)
    across, blocked, blocked_across = material.out_of_plane, None, None
    if prestress is not None:
        blocked = in_time("prestress", material.thermal_stress_moduli.shape, prestress.stress)
        if prestress.eigenstrains and across is not None and across.any():
            size = (posed.space.mesh.n_cells,)
            blocked_across = in_time("out_of_plane_prestress", size, prestress.out_of_plane)
    untouched: tuple[str, ...] = ()
    if trajectory.pressures.shape[1] > 0 and not trajectory.pressures.any():
        untouched = (f"{', '.join(posed.obstacles.subjects)}: nothing pressed on it at the stored instants",)
    return Results(
        mesh=posed.space.mesh,
        scene=posed.scene,
        effects=tuple(effect.describe_body(posed.space.in_plane) for effect in posed.scene.canonical),
        displacement=u,
        forces=forces,
        contact=contact_history(posed, trajectory, u, forces),
        acting=boundary_forces(posed, trajectory, u, forces),
        moduli=material.moduli,
        stabilisation=material.choose_stabilisation(posed.space.dim),
        trajectory=trajectory,
        seconds={"assemble": assembled, **trajectory.seconds},
        prestress=blocked,
        out_of_plane_prestress=blocked_across,
        out_of_plane=None if across is None else np.ascontiguousarray(across[:, :3]),
        inactive=posed.inactive + untouched,
        sides=sides_of(posed),
    )


def without_mean_motion(space: Space) -> Callable[[Floats], Floats]:
    """Return a function that takes from nodal values (n_nodes, dim) the mean displacement and mean rotation of Pi u.

    The rotation is the antisymmetric part of the gradient.
    """
    points, dim = space.mesh.points, space.dim
    values, gradient = mean_weights(space, np.ones(space.mesh.n_cells, dtype=bool))
    modes, reads = rigid_modes(points - points.mean(axis=0)), rigid_modes(gradient)
    reads[:, :dim] *= np.repeat(values, dim)[:, None]
    return lambda u: u - (modes @ np.linalg.solve(reads.T @ modes, reads.T @ u.ravel())).reshape(u.shape)


def displacement(posed: PosedScene, y: Floats, t: float) -> Floats:
    """u (n_u,) from the free unknowns y (n,) at the instant `t`."""
    u: Floats = posed.supports.P @ y
    return u if posed.supports.still else u + posed.supports.motion(t)


def warn_of_lost_work(run: Trajectory) -> None:
    """Log a warning where end-of-step forces times increments are far above the work that friction lets be done."""
    works = run.work_second_order
    first, second = float(run.work[-1]), float(works[-1])
    lost, better = float(run.dissipated[-1]), float(run.dissipated_second_order[-1])
    size = max(float(np.abs(works).max()), float(run.energy.max()))
    if lost <= SAME * size or abs(first - second) <= WORTH_A_WORD * size:
        return
    log.warning(
        "time steps: displacements and stresses are not affected; for work and friction energy quote "
        f"history.work_second_order, {second:.6g}, and dissipated_second_order, {better:.6g}, or take more steps: the "
        f"sums of backward Euler, {first:.6g} and {lost:.6g}, are of first order."
    )


def warn_of_large_strains(posed: PosedScene, results: Results) -> None:
    """Log a warning of the largest principal strain and its place, if small strains are left.

    It looks at about CHUNK_SIZE cells, at the stored instant of the largest energy.
    """
    space, row = posed.space, int(np.argmax(results.energy))
    groups = [group.part(slice(None, None, 1 + space.mesh.n_cells // CHUNK_SIZE)) for group in space.groups]
    cells, mesh = np.concatenate([group.cells for group in groups]), space.mesh
    tensor = strains(space, results.displacement[row], groups)[cells]
    tensor[:, space.dim :] *= 0.5
    size = np.abs(principal(tensor)).max(axis=1)
    k, volumes = int(np.argmax(size)), mesh.measures[cells]
    # At a singular corner some strain is large, if only the mesh is fine.
    if volumes[size > WORTH_A_WORD].sum() > 0.01 * volumes.sum():
        place, t = coordinates(mesh.centroids[cells[k]]), float(results.times[row])
        log.warning(
            f"small strains are left: a strain of {size[k]:.2g} at {place}, t = {t:.6g}. "
            "The linear model does not hold there; compare the units of stiffness, loads, supports and mesh."
        )


def _warn_of_friction_where_open(posed: PosedScene, trajectory: Trajectory) -> None:
    """Say how much of friction's work is done where contact is open, if nobody has said that it is meant to be."""
    terms, obstacles = posed.terms, posed.obstacles
    asked = [friction for friction in terms.frictions if friction.in_the_air]
    if not asked or len(obstacles.nodes) == 0:
        return
    first, place = distinct_pairs(obstacles.nodes, obstacles.partners)
    at = obstacles[first].find(terms)
    # The last column is of terms without an obstacle.
    pressed = sum_columns(trajectory.pressures, place, len(first) + 1)[:, at]
    rubbed = np.diff(trajectory.worn, axis=0)
    # Open after the step and before it: the step in which a place closes or opens may rub on either side of that.
    # Answers are a solver's: of the largest pressure 1e-6 counts as touch, and as much of friction's work counts.
    closed = pressed > 1e-6 * pressed.max(initial=0.0)
    gone = ~(closed[1:] | closed[:-1]) & (at >= 0)
    gone &= ContactRows.from_parts(asked, terms.normals.shape[1]).find(terms) >= 0
    lost, total = rubbed[gone].sum(), rubbed.sum()
    if lost > 1e-6 * total:
        warnings.warn(
            f"{asked[0].subject}: its bound is given, and {lost / total:.0%} of all friction work is done in the air, "
            "where contact is open. Say while_closed=True to rub where there is touch, or while_closed=False if this "
            "is meant.",
            SceneWarning,
            stacklevel=4,
        )


def _damped(posed: PosedScene, trajectory: Trajectory, row: int) -> Floats | float:
    """The forces of dashpots on the nodes (n_u,), at the rates of the step that led to a row."""
    n = int(trajectory.stored[row])
    if posed.viscosity is None or trajectory.velocity is None or n == 0:
        return 0.0
    v = posed.supports.P @ trajectory.velocity[row]
    if not posed.supports.still:
        s, t = (float(instant) for instant in trajectory.times[n - 1 : n + 1])
        v = v + (posed.supports.motion(t) - posed.supports.motion(s)) / (t - s)
    return posed.viscosity @ v


def with_origin(
    programs: Iterator[SolvedProgram], posed: PosedScene, effects: Sequence[str], condense: bool, **more: str
) -> Iterator[SolvedProgram]:
    """The programs, which now say what scene and mesh they are of, and whose cells K is made of."""
    for program in programs:
        rows = None if condense else posed.energy_rows
        origin = {"scene": list(effects), "mesh": size_of(posed.space.mesh), **more}
        yield replace(program, origin=origin, energy_rows=rows)


def size_of(mesh: Mesh) -> dict[str, Any]:
    """The numbers of cells and nodes, and h, as files have them."""
    return {"cells": mesh.n_cells, "nodes": mesh.n_nodes, "h": mesh.h}


def programs_of_steps(history: Results, numbers: Sequence[int], condense: bool = True) -> Iterator[SolvedProgram]:
    """The programs of these steps, with one factorisation.

    HistoryError where the history has no scene, no such step, or has not stored the states before and after one.
    """
    if history.scene is None:
        raise HistoryError(
            "program: the history was read from files, which do not keep the functions of a scene, or joined; take a "
            "stage, simulate again, or take vemcvx.programs(scene, mesh, times)."
        )
    with suppress_scene_warnings():
        posed = pose_scene(history.scene, history.mesh, history.trajectory.times.tolist())
    found = programs_of_trajectory(posed.system, history.trajectory, numbers, condense)
    return with_origin(found, posed, history.effects, condense, solver=history.solver)
