"""A scene: the effects to simulate, independent of any mesh."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from vemcvx.base.arrays import Floats, Ints, brief, drop_tails, read_only
from vemcvx.base.errors import SceneError, VemcvxError
from vemcvx.effects import Contribution, Effect, Eigenstrain, Friction, InitialStress, Material, MaterialLaw, Symmetry
from vemcvx.effects.materials import REVOLVED
from vemcvx.meshes import Mesh
from vemcvx.vem import Space, stress_load
from vemcvx.vem.boundary import DIRECTION_TOLERANCE, MirrorPlanes
from vemcvx.vem.stabilisation import VertexWeights
from vemcvx.vem.tensors import upper_triangle


def compose(materials: Sequence[Material], mesh: Mesh) -> Material:
    """Return one material for the whole body."""
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
    # The moduli and weights of a material are zero in the cells of other materials.
    own = [m.choose_stabilisation(dim) for m in materials]
    weights = [one.tau for one in own if isinstance(one, VertexWeights)]
    if len(weights) < len(own):
        raise SceneError(
            "materials: a stabilisation of your own needs one material for the whole body. Give this material moduli "
            "that are arrays with one value per cell, and leave out on=."
        )
    return Material(
        subject="materials",
        moduli=np.sum(moduli, axis=0),
        thermal_stress_moduli=np.sum([m.thermal_stress_moduli for m in materials], axis=0),
        plane=materials[0].plane,
        out_of_plane=np.sum(across, axis=0) if len(across) == len(materials) else None,
        stabilisation=VertexWeights(np.sum(weights, axis=0)),
    )


def _check_cover(materials: Sequence[Material], mesh: Mesh) -> None:
    count = np.sum([np.ones(mesh.n_cells) if m.cells is None else m.cells for m in materials], axis=0)
    found = [
        f"{wrong.sum()} have {words} (first: cell {(first := int(np.argmax(wrong)))} at {mesh.centroids[first]})"
        for wrong, words in ((count == 0, "no material"), (count > 1, "several materials"))
        if wrong.any()
    ]
    if found:
        subjects = ", ".join(m.subject for m in materials)
        raise SceneError(
            f"materials: every cell needs exactly one material. Of {mesh.n_cells} cells, {' and '.join(found)}. Found "
            f"{subjects}. Give each material on=, the name of a cell datum that is nonzero only in its cells."
        )


@dataclass(frozen=True)
class InitialStresses:
    """The stresses sigma_0 in sigma = C eps(u) + sigma_0, and the load due to sigma_0."""

    material: Material
    eigenstrains: tuple[Eigenstrain, ...]
    stresses: tuple[InitialStress, ...]
    matrix: sp.csr_matrix  # (n_u, components * n_cells) the map from cell stresses to internal nodal forces

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
        """Return the stress zz (n_cells,) due to eigenstrains, or None."""
        if self.material.out_of_plane is None:
            return None
        total = np.zeros(len(self.material.thermal_stress_moduli))
        for eigenstrain in self.eigenstrains:
            total -= self.material.out_of_plane[:, 3] * eigenstrain.value(t)
        return total

    def vector(self, t: float) -> Floats:
        """Return the nodal forces (n_u,) at the instant `t`."""
        sigma = self.stress(t).ravel()
        force = -(self.matrix @ sigma)
        # Balanced stresses give exactly zero forces.
        force[np.abs(force) <= 16 * np.finfo(float).eps * (abs(self.matrix) @ np.abs(sigma))] = 0.0
        return force


def initial_stresses(parts: Sequence[Contribution], material: Material, space: Space) -> InitialStresses | None:
    """Return the initial stresses of all contributions, or None."""
    strains, stresses = (
        tuple(x for part in parts for x in getattr(part, name)) for name in ("eigenstrains", "initial_stresses")
    )
    return InitialStresses(material, strains, stresses, stress_load(space)) if strains or stresses else None


def contributions(effects: Iterable[Effect], space: Space) -> list[tuple[Effect, Contribution]]:
    """Return each effect with its contribution."""
    parts = [(effect, effect.contribute(space)) for effect in effects]
    planes = [
        support for effect, part in parts if isinstance(effect, (Symmetry, MaterialLaw)) for support in part.supports
    ]
    if not planes:
        return parts
    mirrors = _spans(np.concatenate([s.nodes for s in planes]), np.concatenate([s.directions for s in planes]))
    mirrored = replace(space, mirrors=mirrors)
    return [(effect, effect.contribute(mirrored) if _acts_in_contact(part) else part) for effect, part in parts]


def _acts_in_contact(part: Contribution) -> bool:
    bilateral = any(support.contact for support in part.supports)
    return bilateral or any((part.frictions, part.obstacles, part.surfaces))


def _spans(nodes: Ints, directions: Floats) -> MirrorPlanes:
    """Return the projection onto the span of directions at each node."""
    each, place = np.unique(nodes, return_inverse=True)
    squares = np.zeros((len(each), directions.shape[1], directions.shape[1]))
    np.add.at(squares, place, np.einsum("ki,kj->kij", directions, directions))
    # Two directions at a small angle phi give the eigenvalue 1 - cos(phi), about phi^2 / 2.
    sizes, axes = np.linalg.eigh(squares)
    axes = axes * (sizes > 0.5 * DIRECTION_TOLERANCE**2)[:, None, :]
    return MirrorPlanes(read_only(each), read_only(axes @ axes.swapaxes(1, 2)))


Datum = Callable[[float], Floats]


def active_parts(
    effects: Iterable[Effect], space: Space, times: Sequence[float]
) -> tuple[list[Contribution], list[str]]:
    """Return the contributions, and notes on omitted frictions."""
    found, notes = list[Contribution](), list[str]()

    def shorten(datum: Any) -> Any:
        return replace(datum, value=drop_tails(datum.value, times))

    for _, part in contributions(effects, space):
        idle = [len(times) > 0 and _zero(_bound(friction), times) for friction in part.frictions]
        notes += [f"{part.frictions[i].subject}: its bound is zero at all instants" for i in np.flatnonzero(idle)]
        shortened = replace(
            part,
            loads=tuple(replace(load, times=tuple(times)) for load in part.loads),
            supports=tuple(x if x.value is None else shorten(x) for x in part.supports),
            frictions=tuple(friction for friction, gone in zip(part.frictions, idle, strict=True) if not gone),
            eigenstrains=tuple(map(shorten, part.eigenstrains)),
            initial_stresses=tuple(map(shorten, part.initial_stresses)),
        )
        found.append(shortened)
    return found, notes


def _bound(friction: Friction) -> Datum:
    """Return a function of time that is zero if friction cannot act."""
    law, m = friction.law, len(friction.nodes)
    if law is None:
        return friction.weights
    if law.slips:
        return lambda t: np.ones(1)  # Weights that depend on slip are not known beforehand.
    # The normal force 1e100 is large in any units.
    return lambda t: friction.weights_under(t, np.full(m, 1e100), np.zeros(m), np.zeros(m))


def _zero(value: Datum, times: Sequence[float]) -> bool:
    try:
        return not any(np.any(value(float(t))) for t in times)
    except VemcvxError:
        return False  # The step that needs the datum raises the error.


class Scene:
    """A set of effects, independent of any mesh.

    Parameters
    ----------
    *effects : Effect
        A simulation needs exactly one material for every cell. Several materials select cells by `on`.

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
        """The effects, sorted by class and settings."""
        return tuple(sorted(self.effects, key=_rank))

    @property
    def is_axisymmetric(self) -> bool:
        """True for a body of revolution."""
        planes = [getattr(x, "plane", None) for x in self.effects if isinstance(x, MaterialLaw)]
        return any(isinstance(plane, str) and plane == REVOLVED for plane in planes)

    def with_(self, *effects: Effect) -> Scene:
        """Return a scene with these additional effects."""
        return Scene(*self.effects, *effects)

    def without(self, *kinds: type[Effect] | Effect) -> Scene:
        """Return a scene without these effects, or without all effects of these classes."""
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


def _is(effect: Effect, kind: type[Effect] | Effect) -> bool:
    return isinstance(effect, kind) if isinstance(kind, type) else effect is kind


def _rank(effect: Effect) -> tuple[str, list[bytes], list[int]]:
    settings = list(vars(effect).values())
    # Functions are sorted by place in the source, then by address in memory.
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
