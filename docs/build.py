"""Build the site: python docs/build.py DIR [--work FOLDER].

Sphinx with MyST-NB runs the lessons and the code of the pages, and reads the docstrings; furo is the theme. They were
chosen over MkDocs because MyST-NB takes notebooks and code in pages alike, a reference that leads nowhere fails the
build, and numpydoc is the style of the docstrings. All have BSD or MIT licences; MathJax, which is shipped inside, has
Apache 2.0.

Sources are in `docs`, whose `conf.py` has the conventions; what they show stays where it lives: lessons, problem
files and pictures in `problems`, docstrings in `vemcvx`, CHANGELOG.md. Warnings are errors, and pages are checked when
they are built: every link and anchor, words for every picture, headings in order, and nothing that a browser would load
from another host.

With --work the sources and executed notebooks are kept in that folder, and code that has not changed is not run again.
"""

from __future__ import annotations

import argparse
import importlib
import json
import logging
import os
import shutil
import sys
import tempfile
import time
from importlib.util import find_spec
from pathlib import Path
from unittest.mock import MagicMock

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
sys.path[:0] = [str(ROOT), str(HERE)]
os.environ["PYTHONPATH"] = str(ROOT)  # for the kernels that run cells
START = time.perf_counter()
TEXTS = "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "LICENSE", "CITATION.cff"


def say(doing: str) -> None:
    """Print what is done, and after how many seconds it began."""
    print(f"site: {time.perf_counter() - START:4.0f} s  {doing}", flush=True)


def staged(sources: Path) -> None:
    """Put together Sphinx's folder of sources: pages of `docs`, and those written from what lives elsewhere."""
    from generator import gallery, lessons, live, reference

    say("collects pages and pictures")
    shutil.copytree(HERE, sources, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__", "build.py"))
    shutil.copytree(ROOT / "problems" / "pictures", sources / "pictures", dirs_exist_ok=True)
    (sources / "pictures" / "README.md").unlink()
    for text in TEXTS:
        shutil.copy2(ROOT / text, sources / text)
    sys.path.insert(0, str(ROOT / "problems"))
    (sources / "deviations.txt").write_text(importlib.import_module("paper_figures").deviations(), encoding="utf-8")
    writers = {"learn": lessons.write, "gallery": gallery.write, "reference": reference.write}
    for name, write in (writers | {"_static/live": live.write}).items():
        say(f"writes {name}")
        write(sources / name)
    math = Path(find_spec("sphinx-mathjax-offline").origin).parent / "static" / "mathjax"
    (sources / "_static" / "mathjax").mkdir(exist_ok=True)
    shutil.copy2(math / "tex-svg-full.js", sources / "_static" / "mathjax")


def kernel(folder: Path) -> None:
    """Give the cells this Python, one thread, and no log but errors: Jupyter finds it before any other."""
    argv = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}", "--log-level=ERROR"]
    given = {"argv": argv, "display_name": "Python 3", "language": "python", "env": {"OPENBLAS_NUM_THREADS": "1"}}
    (folder / "kernels" / "python3").mkdir(parents=True, exist_ok=True)
    (folder / "kernels" / "python3" / "kernel.json").write_text(json.dumps(given), encoding="utf-8")
    os.environ["JUPYTER_PATH"] = str(folder)
    logging.getLogger("traitlets").setLevel(logging.WARNING)


def built(sources: Path, pages: Path, work: Path, cached: bool) -> int:
    """Run Sphinx on the sources; its exit code."""
    from sphinx.cmd.build import main

    say("runs Sphinx, and the cells of lessons and pages")
    # Notebooks are run by two processes; the cache is one file, which they would write to at once.
    cells = ["-D", "nb_execution_mode=cache", "-D", f"nb_execution_cache_path={work / 'cells'}"]
    how = ["-b", "html", "-a", "-W", "--keep-going", "-n", "-d", str(work / "doctrees")]
    return int(main([*how, *(cells if cached else ["-j", "2"]), str(sources), str(pages)]))


def main() -> None:
    """Build the site, and check it; the exit code is 1 where anything is at fault."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--work", type=Path, metavar="FOLDER")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="vemcvx-site-") as passing:
        work = (asked.work or Path(passing)).resolve()
        staged(work / "sources")
        kernel(work / "jupyter")
        ended = built(work / "sources", asked.folder.resolve(), work, asked.work is not None)
        if ended:
            sys.exit(f"site: Sphinx found the faults above and ended with {ended}.")
    from generator import checks, slides

    say("writes slides")
    slides.write(asked.folder)
    say("checks pages")
    faults = checks.faults(asked.folder)
    if faults:
        sys.exit("\n".join(faults) + f"\nsite: {len(faults)} faults.")
    say(f"{asked.folder} is built")


if __name__ == "__main__":
    if find_spec("pytest") is None:
        sys.modules["pytest"] = MagicMock()  # `vemcvx.testing` is described without pytest, which only runs it
    main()
