"""The source distribution is complete, and the citation names this version."""

from __future__ import annotations

import re
import subprocess
import sys
import tarfile
import tomllib
from pathlib import Path

import pytest

import vemcvx as vx

ROOT = Path(__file__).parents[2]
FOLDERS = "vemcvx", "problems", "tests", "docs", ".ci", ".github"
FILES = "README.md", "CHANGELOG.md", "CONTRIBUTING.md", "CITATION.cff", "LICENSE", "pyproject.toml"


@pytest.fixture(scope="module")
def unpacked(tmp_path_factory):
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("sdist")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", str(folder)]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    with tarfile.open(next(folder.glob("*.tar.gz"))) as packed:
        packed.extractall(folder, filter="data")
    return folder / f"vemcvx-{vx.__version__}"


@pytest.mark.slow
def test_the_source_distribution_has_every_file(unpacked):
    here = {path.relative_to(ROOT) for folder in FOLDERS for path in (ROOT / folder).rglob("*") if path.is_file()}
    wanted = {path for path in here if "__pycache__" not in path.parts}
    assert wanted <= {path.relative_to(unpacked) for path in unpacked.rglob("*")}
    for name in FILES:
        assert (unpacked / name).read_bytes() == (ROOT / name).read_bytes()


def test_the_citation_names_this_version():
    entries = dict(re.findall(r'^([a-z-]+): "?([^"\n]+)"?$', (ROOT / "CITATION.cff").read_text(encoding="utf-8"), re.M))
    assert entries["version"] == vx.__version__
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["version"] == vx.__version__
    assert re.fullmatch(r"\d{4}-\d\d-\d\d", entries["date-released"])
