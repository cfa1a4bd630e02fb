"""`vemcvx collection` writes graded and reproducible instances, and an independent script confirms their optima."""

from __future__ import annotations

import ast
import csv
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from test_cli import invoke

import vemcvx as vx
from vemcvx.cli.collection import INSTANCES, CollectionInstance, confirm, write_collection
from vemcvx.cli.collection.benchmark import kind_of
from vemcvx.cli.collection.writing import CORE, LARGE, OPTIMA, SEQUENCES, SIZES
from vemcvx.exchange import sequence_from_npz

SCRIPT = Path(vx.__file__).parent / "cli" / "collection" / "confirm.py"
GRADES = {instance.grade for instance in INSTANCES}


def choose_small():
    """Return one small instance of each grade, and two instances without optimum."""
    large = "cattaneo_mindlin", "janssen_silo", "shear_lag", "thermal_expansion_blocked_by_friction"
    small = [one for one in INSTANCES if one.condense and one.n <= 32 and one.problem not in large]
    first = {(one.grade, one.without): one for one in reversed(small)}
    return [first[key] for key in sorted(first)]


def read_manifest(folder):
    return json.loads((folder / "manifest.json").read_text())["instances"]


def test_names_are_unique_and_published_and_every_grade_has_a_core_instance():
    names = [instance.name for instance in INSTANCES]
    assert len(set(names)) == len(names) == 138
    assert len(GRADES) == 14
    assert len(CORE) == 40
    assert {one.grade for one in INSTANCES if one.name in CORE} == GRADES
    published = [line.split(",")[0] for line in SCRIPT.with_name(OPTIMA).read_text().splitlines()[1:]]
    assert sorted(published) == sorted([*names, *(one.name for one in (*LARGE, *SEQUENCES))])


@pytest.mark.long
def test_a_sequence_has_one_set_of_matrices_and_the_programs_of_its_steps(tmp_path):
    short = [
        CollectionInstance(grade="sequences", problem=problem, n=n, of=8, step=8, steps=7)
        for problem, n in (("feng_han_huang", 8), ("block_in_space", 4))
    ]
    write_collection(tmp_path / "all", instances=short)
    for one in short:
        write_collection(tmp_path / "one", instances=[replace(one, steps=1)])
        last = vx.read_program(tmp_path / "one" / f"{replace(one, steps=1).name}.npz")
        programs = sequence_from_npz(tmp_path / "all" / f"{one.name}.npz")
        assert [program.step for program in programs] == [2, 3, 4, 5, 6, 7, 8]
        assert all(program.operators is programs[0].operators for program in programs)
        # Previous steps change the last digits of the bounds.
        (low, high), (lowest, highest) = last.bounds, programs[-1].bounds
        assert max(low, lowest) <= min(high, highest)
        words = json.loads((tmp_path / "all" / f"{one.name}.json").read_text())
        assert words["optimum"]["low"] == sum(program.bounds[0] for program in programs)
        assert words["optimum"]["energy_norm"] == max(program.norm for program in programs)
        assert len(confirm.Program(tmp_path / "all" / f"{one.name}.npz").steps()) == 7
    assert confirm.main(tmp_path / "all") == 0


def test_the_script_imports_three_packages_only():
    tree = ast.parse(SCRIPT.read_text())
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert {name.split(".")[0] for name in names} - set(sys.stdlib_module_names) == {"numpy", "scipy", "clarabel"}


@pytest.mark.long
def test_the_script_confirms_an_instance_of_each_grade(tmp_path, capsys):
    assert write_collection(tmp_path, instances=choose_small()).startswith(f"{len(GRADES) + 1} instances")
    manifest = read_manifest(tmp_path)
    assert {row["grade"] for row in manifest} == GRADES
    rows = [row for row in manifest if "optimum" in row]
    assert {row["status"] for row in manifest if row not in rows} == {"infeasible", "unbounded"}
    for row in rows:
        program = vx.read_program(tmp_path / f"{row['name']}.npz")
        assert len(program.g) == row["unknowns"]
        optimum = row["optimum"]
        # If K has a kernel, rounding errors differ after reading.
        bounds = optimum["low"], optimum["high"]
        assert program.bounds == (pytest.approx(bounds, rel=1e-12) if row["kernel"] else bounds)
        assert program.certificate.error <= 1e-8 * program.norm
        own = confirm.Program(tmp_path / f"{row['name']}.npz")
        value, gap, floor = own.certify(own.d, own.lam, own.p)
        assert gap <= program.certificate.gap + program.certificate.floor + floor
        assert value == pytest.approx(optimum["value"], abs=optimum["high"] - optimum["low"] + floor)
        assert (count_degenerate(program) > 0) == (row["grade"] == "degenerate")
    assert confirm.main(tmp_path) == 0
    told = capsys.readouterr().out
    assert f"{len(manifest)} of {len(manifest)} are confirmed: {len(rows)} optima, 2 proofs" in told
    assert (tmp_path / "confirm.py").read_text() == SCRIPT.read_text()
    assert {path.name for path in tmp_path.iterdir()} >= {"README.md", "LICENSE.txt", "CITATION.cff"}


def count_degenerate(program):
    """Count norm terms with zero slip and a multiplier at the bound, up to 1e-9."""
    slip = np.linalg.norm(program.slip(program.answer.d), axis=1)
    room = program.w - np.linalg.norm(program.answer.lam, axis=1)
    return np.count_nonzero((slip <= 1e-9 * slip.max(initial=0.0)) & (room <= 1e-9 * program.w))


@pytest.mark.long
@pytest.mark.parametrize("status", ["infeasible", "unbounded"])
def test_the_script_refuses_a_false_proof(tmp_path, status):
    write_collection(tmp_path, instances=[one for one in choose_small() if one.without == status])
    (row,) = read_manifest(tmp_path)
    assert kind_of(row) == "no optimum"
    program, vector = confirm.Program(tmp_path / f"{row['name']}.npz"), np.array(row["certificate"])
    assert confirm.is_proof(program, status, vector)
    assert not confirm.is_proof(program, status, -vector)
    assert not confirm.is_proof(program, status, np.ones_like(vector))


@pytest.mark.long
def test_the_script_does_not_confirm_answers_with_understated_gaps(tmp_path, monkeypatch):
    write_collection(tmp_path, instances=[choose_small()[0]])
    right = confirm.Program.certify
    monkeypatch.setattr(confirm.Program, "certify", lambda *given: (right(*given)[0], 0.0, 0.0))
    assert confirm.main(tmp_path) == 1


@pytest.mark.long
def test_two_collections_are_equal_byte_for_byte(tmp_path):
    for name in ("a", "b"):
        write_collection(tmp_path / name, instances=choose_small()[:3])
    for path in (tmp_path / "a").iterdir():
        assert path.read_bytes() == (tmp_path / "b" / path.name).read_bytes(), path.name


@pytest.mark.slow
def test_the_script_confirms_the_whole_collection(tmp_path):
    done = invoke("collection", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    run = subprocess.run([sys.executable, tmp_path / "confirm.py"], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    published, made = (
        list(csv.DictReader(path.read_text().splitlines())) for path in (SCRIPT.with_name(OPTIMA), tmp_path / OPTIMA)
    )
    known = {row["name"]: row for row in published}
    for row in made:
        same = known[row["name"]]
        assert [row[key] for key in ("grade", *SIZES, "status")] == [same[key] for key in ("grade", *SIZES, "status")]
        if row["low"]:
            # With a condition number up to 1e9, bounds depend on the rounding of the machine.
            tolerance = 5e-8 if row["grade"] == "incompressible" else 1e-9
            low, high = (pick(float(row[end]), float(same[end])) for pick, end in ((max, "low"), (min, "high")))
            assert low - high <= tolerance * abs(high), row["name"]
    assert "141 of 141 are confirmed: 135 optima, 6 proofs that no optimum exists" in run.stdout
