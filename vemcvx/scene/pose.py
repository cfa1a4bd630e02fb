"""A scene posed on a mesh."""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, cached_property, partial, reduce
from itertools import chain
from operator import add
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats, Ints, read_only
from vemcvx.base.errors import SceneError, SceneWarning
from vemcvx.effects import Contribution, Load, Material, MaterialLaw, Obstacle, Support
from vemcvx.effects.materials import REVOLVED
from vemcvx.linear import order_by_nested_dissection
from vemcvx.meshes import Mesh
from vemcvx.program.kernel import Kernel
from vemcvx.program.system import Damping, Motion, System
from vemcvx.scene.contact import Obstacles, Surface, Terms, pose_contact, warn_of_free_normals
from vemcvx.scene.rigid import build_body_frame, check_balance, find_pins, floating_motions
from vemcvx.scene.rows import straighten_normals
from vemcvx.scene.scene import InitialStresses, Scene, active_parts, compose, initial_stresses
from vemcvx.scene.supports import Supports, by_precedence, check_bonds, check_off_axis, resolve
from vemcvx.vem import Space
from vemcvx.vem.elasticity import rigid_modes
from vemcvx.vem.tensors import AXISYMMETRIC


def build_load(
    loads: tuple[Load | InitialStresses, ...], A: sp.csr_matrix, supports: Supports
) -> Callable[[float], Floats]:
    """Return the load of a System, t -> (n,)."""
    others = [load for load in loads if not isinstance(load, Load)]
    gathered = [(load.values, supports.gather(load.matrix)) for load in loads if isinstance(load, Load)]
    dirichlet_force = build_dirichlet_force(A, supports)

    def load(t: float) -> Floats:
        f = np.zeros(supports.P.shape[1]) if supports.still else -dirichlet_force(t)
        for values, matrix in gathered:
            f += matrix @ values(t)
        for other in others:
            f += supports.gather(other.vector(t))
        return f

    return load


def build_dirichlet_force(A: sp.csr_matrix, supports: Supports) -> Callable[[float], Floats]:
    """Return the force P'A u_D (n,) of the prescribed displacement u_D, as a function of t."""
    moved = supports.moved
    matrix = sp.csr_matrix(supports.gather(A[:, moved]))
    return lambda t: matrix @ supports.motion(t)[moved]


T = TypeVar("T")
UNHELD = "the motion of the whole body: nothing holds it and its loads balance, so the mean motion is taken to be zero"


@dataclass(frozen=True, kw_only=True)
class PosedScene:
    """A scene on a mesh. The unknowns y determine the nodal displacements u = P y + u_D(t)."""

    scene: Scene
    space: Space
    supports: Supports
    A: sp.csr_matrix  # (n_u, n_u) stiffness over all nodal values
    loads: tuple[Load | InitialStresses, ...]
    terms: Terms
    obstacles: Obstacles
    surface: Surface  # contact nodes
    material: Material
    prestress: InitialStresses | None  # stresses at zero strain
    springs: sp.csr_matrix | None  # stiffness of springs to the ground, which is a part of A
    inactive: tuple[str, ...]  # sentences on omitted frictions and on pins
    curves: tuple[str, ...]  # names of effects on curved boundaries
    viscosity: sp.csr_matrix | None  # (n_u, n_u) viscous nodal forces per nodal velocity
    laws: tuple[Contribution, ...]  # contributions of materials, with stiffness None
    stops: Sequence[Obstacle]  # obstacles of all effects
    causes: Mapping[str, Ints]
    """The effect number of each support, friction and obstacle; -1 for pins."""
    caused_loads: tuple[tuple[int, Load], ...]  # (effect number, load)
    caused_springs: tuple[tuple[int, sp.csr_matrix], ...]  # (effect number, stiffness of springs)
    pins: tuple[Support, ...]  # supports that bear no force (scene.rigid)

    @cached_property
    def kernel(self) -> Kernel | None:
        """The rigid motions that only friction or contact resists; a warning names these motions."""
        felt = self.supports.on_free(sp.vstack([self.terms.acting_rows, self.obstacles.rows]))
        kernel, of_bodies = floating_motions(self.space, self.supports, felt, self.springs)
        if kernel is not None:
            words = (
                "supports: nothing but friction or one-sided contact holds the body against "
                f"{' and '.join(kernel.names)}. Stresses and contact forces are unique, but the displacement may be "
                "unique only up to this motion."
            )
            if of_bodies:
                logging.getLogger("vemcvx").info("%s", words)
            else:
                warnings.warn(words, SceneWarning, stacklevel=3)
        return kernel

    @cached_property
    def system(self) -> System:
        """The system for the free unknowns y."""
        A, supports, terms = self.A, self.supports, self.terms
        # Rigid motions strain springs and bodies of revolution.
        rigid = self.springs is None and not self.space.axisymmetric
        frame = build_body_frame(self.space) if rigid else lambda u: u

        def motion(stiffness: sp.csr_matrix, tangential: sp.csr_matrix, normal: sp.csr_matrix) -> Motion | None:
            if supports.still:
                return None
            return Motion(
                dirichlet_force=build_dirichlet_force(stiffness, supports),
                prescribed_slip=lambda t: tangential @ supports.motion(t),
                stored=lambda s, t: float(supports.motion(s) @ (stiffness @ supports.motion(t))),
                frame=lambda t, y: frame(supports.P @ y + supports.motion(t)),
                pair=lambda v, w: float(v @ (stiffness @ w)),
                remaining_gap=lambda t: normal @ supports.motion(t),
            )

        damping, none = None, sp.csr_matrix((0, A.shape[0]))
        if self.viscosity is not None:
            damping = Damping(_restrict(self.viscosity, supports), motion(self.viscosity, none, none))
        return System(
            K=_restrict(A, supports),
            load=build_load(self.loads, A, supports),
            norms=terms.norms(supports),
            motion=motion(A, terms.acting_rows, self.obstacles.rows),
            order=cache(partial(_order, A, supports, supports.points)),
            near_kernel=supports.gather(rigid_modes(supports.points)),
            kernel=self.kernel,
            limits=self.obstacles.limits(supports),
            damping=damping,
            dragged=terms.immovable_terms(supports),
        )

    def force(self, t: float) -> Floats:
        """Return the nodal load f (n_u,), without reactions."""
        f = np.zeros(self.A.shape[0])
        for load in self.loads:
            f += load.vector(t)
        return f

    def at_rest(self, u: Floats) -> Floats:
        """Return u (n_u,) minus a rigid motion, so that the result is zero at the pins."""
        for pins in self.pins:
            values = pins.nodes * self.space.dim + np.argmax(pins.directions, axis=1)
            modes = rigid_modes(self.supports.points - pins.points.mean(axis=0))
            u = u - modes @ np.linalg.solve(modes[values], u[values])
        return u


@contextmanager
def suppress_scene_warnings() -> Iterator[None]:
    """Suppress warnings about scenes inside the block."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SceneWarning)
        yield


def pose_scene(scene: Scene, mesh: Mesh, times: Sequence[float] = (), *, between: Sequence[float] = ()) -> PosedScene:
    """Return a scene posed on a mesh. Floating bodies are refused, and frictions that are always zero are left out."""
    posed = pose_unchecked(scene, mesh, times)
    _ = posed.kernel
    warn_of_free_normals(posed.terms.frictions, posed.supports, posed.obstacles, posed.springs)
    if posed.pins:
        check_balance(posed.force, mesh.points, times if len(times) else between)
    return posed


def pose_unchecked(scene: Scene, mesh: Mesh, times: Sequence[float]) -> PosedScene:
    """Return a scene posed on a mesh. Floating bodies are not refused."""
    space = Space(mesh, axisymmetric=scene.is_axisymmetric)
    parts, inactive = active_parts(scene.canonical, space, times)
    material = compose([p.material for p in parts if p.material is not None], mesh)
    _check_revolution(space, material)
    prestress = initial_stresses(parts, material, space)
    springs = _sum(p.stiffness for p in parts if p.material is None)
    supports, pins, (frictions, stops, surfaces) = _hold(space, parts, springs)
    terms, obstacles, surface = pose_contact(surfaces, frictions, stops, supports, times)
    forms = [p.material.stiffness(space) for p in parts if p.material is not None and p.stiffness is None]
    laws = [p for effect, p in zip(scene.canonical, parts, strict=True) if isinstance(effect, MaterialLaw)]
    return PosedScene(
        scene=scene,
        space=space,
        supports=supports,
        A=reduce(add, [*forms, *(p.stiffness for p in parts if p.stiffness is not None)]),
        loads=_chain(p.loads for p in parts) + (() if prestress is None else (prestress,)),
        terms=terms,
        obstacles=obstacles,
        surface=surface,
        material=material,
        prestress=prestress,
        springs=springs,
        inactive=(*inactive, *[UNHELD] * len(pins)),
        curves=_chain(p.curves for p in parts),
        viscosity=_sum(p.viscosity for p in parts),
        laws=tuple(replace(p, stiffness=None) for p in laws),
        stops=stops,
        pins=pins,
        **_find_causes(parts, supports),
    )


def _check_revolution(space: Space, material: Material) -> None:
    if len({space.axisymmetric, material.plane == REVOLVED, len(material.moduli) == AXISYMMETRIC}) > 1:
        words = f'a material of a body of revolution has the attribute plane = "{REVOLVED}"'
        raise SceneError(
            f"{material.subject}: found plane {material.plane}; {words}, and {AXISYMMETRIC} moduli per cell."
        )


def _hold(
    space: Space, parts: Sequence[Contribution], springs: sp.csr_matrix | None
) -> tuple[Supports, tuple[Support, ...], list[list[Any]]]:
    """Return the supports, the pins, and [frictions, obstacles, surfaces]."""
    holds = by_precedence(_chain(p.supports for p in parts))
    contact = [_chain(getattr(p, name) for p in parts) for name in ("frictions", "obstacles", "surfaces")]
    if space.axisymmetric:
        check_off_axis(_chain(contact))
    straight = iter(straighten_normals(holds, _chain(contact)))
    kinds = [[next(straight) for _ in kind] for kind in contact]
    normals = (*kinds[0], *kinds[1])
    check_bonds(holds, normals)
    # `floating_motions` refuses bodies of revolution that float.
    floats = springs is None and not space.axisymmetric
    pins = find_pins((*holds, *normals), space.mesh.points) if floats else ()
    return resolve([*holds, *pins], normals, space.mesh.points), pins, kinds


def _find_causes(parts: Sequence[Contribution], supports: Supports) -> dict[str, Any]:
    """Return the fields of PosedScene that contain effect numbers."""
    owner = {id(support): i for i, part in enumerate(parts) for support in part.supports}
    causes = {
        name: np.repeat(np.arange(len(parts)), [len(getattr(part, name)) for part in parts])
        for name in ("frictions", "obstacles")
    }
    causes["supports"] = np.array([owner.get(id(support), -1) for support in supports.given], dtype=np.int64)
    springs = [(i, part.stiffness) for i, part in enumerate(parts) if part.material is None]
    return {
        "causes": causes,
        "caused_loads": tuple((i, load) for i, part in enumerate(parts) for load in part.loads),
        "caused_springs": tuple((i, stiffness) for i, stiffness in springs if stiffness is not None),
    }


def _sum(matrices: Iterable[sp.csr_matrix | None]) -> sp.csr_matrix | None:
    given = [matrix for matrix in matrices if matrix is not None]
    return reduce(add, given) if given else None


def _chain(tuples: Iterable[tuple[T, ...]]) -> tuple[T, ...]:
    return tuple(chain.from_iterable(tuples))


def _restrict(A: sp.csr_matrix, supports: Supports) -> sp.csr_matrix:
    K = supports.P.T @ A @ supports.P
    K = sp.csr_matrix(0.5 * (K + K.T))  # Rounding makes the triple product slightly unsymmetric.
    read_only(K.data)  # A System does not copy a read-only matrix.
    return K


def _order(A: sp.csr_matrix, supports: Supports, points: Floats) -> Ints:
    """Return the free unknowns in a nested-dissection order."""
    dim, n = points.shape[1], len(points)
    entries = np.ones(len(A.indices), dtype=np.int8), A.indices // dim, A.indptr
    graph = sp.csr_matrix(entries, shape=(A.shape[0], n))[::dim]
    sites, first = np.unique(supports.sites, return_index=True)
    if len(sites) < n:
        joined = sp.csr_matrix((np.ones(n, dtype=np.int8), (np.arange(n), supports.sites)))
        graph, points = sp.csr_matrix(joined.T @ graph @ joined), points[first]
    rank = np.full(len(sites) + 1, len(sites))  # amplitudes of rigid parts come last
    rank[order_by_nested_dissection(graph, points)] = np.arange(len(sites))
    return np.argsort(rank[supports.owner], kind="stable")
