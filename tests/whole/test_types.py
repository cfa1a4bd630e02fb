"""Strict mypy and pyright accept a typed script of a user, and find the mistakes in `WRONG`."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest
import typed_script

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[2]
SCRIPT = Path(typed_script.__file__).read_text()
WRONG = (
    "vx.System(np.eye(2), 3.0)",
    "vx.Norms(np.eye(2), 0.5, block='2')",
    "vx.Limits(np.eye(2), {})",
    "vx.Scene(vx.Traction(lambda x: x, on='left'))",
    "vx.simulate(scene(), mesh(4), times)",
    "abstract().state + 'words' * mesh(4).n_cells",
)


def check_by_mypy(folder):
    """Return the errors that mypy finds in the script, by line."""
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file", "", "--no-error-summary", "script.py"]
    done = subprocess.run(command, cwd=folder, env={"MYPYPATH": str(ROOT)}, capture_output=True, text=True, check=False)
    assert done.returncode in (0, 1), done.stderr
    return {int(line): words for line, words in re.findall(r"^script\.py:(\d+): error: (.*)$", done.stdout, re.M)}


def check_by_pyright(folder):
    """Return the errors that pyright finds in the script, by line."""
    if importlib.util.find_spec("basedpyright") is None:
        pytest.skip("basedpyright is not installed")
    options = {"typeCheckingMode": "strict", "extraPaths": [str(ROOT)], "include": ["script.py"]}
    (folder / "pyrightconfig.json").write_text(json.dumps(options))
    words = ["-c", "from basedpyright.pyright import main; main()", "--pythonpath", sys.executable, "--outputjson"]
    done = subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True, check=False)
    found = json.loads(done.stdout)
    assert found["summary"]["filesAnalyzed"] == 1
    return {each["range"]["start"]["line"] + 1: each["message"] for each in found["generalDiagnostics"]}


@pytest.mark.parametrize("check", [check_by_mypy, check_by_pyright])
def test_a_users_script_has_no_errors_of_types(check, tmp_path):
    (tmp_path / "script.py").write_text(SCRIPT)
    assert check(tmp_path) == {}


@pytest.mark.parametrize("check", [check_by_mypy, check_by_pyright])
def test_type_checkers_find_every_mistake(check, tmp_path):
    (tmp_path / "script.py").write_text("\n".join([SCRIPT, *WRONG]))
    first = SCRIPT.count("\n") + 2
    assert set(check(tmp_path)) == set(range(first, first + len(WRONG)))


def test_the_script_runs(tmp_path):
    pytest.importorskip("matplotlib")
    typed_script.main(tmp_path)
    assert (tmp_path / "slip.gif").stat().st_size > 0
