"""What every effect must satisfy: sentences, each "every effect ..." of a sample."""

from __future__ import annotations

import dataclasses
import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from vemcvx.arrays import Floats
from vemcvx.effects import ContactSurface, Contribution, Eigenstrain, Friction, InitialStress, MaterialLaw
from vemcvx.errors import SceneError
from vemcvx.testing.effect_samples import EffectSample, Other, answer, content, mesh, nameless
from vemcvx.vem import Space

UNIT = 4 * float(np.finfo(float).eps)
"""By how much the length of a unit vector may miss one."""


def is_frozen(sample: EffectSample) -> None:
    """Its fields cannot be set."""
    for name in sample.fields:
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(sample.effect, name, None)


def contributes_the_same_arrays_when_asked_twice(sample: EffectSample) -> None:
    """Also after a run, and for another space of the same mesh."""
    space = Space(mesh())
    first = content(sample.effect.contribute(space))
    answer(sample.effect, *sample.beside)
    assert content(sample.effect.contribute(space)) == first
    assert content(sample.changed().contribute(Space(mesh()))) == first


def remembers_no_mesh(sample: EffectSample) -> None:
    """What it contributes on one mesh does not depend on those before."""
    fine, coarse = Space(mesh("voronoi", 4)), Space(mesh())
    alone = content(sample.changed().contribute(coarse))
    assert content(sample.effect.contribute(fine)) != alone
    assert content(sample.effect.contribute(coarse)) == alone


def contributes_finite_arrays_that_fit_the_space(sample: EffectSample) -> None:
    """Shapes, node numbers, unit vectors, weights >= 0."""
    space = Space(mesh("hanging", 3))
    part = sample.effect.contribute(space)
    assert isinstance(part, Contribution)
    matrices = part.stiffness, part.viscosity
    assert any(value for value in vars(part).values() if isinstance(value, tuple)) or any(
        matrix is not None for matrix in matrices
    )
    n, nodes = space.n_unknowns, space.mesh.n_nodes
    if part.stiffness is not None:
        assert part.stiffness.shape == (n, n)
        assert np.isfinite(part.stiffness.data).all()
    for load in part.loads:
        assert load.matrix.shape in ((n, load.points.size), (n, len(load.points)))
        assert np.isfinite(load.vector(1.0)).all()
    for support in part.supports:
        m = len(support.nodes)
        assert support.directions.shape == support.points.shape == (m, 2)
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
        if friction.slip_law is not None:
            slip = np.linspace(0.0, 1.0, len(friction.nodes))
            friction.slip_law.added(friction.subject, friction.nodes, 1.0, slip, (slip, slip))


def _units(vectors: Floats) -> bool:
    return bool(np.abs(np.linalg.norm(vectors, axis=1) - 1).max() < UNIT)


def names_an_unknown_boundary_and_what_exists(sample: EffectSample) -> None:
    """In one sentence, which begins with the name of its class."""
    for on in () if sample.on is None else ("bottm", ["left", "bottm"]):
        with pytest.raises(
            SceneError,
            match=rf"^{sample.name}: there is no boundary named 'bottm'; this mesh has 'left', 'right', 'bottom', "
            r"'top', 'boundary'; add one with mesh\.with_boundary\(name, predicate\)\.$",
        ):
            answer(sample.changed(on=on), *sample.beside)


def names_an_unknown_cell_datum_and_what_exists(sample: EffectSample) -> None:
    """Likewise, of materials of a region."""
    for on in ("wst", ["west", "wst"]) if isinstance(sample.effect, MaterialLaw) else ():
        with pytest.raises(
            SceneError,
            match=rf"^{sample.name}: on= names cells by a cell datum that is nonzero there; found 'wst', but this mesh "
            r"has 'west', 'east'\. Add one with mesh\.with_cell_data\(name, values\)\.$",
        ):
            answer(sample.changed(on=on), *sample.beside)


def takes_a_name_or_a_list_of_names(sample: EffectSample) -> None:
    """On one boundary, or on several at once."""
    space = Space(mesh())

    def on(names: object) -> Any:
        return nameless(content(sample.changed(on=names).contribute(space)))

    if isinstance(sample.effect, MaterialLaw):
        assert on("west") == on(["west"]) == on(("west", "west"))
        assert on("west") != on("east")
    if sample.on is not None:
        assert on("left") == on(["left"]) == on(("left", "left"))
        assert on("boundary") == on(["left", "boundary", "right"])
        assert on("left") != on(["left", "top"])


def refuses_data_that_are_not_finite(sample: EffectSample) -> None:
    """Constants when the scene is posed, functions when they are evaluated."""
    for name, components in sample.data.items():
        for wrong in (np.nan, np.inf):
            constant = wrong if components == 1 else (*np.zeros(components - 1), wrong)
            shape = () if components == 1 else (components,)

            def late(x: Floats, t: float = 1.0, wrong: float = wrong, shape: tuple[int, ...] = shape) -> Floats:
                values = np.zeros((len(x), *shape))
                values[-1] = wrong if t > 0.5 else 0.0
                return values

            for value in (constant, late):
                spoilt = sample.with_datum(name, value)
                with pytest.raises(SceneError, match=rf"^{sample.name}.*found NaN or infinity .*must be finite"):
                    answer(spoilt, *sample.beside)


def refuses_numbers_that_are_not_finite(sample: EffectSample) -> None:
    """Each of its settings that is a float."""
    effect: Any = sample.effect
    for name in sample.fields:
        if isinstance(getattr(effect, name), float):
            with pytest.raises(SceneError, match=f"^{sample.name}"):
                answer(sample.changed(**{name: np.nan}), *sample.beside)


def leaves_the_arrays_of_the_user_alone(sample: EffectSample) -> None:
    """What functions of the user return is not written to."""
    for name, components in sample.data.items():
        handed: dict[int, Floats] = {}

        def given(x: Floats, *t: float, handed: dict[int, Floats] = handed, components: int = components) -> Floats:
            shape = (len(x), components) if components > 1 else len(x)
            return handed.setdefault(len(x), np.full(shape, 0.25))

        effect = sample.with_datum(name, given)
        first = content(effect.contribute(Space(mesh())))
        assert handed
        assert all((array == 0.25).all() for array in handed.values())
        assert content(effect.contribute(Space(mesh()))) == first


def describes_itself_in_one_line(sample: EffectSample) -> None:
    """Class, boundaries, and data however long they are."""
    words = sample.effect.describe()
    assert words.startswith(sample.name + ":")
    assert words.strip() == words
    assert "\n" not in words
    assert "0x" not in words
    for name in sample.on or ():
        assert name in words
    if isinstance(sample.effect, MaterialLaw):
        assert "west" in sample.changed(on="west").describe()
    for name, components in sample.data.items():
        many = sample.with_datum(name, np.ones((500, components))).describe()
        assert "\n" not in many
        assert len(many) < 200


def survives_a_copy_to_another_process(sample: EffectSample) -> None:
    """Pickled, it equals itself."""
    assert pickle.loads(pickle.dumps(sample.effect)) == sample.effect


def does_not_depend_on_its_place_in_the_scene(sample: EffectSample) -> None:
    """Histories are the same to the last bit, in whatever order effects are named."""
    effects = (sample.effect, *sample.beside)
    reference = answer(*effects)
    rng = np.random.default_rng(0)
    orders = [tuple(reversed(range(len(effects)))), *(rng.permutation(len(effects)) for _ in range(2))]
    for order in orders:
        other = answer(*(effects[i] for i in order))
        for name in ("displacement", "forces", "energy", "work", "dissipated", "certificate", "iterations"):
            assert np.array_equal(getattr(other, name), getattr(reference, name)), name
        for name in ("slip", "traction", "pressure", "sticking"):
            assert np.array_equal(getattr(other.contact, name), getattr(reference.contact, name)), name


def changes_the_answer_of_a_scene(sample: EffectSample) -> None:
    """Without it, or with what stands in its place, displacements differ."""
    present, absent = answer(sample.effect, *sample.beside), answer(*sample.instead, *sample.beside)
    scale = np.abs(present.displacement).max() + np.abs(absent.displacement).max()
    # The smallest change is that of the quadrature rule's weights; round-off is 1e-15.
    assert np.abs(present.displacement - absent.displacement).max() > 1e-6 * scale


def changes_the_answer_by_each_of_its_settings(sample: EffectSample) -> None:
    """Every field has another value with which they do."""
    assert set(sample.others) == set(sample.fields)
    reference = answer(sample.effect, *sample.beside).displacement
    for name, other in sample.others.items():
        other = other if isinstance(other, Other) else Other(other)
        changed = sample.changed(**{name: other.value, **other.changes})
        found = answer(changed, *sample.beside, *other.beside).displacement
        assert np.abs(found - reference).max() > 1e-6 * np.abs(reference).max(), name


SENTENCES: tuple[Callable[[EffectSample], None], ...] = (
    is_frozen,
    contributes_the_same_arrays_when_asked_twice,
    remembers_no_mesh,
    contributes_finite_arrays_that_fit_the_space,
    names_an_unknown_boundary_and_what_exists,
    names_an_unknown_cell_datum_and_what_exists,
    takes_a_name_or_a_list_of_names,
    refuses_data_that_are_not_finite,
    refuses_numbers_that_are_not_finite,
    leaves_the_arrays_of_the_user_alone,
    describes_itself_in_one_line,
    survives_a_copy_to_another_process,
    does_not_depend_on_its_place_in_the_scene,
    changes_the_answer_of_a_scene,
    changes_the_answer_by_each_of_its_settings,
)
