"""The conformance suite of effects."""

from __future__ import annotations

import dataclasses
import inspect
import pickle
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

from vemcvx.base.arrays import Floats
from vemcvx.base.errors import SceneError
from vemcvx.effects import (
    BodyForce,
    ContactSurface,
    Contribution,
    Effect,
    Eigenstrain,
    Friction,
    InitialStress,
    MaterialLaw,
    Prestress,
    ThermalStrain,
)
from vemcvx.history import History
from vemcvx.meshes import FAMILIES, SPACE_FAMILIES, Mesh
from vemcvx.scene import Scene
from vemcvx.simulation import simulate
from vemcvx.vem import Space

IN_CELLS = MaterialLaw, BodyForce, Prestress, ThermalStrain
"""Effects whose `on` selects cells by cell data."""

TIMES = np.array([0.0, 0.4, 1.0])


@dataclass(frozen=True)
class EffectSample:
    """An effect, and a scene that the effect changes, in the unit square or the unit cube.

    Parameters
    ----------
    effect : Effect
    beside : tuple of Effect
        The other effects of the scene.
    instead : tuple of Effect
        The effects that replace `effect` in the scene for comparison.
    data : mapping of names to numbers
        The number of components of every field with data f(x, t) or f(x).
    others : mapping of names to values
        For every field, another value that changes the answer, or a Scene of effects that replace the effect. With
        None, the field is not tested.
    in_space : bool
        True for the unit cube.

    Examples
    --------
    >>> from vemcvx.testing import EffectSample
    >>> EffectSample(vx.Clamp("left"), beside=(vx.Elasticity(200.0, 0.3),)).name
    'Clamp'
    """

    effect: Effect
    beside: tuple[Effect, ...]
    instead: tuple[Effect, ...] = ()
    data: Mapping[str, int] = field(default_factory=dict)
    others: Mapping[str, object] = field(default_factory=dict)
    in_space: bool = False

    def replace(self, **fields: object) -> Effect:
        """Return the effect with other values of fields."""
        effect: Any = self.effect
        return dataclasses.replace(effect, **fields)

    @property
    def name(self) -> str:
        """The name of the class of the effect."""
        return type(self.effect).__name__

    @property
    def fields(self) -> list[str]:
        """The names of the fields of the effect, without `plane` for bodies in space."""
        effect: Any = self.effect
        names = [one.name for one in dataclasses.fields(effect)]
        return [name for name in names if not (self.in_space and name == "plane")]

    @property
    def on(self) -> list[str] | None:
        """The boundaries on which the effect acts, or None."""
        effect: Any = self.effect
        return list(np.atleast_1d(effect.on)) if hasattr(effect, "on") and not isinstance(effect, IN_CELLS) else None

    def mesh(self, which: int = 0) -> Mesh:
        """Return mesh 0, 1 or 2; answers use mesh 0."""
        plane, space = (("squares", 3), ("voronoi", 4), ("hanging", 3)), (("cubes", 2), ("voronoi3", 3), ("prisms", 2))
        return mesh(*(space if self.in_space else plane)[which])

    def answer(self, *effects: Effect) -> History:
        """Return the history of a scene of these effects on mesh 0."""
        return simulate(Scene(*effects), self.mesh(), TIMES)

    def contribution(self, effect: Effect, which: int = 0) -> Any:
        """Return the contribution of an effect on mesh number `which`, as plain data."""
        return content(effect.contribute(Space(self.mesh(which))))


@cache
def mesh(family: str = "squares", n: int = 3) -> Mesh:
    """Return a mesh of the unit square or the unit cube, with the cell data "west" and "east"."""
    made: Mesh = (FAMILIES | SPACE_FAMILIES)[family](n)
    west = made.centroids[:, 0] < 0.5
    return made.with_cell_data("west", west).with_cell_data("east", ~west)


def content(thing: Any, rows: int = 1) -> Any:
    """Return a contribution as plain data that can be compared."""
    if dataclasses.is_dataclass(thing):
        rows = len(getattr(thing, "nodes", range(rows)))
        names = [f.name for f in dataclasses.fields(thing) if f.name not in ("value", "at")]
        values = {name: content(getattr(thing, name), rows) for name in names}
        value = getattr(thing, "vector", getattr(thing, "value", None))
        at_times = tuple(content(value(t)) for t in TIMES) if callable(value) else None
        return values | {"at times": at_times}
    if isinstance(thing, (sp.csr_matrix, sp.csr_array)):
        return content((thing.shape, thing.indptr, thing.indices, thing.data))
    if isinstance(thing, np.ndarray):
        return thing.shape, thing.dtype.str, thing.tobytes()
    if isinstance(thing, tuple):
        return tuple(content(part, rows) for part in thing)
    if callable(thing):
        # Friction functions also take forces and slips (rows,).
        more = [np.full(rows, 0.5)] * (len(inspect.signature(thing).parameters) - 1)
        return tuple(content(thing(t, *more)) for t in TIMES)
    return thing


def nameless(thing: Any) -> Any:
    if isinstance(thing, dict):
        return {name: nameless(value) for name, value in thing.items() if name != "subject"}
    return tuple(map(nameless, thing)) if isinstance(thing, tuple) else thing


def contributes_the_same_arrays_after_other_runs(sample: EffectSample) -> None:
    first = sample.contribution(sample.effect)
    sample.answer(sample.effect, *sample.beside)
    assert sample.contribution(sample.effect, 1) != first
    assert sample.contribution(sample.effect) == sample.contribution(sample.replace()) == first


def contributes_finite_arrays_that_fit_the_space(sample: EffectSample) -> None:
    space = Space(sample.mesh(2))
    part = sample.effect.contribute(space)
    assert isinstance(part, Contribution)
    assert any(len(value) if isinstance(value, tuple) else value is not None for value in vars(part).values())
    n, nodes = space.n_unknowns, space.mesh.n_nodes
    own = part.stiffness
    if own is None and part.material is not None:
        own = part.material.stiffness(space)
    if own is not None:
        assert own.shape == (n, n)
        assert np.isfinite(own.data).all()
    for load in part.loads:
        assert load.matrix.shape in ((n, load.points.size), (n, len(load.points)))
        assert np.isfinite(load.vector(1.0)).all()
    for support in part.supports:
        m = len(support.nodes)
        assert support.directions.shape == support.points.shape == (m, space.dim)
        assert _units(support.directions)
        assert support.value is None or support.value(1.0).shape == (m,)
    every: tuple[Friction | ContactSurface, ...] = (*part.frictions, *part.surfaces)
    for rows in every:
        assert ((rows.nodes >= 0) & (rows.nodes < nodes)).all()
        assert (rows.lengths > 0).all()
        assert _units(rows.normals)
    stresses: tuple[Eigenstrain | InitialStress, ...] = (*part.eigenstrains, *part.initial_stresses)
    for stress in stresses:
        assert len(stress.value(1.0)) == space.mesh.n_cells
        assert np.isfinite(stress.value(1.0)).all()
    for friction in part.frictions:
        assert (friction.weights(1.0) >= 0).all()
        assert friction.directions is None or _units(friction.directions)
        if friction.law is not None:
            slip = np.linspace(0.0, 1.0, len(friction.nodes))
            friction.weights_under(1.0, slip, slip, slip)


def has_the_slope_of_its_law(sample: EffectSample) -> None:
    """Compare the slope of a law with difference quotients."""
    for friction in sample.effect.contribute(Space(sample.mesh(2))).frictions:
        m = len(friction.nodes)
        past, none = np.linspace(0.0, 1.0, m), np.zeros(m)
        for size in (1e-3, 1.0, 1e3) if friction.law is not None and friction.law.slope is not None else ():
            p, step = size * np.linspace(1.0, 2.0, m), 1e-6 * size
            w, ahead = (friction.weights_under(1.0, forces, past, none) for forces in (p, p + step))
            off = (ahead - w) / step - friction.slope_under(1.0, p, past)
            assert (np.abs(off) <= 1e-4 * (w / size + np.abs(ahead - w) / step)).all()


def _units(vectors: Floats) -> bool:
    return bool(np.abs(np.linalg.norm(vectors, axis=1) - 1).max() < 4 * np.finfo(float).eps)


def refuses_an_unknown_name_and_lists_existing_ones(sample: EffectSample) -> None:
    if isinstance(sample.effect, IN_CELLS):
        words = r"found on='wst'; cell data of this mesh: 'west', 'east'\. on= names .* nonzero"
        there, wrong, way = "west", "wst", r"\. Add a cell datum with mesh\.with_cell_data\(name, values\)"
    else:
        words = "there is no boundary named 'bottm'; this mesh has " + ", ".join(map(repr, sample.mesh().boundaries))
        there, wrong, way = "left", "bottm", r"; add one with mesh\.with_boundary\(name, predicate\)"
    for on in (wrong, [there, wrong]) if isinstance(sample.effect, IN_CELLS) or sample.on is not None else ():
        with pytest.raises(SceneError, match=rf"^{sample.name}: {words}{way}\.$"):
            sample.answer(sample.replace(on=on), *sample.beside)


def takes_a_name_or_a_list_of_names(sample: EffectSample) -> None:
    def on(names: object) -> Any:
        return nameless(sample.contribution(sample.replace(on=names)))

    if isinstance(sample.effect, IN_CELLS):
        assert on("west") == on(["west"]) == on(("west", "west"))
        assert on("west") != on("east")
    if sample.on is not None:
        assert on("left") == on(["left"]) == on(("left", "left"))
        assert on("boundary") == on(["left", "boundary", "right"])
        assert on("left") != on(["left", "top"])


def refuses_nan_and_infinity(sample: EffectSample) -> None:
    for name, components in sample.data.items():
        for wrong in (np.nan, np.inf):
            shape = () if components == 1 else (components,)

            def late(x: Floats, t: float = 1.0, wrong: float = wrong, shape: tuple[int, ...] = shape) -> Floats:
                values = np.ones((len(x), *shape))
                values[-1] = wrong if t > 0.5 else 1.0
                return values

            for value in (wrong if components == 1 else (*np.ones(components - 1), wrong), late):
                with pytest.raises(SceneError, match=rf"^{sample.name}.*found NaN or infinity .*must be finite"):
                    sample.answer(sample.replace(**{name: value}), *sample.beside)
    for name in sample.fields:
        if isinstance(getattr(sample.effect, name), float):
            with pytest.raises(SceneError, match=f"^{sample.name}"):
                sample.answer(sample.replace(**{name: np.nan}), *sample.beside)


def describes_itself_in_one_line(sample: EffectSample) -> None:
    words = sample.effect.describe()
    assert words.startswith(sample.name + ":")
    assert words.strip() == words
    assert "\n" not in words
    assert "0x" not in words
    for name in sample.on or ():
        assert name in words
    if isinstance(sample.effect, IN_CELLS):
        assert "west" in sample.replace(on="west").describe()
    for name, components in sample.data.items():
        many = sample.replace(**{name: np.ones((500, components))}).describe()
        assert "\n" not in many
        assert len(many) < 200


def survives_a_copy_to_another_process(sample: EffectSample) -> None:
    assert pickle.loads(pickle.dumps(sample.effect)) == sample.effect


def does_not_depend_on_its_place_in_the_scene(sample: EffectSample) -> None:
    effects = (sample.effect, *sample.beside)
    reference, rng = sample.answer(*effects), np.random.default_rng(0)
    for order in (range(len(effects))[::-1], *(rng.permutation(len(effects)) for _ in range(2))):
        other = sample.answer(*(effects[i] for i in order))
        for name in ("displacement", "forces", "energy", "work", "dissipated", "certificate", "iterations"):
            assert np.array_equal(getattr(other, name), getattr(reference, name)), name
        for name in ("slip", "traction", "pressure", "sticking"):
            assert np.array_equal(getattr(other.contact, name), getattr(reference.contact, name)), name


def changes_the_answer_of_a_scene(sample: EffectSample) -> None:
    present, absent = sample.answer(sample.effect, *sample.beside), sample.answer(*sample.instead, *sample.beside)
    scale = np.abs(present.displacement).max() + np.abs(absent.displacement).max()
    assert np.abs(present.displacement - absent.displacement).max() > 1e-6 * scale


def changes_the_answer_by_each_of_its_settings(sample: EffectSample) -> None:
    assert set(sample.others) == set(sample.fields)
    reference = sample.answer(sample.effect, *sample.beside).displacement
    for name, other in sample.others.items():
        if other is None:
            continue
        changed = other if isinstance(other, Scene) else [sample.replace(**{name: other})]
        found = sample.answer(*changed, *sample.beside).displacement
        assert np.abs(found - reference).max() > 1e-6 * np.abs(reference).max(), name


PROPERTIES: tuple[Callable[[EffectSample], None], ...] = (
    contributes_the_same_arrays_after_other_runs,
    contributes_finite_arrays_that_fit_the_space,
    has_the_slope_of_its_law,
    refuses_an_unknown_name_and_lists_existing_ones,
    takes_a_name_or_a_list_of_names,
    refuses_nan_and_infinity,
    describes_itself_in_one_line,
    survives_a_copy_to_another_process,
    does_not_depend_on_its_place_in_the_scene,
    changes_the_answer_of_a_scene,
    changes_the_answer_by_each_of_its_settings,
)
