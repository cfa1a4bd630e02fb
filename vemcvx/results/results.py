"""Displacements, forces and stresses at S stored instants."""

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

from vemcvx.base.arrays import ArrayField, Floats, Ints, array_fields, brief, is_whole
from vemcvx.base.errors import WARNING_FRACTION, HistoryError, SceneError, SceneWarning
from vemcvx.base.outline import coordinates
from vemcvx.meshes import Mesh, PolyhedralMesh
from vemcvx.meshes.polygons import cell_of_corner
from vemcvx.program import SolvedProgram
from vemcvx.results import quoted
from vemcvx.results.contact import Contact, contact_history
from vemcvx.results.corners import Corners, Sides, find_sides
from vemcvx.results.forces import ActingForces, BoundaryForces, boundary_forces
from vemcvx.scene import Scene
from vemcvx.scene.pose import PosedScene, pose_scene, suppress_scene_warnings
from vemcvx.stepping import Storage, Trajectory, programs_of_trajectory
from vemcvx.vem import Space, Stabilisation, strains
from vemcvx.vem.elasticity import rigid_modes
from vemcvx.vem.loads import mean_weights
from vemcvx.vem.stabilisation import VertexWeights
from vemcvx.vem.tensors import equivalent, principal, stresses

log = logging.getLogger("vemcvx")


@dataclass(frozen=True, kw_only=True, repr=False)
class Results(ActingForces):
    """The arrays of a simulation, which :class:`vemcvx.History` documents and extends by methods."""

    mesh: Mesh
    scene: Scene | None
    effects: tuple[str, ...]
    displacement: Annotated[Floats, "S nodes dim", "length"]
    forces: Annotated[Floats, "S nodes dim", "force"]
    contact: Contact
    acting: BoundaryForces  # forces of effects on nodes
    # Lame's constants lambda and mu, or the upper triangle of the elastic matrix by rows.
    moduli: Annotated[Floats, "constants cells", "force/area"]
    trajectory: Trajectory
    seconds: dict[str, float]  # "assemble", "prepare" and "solve"
    prestress: Annotated[Floats | None, "S cells components", "force/area"] = None  # stresses at zero strain
    out_of_plane: Annotated[Floats | None, "cells 3", "force/area"] = None  # stress zz per strain e_xx, e_yy, 2 e_xy
    out_of_plane_prestress: Annotated[Floats | None, "S cells", "force/area"] = None  # stress zz due to eigenstrains
    inactive: tuple[str, ...] = ()  # a sentence for each effect without influence on this run
    errors: dict[str, float] | None = None
    bound: dict[str, Any] | None = None
    sides: Sides | None = None
    growth: dict[str, str] | None = None  # key of an extreme -> how it grew on finer meshes
    energy_bounds: Annotated[Floats | None, "N 2", "energy"] = None
    cell_bounds: Annotated[Floats | None, "cells", "force length"] = None
    force_bounds: Annotated[Floats | None, "N 2", "force"] = None
    bounded_force: dict[str, int] | None = None  # boundary and axis of `force_bounds`, such as {"top": 0}
    stabilisation: Stabilisation | None = None
    units: dict[str, str] | None = None

    @property
    def steps(self) -> int:
        """The number of steps N, stored or not."""
        return len(self.trajectory.times) - 1

    @property
    def stored(self) -> Ints:
        """The numbers (S,) of the stored steps; 0 is the initial instant."""
        return self.trajectory.stored

    @property
    def times(self) -> Floats:
        """The stored instants (S,)."""
        return self.trajectory.times[self.stored]

    @property
    def energy(self) -> Floats:
        """The energy (S,) stored in the body, in springs and in soft contact."""
        return self.trajectory.energy[self.stored]

    @property
    def dissipated(self) -> Floats:
        """The energy (S,) dissipated since the initial instant by friction and dashpots (:class:`vemcvx.Viscosity`)."""
        return self.trajectory.dissipated[self.stored]

    @property
    def work(self) -> Floats:
        """The work (S,) of forces and reactions so far, with the forces at the end of each step.

        The loss of time stepping, `work` - `dissipated` - (`energy` - initial energy), is never negative.
        """
        return self.trajectory.work[self.stored]

    @property
    def dissipated_second_order(self) -> Floats:
        """The dissipated energy (S,), accurate to second order in the time step.

        The order is 1 with dashpots. In space, it is 1 if the direction of slip changes.
        """
        return self.trajectory.dissipated_second_order[self.stored]

    @property
    def work_second_order(self) -> Floats:
        """The work (S,) of forces and reactions, accurate to second order in the time step."""
        return self.trajectory.work_second_order[self.stored]

    @property
    def certificate(self) -> Floats:
        """The certified relative energy error (S,) of each stored step, without errors of earlier steps."""
        return self.trajectory.certificate[self.stored]

    @property
    def certificate_kind(self) -> str:
        """The kind of `certificate`: "bound", or "for the given friction" if friction bounds depend on the answer."""
        return self.trajectory.certificate_kind

    @property
    def certificate_floor(self) -> Floats:
        """The part (S,) of the relative energy error that rounding alone may cause."""
        return self.trajectory.certificate_floor[self.stored]

    @property
    def certified(self) -> Floats:
        """The sum (S,) of `certificate` and `certificate_floor`."""
        return self.trajectory.certified[self.stored]

    @property
    def certified_total(self) -> Floats:
        """The sum (S,) as in `certificate_total`, including rounding errors."""
        return self.trajectory.certified_total[self.stored]

    @property
    def certificate_total(self) -> Floats:
        """The sum (S,) of the certified errors of all steps so far, relative to the largest energy norm so far."""
        return self.trajectory.certificate_total[self.stored]

    @property
    def iterations(self) -> Ints:
        """The iterations (S,) of the solver."""
        return self.trajectory.iterations[self.stored]

    @property
    def solver(self) -> str:
        """The name and the settings of the solver."""
        return self.trajectory.solver

    @property
    def spread(self) -> tuple[str, str]:
        """The measure of contact surfaces, "length" or "area", and the unit of forces per measure."""
        flat = self._space.in_plane and not self.is_axisymmetric
        return ("length", "force/length") if flat else ("area", "force/length²")

    def stress(self, step: int) -> Floats:
        """Return the stresses xx, yy, xy (n_cells, 3) at a stored step; tension is positive.

        In space, the stresses are xx, yy, zz, xy, yz, xz (n_cells, 6). Stresses at zero strain are included.
        """
        return self.on_cells(step)["stress"]

    def out_of_plane_stress(self, step: int) -> Floats:
        """Return the stress zz (n_cells,) normal to the plane at a stored step; tension is positive.

        The stress zz is 0 in plane stress, and the hoop stress in a body of revolution. A Prestress adds nothing.
        """
        self._space.require_plane("history: out_of_plane_stress", "take the third column of stress(step)")
        self.row(step)
        if self.out_of_plane is None and not self.is_axisymmetric:
            raise SceneError(
                "history: the stress normal to the plane is unknown, because a material does not give "
                "out_of_plane (see Material); principal_stresses(step) and stress(step) do not need it."
            )
        return self.on_cells(step)["out_of_plane_stress"]

    def von_mises(self, step: int) -> Floats:
        """Return von Mises' stress (n_cells,) at a stored step; raise SceneError if the stress zz is unknown."""
        fields = self.on_cells(step)
        return fields["von_mises"] if "von_mises" in fields else self.out_of_plane_stress(step)

    def principal_stresses(self, step: int) -> Floats:
        """Return the principal stresses (n_cells, 2) in the plane at a stored step, the larger first; tension positive.

        In space and in bodies of revolution, the shape is (n_cells, 3). The hoop stress is a principal stress.
        """
        return self.on_cells(step)["principal_stresses"]

    def on_cells(self, step: int) -> dict[str, Floats]:
        """Return all cell fields of a stored step by name; "strain_energy" is the density 1/2 eps : C eps."""
        row = self.row(step)
        strain = strains(self._space, self.displacement[row])
        elastic = stresses(self.moduli, strain)
        stress = elastic if self.prestress is None else elastic + self.prestress[row]
        energy = 0.5 * np.einsum("ci,ci->c", elastic, strain)
        if self.is_axisymmetric:
            stress, hoop = stress[:, :3], stress[:, 3]
            every = -np.sort(-np.column_stack([principal(stress), hoop]))
            fields = {"stress": stress, "principal_stresses": every, "strain_energy": energy}
            return fields | {"out_of_plane_stress": hoop, "von_mises": equivalent(stress, hoop)}
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
        """The largest displacement, stresses, slip, friction and pressure over all stored steps, with place and time.

        `Extreme.unbounded` warns that a value at a corner or point load may grow without limit as the mesh is refined
        (:mod:`vemcvx.results.corners`).
        """
        corners, grew, found = Corners(self.mesh, self.contact, self.sides), self.growth or {}, []
        given = not self.trajectory.given_friction.any()
        for one, k, even in largest_values(self):
            # At corners, slip is bounded, and so is friction with a given bound.
            bounded = one.key == "slip" or (one.key == "friction" and given)
            near, row = [] if even or bounded else _near(self, corners, one.key, k), self.row(one.step)
            words = corners.at_load(near) if one.key == "displacement" else corners.sentence(near, row)
            found.append(replace(one, unbounded="; ".join(filter(None, (words, grew.get(one.key, ""))))))
        return tuple(found)

    @cached_property
    def peak(self) -> int:
        """The last stored step with at least 99 % of the largest energy."""
        return int(self.stored[last_of_largest(self.energy)])

    @cached_property
    def turns(self) -> Ints:
        """The stored steps at which the motion reverses."""
        u, before, found = self.displacement, np.zeros(()), list[int]()
        least = self.trajectory.accuracy * max(float(np.linalg.norm(row)) for row in u)
        for row in range(1, len(u)):
            moved = u[row] - u[row - 1]
            if np.linalg.norm(moved) > least:  # Smaller increments may be solver errors.
                if float((moved * before).sum()) < 0:
                    found.append(int(self.stored[row - 1]))
                before = moved
        return np.array(found, dtype=np.int64)

    def telling(self, most: int) -> Ints:
        """Return up to `most` >= 2 stored steps to draw, such as the peak and reversals."""
        later = self.stored[self.stored > 0]
        evenly = np.unique(np.linspace(0, len(later), min(most, len(later)) + 1)[1:].round().astype(int)) - 1
        steps = np.union1d(self.turns, later[-1:]) if len(self.turns) else later[evenly]
        chosen = np.union1d(steps[:1], steps[1 - most :])
        return chosen if self.peak in chosen else np.union1d(chosen[int(len(chosen) == most) :], self.peak)

    def row(self, step: int | None) -> int:
        """Return the row of a stored step in arrays; negative steps count from the end, None means the peak."""
        step = self.peak if step is None else step
        wanted = step if not is_whole(step) or step >= 0 else step + self.steps + 1
        stored: list[int] = self.stored.tolist()
        if not is_whole(step) or wanted not in stored:
            kept = np.array2string(self.stored, threshold=8)
            raise SceneError(f"history: step {brief(step)} was not stored; stored steps: {kept} of 0 ... {self.steps}.")
        return stored.index(wanted)


ALIKE = 0.99  # Values above this fraction of the largest value are treated as largest.


def last_of_largest(sizes: ArrayLike) -> int:
    """Return the last position of a value within 1 % of the largest."""
    values = np.nan_to_num(sizes)
    return int(np.flatnonzero(values >= ALIKE * values.max())[-1])


def largest_values(history: Results) -> Iterator[tuple[quoted.Extreme, int, bool]]:
    """Yield each extreme, the node or cell, and True for a nearly uniform field."""
    found: dict[str, tuple[quoted.Extreme, int, Floats]] = {}
    # If squares overflow, the extremes are infinite.
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
    """Yield key, name, unit, values and places of each field."""
    mesh, contact = history.mesh, history.contact
    size, stress = np.linalg.norm(history.displacement[row], axis=1), "force/length²"
    yield "displacement", ("largest displacement", "length", size, mesh.points)
    cells = history.on_cells(step)
    if "von_mises" in cells:
        yield "von_mises", ("largest von Mises stress", stress, cells["von_mises"], mesh.centroids)
    principal = cells["principal_stresses"]
    yield "largest_principal_stress", ("largest principal stress", stress, principal[:, 0], mesh.centroids)
    yield "smallest_principal_stress", ("smallest principal stress", stress, principal[:, -1], mesh.centroids)
    if len(contact.nodes):
        over, unit = history.spread
        slip, friction = np.linalg.norm(contact.slip[row], axis=1), np.linalg.norm(contact.traction[row], axis=1)
        yield "slip", ("largest slip", "length", slip, contact.points)
        yield "friction", (f"largest friction per {over}", unit, friction, contact.points)
        yield "pressure", ("largest contact pressure", unit, contact.pressure[row], contact.points)
        smooth = "largest recovered contact pressure"
        yield "pressure_recovered", (smooth, unit, contact.pressure_recovered[row], contact.points)


RECORDS: dict[str, type] = {
    "": Results,
    "contact.": Contact,
    "acting.": BoundaryForces,
    "trajectory.": Trajectory,
    "sides.": Sides,
    "stabilisation.": VertexWeights,
}
"""Prefix of array names in files -> class of the arrays."""


def list_arrays(history: Results) -> Iterator[tuple[str, NDArray[Any], ArrayField]]:
    """Yield the name, the values and the description of each array of a history."""
    for prefix, kind in RECORDS.items():
        record = attrgetter(prefix[:-1])(history) if prefix else history
        for name, of in array_fields(type(record)).items() if isinstance(record, kind) else ():
            if (values := getattr(record, name)) is not None:
                yield prefix + name, values, of


def record(posed: PosedScene, trajectory: Trajectory, assembled: float, storage: Storage) -> Results:
    """Return the results of a trajectory; `assembled` is the time of assembly in seconds."""
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
        stressed = posed.A @ u[row].ravel() + _damping_force(posed, trajectory, row)
        forces[row] = (stressed - posed.force(t)).reshape(shape)
    across, blocked, blocked_across = material.out_of_plane, None, None
    if prestress is not None:
        blocked = in_time("prestress", material.thermal_stress_moduli.shape, prestress.stress)
        if prestress.eigenstrains and across is not None and across.any():
            size = (posed.space.mesh.n_cells,)
            blocked_across = in_time("out_of_plane_prestress", size, prestress.out_of_plane)
    contact = contact_history(posed, trajectory, u, forces)
    _warn_of_friction_where_open(posed, contact)
    untouched: tuple[str, ...] = ()
    if trajectory.pressures.shape[1] > 0 and not trajectory.pressures.any():
        untouched = (f"{', '.join(posed.obstacles.subjects)}: nothing pressed on it at the stored instants",)
    return Results(
        mesh=posed.space.mesh,
        scene=posed.scene,
        effects=tuple(effect.describe_body(posed.space.in_plane) for effect in posed.scene.canonical),
        displacement=u,
        forces=forces,
        contact=contact,
        acting=boundary_forces(posed, trajectory, u, forces),
        moduli=material.moduli,
        stabilisation=material.choose_stabilisation(posed.space.dim),
        trajectory=trajectory,
        seconds={"assemble": assembled, **trajectory.seconds},
        prestress=blocked,
        out_of_plane_prestress=blocked_across,
        out_of_plane=None if across is None else np.ascontiguousarray(across[:, :3]),
        inactive=posed.inactive + untouched,
        sides=find_sides(posed),
    )


def without_mean_motion(space: Space) -> Callable[[Floats], Floats]:
    """Return a function that subtracts the mean displacement and rotation from nodal values."""
    points, dim = space.mesh.points, space.dim
    values, gradient = mean_weights(space, np.ones(space.mesh.n_cells, dtype=bool))
    modes, reads = rigid_modes(points - points.mean(axis=0)), rigid_modes(gradient)
    reads[:, :dim] *= np.repeat(values, dim)[:, None]
    return lambda u: u - (modes @ np.linalg.solve(reads.T @ modes, reads.T @ u.ravel())).reshape(u.shape)


def displacement(posed: PosedScene, y: Floats, t: float) -> Floats:
    """Return the nodal displacements (n_u,) for the free unknowns y at time t."""
    u: Floats = posed.supports.P @ y
    return u if posed.supports.still else u + posed.supports.motion(t)


def warn_of_large_strains(posed: PosedScene, results: Results) -> None:
    """Log a warning if the strains of the step with the largest energy are not small."""
    space, row = posed.space, int(np.argmax(results.energy))
    count = space.components - space.axisymmetric
    tensor, hoop = np.split(strains(space, results.displacement[row]), [count], axis=1)
    tensor[:, space.dim :] *= 0.5
    size = np.abs(np.hstack([principal(tensor), hoop])).max(axis=1)
    k, volumes = int(np.argmax(size)), space.mesh.measures
    # Large strains in a few cells at singular corners are no reason to warn.
    if volumes[size > WARNING_FRACTION].sum() > 0.01 * volumes.sum():
        place, t = coordinates(space.mesh.centroids[k]), float(results.times[row])
        log.warning(
            f"strains are not small: found {size[k]:.2g} at {place}, t = {t:.6g}. "
            "The linear model does not hold there; compare the units of stiffness, loads, supports and mesh."
        )


def _warn_of_friction_where_open(posed: PosedScene, contact: Contact) -> None:
    unsettled = [friction for friction in posed.terms.frictions if friction.in_the_air]
    if not unsettled or len(posed.obstacles.nodes) == 0:
        return
    rubbed = np.diff(contact.wear, axis=0) * contact.friction_lengths
    # Nodes that open or close in a step may have friction.
    gone = ~(contact.closed[1:] | contact.closed[:-1])
    lost, total = rubbed[gone].sum(), rubbed.sum()
    if lost > 1e-6 * total:
        warnings.warn(
            f"{unsettled[0].subject}: {lost / total:.0%} of all friction work is done in the air, where contact is "
            "open, because its bound does not depend on pressure. In TrescaFriction, set while_closed=True for "
            "friction only in contact, or while_closed=False if this is intended.",
            SceneWarning,
            stacklevel=4,
        )


def _damping_force(posed: PosedScene, trajectory: Trajectory, row: int) -> Floats | float:
    n = int(trajectory.stored[row])
    if posed.viscosity is None or trajectory.velocity is None or n == 0:
        return 0.0
    v = posed.supports.P @ trajectory.velocity[row]
    if not posed.supports.still:
        s, t = (float(instant) for instant in trajectory.times[n - 1 : n + 1])
        v = v + (posed.supports.motion(t) - posed.supports.motion(s)) / (t - s)
    return posed.viscosity @ v


def with_origin(
    programs: Iterator[SolvedProgram], posed: PosedScene, effects: Sequence[str], **more: str
) -> Iterator[SolvedProgram]:
    """Yield the programs with their origin: scene, mesh and solver."""
    origin = {"scene": list(effects), "mesh": size_of(posed.space.mesh), **more}
    return (replace(program, origin=origin) for program in programs)


def size_of(mesh: Mesh) -> dict[str, Any]:
    """Return the number of cells, the number of nodes, and h by name."""
    return {"cells": mesh.n_cells, "nodes": mesh.n_nodes, "h": mesh.h}


def programs_of_steps(history: Results, numbers: Sequence[int], condense: bool = True) -> Iterator[SolvedProgram]:
    """Return the programs of some steps, or raise HistoryError."""
    if history.scene is None:
        raise HistoryError(
            "program: the scene of the history is unknown, because the history was read from files or joined. Use "
            "a stage of a joined history, simulate again, or call vemcvx.programs(scene, mesh, times)."
        )
    with suppress_scene_warnings():
        posed = pose_scene(history.scene, history.mesh, history.trajectory.times.tolist())
    found = programs_of_trajectory(posed.system, history.trajectory, numbers, condense)
    return with_origin(found, posed, history.effects, solver=history.solver)
