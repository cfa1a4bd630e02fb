"""The gallery: every problem in its small setting, timed, and its picture.

    python problems/gallery.py [NAME ...] [--out problems/pictures] [--page]

With --page nothing is run: a page of all pictures that are in the folder is written there, README.md.

There are two kinds of problem in this folder, and each says itself how it is drawn:

- a *problem file*, for `vemcvx run`: besides scene, mesh and times (and `initial`) it defines
  SMALL = {"n": .., "steps": ..}, the setting that runs in seconds (with "accuracy", if 1e-8 is out of reach), and
  picture(history), which returns a matplotlib figure of a history so computed. Without them it gets 8 cells, 8 steps
  and the deformed mesh;
- a *lesson*, a program of its own: it takes --picture FILE.

Pictures are PROBLEM.png, drawn through vemcvx.base.canvas with the colours of vemcvx.plots.style.
"""

import argparse
import ast
import contextlib
import importlib
import sys
import time
import warnings
from functools import cache
from pathlib import Path

import vemcvx as vx
from vemcvx.base.errors import SceneWarning
from vemcvx.cli.supplied import Supplied
from vemcvx.plots import deformed_mesh

HERE = Path(__file__).parent
DPI = 100
LESSONS = (
    "elastoplastic_block",
    "elastoplastic_truss",
    "membrane_with_friction",
    "spring_slider_chain",
)
"""Those that are quick; hard_cases and stabilisation_spectrum take minutes and are drawn by themselves."""


@cache
def problem_files():
    """Names of all problem files of this folder: what defines a mesh, and scene and times or stages, outermost."""
    return [path.stem for path in sorted(HERE.glob("*.py")) if Supplied(path).is_problem]


@contextlib.contextmanager
def quiet():
    """Without what scenes say each time of bodies that only contact holds, and lessons of what they compute."""
    with warnings.catch_warnings(), contextlib.redirect_stdout(None):
        warnings.simplefilter("ignore", SceneWarning)
        yield


def small_run(problem):
    """The history of a problem file in its small setting."""
    small = {"n": 8, "steps": 8, "accuracy": 1e-8, **getattr(problem, "SMALL", {})}
    mesh, found = problem.mesh(small["n"]), [getattr(problem, "initial", None)]
    has_stages = hasattr(problem, "stages")
    with quiet():
        for scene, times in problem.stages() if has_stages else [(problem.scene(), problem.times(small["steps"]))]:
            found.append(vx.simulate(scene, mesh, times, initial=found[-1], solver=vx.Newton(small["accuracy"])))
    return vx.joined(found[1:]) if has_stages else found[-1]


def picture(problem, history):
    """The figure of a problem file's history."""
    with quiet():
        if hasattr(problem, "picture"):
            return problem.picture(history)
        return deformed_mesh(history, units=getattr(problem, "UNITS", None))


def drawn(name, folder):
    """Run a problem, write its picture; what it is and the seconds of the run in a line."""
    path, start = folder / f"{name}.png", time.perf_counter()
    if name in LESSONS:
        with quiet():
            importlib.import_module(name).main(path)
        return f"{name:40s} {time.perf_counter() - start:6.2f} s with its picture"
    problem = importlib.import_module(name)
    history = small_run(problem)
    seconds = time.perf_counter() - start
    picture(problem, history).savefig(path, dpi=DPI)
    return (
        f"{name:40s} {seconds:6.2f} s  {history.mesh.n_cells:5d} cells  {history.steps:3d} steps"
        f"  certified {history.certificate.max():.0e}"
    )


def title(name):
    """The first line of what a problem says of itself."""
    return ast.get_docstring(ast.parse((HERE / f"{name}.py").read_text(encoding="utf-8"))).splitlines()[0]


def page(folder):
    """Write the page of all pictures in the folder that a problem or lesson of their name has drawn."""
    lines = [
        "# Gallery",
        "",
        "Made by `python problems/gallery.py --page`; each picture is drawn by the file named below it.",
        "",
    ]
    for path in sorted(folder.glob("*.png")):
        if (HERE / f"{path.stem}.py").exists():
            file = f"[`{path.stem}.py`](../{path.stem}.py)"
            lines += [f"![{path.stem}]({path.name})", "", f"{file}: {title(path.stem)}", ""]
    (folder / "README.md").write_text("\n".join(lines), encoding="utf-8")


def main(names, folder):
    folder.mkdir(parents=True, exist_ok=True)
    known = [*problem_files(), *LESSONS]
    for name in names or known:
        if name not in known:
            sys.exit(f"gallery: there is no problem {name!r}; there are {', '.join(known)}.")
        print(drawn(name, folder))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--out", type=Path, default=HERE / "pictures")
    parser.add_argument("--page", action="store_true", help="write a page of the pictures there are")
    asked = parser.parse_args()
    if asked.page:
        page(asked.out)
    else:
        main(asked.names, asked.out)
