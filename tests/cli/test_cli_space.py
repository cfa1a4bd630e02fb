"""Commands on problem files in space: default meshes, second-order cones, pictures and the report."""

from __future__ import annotations

import html
import sys

import pytest
from called import call

from vemcvx.cli import problem_file
from vemcvx.cli.problem_file import read_problem

BLOCK = '''"""A block dragged in space."""
import numpy as np, vemcvx as vx
def scene(bound=4.0):
    drag = vx.PrescribedDisplacement(lambda x, t: [0.1 * np.sin(t), 0.1 - 0.1 * np.cos(t), 0.0], on="top")
    floor = vx.BilateralContact(on="bottom"), vx.TrescaFriction(bound, on="bottom")
    return vx.Scene(vx.Elasticity(200.0, 0.3), drag, *floor)
def mesh(n, family="cubes"):
    return vx.meshes.SPACE_FAMILIES[family](n)
def times(steps):
    return np.linspace(0.0, 3.0, steps + 1)
'''


@pytest.fixture
def block(tmp_path):
    (tmp_path / "block.py").write_text(BLOCK)
    return tmp_path / "block.py"


def run(command, block, *options):
    code, output = call(command, str(block), *options)
    assert code == 0, output
    return " ".join(output.split())


@pytest.mark.long
def test_default_meshes_in_space_are_coarser_than_in_the_plane(block, tmp_path, monkeypatch):
    own = tmp_path / "own.py"
    own.write_text(BLOCK.replace('family="cubes"', 'family="own"').replace("SPACE_FAMILIES[family]", "cubes"))
    assert read_problem(own).family == "own"
    assert [read_problem(own).default_n(n) for n in (64, 4)] == [8, 4]
    assert read_problem("feng_han_huang").default_n(64) == 64
    monkeypatch.setattr(problem_file, "SPACE_N", 2)
    for command in (["show"], ["run", "--steps", "1"], ["compare", "--steps", "1", "--solvers", "newton"]):
        assert "8 cells, 27 nodes" in run(command[0], block, *command[1:])


def test_show_names_second_order_cones_and_the_solvers_that_refuse_them(block):
    shown = run("show", block, "--n", "2")
    assert "9 norms of 2 components, 9 second-order cones" in shown
    assert "Elasticity: E = 200.0, nu = 0.3, shear stabilisation" in shown
    assert "plane strain" not in shown
    assert "OSQP (no second-order cones)" in shown


@pytest.mark.long
def test_pictures_and_the_report_name_what_they_leave_out(block, tmp_path, monkeypatch):
    pytest.importorskip("matplotlib")
    monkeypatch.setitem(sys.modules, "pyvista", None)
    out = tmp_path / "out"
    printed = run("run", block, "--n", "2", "--steps", "2", "--plot", "--report", "--out", str(out))
    missing = "deformed_body: drawing bodies in space needs PyVista, which is not installed: pip install 'vemcvx[view]'"
    assert f"left out {missing}" in printed
    pictures = {"contact_face", "hysteresis_loop", "forces_over_time", "energy_ledger"}
    files = {"report.html", "history.pvd", "step_0002.vtu", "contact.csv", "summary.json"}
    assert {path.name for path in out.iterdir()} >= files | {f"{name}.png" for name in pictures}
    page = html.unescape((out / "report.html").read_text())
    assert f"Left out: {missing}." in page
    assert page.count("<img") == 4
    assert "largest friction per area" in page
    assert "algebra" in page.split("Error budget")[1]
