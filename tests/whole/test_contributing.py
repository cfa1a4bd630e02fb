"""The recipes of CONTRIBUTING.md, followed word for word: an effect, a family of meshes, a solver."""

from __future__ import annotations

import importlib.util
import json
import re
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp
from scenes import paper_scene

import vemcvx as vx
from vemcvx.cli import solver_names
from vemcvx.scene.pose import pose_scene

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "CONTRIBUTING.md").read_text()
BLOCKS = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
FILES = {re.match(r"# (\S+)\n", text).group(1): text for text in BLOCKS[::2]}
LINES = dict(zip(FILES, BLOCKS[1::2], strict=True))
"""Each recipe is a file, whose path its first line says, and a line."""


def test_the_page_names_every_package_and_its_links_lead_somewhere():
    packages = {path.parent.name for path in (ROOT / "vemcvx").glob("*/__init__.py")}
    assert set(re.findall(r"^\| `vemcvx/(\w+)` \|", TEXT, re.MULTILINE)) == packages
    for target in re.findall(r"\]\(([^)#]+)\)", re.sub(r"```.*?```", "", TEXT, flags=re.DOTALL)):
        assert (ROOT / target).exists(), target


@pytest.fixture
def made(tmp_path, monkeypatch):
    """A function that puts the file of a recipe into the package, for one test, and returns what its line defines."""

    def make(path):
        name = path.removesuffix(".py").replace("/", ".")
        file = tmp_path / Path(path).name
        file.write_text(FILES[path])
        spec = importlib.util.spec_from_file_location(name, file)
        module = importlib.util.module_from_spec(spec)
        monkeypatch.setitem(sys.modules, name, module)
        spec.loader.exec_module(module)
        known = dict(vars(module))
        if LINES[path].startswith("from"):
            exec(LINES[path], known)
            return known
        return eval(f"{{{LINES[path]}}}", known)

    return make


def test_an_effect_in_one_file_and_a_line(made):
    """A bar on rollers between a fixed end and springs whose support moves by U t: u = k U t / (M + k) (1 - x)."""
    Robin = made("vemcvx/effects/robin.py")["Robin"]
    k, young, poisson, U = 3.0, 10.0, 0.3, 0.01
    M = young * (1 - poisson) / ((1 + poisson) * (1 - 2 * poisson))
    scene = vx.Scene(
        vx.Elasticity(young, poisson),
        vx.Symmetry(on=["right", "bottom", "top"]),
        Robin(k, lambda x, t: np.tile([U * t, 0.0], (len(x), 1)), on="left"),
    )
    history = vx.simulate(scene, vx.meshes.voronoi(6), [0.0, 0.5, 1.0])
    exact = np.outer(history.times, k * U / (M + k) * (1 - history.mesh.points[:, 0]))
    assert np.abs(history.displacement[..., 0] - exact).max() < 1e-12 * U
    assert np.abs(history.displacement[..., 1]).max() < 1e-12 * U
    assert vx.error_budget(history).largest["total"] < 1e-12
    assert any(words.startswith("Robin: stiffness 3.0") for words in history.effects)


def test_a_family_of_meshes_in_one_file_and_a_line(made, monkeypatch):
    for name, family in made("vemcvx/meshes/families/trapezoids.py").items():
        monkeypatch.setitem(vx.meshes.FAMILIES, name, family)
    mesh = vx.meshes.FAMILIES["trapezoids"](4, box=((0.0, 1.5), (-1.0, 0.0)))
    # Checks that the family skips.
    assert vx.PolygonMesh(mesh.points, mesh.cells).n_cells == mesh.n_cells == 24
    assert set(mesh.boundaries) == {"left", "right", "bottom", "top", "boundary"}
    assert mesh.areas.sum() == pytest.approx(1.5, rel=1e-14)
    assert mesh.h > 1.1 * vx.meshes.squares(4).h
    G = np.array([[0.01, -0.02], [0.03, 0.015]])
    scene = vx.Scene(vx.Elasticity(7.0, 0.3), vx.PrescribedDisplacement(lambda x, t: t * x @ G.T, on="boundary"))
    history = vx.simulate(scene, mesh, [0.0, 1.0])
    assert np.abs(history.displacement[-1] - mesh.points @ G.T).max() < 1e-13


@pytest.fixture
def uzawa(made, monkeypatch):
    """The solver of the recipe, by its name on the command line, at the accuracy 1e-7."""
    for name, kind in made("vemcvx/solvers/uzawa.py").items():
        monkeypatch.setitem(solver_names.NAMES, name, kind)
    return solver_names.named_solver("uzawa", 1e-7)


def test_a_solver_in_one_file_and_a_line(uzawa):
    """Answers to the same steps are no farther apart than the errors of both, certified step by step, add up to."""
    scene, mesh, times = paper_scene(lambda t: np.sin(6 * t)), vx.meshes.voronoi(4), np.linspace(0.0, 1.0, 7)
    own, newton = (vx.simulate(scene, mesh, times, solver=solver) for solver in (uzawa, vx.Newton()))
    assert own.certificate.max() <= 1e-7
    assert not own.contact.sticking[-1].all()
    A = pose_scene(scene, mesh).A
    apart = (own.displacement - newton.displacement).reshape(len(times), -1)
    distance = np.sqrt(np.einsum("ni,ni->n", apart, (A @ apart.T).T) / (2 * newton.energy.max()))
    allowed = sum(h.certificate_total[-1] + h.certificate_floor.sum() for h in (own, newton))
    assert distance.max() <= allowed < 1e-6


def test_the_accuracy_is_in_the_files_whatever_the_solver_prints(uzawa, tmp_path):
    class Quiet(type(uzawa)):
        __repr__ = object.__repr__

    history = vx.simulate(paper_scene(), vx.meshes.squares(3), [0.0, 1.0], solver=Quiet(accuracy=1e-5))
    history.write(tmp_path / "out")
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["accuracy"] == 1e-5
    assert vx.read_history(tmp_path / "out").trajectory.accuracy == 1e-5


def test_the_solver_takes_second_order_cones(uzawa):
    """A mass on a spring, dragged around on a plane: it slips in every step from the third on."""
    k, w, times = 2.0, 0.5, np.linspace(0.0, 1.0, 9)
    system = vx.System(
        k * np.eye(2), lambda t: [2 * np.sin(3 * t), 1 - np.cos(3 * t)], vx.Norms(np.eye(2), [w], block=2)
    )
    own, newton = (vx.march(system, times, solver=solver) for solver in (uzawa, vx.Newton()))
    assert np.linalg.norm(np.diff(own.state, axis=0), axis=1)[2:].min() > 0
    allowed = (own.certificate_total[-1] + newton.certificate_total[-1]) * np.sqrt(2 * newton.energy.max())
    assert np.sqrt(k) * np.linalg.norm(own.state - newton.state, axis=1).max() <= allowed + 1e-15


def test_the_solver_is_asked_for_no_more_than_it_accepts(uzawa):
    scene = paper_scene().with_(vx.UnilateralContact(on="top"))
    with pytest.raises(vx.NotAccepted, match="solver Uzawa: the program has bounds, which it does not accept"):
        vx.simulate(scene, vx.meshes.squares(3), [0.0, 1.0], solver=uzawa)


def test_the_solver_refuses_an_accuracy_that_means_nothing(uzawa):
    with pytest.raises(vx.SceneError, match="^Uzawa: found accuracy = 2"):
        type(uzawa)(accuracy=2)


def test_a_solver_need_not_be_a_dataclass(uzawa, tmp_path):
    class Plain(vx.Solver):
        accepts, max_iterations, prepare = uzawa.accepts, 20_000, type(uzawa).prepare

        def __init__(self, accuracy):
            self.accuracy = accuracy

    asked = paper_scene(), vx.meshes.squares(3), [0.0, 0.5, 1.0]
    history = vx.simulate(*asked, solver=Plain(3e-7), stream=tmp_path)
    assert history.solver == "Plain(accuracy=3e-07)"
    assert history.trajectory.accuracy == 3e-7
    assert history.certificate.max() <= 3e-7
    again = vx.simulate(*asked, solver=Plain(3e-7), stream=tmp_path, resume=True)
    assert np.array_equal(again.displacement, history.displacement)
    assert isinstance(Plain(1e-9).asked(1e-4), Plain)
    assert Plain(1e-9).asked(1e-4).accuracy == 1e-4
    with pytest.raises(vx.SceneError, match="^Plain: found accuracy = 'fine'"):
        vx.simulate(*asked, solver=Plain("fine"))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"lam": np.zeros(3)}, r"found lam = array.*; wanted an array of floats \(3, 1\)"),
        ({"d": np.zeros((3, 1))}, r"found d = array.*; wanted an array of floats \(3,\)"),
        ({"d": [0.0, 0.0, 0.0]}, r"found d = \[.*; wanted an array of floats \(3,\)"),
        ({"p": None}, r"found p = None; wanted an array of floats \(0,\)"),
        ({"iterations": None}, r"found the answer Answer.*; wanted Answer\(d, lam, iterations\)"),
    ],
)
def test_an_answer_that_fits_no_program_is_refused_in_one_sentence(uzawa, monkeypatch, change, words):
    prepared = type(uzawa.prepare(vx.Operators(np.eye(2), sp.csr_matrix(np.eye(2)))))
    own = prepared.solve
    monkeypatch.setattr(prepared, "solve", lambda *asked: replace(own(*asked), **change))
    with pytest.raises(vx.SceneError, match=f"^solver Uzawa: {words}"):
        vx.simulate(paper_scene(), vx.meshes.squares(3), [0.0, 1.0], solver=uzawa)
