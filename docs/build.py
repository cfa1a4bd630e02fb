"""Build the site: python docs/build.py DIR [--work FOLDER].

The build runs the lessons and the code cells of the pages. Sphinx then makes the pages. With --work, the build keeps
sources and executed notebooks in FOLDER, and does not run unchanged code again. `docs/README.md` has the conventions
for pages.
"""

from __future__ import annotations

import argparse
import importlib
import json
import logging
import os
import shutil
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
START = time.perf_counter()
TEXTS = "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "LICENSE", "CITATION.cff"
PROCESSES = 2
"""Number of Jupyter kernels, and of Sphinx's processes."""


def report(task: str) -> None:
    """Print a task, and the seconds since the start."""
    print(f"site: {time.perf_counter() - START:4.0f} s  {task}", flush=True)


def collect_sources(sources: Path) -> None:
    """Write pages, lessons, problems and pictures into Sphinx's folder of sources."""
    from generator import gallery, lessons

    report("collects pages and pictures")
    shutil.copytree(HERE, sources, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__", "build.py"))
    shutil.copytree(ROOT / "problems" / "pictures", sources / "pictures", dirs_exist_ok=True)
    (sources / "pictures" / "README.md").unlink()
    for text in TEXTS:
        shutil.copy2(ROOT / text, sources / text)
    sys.path.insert(0, str(ROOT / "problems"))
    (sources / "deviations.txt").write_text(importlib.import_module("paper_figures").deviations(), encoding="utf-8")
    lessons.write(sources / "learn")
    gallery.write(sources / "gallery")
    math = Path(find_spec("sphinx-mathjax-offline").origin).parent / "static" / "mathjax"
    for folder in ("mathjax", "live"):
        (sources / "_static" / folder).mkdir(exist_ok=True)
    shutil.copy2(math / "tex-svg-full.js", sources / "_static" / "mathjax")


def write_kernel(folder: Path) -> None:
    """Write a Jupyter kernel with one thread, and set JUPYTER_PATH."""
    argv = [sys.executable, "-m", "ipykernel_launcher", "-f", "{connection_file}", "--log-level=ERROR"]
    threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONPATH": str(ROOT)}
    spec = {"argv": argv, "display_name": "Python 3", "language": "python", "env": threads}
    (folder / "kernels" / "python3").mkdir(parents=True, exist_ok=True)
    (folder / "kernels" / "python3" / "kernel.json").write_text(json.dumps(spec), encoding="utf-8")
    os.environ["JUPYTER_PATH"] = str(folder)
    logging.getLogger("traitlets").setLevel(logging.WARNING)


def run_code(sources: Path, folder: Path) -> None:
    """Write the pages of `vemcvx app --html`, and run the code cells that are not in the cache."""
    from generator.gallery import LIVE
    from jupyter_cache import get_cache
    from jupyter_cache.executors.utils import create_cache_bundle, single_nb_execution

    def run_page(page: Any) -> Any:
        with tempfile.TemporaryDirectory() as empty:
            result = single_nb_execution(page.nb, empty, timeout=300, allow_errors=False)
        report(f"ran {Path(page.uri).relative_to(sources)} in {result.time:.0f} s")
        return create_cache_bundle(page, None, None, result.time, result.exc_string)

    def write_live(name: str) -> None:
        page = sources / "_static" / "live" / f"{name}.html"
        if not page.is_file():
            command = [sys.executable, "-m", "vemcvx", "app", name, "--step", str(LIVE[name]), "--html", str(page)]
            subprocess.run(command, check=True, capture_output=True)
            report(f"wrote the live page of {name}")

    cache, uris = get_cache(folder), []
    marked = [page for page in sources.rglob("*.md") if page.read_text(encoding="utf-8").startswith("---\nfile_format")]
    for path in (*sorted((sources / "learn").glob("*.ipynb")), *marked):
        reader = {"name": "myst_nb_md" if path.suffix == ".md" else "nbformat", "type": "plugin"}
        uris += [cache.add_nb_to_project(str(path), read_data=reader).uri]
    pages = [cache.get_project_notebook(record.pk) for record in cache.list_unexecuted(filter_uris=uris)]
    report(f"runs the cells of {len(pages)} pages")
    with ThreadPoolExecutor(PROCESSES) as pool:
        live = pool.map(write_live, LIVE)
        for bundle in pool.map(run_page, pages):
            if bundle.traceback:
                pool.shutdown(cancel_futures=True)
                sys.exit(f"{bundle.uri}\n{bundle.traceback}\nsite: a cell failed.")
            cache.cache_notebook_bundle(bundle, check_validity=False, overwrite=True)
        list(live)


def main() -> None:
    """Build the site and check it; the exit code is 1 if there is a fault."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, metavar="DIR")
    parser.add_argument("--work", type=Path, metavar="FOLDER")
    options = parser.parse_args()
    from generator import checks, slides
    from sphinx.cmd.build import main as run_sphinx

    with tempfile.TemporaryDirectory(prefix="vemcvx-site-") as passing:
        work = (options.work or Path(passing)).resolve()
        collect_sources(work / "sources")
        write_kernel(work / "jupyter")
        run_code(work / "sources", work / "cells")
        report("runs Sphinx")
        flags = ["-b", "html", "-a", "-W", "--keep-going", "-j", str(PROCESSES), "-d", str(work / "doctrees")]
        flags += ["-D", f"nb_execution_cache_path={work / 'cells'}"]
        if code := run_sphinx([*flags, str(work / "sources"), str(options.folder.resolve())]):
            sys.exit(f"site: Sphinx found the faults above and ended with {code}.")
    report("writes slides")
    slides.write(options.folder)
    report("checks pages")
    if faults := checks.find_faults(options.folder.resolve()):
        sys.exit("\n".join(faults) + f"\nsite: {len(faults)} faults.")
    report(f"{options.folder} is built")


if __name__ == "__main__":
    sys.path[:0] = [str(ROOT), str(HERE)]
    main()
