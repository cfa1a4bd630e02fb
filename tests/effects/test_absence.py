"""Absence is free: what a scene does not name, and what turns out to do nothing, costs nothing and changes no bit."""

import itertools
import logging
import subprocess
import sys
import textwrap

import numpy as np
import pytest
import scipy.sparse as sp
from scenes import mostly_long
from test_conformance_effects import HELD, PULLED, RUBBING, SAMPLES, STEEL, TOUCHING

import vemcvx as vx
from vemcvx.linear import superlu
from vemcvx.program.condensation import MOST_SHAPES, Condensation
from vemcvx.scene import pose_scene
from vemcvx.testing.effects import TIMES, mesh


def bits(thing):
    """An array, matrix or None as comparable bytes."""
    if thing is None:
        return None
    if sp.issparse(thing):
        whole = sp.csr_matrix(thing, copy=True)
        whole.sort_indices()
        return whole.shape, whole.indptr.tobytes(), whole.indices.tobytes(), whole.data.tobytes()
    return np.shape(thing), np.asarray(thing).tobytes()


def program(posed):
    """Everything of which the convex programs are made: unknowns, terms, cones, and their numbers, bit for bit."""
    system, seen = posed.system, Condensation(posed.system)
    norms, limits, damping = system.norms, system.limits, system.damping
    pressed = np.ones(0 if limits is None else limits.D.shape[0])
    return {
        "unknowns": (system.n, len(seen.retained)),
        "terms": (seen.operators.count, seen.operators.block, len(seen.operators.compliance), seen.operators.features),
        "K": bits(system.K),
        "S": bits(seen.operators.K),
        "order": bits(system.elimination_order()),
        "load": [bits(system.load(t)) for t in TIMES],
        "B": None if norms is None else bits(norms.B),
        "w": None if norms is None else [bits(norms.weights_under(t, pressed)) for t in TIMES],
        "D": None if limits is None else (bits(limits.D), bits(limits.compliance)),
        "e": None if limits is None else [bits(system.remaining_gap(t)) for t in TIMES],
        "C": None if damping is None else bits(damping.C),
        "motion": system.motion is None,
        "prestress": posed.prestress is None,
    }


def answers(scene, on=None):
    found = vx.simulate(scene, on or mesh(), TIMES)
    arrays = ("displacement", "forces", "energy", "work", "dissipated", "certificate", "iterations")
    return {name: bits(getattr(found, name)) for name in arrays}


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:.*nothing holds the body in the normal direction")
@pytest.mark.parametrize("sample", SAMPLES.values(), ids=SAMPLES)
def test_a_scene_without_an_effect_never_heard_of_it(sample):
    full = vx.Scene(*sample.beside, sample.effect, *sample.instead)
    left, plain = full.without(sample.effect), vx.Scene(*sample.beside, *sample.instead)
    assert sample.effect not in left.effects
    if not any(isinstance(effect, vx.effects.MaterialLaw) for effect in left):
        left, plain = left.with_(STEEL), plain.with_(STEEL)
    assert program(pose_scene(left, mesh())) == program(pose_scene(plain, mesh()))
    assert answers(left) == answers(plain)


def none(x, t):
    return np.zeros(len(x))


SUPPORTED = (STEEL, HELD, PULLED, TOUCHING, RUBBING)
TOUCHED = (*SUPPORTED, vx.UnilateralContact(on="left"))
VOID = {
    "Traction": (vx.Traction((0.0, 0.0), on="left"), SUPPORTED, "Traction on left: its force is zero"),
    "Pressure": (vx.Pressure(none, on="left"), SUPPORTED, "Pressure on left: its force is zero"),
    "BodyForce": (vx.BodyForce((0.0, 0.0)), SUPPORTED, "BodyForce: its force is zero"),
    "PointLoad": (vx.PointLoad((0.0, 0.0), at=(0.0, 1.0)), SUPPORTED, "its force is zero"),
    "ThermalStrain": (vx.ThermalStrain(expansion=1e-5, temperature=none), SUPPORTED, "its strain is zero"),
    "Prestress": (vx.Prestress((0.0, 0.0, 0.0)), SUPPORTED, "its stress is zero"),
    "ElasticFoundation": (vx.ElasticFoundation(0.0, 0.0, on="left"), SUPPORTED, "ElasticFoundation: its stiffness is"),
    "Viscosity": (vx.Viscosity(shear=0.0), SUPPORTED, "Viscosity: its viscosity is zero"),
    "Tresca": (vx.TrescaFriction(none, on="bottom"), SUPPORTED[:-1], "TrescaFriction on bottom: its bound is zero"),
    "Coulomb": (vx.CoulombFriction(0.0, on="left"), TOUCHED, "CoulombFriction on left: its bound is zero"),
    "capped": (vx.CoulombFriction(0.3, on="left", cap=0.0), TOUCHED, "CoulombFriction on left: its bound is zero"),
    "Unilateral": (
        vx.UnilateralContact(on="right"),
        SUPPORTED,
        "UnilateralContact on right: other effects hold all its nodes",
    ),
    "Compliance": (
        vx.NormalCompliance(3.0, on="right"),
        SUPPORTED,
        "Compliance on right: other effects hold all its nodes",
    ),
    "Tresca, held": (
        vx.TrescaFriction(3.0, on="right"),
        SUPPORTED,
        "TrescaFriction on right: other effects hold all its nodes",
    ),
}


@pytest.mark.long
@pytest.mark.parametrize(("void", "beside", "says"), VOID.values(), ids=VOID)
def test_void_effects_are_dropped_and_said(void, beside, says, caplog):
    with_void, without = (pose_scene(vx.Scene(*some, *beside), mesh(), TIMES) for some in ((void,), ()))
    assert program(with_void) == program(without)
    assert [words for words in with_void.inactive if says in words]
    assert without.inactive == ()
    with caplog.at_level(logging.INFO, "vemcvx"):
        assert answers(vx.Scene(void, *beside)) == answers(vx.Scene(*beside))
    assert f"left out: {with_void.inactive[0]}" in caplog.text


def test_what_begins_late_is_kept():
    late = vx.TrescaFriction(lambda x, t: max(t - 0.9, 0.0), on="bottom")
    posed = pose_scene(vx.Scene(STEEL, HELD, PULLED, TOUCHING, late), mesh(), TIMES)
    assert posed.inactive == ()
    assert posed.system.norms is not None


def test_data_that_fail_later_fail_in_their_step():
    late = vx.BodyForce(lambda x, t: np.full((len(x), 2), np.nan if t > 0.5 else 0.0))
    assert pose_scene(vx.Scene(*SUPPORTED, late), mesh(), TIMES).inactive == ()
    with pytest.raises(vx.SceneError, match=r"BodyForce: found NaN .* t = 1"):
        vx.simulate(vx.Scene(*SUPPORTED, late), mesh(), TIMES)


def test_without_says_what_is_there():
    scene = vx.Scene(STEEL, HELD, PULLED)
    for absent, name in ((vx.TrescaFriction, "TrescaFriction"), ("Clamp", "'Clamp'")):
        with pytest.raises(vx.SceneError, match=f"^Scene.without: .* no {name} in this scene; it has Elasticity"):
            scene.without(absent)
    assert scene.without(vx.Clamp, PULLED).effects == (STEEL,)
    assert scene.effects == (STEEL, HELD, PULLED)


def test_a_scene_without_its_material_is_one_to_add_to():
    unfinished = vx.Scene(*SUPPORTED, PULLED).without(vx.Elasticity)
    with pytest.raises(vx.SceneError, match="^Scene: found 0 materials"):
        vx.simulate(unfinished, mesh(), TIMES)
    wood = vx.Orthotropic(young=(200.0, 60.0), poisson=0.3, shear=40.0)
    assert answers(unfinished.with_(wood)) == answers(vx.Scene(*SUPPORTED[1:], PULLED, wood))


@pytest.mark.long
def test_a_scene_without_convex_terms_imports_no_conic_solver():
    code = """
        import sys, numpy as np, vemcvx as vx
        steel, clamp = vx.Elasticity(young=200.0, poisson=0.3), vx.Clamp(on="right")
        contact, friction = vx.BilateralContact(on="bottom"), vx.TrescaFriction(bound=0.0, on="bottom")
        scene = vx.Scene(steel, clamp, contact, friction, vx.Traction((1.0, 0.0), on="left"))
        history = vx.simulate(scene, vx.meshes.squares(4), np.linspace(0, 1, 5), initial="equilibrium")
        assert history.solver.startswith("Direct"), history.solver
        print({"cvxpy", "clarabel", "osqp", "meshio", "matplotlib", "scipy.optimize"} & set(sys.modules))
    """
    run = subprocess.run([sys.executable, "-c", textwrap.dedent(code)], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "set()"


@pytest.fixture
def counted(monkeypatch):
    """Counts of factorisations and back-substitutions."""
    counts = {"factorised": 0, "solved": 0}

    class Counting(superlu.SuperLUFactor):
        def __init__(self, *args):
            counts["factorised"] += 1
            super().__init__(*args)

        def solve(self, b):
            counts["solved"] += bool(b.any())
            return super().solve(b)

    monkeypatch.setattr(superlu, "SuperLUFactor", Counting)
    return counts


def turning(x, t):
    return np.column_stack([np.cos(9 * t * (1 + x[:, 1])), np.sin(7 * t * x[:, 1])])


BESIDE = 1
"""The solve that does not go by steps: it estimates what rounding hides. Rows whose residual is rounding cost none."""


@pytest.mark.long
def test_linear_scenes_cost_one_solve_a_field(counted):
    """Two loads, each a scalar times a field: more steps cost no more solves, but a few that make up for rounding."""
    scene = vx.Scene(STEEL, HELD, PULLED, vx.BodyForce(lambda x, t: np.full((len(x), 2), np.sin(t))))
    for steps in (4, 32, 256):
        counted.update(factorised=0, solved=0)
        vx.simulate(scene, mesh("voronoi", 6), np.linspace(0, 1, steps + 1), store="last")
        assert counted["factorised"] == 1
        assert 1 <= counted["solved"] - BESIDE <= MOST_SHAPES


@mostly_long("steps", [8, 32])
def test_scenes_without_friction_cost_one_solve_a_step(steps, counted):
    """A load that takes a new shape in every step, and has one at the start, whose own response is one more."""
    scene = vx.Scene(STEEL, HELD, TOUCHING, vx.Traction(turning, on="left"))
    vx.simulate(scene, mesh("voronoi", 6), np.linspace(0, 1, steps + 1), initial="equilibrium", store="last")
    assert counted == {"factorised": 1, "solved": BESIDE + 1 + steps}


NAMED = (
    vx.Elasticity(young=200.0, poisson=0.3, on="west"),
    vx.Orthotropic((200.0, 60.0, 50.0), poisson=(0.3, 0.3, 0.2), shear=40.0, plane="strain", angle=0.4, on="east"),
    vx.Viscosity(shear=30.0, volume=20.0),
    vx.ThermalStrain(expansion=1e-4, temperature=lambda x, t: t * x[:, 1]),
    vx.Prestress(lambda x, t: t * np.column_stack([x[:, 0], x[:, 1], 0.1 + 0 * x[:, 0]])),
    PULLED,
    vx.Traction(lambda x, t: -t * np.column_stack([x[:, 0], 3 + x[:, 0]]), on="top"),
    vx.Pressure(lambda x, t: t / 3, on="top"),
    vx.BodyForce(lambda x, t: t * np.column_stack([x[:, 1], -1 / 3 - x[:, 0]])),
    vx.PointLoad(lambda x, t: t * np.full((len(x), 2), 0.1), at=(0.0, 1.0)),
    vx.Clamp(on="corner"),
    vx.PrescribedDisplacement(
        lambda x, t: 1e-3 * t * np.maximum(0.7 - x[:, 1], 0.0), on="low right", direction="normal"
    ),
    vx.Symmetry(on="crown"),
    vx.ElasticFoundation(normal=3.0, tangential=0.7, on="low right"),
    vx.BilateralContact(on="west floor"),
    vx.TrescaFriction(0.7, on="west floor"),
    vx.UnilateralContact(on="east floor", gap=1e-4),
    vx.NormalCompliance(500.0, on="left", gap=1e-4),
    vx.CoulombFriction(0.2, on=["east floor", "left"]),
)
KINDS = {type(effect) for effect in NAMED}
ALONE = vx.Rigid, vx.PrescribedSlip
"""Effects beside which no other one holds the same nodes."""
ALL = NAMED + tuple(
    {type(s.effect): s.effect for s in SAMPLES.values() if type(s.effect) not in (*KINDS, *ALONE)}.values()
)
"""An effect of every other kind that is exported."""


def crowded():
    made = mesh("voronoi", 4)
    for name, where in {
        "corner": lambda p: (p[:, 0] > 1 - 1e-9) & (p[:, 1] > 0.75),
        "low right": lambda p: (p[:, 0] > 1 - 1e-9) & (p[:, 1] < 0.75),
        "crown": lambda p: (p[:, 1] > 1 - 1e-9) & (p[:, 0] > 0.75),
        "west floor": lambda p: (p[:, 1] < 1e-9) & (p[:, 0] < 0.5),
        "east floor": lambda p: (p[:, 1] < 1e-9) & (p[:, 0] > 0.5),
    }.items():
        made = made.with_boundary(name, where)
    return made


@pytest.mark.long
def test_every_permutation_of_all_effects_is_one_program():
    on = crowded()
    reference = program(pose_scene(vx.Scene(*ALL), on, TIMES))
    rng = np.random.default_rng(3)
    for order in itertools.chain([range(len(ALL))[::-1]], (rng.permutation(len(ALL)) for _ in range(30))):
        assert program(pose_scene(vx.Scene(*(ALL[i] for i in order)), on, TIMES)) == reference
    first, last = (answers(vx.Scene(*effects), on) for effects in (ALL, ALL[::-1]))
    assert first == last
