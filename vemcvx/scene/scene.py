"""A scene: the effects to simulate, independent of any mesh, and the composition of its materials into one body."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats, Ints, brief, drop_tails, read_only
from vemcvx.base.errors import SceneError, VemcvxError
from vemcvx.base.outline import Outline
from vemcvx.effects import Contribution, Effect, Eigenstrain, Friction, InitialStress, Load, Material, MaterialLaw
from vemcvx.effects.materials import REVOLVED
from vemcvx.meshes import Mesh
from vemcvx.scene.rows import pairs_of
from vemcvx.vem import Space, Stabilisation, stress_load
from vemcvx.vem.boundary import DIRECTION_TOLERANCE, MirrorPlanes
from vemcvx.vem.stabilisation import InRegions, VertexWeights
from vemcvx.vem.tensors import upper_triangle


def compose(materials: Sequence[Material], mesh: Mesh) -> Material:
    """Return one material for the whole body; raise SceneError if a cell has none or several, or if `plane` differs."""
    if not materials:
        words = "a scene has at least one, such as Elasticity(young=200.0, poisson=0.3)"
        raise SceneError(f"Scene: found 0 materials; {words}.")
    if len(materials) == 1 and materials[0].cells is None:
        return materials[0]
    _check_cover(materials, mesh)
    planes = {m.plane: m.subject for m in materials}
    if len(planes) > 1:
        words = " and ".join(f"plane {plane} in {subject}" for plane, subject in sorted(planes.items()))
        raise SceneError(f"materials: found {words}; give all materials the same plane=.")
    isotropic, dim = all(len(m.moduli) == 2 for m in materials), mesh.points.shape[1]
    moduli = [m.moduli if isotropic else upper_triangle(m.elastic(dim)) for m in materials]
    across = [m.out_of_plane for m in materials if m.out_of_plane is not None]
    # Each material and its stabilisation vanish in the cells of other materials.
    own: list[Stabilisation] = [m.choose_stabilisation(dim) for m in materials]
    weights = [one.tau for one in own if isinstance(one, VertexWeights)]
    filled = [np.abs(m.moduli).max(axis=0) > 0.0 for m in materials]
    regions = InRegions(tuple(zip(filled, own, strict=True)))
    return Material(
        subject="materials",
        moduli=np.sum(moduli, axis=0),
        thermal_stress_moduli=np.sum([m.thermal_stress_moduli for m in materials], axis=0),
        plane=materials[0].plane,
        out_of_plane=np.sum(across, axis=0) if len(across) == len(materials) else None,
        stabilisation=VertexWeights(np.sum(weights, axis=0)) if len(weights) == len(own) else regions,
    )


def _check_cover(materials: Sequence[Material], mesh: Mesh) -> None:
    count = np.sum([np.ones(mesh.n_cells) if m.cells is None else m.cells for m in materials], axis=0)
    found = [
        f"{wrong.sum()} have {words} (first: cell {(first := int(np.argmax(wrong)))} around {mesh.centroids[first]})"
        for wrong, words in ((count == 0, "no material"), (count > 1, "more than one"))
        if wrong.any()
    ]
    if found:
        subjects = ", ".join(m.subject for m in materials)
        raise SceneError(
            f"materials: every cell needs exactly one; of {mesh.n_cells} cells {' and '.join(found)}. Found "
            f"{subjects}; give each material its cells by on=, the name of a cell datum that is nonzero on them."
        )


@dataclass(frozen=True)
class InitialStresses:
    """Stresses sigma_0 of the unstrained body: sigma = C eps(u) + sigma_0. The load is -sum_K |K| sigma_0 : eps(Pi v).

    sigma_0 is the sum of initial stresses minus the stresses that block the eigenstrains.
    """

    material: Material
    eigenstrains: tuple[Eigenstrain, ...]
    stresses: tuple[InitialStress, ...]
    matrix: sp.csr_matrix  # (n_u, components n_cells) virtual work of stresses constant on cells

    def stress(self, t: float) -> Floats:
        """Return sigma_0 (n_cells, components) at the instant `t`."""
        total = np.zeros_like(self.material.thermal_stress_moduli)
        for stress in self.stresses:
            value = stress.value(t)
            total[:, : value.shape[1]] += value
        for eigenstrain in self.eigenstrains:
            total -= self.material.thermal_stress_moduli * eigenstrain.value(t)[:, None]
        return total

    def out_of_plane(self, t: float) -> Floats | None:
        """Return the stress zz (n_cells,) of eigenstrains in plane strain; None if the material gives no zz."""
        if self.material.out_of_plane is None:
            return None
        total = np.zeros(len(self.material.thermal_stress_moduli))
        for eigenstrain in self.eigenstrains:
            total -= self.material.out_of_plane[:, 3] * eigenstrain.value(t)
        return total

    def vector(self, t: float) -> Floats:
        """Return the nodal force (n_u,) at the instant `t`; zero at nodes where stresses balance up to rounding."""
        sigma = self.stress(t).ravel()
        force = -(self.matrix @ sigma)
        # Rounding of a uniform stress would leave small forces that violate the condition on initial states.
        force[np.abs(force) <= 16 * np.finfo(float).eps * (abs(self.matrix) @ np.abs(sigma))] = 0.0
        return force


def initial_stresses(parts: Sequence[Contribution], material: Material, space: Space) -> InitialStresses | None:
    """Return the initial stresses of all contributions; None if there are none."""
    strains, stresses = (
        tuple(x for part in parts for x in getattr(part, name)) for name in ("eigenstrains", "initial_stresses")
    )
    return InitialStresses(material, strains, stresses, stress_load(space)) if strains or stresses else None


def contributions(effects: Iterable[Effect], space: Space) -> list[tuple[Effect, Contribution]]:
    """Return each effect with its contribution.

    A plane of symmetry is a side of the body on which supports keep the nodes in the plane at all times. A contact
    curve that ends at such a plane continues behind the plane as a mirror image. So effects of contact are evaluated
    again with these planes: nodes on the planes get the normals of the whole body.
    """
    parts = [(effect, effect.contribute(space)) for effect in effects]
    mirrors = _mirrors([part for _, part in parts], space)
    if mirrors is None:
        return parts
    mirrored = replace(space, mirrors=mirrors)
    return [(effect, effect.contribute(mirrored) if len(_contact(part)) else part) for effect, part in parts]


def _contact(part: Contribution) -> Ints:
    """Return the nodes where an effect contributes contact, then the partners of these nodes (-1 for none)."""
    bilateral = [support for support in part.supports if support.contact]
    return np.concatenate(pairs_of([*part.frictions, *part.obstacles, *part.surfaces, *bilateral]))


def _mirrors(parts: list[Contribution], space: Space) -> MirrorPlanes | None:
    """Return the planes of symmetry at contact nodes; None if supports hold every contact node fully or not at all."""
    still = [s for part in parts for s in part.supports if s.value is None and s.patterns is None and not s.contact]
    touching = np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *map(_contact, parts)]))
    if not still or not len(touching):
        return None
    held = _spans(np.concatenate([s.nodes for s in still]), np.concatenate([s.directions for s in still]))
    fully_held = np.trace(held.projections, axis1=1, axis2=2) > space.dim - 0.5
    if not np.isin(held.nodes[~fully_held], touching).any():
        return None
    # A fully held node counts as a node on planes of all directions.
    nodes = [np.repeat(held.nodes[fully_held], space.dim)]
    normals = [np.tile(np.eye(space.dim), (int(fully_held.sum()), 1))]
    for of_side, normal in _sides_held_across(space, held):
        nodes.append(of_side.ravel())
        normals.append(np.repeat(normal, of_side.shape[1], axis=0))
    of_nodes, across = np.concatenate(nodes), np.concatenate(normals)
    here = np.isin(of_nodes, touching)
    return _spans(of_nodes[here], across[here])


def _sides_held_across(space: Space, held: MirrorPlanes) -> Iterator[tuple[Ints, Floats]]:
    """Yield nodes (m, n) and normals (m, dim) of the sides whose n nodes are all held along the normal of the side."""
    part, place = space.part("boundary", "symmetry", contact=True), np.full(space.mesh.n_nodes, -1)
    place[held.nodes] = np.arange(len(held.nodes))
    for rule in part.rules(1):
        sides = np.flatnonzero((place[rule.nodes] >= 0).all(axis=1))
        nodes, normals = rule.nodes[sides], part.normals[rule.sides[sides]]
        along = np.einsum("snij,sj->sni", held.projections[place[nodes]], normals)
        across = (np.linalg.norm(along - normals[:, None, :], axis=2) <= DIRECTION_TOLERANCE).all(axis=1)
        yield nodes[across], normals[across]


def _spans(nodes: Ints, directions: Floats) -> MirrorPlanes:
    """Return the orthogonal projection onto the span of the directions of each node."""
    each, place = np.unique(nodes, return_inverse=True)
    squares = np.zeros((len(each), directions.shape[1], directions.shape[1]))
    np.add.at(squares, place, np.einsum("ki,kj->kij", directions, directions))
    # Two directions at an angle a give the eigenvalues 1 -+ cos a; the smaller one is about a^2 / 2.
    sizes, axes = np.linalg.eigh(squares)
    axes = axes * (sizes > 0.5 * DIRECTION_TOLERANCE**2)[:, None, :]
    return MirrorPlanes(read_only(each), read_only(axes @ axes.swapaxes(1, 2)))


Varying = TypeVar("Varying", Load, Friction, Eigenstrain, InitialStress)
Datum = Callable[[float], Floats]


def active_parts(
    effects: Iterable[Effect], space: Space, times: Sequence[float]
) -> tuple[list[Contribution], list[str]]:
    """Drop loads, friction bounds, springs and dashpots that are zero at all of `times`.

    Return the contributions, and a sentence for each dropped load, bound, spring or dashpot.
    """
    notes: list[str] = []
    return [_without_inactive(effect, part, times, notes) for effect, part in contributions(effects, space)], notes


def _without_inactive(effect: Effect, part: Contribution, times: Sequence[float], notes: list[str]) -> Contribution:
    """Return a contribution without parts that vanish at all `times`; append a sentence per dropped part to `notes`."""

    def alive(data: tuple[Varying, ...], value: Callable[[Varying], Datum], what: str) -> tuple[Varying, ...]:
        zero = [len(times) > 0 and _zero(value(datum), times) for datum in data]
        notes.extend(f"{data[i].subject}: its {what} is zero at all instants" for i in np.flatnonzero(zero))
        return tuple(datum for datum, gone in zip(data, zero, strict=True) if not gone)

    def shorten(datum: Any) -> Any:
        return replace(datum, value=drop_tails(datum.value, times))

    matrices = () if part.material is not None else ("stiffness", "viscosity")
    weak = [name for name in matrices if (A := getattr(part, name)) is not None and not A.data.any()]
    none: dict[str, Any] = dict.fromkeys(weak)
    notes.extend(f"{type(effect).__name__}: its {name} is zero" for name in weak)
    return replace(
        part,
        **none,
        loads=tuple(replace(x, times=tuple(times)) for x in alive(part.loads, lambda load: load.vector, "force")),
        supports=tuple(x if x.value is None else shorten(x) for x in part.supports),
        frictions=alive(part.frictions, _bound, "bound"),
        eigenstrains=tuple(map(shorten, alive(part.eigenstrains, lambda x: x.value, "strain"))),
        initial_stresses=tuple(map(shorten, alive(part.initial_stresses, lambda x: x.value, "stress"))),
    )


def _bound(friction: Friction) -> Datum:
    """Return a function of time whose values, one per row, are zero if the row has no friction at any pressure."""
    law, ellipse, m = friction.law, friction.ellipse, len(friction.nodes)
    if ellipse is not None:
        return lambda t: np.maximum(*ellipse.bounds(t))
    if law is None:
        return friction.weights
    if law.slips:
        return lambda t: np.ones(1)  # Weights that depend on slip are not known beforehand.
    # At a contact force of 1e100, a law that depends on pressure gives positive weights in any units.
    return lambda t: friction.weights_under(t, np.full(m, 1e100), np.zeros(m), np.zeros(m))


def _zero(value: Datum, times: Sequence[float]) -> bool:
    try:
        return not any(np.any(value(float(t))) for t in times)
    except VemcvxError:
        return False  # The step that needs the datum raises the error.


class Scene:
    """A set of effects, for every mesh that has the named boundaries; the order of effects changes nothing.

    Parameters
    ----------
    *effects : Effect
        A simulation needs a material. Several materials name their cells by `on`; every cell has exactly one material.

    Raises
    ------
    SceneError
        An argument is not an effect.

    Examples
    --------
    >>> import vemcvx as vx
    >>> scene = vx.Scene(vx.Elasticity(young=200.0, poisson=0.3), vx.Clamp(on="right"))
    """

    def __init__(self, *effects: Effect):
        for effect in effects:
            if not isinstance(effect, Effect):
                raise SceneError(
                    f"Scene: found {brief(effect)}, which is not an effect; give effects as separate arguments, "
                    'such as Scene(Elasticity(young=200.0, poisson=0.3), Clamp(on="right")).'
                )
        self._effects = effects

    @property
    def effects(self) -> tuple[Effect, ...]:
        """The effects, in the order given."""
        return self._effects

    @property
    def canonical(self) -> tuple[Effect, ...]:
        """The effects in the order of summation, which does not depend on the order given."""
        return tuple(sorted(self.effects, key=_rank))

    @property
    def is_axisymmetric(self) -> bool:
        """True if the body is a body of revolution: a material has plane="axisymmetric"."""
        planes = [getattr(x, "plane", None) for x in self.effects if isinstance(x, MaterialLaw)]
        return any(isinstance(plane, str) and plane == REVOLVED for plane in planes)

    def with_(self, *effects: Effect) -> Scene:
        """Return a scene with these additional effects."""
        return Scene(*self.effects, *effects)

    def without(self, *kinds: type[Effect] | Effect) -> Scene:
        """Return a scene without some of the effects.

        Parameters
        ----------
        *kinds : subclass of Effect, or Effect
            Classes, whose effects are all removed, or single effects of the scene.

        Raises
        ------
        SceneError
            The scene has no such effect.
        """
        for kind in kinds:
            if not any(_is(effect, kind) for effect in self.effects):
                there = ", ".join(dict.fromkeys(type(effect).__name__ for effect in self.effects))
                name = kind.__name__ if isinstance(kind, type) else brief(kind)
                raise SceneError(
                    f"Scene.without: there is no {name} in this scene; it has {there}. Give the class of an effect, or "
                    "an effect of the scene."
                )
        return Scene(*(x for x in self.effects if not any(_is(x, kind) for kind in kinds)))

    def __iter__(self) -> Iterator[Effect]:
        return iter(self.effects)

    def __repr__(self) -> str:
        return "Scene(\n" + "".join(f"    {effect!r},\n" for effect in self.effects) + ")"

    def _repr_html_(self) -> str:
        outline = [effect.describe().partition(": ") for effect in self.effects]
        return Outline("Scene", [(name, words) for name, _, words in outline]).html()


def _is(effect: Effect, kind: type[Effect] | Effect) -> bool:
    return isinstance(effect, kind) if isinstance(kind, type) else effect is kind


def _rank(effect: Effect) -> tuple[str, list[bytes], list[int]]:
    settings = list(vars(effect).values())
    # Functions are ordered by their place in the source; addresses break ties only.
    return type(effect).__name__, [_content(v) for v in settings], [id(v) for v in settings if callable(v)]


def _content(setting: object) -> bytes:
    if isinstance(setting, np.ndarray):
        return setting.tobytes()  # repr() abbreviates arrays and rounds them to eight digits.
    if isinstance(setting, (tuple, list)) and any(map(callable, setting)):
        return b", ".join(map(_content, setting))
    if callable(setting):
        line = getattr(getattr(setting, "__code__", None), "co_firstlineno", 0)
        return f"{getattr(setting, '__module__', '')}.{getattr(setting, '__qualname__', '')}:{line:09}".encode()
    return repr(setting).encode()
