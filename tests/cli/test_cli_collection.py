"""`vemcvx collection`: named, graded, equal from run to run, and confirmed by a script that knows nothing of us."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from test_cli import invoke

import vemcvx as vx
from vemcvx.cli import supplied
from vemcvx.cli.collection import INSTANCES, CollectionInstance, confirm, write_collection, writing
from vemcvx.cli.collection.benchmark import kind_of
from vemcvx.cli.collection.writing import CORE, LARGE, OPTIMA, SEQUENCES, departures
from vemcvx.exchange import sequence_from_npz

SCRIPT = Path(vx.__file__).parent / "cli" / "collection" / "confirm.py"
GRADES = {instance.grade for instance in INSTANCES}


def one_a_grade():
    """The first condensed instance of each grade that takes no time; of those without optimum one of each kind."""
    large = "cattaneo_mindlin", "janssen_silo", "shear_lag", "thermal_expansion_blocked_by_friction"
    small = [one for one in INSTANCES if one.condense and one.n <= 32 and one.problem not in large]
    first = {(one.grade, one.without): one for one in reversed(small)}
    return [first[key] for key in sorted(first)]


def test_the_list_is_named_and_graded():
    names = [instance.name for instance in INSTANCES]
    assert len(set(names)) == len(names) == 138
    hard = {"bounds", "pressure", "soft", "viscous", "sticking", "degenerate", "incompressible", "units", "discs"}
    assert {"easy", "sizes", "bodies", "floating", "no optimum"} | hard == GRADES
    assert len(CORE) == 40
    assert {one.grade for one in INSTANCES if one.name in CORE} == GRADES
    others = *LARGE, *SEQUENCES
    assert len({*names, *(one.name for one in others)}) == 138 + len(others)


def test_all_are_published():
    published = SCRIPT.with_name(OPTIMA).read_text().splitlines()
    names = {line.split(",")[0] for line in published[1:]}
    assert names == {one.name for one in (*INSTANCES, *SEQUENCES, *LARGE)}


@pytest.mark.parametrize(
    ("asked", "wanted"),
    [
        ((), {*INSTANCES, *SEQUENCES}),
        (("--large",), {*INSTANCES, *SEQUENCES, *LARGE}),
        (("--core",), CORE),
    ],
)
def test_the_command_writes_the_whole_list(tmp_path, monkeypatch, asked, wanted):
    chosen = []

    def written(folder, beside, instances, progress):
        chosen.extend(instances)
        return "written"

    monkeypatch.setattr(writing, "write_collection", written)
    assert invoke("collection", "--out", tmp_path, *asked).exit_code == 0
    assert {one.name for one in chosen} == {getattr(one, "name", one) for one in wanted}


@pytest.mark.long
def test_optima_are_those_published(tmp_path):
    """What is written here agrees with the list that came with the version, or is told."""
    small = [one for one in INSTANCES if one.name in CORE and one.problem in ("block_between_dies", "block_on_incline")]
    said = write_collection(tmp_path, instances=small)
    assert "optima.csv agrees with the published optima.csv of version 5" in said
    (row, *_) = json.loads((tmp_path / "manifest.json").read_text())["instances"]
    assert departures([{**row, "unknowns": 99}]) == [f"{row['name']} has unknowns 99, not {row['unknowns']}"]
    assert departures([{**row, "name": "new"}]) == ["new is not in the published optima.csv"]
    lower = {
        **row,
        "optimum": {**row["optimum"], "low": row["optimum"]["low"] - 2.0, "high": row["optimum"]["low"] - 1.0},
    }
    (said,) = departures([lower])
    assert said.startswith(f"{row['name']} has low {lower['optimum']['low']!r}, not ")
    # What another machine rounds otherwise is the same.
    moved = {key: row["optimum"][key] * (1 - 1e-11) for key in ("low", "high")}
    assert departures([{**row, "optimum": {**row["optimum"], **moved}}]) == []


@pytest.mark.long
def test_a_sequence_has_its_matrices_once(tmp_path):
    """Read back it is the programs of its steps; the script that knows nothing of us confirms all of them."""
    short = [
        CollectionInstance(grade="sequences", problem=problem, n=n, of=8, step=8, steps=7)
        for problem, n in (("feng_han_huang", 8), ("block_with_grain", 6), ("block_in_space", 4))
    ]
    write_collection(tmp_path / "all", instances=short)
    for one in short:
        write_collection(tmp_path / "one", instances=[replace(one, steps=1)])
        last = vx.read_program(tmp_path / "one" / f"{replace(one, steps=1).name}.npz")
        programs = sequence_from_npz(tmp_path / "all" / f"{one.name}.npz")
        assert [program.step for program in programs] == [2, 3, 4, 5, 6, 7, 8]
        assert all(program.operators is programs[0].operators for program in programs)
        # Forces out of balance are differences of larger ones; their last digits depend on what was posed before.
        (low, high), (lowest, highest) = last.bounds, programs[-1].bounds
        assert max(low, lowest) <= min(high, highest)
        words = json.loads((tmp_path / "all" / f"{one.name}.json").read_text())
        assert words["optimum"]["low"] == sum(program.bounds[0] for program in programs)
        assert words["optimum"]["energy_norm"] == max(program.norm for program in programs)
        assert len(confirm.Program(tmp_path / "all" / f"{one.name}.npz").steps()) == 7
    assert confirm.main(tmp_path / "all") == 0


def test_the_script_needs_three_packages():
    tree = ast.parse(SCRIPT.read_text())
    names = {alias.name for node in ast.walk(tree) if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    others = {name.split(".")[0] for name in names} - set(sys.stdlib_module_names)
    assert others == {"numpy", "scipy", "clarabel"}


@pytest.mark.long
def test_what_is_written_is_confirmed(tmp_path, capsys):
    """In each grade: the manifest says what the files hold, and independent gaps agree with ours."""
    said = write_collection(tmp_path, "mtx", instances=one_a_grade())
    assert said.startswith(f"{len(GRADES) + 1} instances of 'vemcvx collection 5'")
    every = json.loads((tmp_path / "manifest.json").read_text())["instances"]
    assert {row["grade"] for row in every} == GRADES
    rows = [row for row in every if "optimum" in row]
    assert {row["status"] for row in every if row not in rows} == {"infeasible", "unbounded"}
    for row in rows:
        program = vx.read_program(tmp_path / f"{row['name']}.npz")
        other = vx.read_program(tmp_path / f"{row['name']}.mtx")
        assert len(program.g) == len(other.g) == row["unknowns"]
        # Beside a kernel factors of K differ in how they are anchored: bounds differ by rounding.
        bounds = row["optimum"]["low"], row["optimum"]["high"]
        assert program.bounds == (pytest.approx(bounds, rel=1e-12) if row["kernel"] else bounds)
        assert program.certificate.error <= 1e-8 * program.norm
        own = confirm.Program(tmp_path / f"{row['name']}.npz")
        value, gap, floor = own.certify(own.d, own.lam, own.p)
        assert gap <= program.certificate.gap + program.certificate.floor + floor
        optimum = row["optimum"]
        assert value == pytest.approx(optimum["value"], abs=optimum["high"] - optimum["low"] + floor)
        assert (degenerate(program) > 0) == (row["grade"] == "degenerate")
    assert (tmp_path / "confirm.py").read_text() == SCRIPT.read_text()
    assert confirm.main(tmp_path) == 0
    said = capsys.readouterr().out
    assert f"{len(every)} of {len(every)} are confirmed: {len(rows)} optima, 2 proofs that no optimum exists" in said
    assert f"by certified error: {len(rows)} within 0.001" in said


def degenerate(program):
    """Number of norm terms at rest and at their bound at once, but for what the certificate leaves open."""
    slip = np.linalg.norm(program.slip(program.answer.d), axis=1)
    room = program.w - np.linalg.norm(program.answer.lam, axis=1)
    return np.count_nonzero((slip <= 1e-9 * slip.max(initial=0.0)) & (room <= 1e-9 * program.w))


@pytest.mark.long
@pytest.mark.parametrize("status", ["infeasible", "unbounded"])
def test_a_proof_that_is_none_is_refused(tmp_path, status):
    """A multiplier of the other sign, a ray the other way."""
    write_collection(tmp_path, instances=[one for one in one_a_grade() if one.without == status])
    (row,) = json.loads((tmp_path / "manifest.json").read_text())["instances"]
    assert kind_of(row) == "no optimum"
    program, vector = confirm.Program(tmp_path / f"{row['name']}.npz"), np.array(row["certificate"])
    assert confirm.is_proof(program, status, vector)
    assert not confirm.is_proof(program, status, -vector)
    assert not confirm.is_proof(program, status, np.ones_like(vector))


@pytest.mark.long
def test_the_folder_says_what_it_is_and_is_whole(tmp_path):
    write_collection(tmp_path, instances=[one_a_grade()[0]])
    for line in (tmp_path / "SHA256SUMS.txt").read_text().splitlines():
        digest, name = line.split("  ")
        assert sha256((tmp_path / name).read_bytes()).hexdigest() == digest
    assert {path.name for path in tmp_path.iterdir()} >= {"README.md", "LICENSE.txt", "CITATION.cff", "confirm.py"}
    assert "Version 5" in (tmp_path / "README.md").read_text()


@pytest.mark.long
def test_an_optimum_that_is_none_is_not_confirmed(tmp_path, monkeypatch):
    """Gaps that are too small by far are found out by any other answer."""
    write_collection(tmp_path, instances=[one_a_grade()[0]])
    right = confirm.Program.certify
    monkeypatch.setattr(confirm.Program, "certify", lambda *given: (right(*given)[0], 0.0, 0.0))
    assert confirm.main(tmp_path) == 1


@pytest.mark.long
def test_it_is_the_same_every_time(tmp_path):
    for name in ("a", "b"):
        write_collection(tmp_path / name, "cbf", instances=one_a_grade()[:3])
    files = sorted(path.name for path in (tmp_path / "a").iterdir())
    for name in files:
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name


def test_what_cannot_be_made_is_refused(tmp_path, monkeypatch):
    done = invoke("collection", "--out", tmp_path / "new", "--format", "sif")
    assert done.exit_code == 2
    assert "--format: found format 'sif'; there are 'npz'" in done.output
    monkeypatch.setattr(supplied, "PACKAGE", tmp_path / "vemcvx")
    done = invoke("collection", "--out", tmp_path / "new")
    assert done.exit_code == 2
    assert "found no problem files" in done.output


@pytest.mark.slow
def test_the_whole_collection_is_confirmed(tmp_path):
    done = invoke("collection", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    run = subprocess.run([sys.executable, tmp_path / "confirm.py"], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    assert "optima.csv agrees with the published optima.csv of version 5" in " ".join(done.output.split())
    assert "141 of 141 are confirmed: 135 optima, 6 proofs that no optimum exists" in run.stdout
