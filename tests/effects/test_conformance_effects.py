"""What every effect must satisfy: one list of sentences, run over every effect that the package exports."""

from __future__ import annotations

import dataclasses
import inspect
import pickle
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache

import numpy as np
import pytest
import scipy.sparse as sp
from scenes import FAMILIES

import vemcvx as vx
from vemcvx.effects import Contribution, Given
from vemcvx.vem import Space

TIMES = np.array([0.0, 0.4, 1.0])
OTHER_FIELDS = {"on", "direction", "plane", "stabilisation", "quadrature", "stiffness", "at", "while_closed"}
"""Fields of effects that carry no data f(x, t)."""


def pull(x, t):
    return np.column_stack([8 * (1.25 - x[:, 1]) * t, np.full(len(x), -0.01 * t)])


def lift(x, t):
    # Zero where the clamp begins, so that it may stand beside it.
    return 1e-3 * t * (1 - x[:, 0]) * (1 + x[:, 1])


def slide(x, t):
    return lift(x, t)[:, None] * [1.0, 0.5]


def weigh(x, t):
    return t * np.column_stack([3 + x[:, 1], -1 - x[:, 0]])


def uneven(x, t):
    return 3 + x[:, 0] + 0 * t


def stiff(x):
    return 200 + 50 * x[:, 0]


def apart(x, t):
    return 1e-3 * x[:, 0] * (1 + t)


def springy(x, t):
    return 400 + 100 * x[:, 0] + 0 * t


def grip(x, t):
    return 0.3 + 0.1 * x[:, 0] + 0 * t


def press(x, t):
    return t * (3 + x[:, 1])


def suck(x, t):
    return -t * (1 + x[:, 0])


def dirichlet_force(x, t):
    return t * np.column_stack([3 + x[:, 0], 1 - x[:, 1], x[:, 0] * x[:, 1]])


def belt(x, t):
    return 0.1 * t * np.column_stack([2 + x[:, 0], 0 * x[:, 1]])


def squeeze(x, t):
    return -dirichlet_force(x, t) - [t, 0.0, 0.0]


STEEL = vx.Elasticity(young=200.0, poisson=0.3)
HELD = vx.Clamp(on="right")
PULLED = vx.Traction(pull, on="left")
SHAKEN = vx.Traction(lambda x, t: np.tile([30 * t * (0.6 - t), 0.0], (len(x), 1)), on="left")
PRESSED = vx.Traction(lambda x, t: t * np.column_stack([4 + x[:, 0], -6 - x[:, 0]]), on="top")
TOUCHING = vx.BilateralContact(on="bottom")
RUBBING = vx.TrescaFriction(bound=4.0, on="bottom")


@dataclass(frozen=True)
class Other:
    """Another value of a field that asks for more: for changes of other fields, or for effects beside."""

    value: object
    changes: dict[str, object] = field(default_factory=dict)
    beside: tuple[vx.Effect, ...] = ()


REST = Other("west", beside=(vx.Elasticity(young=80.0, poisson=0.2, on="east"),))
REST_STRESS = Other("west", beside=(vx.Elasticity(young=80.0, poisson=0.2, plane="stress", on="east"),))
# Where the normal is held without an obstacle no pressure is known, and none counts.
UNPRESSED = Other(True, {"backward": None}, beside=(vx.UnilateralContact(on="left"),))


@dataclass(frozen=True)
class Sample:
    """An effect, the scene it stands in, and what stands in its place when it is left out."""

    effect: vx.Effect
    beside: tuple[vx.Effect, ...]
    instead: tuple[vx.Effect, ...] = ()
    data: dict[str, int] = field(default_factory=dict)
    """Names of the fields that carry data, and the number of components of each."""
    others: dict[str, object] = field(default_factory=dict)
    """For every field another value."""
    tuples: tuple[str, ...] = ()
    """Names of the fields whose value is a pair of data."""

    def with_datum(self, name: str, value: object) -> vx.Effect:
        """The effect with a datum replaced; in a pair the second."""
        first = getattr(self.effect, name)
        return dataclasses.replace(self.effect, **{name: (first[0], value) if name in self.tuples else value})

    @property
    def name(self) -> str:
        return type(self.effect).__name__


SAMPLES = {
    "Elasticity": Sample(
        STEEL,
        (HELD, PULLED, TOUCHING, RUBBING),
        (vx.Elasticity(young=100.0, poisson=0.3),),
        {"young": 1, "poisson": 1},
        {"young": 150.0, "poisson": 0.2, "plane": "stress", "stabilisation": "unit", "on": REST},
    ),
    "Elasticity, varying, plane stress": Sample(
        vx.Elasticity(young=stiff, poisson=0.2, plane="stress", stabilisation="unit"),
        (HELD, PULLED, TOUCHING, RUBBING),
        (STEEL,),
        {"young": 1, "poisson": 1},
        {"young": 225.0, "poisson": 0.1, "plane": "strain", "stabilisation": "shear", "on": REST_STRESS},
    ),
    "Orthotropic": Sample(
        vx.Orthotropic(young=(200.0, 60.0), poisson=0.3, shear=40.0, angle=0.4),
        (HELD, PULLED, TOUCHING, RUBBING),
        (STEEL,),
        {"young": 1, "poisson": 1, "shear": 1, "angle": 1},
        {
            "young": (200.0, 80.0),
            "poisson": 0.2,
            "shear": stiff,
            "angle": 0.1,
            "plane": Other("strain", {"young": (200.0, 60.0, 50.0), "poisson": (0.3, 0.3, 0.2)}),
            "on": REST_STRESS,
        },
        ("young",),
    ),
    "Clamp": Sample(
        vx.Clamp(on=["top", "right"]), (STEEL, HELD, PULLED, TOUCHING, RUBBING), others={"on": ["right", "bottom"]}
    ),
    "PrescribedDisplacement": Sample(
        vx.PrescribedDisplacement(slide, on="left"),
        (STEEL, HELD, TOUCHING, RUBBING),
        data={"value": 2},
        others={"value": (0.0, 0.0), "on": "bottom", "direction": "normal"},
    ),
    "PrescribedDisplacement, normal": Sample(
        vx.PrescribedDisplacement(lift, on="left", direction="normal"),
        (STEEL, HELD, TOUCHING, RUBBING),
        data={"value": 1},
        others={"value": 0.0, "on": "bottom", "direction": "tangent"},
    ),
    "PrescribedDisplacement, oblique": Sample(
        vx.PrescribedDisplacement(lift, on="left", direction=(1.0, 2.0)),
        (STEEL, HELD, TOUCHING, RUBBING),
        data={"value": 1},
        others={"value": 0.0, "on": "bottom", "direction": (2.0, 1.0)},
    ),
    "BodyForce": Sample(
        vx.BodyForce(weigh), (STEEL, HELD, TOUCHING, RUBBING), data={"force": 2}, others={"force": pull}
    ),
    "Traction": Sample(
        vx.Traction(pull, on=("left", "top")),
        (STEEL, HELD, TOUCHING, RUBBING),
        data={"force": 2},
        others={"force": weigh, "on": "left"},
    ),
    "Pressure": Sample(
        vx.Pressure(press, on=("left", "top")),
        (STEEL, HELD, TOUCHING, RUBBING),
        data={"value": 1},
        others={"value": suck, "on": "left"},
    ),
    "PointLoad": Sample(
        vx.PointLoad(pull, at=(0.0, 1.0)),
        (STEEL, HELD, TOUCHING, RUBBING),
        data={"force": 2},
        others={"force": weigh, "at": [(0.0, 1.0), (0.0, 0.0)]},
    ),
    "Symmetry": Sample(
        vx.Symmetry(on=["top"]), (STEEL, HELD, PULLED, TOUCHING, RUBBING), others={"on": ["right", "left"]}
    ),
    "ElasticFoundation": Sample(
        vx.ElasticFoundation(normal=stiff, tangential=15.0, on="left"),
        (STEEL, HELD, PULLED, TOUCHING, RUBBING),
        data={"normal": 1, "tangential": 1},
        others={"normal": 10.0, "tangential": 5.0, "on": "top"},
    ),
    "ThermalStrain": Sample(
        vx.ThermalStrain(expansion=1e-3, temperature=press),
        (STEEL, HELD, TOUCHING, RUBBING),
        data={"expansion": 1, "temperature": 1},
        others={"expansion": 2e-3, "temperature": suck},
    ),
    "Prestress": Sample(
        vx.Prestress(dirichlet_force), (STEEL, HELD, TOUCHING, RUBBING), data={"stress": 3}, others={"stress": squeeze}
    ),
    "BilateralContact": Sample(TOUCHING, (STEEL, HELD, PULLED), others={"on": "left"}),
    "TrescaFriction": Sample(
        vx.TrescaFriction(uneven, on="bottom"),
        (STEEL, HELD, SHAKEN, TOUCHING),
        data={"bound": 1, "backward": 1, "ground": 2},
        others={
            "bound": 2.0,
            "on": "left",
            "quadrature": "integral",
            "backward": 1.0,
            "while_closed": UNPRESSED,
            "ground": belt,
        },
    ),
    "TrescaFriction, one way more than the other": Sample(
        vx.TrescaFriction(uneven, on="bottom", backward=1.0),
        (STEEL, HELD, SHAKEN, TOUCHING),
        (vx.TrescaFriction(uneven, on="bottom"),),
        {"bound": 1, "backward": 1, "ground": 2},
        {
            "bound": 5.0,
            "on": "left",
            "quadrature": "integral",
            "backward": 2.0,
            "while_closed": UNPRESSED,
            "ground": belt,
        },
    ),
    "TrescaFriction, integral": Sample(
        vx.TrescaFriction(uneven, on="bottom", quadrature="integral"),
        (STEEL, HELD, SHAKEN, TOUCHING),
        (RUBBING,),
        {"bound": 1, "backward": 1, "ground": 2},
        {"bound": 2.0, "on": "left", "quadrature": "nodes", "backward": 1.0, "while_closed": UNPRESSED, "ground": belt},
    ),
    "TrescaFriction on a belt": Sample(
        vx.TrescaFriction(uneven, on="bottom", ground=belt),
        (STEEL, HELD, PULLED, TOUCHING),
        (vx.TrescaFriction(uneven, on="bottom"),),
        {"bound": 1, "backward": 1, "ground": 2},
        {
            "bound": 5.0,
            "on": "left",
            "quadrature": "integral",
            "backward": 0.1,
            "while_closed": UNPRESSED,
            "ground": slide,
        },
    ),
    "CoulombFriction on a belt": Sample(
        vx.CoulombFriction(grip, on="bottom", ground=belt),
        (STEEL, HELD, PRESSED, vx.UnilateralContact(on=["bottom", "left"])),
        (vx.CoulombFriction(grip, on="bottom"),),
        {"coefficient": 1, "cap": 1, "ground": 2},
        {"coefficient": 0.1, "on": "left", "cap": 0.1, "ground": slide},
    ),
    "UnilateralContact": Sample(
        vx.UnilateralContact(on="bottom", gap=apart),
        (STEEL, HELD, PRESSED, RUBBING),
        data={"gap": 1},
        others={"on": "left", "gap": 0.25},
    ),
    "NormalCompliance": Sample(
        vx.NormalCompliance(springy, on="bottom", gap=apart),
        (STEEL, HELD, PRESSED, RUBBING),
        data={"gap": 1},
        others={"stiffness": 7.0, "on": "left", "gap": 0.25},
    ),
    "Viscosity": Sample(
        vx.Viscosity(shear=30.0, volume=20.0),
        (STEEL, HELD, PULLED, TOUCHING, RUBBING),
        data={"shear": 1, "volume": 1},
        others={"shear": 10.0, "volume": 0.0},
    ),
    "CoulombFriction": Sample(
        vx.CoulombFriction(grip, on="bottom", cap=uneven),
        (STEEL, HELD, PRESSED, PULLED, vx.UnilateralContact(on=["bottom", "left"])),
        data={"coefficient": 1, "cap": 1, "ground": 2},
        others={"coefficient": 0.1, "on": "left", "cap": 0.1, "ground": belt},
    ),
}


@cache
def mesh(family: str = "squares", n: int = 3) -> vx.PolygonMesh:
    made = vx.meshes.FAMILIES[family](n)
    west = made.centroids[:, 0] < 0.5
    return made.with_cell_data("west", west).with_cell_data("east", ~west)


def answer(*effects, on=None):
    return vx.simulate(vx.Scene(*effects), on or mesh(), TIMES)


def content(thing):
    """Everything that a contribution says, as comparable plain data; functions of time by their values."""
    if isinstance(thing, Given):
        return (
            thing.kind,
            content(thing.edges),
            content(thing.cells),
            tuple(content(at_places(thing, t)) for t in TIMES),
        )
    if dataclasses.is_dataclass(thing):
        return {f.name: content(getattr(thing, f.name)) for f in dataclasses.fields(thing) if f.name != "value"} | {
            "at": at_times(thing)
        }
    if sp.issparse(thing):
        return content((thing.shape, thing.indptr, thing.indices, thing.data))
    if isinstance(thing, np.ndarray):
        return thing.shape, thing.dtype.str, thing.tobytes()
    if isinstance(thing, tuple):
        return tuple(map(content, thing))
    if callable(thing) and len(inspect.signature(thing).parameters) == 2:
        return tuple(content(thing(t, np.ones(len(thing(t, 1.0))))) for t in TIMES)
    if callable(thing):
        return tuple(content(thing(t)) for t in TIMES)
    return thing


def at_places(given, t):
    """A datum as a function of place, at points of the first cell."""
    x, cells = np.random.default_rng(0).uniform(0.0, 0.3, (5, 2)), np.zeros(5, dtype=np.int64)
    more = {
        "bound": (t, np.ones(5)),
        "spring": (t, np.ones(5)),
        "foundation": (),
        "moduli": (cells,),
        "eigenstrain": (cells, t),
    }
    return given.value(x, *more.get(given.kind, (t,)))


def at_times(thing):
    """A load or a support as a function of time."""
    if hasattr(thing, "vector"):
        return tuple(content(thing.vector(t)) for t in TIMES)
    return content(thing.value) if callable(getattr(thing, "value", None)) else None


def nameless(thing):
    """Content without the words that name its subject."""
    if isinstance(thing, dict):
        return {name: nameless(value) for name, value in thing.items() if name != "subject"}
    return tuple(map(nameless, thing)) if isinstance(thing, tuple) else thing


def on_boundaries(sample):
    return hasattr(sample.effect, "on") and not isinstance(sample.effect, vx.effects.MaterialLaw)


# The sentences: "every effect ..."


def is_frozen(sample):
    for setting in dataclasses.fields(sample.effect):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(sample.effect, setting.name, None)


def contributes_the_same_arrays_when_asked_twice(sample):
    space = Space(mesh())
    first = content(sample.effect.contribute(space))
    answer(sample.effect, *sample.beside)
    assert content(sample.effect.contribute(space)) == first
    assert content(dataclasses.replace(sample.effect).contribute(Space(mesh()))) == first


def remembers_no_mesh(sample):
    fine, coarse = Space(mesh("voronoi", 4)), Space(mesh())
    alone = content(dataclasses.replace(sample.effect).contribute(coarse))
    assert content(sample.effect.contribute(fine)) != alone
    assert content(sample.effect.contribute(coarse)) == alone


def contributes_finite_arrays_that_fit_the_space(sample):
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
        assert np.abs(np.linalg.norm(support.directions, axis=1) - 1).max() < 1e-15 * 4
        assert support.value is None or support.value(1.0).shape == (m,)
    for rows in (*part.frictions, *part.surfaces):
        assert ((rows.nodes >= 0) & (rows.nodes < nodes)).all()
        assert (rows.lengths > 0).all()
        assert np.abs(np.linalg.norm(rows.normals, axis=1) - 1).max() < 1e-15 * 4
    for stress in (*part.eigenstrains, *part.initial_stresses):
        assert len(stress.value(1.0)) == space.mesh.n_cells
        assert np.isfinite(stress.value(1.0)).all()
    for friction in part.frictions:
        assert (friction.weights(1.0) >= 0).all()


def names_an_unknown_boundary_and_what_exists(sample):
    if not on_boundaries(sample):
        return
    for on in ("bottm", ["left", "bottm"]):
        lost = dataclasses.replace(sample.effect, on=on)
        with pytest.raises(
            vx.SceneError,
            match=rf"^{sample.name}: there is no boundary named 'bottm'; this mesh has 'left', 'right', 'bottom', "
            r"'top', 'boundary'; add one with mesh\.with_boundary\(name, predicate\)\.$",
        ):
            answer(lost, *sample.beside)


def names_an_unknown_cell_datum_and_what_exists(sample):
    if not isinstance(sample.effect, vx.effects.MaterialLaw):
        return
    for on in ("wst", ["west", "wst"]):
        with pytest.raises(
            vx.SceneError,
            match=rf"^{sample.name}: on= names cells by a cell datum that is nonzero there; found 'wst', but this mesh "
            r"has 'west', 'east'\. Add one with mesh\.with_cell_data\(name, values\)\.$",
        ):
            answer(dataclasses.replace(sample.effect, on=on), *sample.beside)


def takes_a_name_or_a_list_of_names(sample):
    space = Space(mesh())

    def on(names):
        return nameless(content(dataclasses.replace(sample.effect, on=names).contribute(space)))

    if isinstance(sample.effect, vx.effects.MaterialLaw):
        assert on("west") == on(["west"]) == on(("west", "west"))
        assert on("west") != on("east")
    if not on_boundaries(sample):
        return
    assert on("left") == on(["left"]) == on(("left", "left"))
    assert on("boundary") == on(["left", "boundary", "right"])
    assert on("left") != on(["left", "top"])


def has_no_data_but_those_probed_here(sample):
    assert {f.name for f in dataclasses.fields(sample.effect)} <= set(sample.data) | OTHER_FIELDS


def refuses_data_that_are_not_finite(sample):
    for name, components in sample.data.items():
        for wrong in (np.nan, np.inf):
            constant = wrong if components == 1 else (*np.zeros(components - 1), wrong)
            shape = () if components == 1 else (components,)

            def late(x, t=1.0, wrong=wrong, shape=shape):
                values = np.zeros((len(x), *shape))
                values[-1] = wrong if t > 0.5 else 0.0
                return values

            for value in (constant, late):
                spoilt = sample.with_datum(name, value)
                with pytest.raises(vx.SceneError, match=rf"^{sample.name}.*found NaN or infinity .*must be finite"):
                    answer(spoilt, *sample.beside)


def leaves_the_arrays_of_the_user_alone(sample):
    for name, components in sample.data.items():
        handed = {}

        def given(x, *t, handed=handed, components=components):
            shape = (len(x), components) if components > 1 else len(x)
            return handed.setdefault(len(x), np.full(shape, 0.25))

        effect = sample.with_datum(name, given)
        first = content(effect.contribute(Space(mesh())))
        assert handed
        assert all((array == 0.25).all() for array in handed.values())
        assert content(effect.contribute(Space(mesh()))) == first


def describes_itself_in_one_line(sample):
    words = sample.effect.describe()
    assert words.startswith(sample.name + ":")
    assert words.strip() == words
    assert "\n" not in words
    assert "0x" not in words
    for name in np.atleast_1d(sample.effect.on) if on_boundaries(sample) else []:
        assert name in words
    if isinstance(sample.effect, vx.effects.MaterialLaw):
        assert "west" in dataclasses.replace(sample.effect, on="west").describe()
    for name, components in sample.data.items():
        many = sample.with_datum(name, np.ones((500, components))).describe()
        assert "\n" not in many
        assert len(many) < 200


def survives_a_copy_to_another_process(sample):
    assert pickle.loads(pickle.dumps(sample.effect)) == sample.effect


def does_not_depend_on_its_place_in_the_scene(sample):
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


def changes_the_answer_of_a_scene(sample):
    present, absent = answer(sample.effect, *sample.beside), answer(*sample.instead, *sample.beside)
    scale = np.abs(present.displacement).max() + np.abs(absent.displacement).max()
    # The smallest change is that of the quadrature rule's weights; round-off is 1e-15.
    assert np.abs(present.displacement - absent.displacement).max() > 1e-6 * scale


def changes_the_answer_by_each_of_its_settings(sample):
    assert set(sample.others) == {f.name for f in dataclasses.fields(sample.effect)}
    reference = answer(sample.effect, *sample.beside).displacement
    for name, other in sample.others.items():
        other = other if isinstance(other, Other) else Other(other)
        changes = {name: other.value, **other.changes}
        if name == "direction" and sample.effect.direction is None:
            changes["value"] = lift
        found = answer(dataclasses.replace(sample.effect, **changes), *sample.beside, *other.beside).displacement
        assert np.abs(found - reference).max() > 1e-6 * np.abs(reference).max(), name


SENTENCES: list[Callable[[Sample], None]] = [
    is_frozen,
    contributes_the_same_arrays_when_asked_twice,
    remembers_no_mesh,
    contributes_finite_arrays_that_fit_the_space,
    names_an_unknown_boundary_and_what_exists,
    names_an_unknown_cell_datum_and_what_exists,
    takes_a_name_or_a_list_of_names,
    has_no_data_but_those_probed_here,
    refuses_data_that_are_not_finite,
    leaves_the_arrays_of_the_user_alone,
    describes_itself_in_one_line,
    survives_a_copy_to_another_process,
    does_not_depend_on_its_place_in_the_scene,
    changes_the_answer_of_a_scene,
    changes_the_answer_by_each_of_its_settings,
]


@pytest.mark.filterwarnings("ignore:.*nothing holds the body in the normal direction")
@pytest.mark.parametrize("sample", SAMPLES.values(), ids=SAMPLES)
@pytest.mark.parametrize("sentence", SENTENCES, ids=lambda f: f.__name__)
def test_every_effect(sentence, sample):
    sentence(sample)


@pytest.mark.parametrize("sample", SAMPLES.values(), ids=SAMPLES)
@pytest.mark.parametrize("family", FAMILIES)
def test_every_effect_runs_on_every_family(sample, family):
    history = answer(sample.effect, *sample.beside, on=mesh(family))
    assert history.certificate.max() < 1e-8
    assert np.isfinite(history.displacement).all()
    assert history.energy[-1] > 0


def test_no_exported_effect_is_missing_from_the_samples():
    exported = {
        thing
        for space in (vx, vx.effects)
        for thing in vars(space).values()
        if isinstance(thing, type) and issubclass(thing, vx.Effect) and not inspect.isabstract(thing)
    }
    assert exported == {type(sample.effect) for sample in SAMPLES.values()}
    assert {kind.__name__ for kind in exported} <= set(vx.__all__)


def test_loads_that_print_alike_are_summed_in_one_order():
    """Sums of three and more depend on their order in the last bit; arrays print eight digits, cut short when long."""
    rng = np.random.default_rng(1)
    like = [vx.Traction(np.array([1.0, 0.3]) + 1e-10 * rng.random(2), on="left") for _ in range(4)]
    other = [vx.BodyForce(lambda x, t, c=c: c * np.ones((len(x), 2))) for c in (0.1, 0.7, 1 / 3)]
    effects = [STEEL, HELD, *like, *other]
    assert len({repr(effect) for effect in like}) == 1
    reference = vx.simulate(vx.Scene(*effects), mesh(), [0.0, 1.0], initial="settled").displacement
    for _ in range(10):
        shuffled = vx.Scene(*(effects[i] for i in rng.permutation(len(effects))))
        assert np.array_equal(vx.simulate(shuffled, mesh(), [0.0, 1.0], initial="settled").displacement, reference)


def test_functions_are_summed_in_the_order_in_which_they_are_written():
    """Not in that of their addresses: two runs of one script would differ in the last bit."""
    makers = [
        lambda: vx.BodyForce(lambda x, t: np.full((len(x), 2), t / 3)),
        lambda: vx.BodyForce(lambda x, t: np.full((len(x), 2), 0.7 * t)),
        lambda: vx.BodyForce(lambda x, t: np.full((len(x), 2), 0.1 * t)),
    ]
    rng = np.random.default_rng(2)
    kept = [[makers[i]() for i in rng.permutation(3)] for _ in range(20)]
    orders = {
        tuple(effect.force.__code__.co_firstlineno for effect in vx.Scene(STEEL, *loads).canonical[:3])
        for loads in kept
    }
    (order,) = orders
    assert list(order) == sorted(order)


def test_an_effect_of_ones_own_runs_beside_the_others():
    """Effects are an open set: any class that contributes arrays of the known kinds is one."""

    @dataclass(frozen=True)
    class Springs(vx.Effect):
        modulus: float
        on: str

        def contribute(self, space):
            part = space.part(self.on, "Springs")
            diagonal = np.zeros(space.n_unknowns)
            diagonal[2 * part.nodes] = self.modulus * part.node_lengths
            return Contribution(stiffness=sp.diags_array(diagonal).tocsr())

        def describe(self):
            return f"Springs: {self.modulus} on {self.on}"

    soft, hard = (answer(STEEL, HELD, PULLED, TOUCHING, RUBBING, Springs(k, "left")) for k in (0.0, 1e6))
    plain = answer(STEEL, HELD, PULLED, TOUCHING, RUBBING)
    assert np.abs(soft.displacement - plain.displacement).max() < 1e-13 * np.abs(plain.displacement).max()
    left = hard.mesh.points[:, 0] == 0
    assert np.abs(hard.displacement[-1, left, 0]).max() < 1e-3 * np.abs(plain.displacement[-1, left, 0]).max()
