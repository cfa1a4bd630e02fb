"""The program of the README prints the text below it, and continuous integration runs the commands of the README."""

from __future__ import annotations

import re
import subprocess

import pytest
from texts import README, ROOT, page

import vemcvx as vx
from vemcvx.cli.supplied import problem_files

TEXT = README.read_text()


@pytest.mark.long
def test_the_program_prints_the_text_below_it(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    ((program, printed),) = re.findall(r"```python\n(.*?)```.*?```text\n(.*?)```", TEXT, re.DOTALL)
    exec(compile(program, "README.md", "exec"), {})
    assert_same_numbers(capsys.readouterr().out, printed)


def assert_same_numbers(said, printed):
    numbers = r"(?<![\w.])\d+(?:\.\d+)?(?:e-\d+)?"
    assert re.sub(numbers, "#", said) == re.sub(numbers, "#", printed)
    for found, written in zip(re.findall(numbers, said), re.findall(numbers, printed), strict=True):
        if "e-" in written:
            # Certificates at the rounding floor depend on the machine.
            assert float(found) < 20 * float(written)
        else:
            assert float(found) == pytest.approx(float(written), abs=1e-6)


def test_both_commands_are_single_lines_and_ci_runs_the_second():
    commands = re.findall(r"^ {4}(python3 -m venv .*)$", TEXT, re.MULTILINE)
    assert len(commands) == 2
    assert "vemcvx run" in commands[0]
    assert "pytest" in commands[1]
    chosen = re.search(r"sed -n '(.*?)'", (ROOT / ".ci" / "run").read_text()).group(1)
    picked = subprocess.run(["sed", "-n", chosen, README], capture_output=True, text=True, check=True)
    assert picked.stdout.splitlines() == [commands[1]]


def list_steps(name):
    """Return the actions and the commands of a GitHub workflow, in order."""
    yaml = pytest.importorskip("yaml")
    jobs = yaml.safe_load((ROOT / ".github" / "workflows" / f"{name}.yml").read_text(encoding="utf-8"))["jobs"]
    return [step.get("uses") or step["run"] for job in jobs.values() for step in job.get("steps", [])]


def test_the_workflow_runs_the_commands_and_builds_the_site():
    commands = re.findall(r"^ {4}python3 (-m venv .*)$", TEXT, re.MULTILINE)
    (site,) = re.findall(r"`(pip install .*docs/build.py site)`", TEXT, re.MULTILINE)
    wanted = [f"python {command}".replace(".venv/bin/", ".venv/${{ matrix.bin }}/") for command in commands]
    assert [step for step in list_steps("tests") if "venv" in step or "docs" in step] == [*wanted, site]


def test_the_readme_names_files_without_links():
    """Relative links would be broken where PyPI shows the README."""
    assert re.findall(r"\]\((?!http)", TEXT) == []


def test_numbers_of_effects_families_lessons_and_commands_are_right():
    effects = re.findall(r"^\| `\w+` \|", page("effects"), re.MULTILINE)
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert all(f"{len(effects)} effects" in text for text in (TEXT, changes))
    families = re.findall(r"^`vx.meshes.([^`(]*)` take `", page("meshes"), re.MULTILINE)
    names = ", ".join(families).split(", ")
    assert len(names) == 13
    assert all(callable(getattr(vx.meshes, name)) for name in names)
    assert {*vx.meshes.FAMILIES, *vx.meshes.SPACE_FAMILIES} <= set(names)
    assert all("thirteen families" in text for text in (TEXT, changes))
    lessons = [path for path in (ROOT / "problems" / "lessons").glob("*.py") if "solutions" not in path.stem]
    assert len(lessons) == 11
    assert "eleven lessons" in TEXT
    assert f"{len(problem_files())} problem files" in changes
    commands = re.findall(r"^\| `vemcvx ", page("howto/command_line"), re.MULTILINE)
    assert len(commands) == 12
    assert "twelve commands" in TEXT
