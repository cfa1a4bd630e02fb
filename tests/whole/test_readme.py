"""The README's program prints what the README says, and its commands are the ones that are run."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest
from typer.testing import CliRunner

import vemcvx as vx
from vemcvx.cli import app

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text()


@pytest.mark.long
def test_the_programs_print_what_is_printed_below_them(capsys, tmp_path, monkeypatch):
    """The others go on where the first ends."""
    monkeypatch.chdir(tmp_path)
    programs = re.findall(r"```python\n(.*?)```.*?```text\n(.*?)```", README, re.DOTALL)
    assert len(programs) == 3
    known = {}
    for program, printed in programs:
        exec(compile(program, "README.md", "exec"), known)
        compare(capsys.readouterr().out, printed)


def compare(said, printed):
    numbers = r"(?<![\w.])\d+(?:\.\d+)?(?:e-\d+)?"
    assert re.sub(numbers, "#", said) == re.sub(numbers, "#", printed)
    for found, written in zip(re.findall(numbers, said), re.findall(numbers, printed), strict=True):
        if "e-" in written:
            # Certificates sit at the rounding floor or the solver's own: their size is what is claimed.
            assert float(found) < 20 * float(written)
        else:
            assert float(found) == pytest.approx(float(written), abs=1e-6)


def test_commands_are_single_lines_of_which_ci_runs_one():
    commands = re.findall(r"^ {4}(python3 -m venv .*)$", README, re.MULTILINE)
    assert len(commands) == 2
    assert "vemcvx run" in commands[0]
    assert "pytest" in commands[1]
    chosen = re.search(r"sed -n '(.*?)'", (ROOT / ".ci" / "run").read_text()).group(1)
    picked = subprocess.run(["sed", "-n", chosen, ROOT / "README.md"], capture_output=True, text=True, check=True)
    assert picked.stdout.splitlines() == [commands[1]]


def test_links_lead_somewhere():
    for target in re.findall(r"\]\(([^)#]+)\)", README):
        assert (ROOT / target).exists(), target


@pytest.mark.long
def test_the_problem_file_runs_as_described(tmp_path):
    """Its pad slips as a whole in the end: friction is the coefficient times the pressure, against the drag."""
    (text,) = re.findall(r"```py\n(.*?)```", README, re.DOTALL)
    (tmp_path / "pad.py").write_text(text)
    assert "`vemcvx run pad.py --n 16" in README
    options = ["--n", "6", "--steps", "4", "--set", "coefficient=0.5", "--out"]
    done = CliRunner().invoke(app, ["run", str(tmp_path / "pad.py"), *options, str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    history = vx.read_history(tmp_path / "out")
    across, up = history.reaction("bottom")[-1]
    assert up > 0
    assert across == pytest.approx(-0.5 * up, rel=1e-8)
    assert not history.contact.sticking[-1].any()
