"""The reference: one command writes it without a warning, and every public name is on its page."""

from __future__ import annotations

import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import vemcvx

ROOT = Path(__file__).parents[2]
SCRIPT = ROOT / ".ci" / "reference.py"
# Modules that the package shows as names of its own have pages of their own.
PAGES = "vemcvx", "vemcvx.meshes", "vemcvx.estimate.measures", "vemcvx.plots", "vemcvx.program", "vemcvx.testing"


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    for package in ("pdoc", "pandas"):
        pytest.importorskip(package)
    folder = tmp_path_factory.mktemp("reference")
    done = subprocess.run(
        [sys.executable, "-W", "error", SCRIPT, folder], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    return folder


def page(folder, module):
    return (folder / f"{module.replace('.', '/')}.html").read_text(encoding="utf-8")


@pytest.mark.slow
@pytest.mark.parametrize("module", PAGES)
def test_every_public_name_is_on_its_page(reference, module):
    names = set(importlib.import_module(module).__all__)
    shown = set(re.findall(r'<section id="([^".]+)">', page(reference, module)))
    modules = {name for name in names if isinstance(getattr(vemcvx, name, None), type(vemcvx))}
    assert names - modules <= shown
    assert modules <= {part.rpartition(".")[2] for part in PAGES}


@pytest.mark.slow
def test_types_are_called_by_their_names(reference):
    shown = page(reference, "vemcvx")
    assert "ArrayLike" in shown
    for spelt_out in ("_array_like", "_NestedSequence", "Annotated[", ":class:"):
        assert spelt_out not in re.sub(r'<div class="pdoc-code.*?</div>', "", shown, flags=re.S), spelt_out


def test_the_command_stands_where_contributors_look():
    assert f"python {SCRIPT.relative_to(ROOT)} " in (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
