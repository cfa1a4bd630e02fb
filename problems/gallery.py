"""The gallery: run every problem in its small setting, time it, and draw its picture.

    python problems/gallery.py [NAME ...] [--out problems/pictures] [--page]

With --page no problem is run: the program writes README.md, which shows the pictures in the folder --out.

This folder has two kinds of problem:

- A *problem file*, for `vemcvx run`, defines scene, mesh and times. For the gallery the file also defines a setting
  that runs in seconds, SMALL = {"n": .., "steps": ..}, with "accuracy" if the accuracy is not 1e-8. The function
  picture(history) of the file returns a matplotlib figure of this run. Without SMALL the gallery takes n = 8 and 8
  steps. Without picture(history) the gallery draws the deformed mesh.
- A *program* has a function main(path) that draws its own picture. `PROGRAMS` lists the quick programs.

The picture of a problem is PROBLEM.png, drawn by matplotlib in the style `STYLE`. C0, C1, ... are the colours of
vemcvx.plots, which colour-blind readers can tell apart.
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

from PIL import Image

import vemcvx as vx
from vemcvx.base.errors import SceneWarning
from vemcvx.cli.supplied import Supplied
from vemcvx.plots.style import SERIES

HERE = Path(__file__).parent
DPI = 100
PROGRAMS = (
    "elastoplastic_block",
    "elastoplastic_truss",
    "membrane_with_friction",
    "spring_slider_chain",
)
"""Programs that the gallery runs."""
STYLE = {
    "axes.axisbelow": True,
    "figure.constrained_layout.w_pad": 0.1,
    "grid.color": "0.9",
    "grid.linewidth": 0.6,
    "legend.fontsize": "small",
    "legend.frameon": False,
    "lines.linewidth": 1.3,
    "lines.markersize": 4,
}


@cache
def problem_files():
    """Return the names of the problem files: they define a mesh, and either stages or a scene and times."""
    return [path.stem for path in sorted(HERE.glob("*.py")) if Supplied(path).is_problem]


@contextlib.contextmanager
def quiet():
    """Suppress printed lines and warnings about scenes."""
    with warnings.catch_warnings(), contextlib.redirect_stdout(None):
        warnings.simplefilter("ignore", SceneWarning)
        yield


def small_run(problem):
    """Return the history of a problem file in its small setting."""
    small = {"n": 8, "steps": 8, "accuracy": 1e-8, **getattr(problem, "SMALL", {})}
    mesh, runs = problem.mesh(small["n"]), [getattr(problem, "initial", None)]
    has_stages = hasattr(problem, "stages")
    with quiet():
        for scene, times in problem.stages() if has_stages else [(problem.scene(), problem.times(small["steps"]))]:
            runs.append(vx.simulate(scene, mesh, times, initial=runs[-1], solver=vx.Newton(small["accuracy"])))
    return vx.joined(runs[1:]) if has_stages else runs[-1]


def picture(problem, history):
    """Return the figure of a problem file's history."""
    import matplotlib
    from cycler import cycler

    with quiet(), matplotlib.rc_context({**STYLE, "axes.prop_cycle": cycler(color=SERIES)}):
        if hasattr(problem, "picture"):
            return problem.picture(history)
        return vx.plots.deformed_mesh(history, units=getattr(problem, "UNITS", None))


def draw(name, folder):
    """Run a problem, write its picture, and return a line with its seconds and size."""
    path, start = folder / f"{name}.png", time.perf_counter()
    if name in PROGRAMS:
        with quiet():
            importlib.import_module(name).main(path)
        shrink(path)
        return f"{name:40s} {time.perf_counter() - start:6.2f} s with its picture"
    problem = importlib.import_module(name)
    history = small_run(problem)
    seconds = time.perf_counter() - start
    picture(problem, history).savefig(path, dpi=DPI)
    shrink(path)
    return (
        f"{name:40s} {seconds:6.2f} s  {history.mesh.n_cells:5d} cells  {history.steps:3d} steps"
        f"  certified {history.certificate.max():.0e}"
    )


def shrink(path):
    """Reduce a picture to a palette of 256 colours."""
    with Image.open(path) as image:
        if image.mode != "P":
            image.convert("RGB").quantize(256, dither=Image.Dither.NONE).save(path, optimize=True)


def title(name):
    """Return the first line of a problem's docstring."""
    return ast.get_docstring(ast.parse((HERE / f"{name}.py").read_text(encoding="utf-8"))).splitlines()[0]


def write_page(folder):
    """Write README.md into `folder`, with the pictures that are named like Python files in `problems`."""
    lines = [
        "# Gallery",
        "",
        "`python problems/gallery.py --page` wrote this page. The file named below a picture draws the picture.",
        "",
    ]
    for path in sorted(folder.glob("*.png")):
        shrink(path)
        if (HERE / f"{path.stem}.py").exists():
            file = f"[`{path.stem}.py`](../{path.stem}.py)"
            lines += [f"![{path.stem}]({path.name})", "", f"{file}: {title(path.stem)}", ""]
    (folder / "README.md").write_text("\n".join(lines), encoding="utf-8")


def main(names, folder):
    """Draw the named problems, or all problems if there are no names, and print a line for each."""
    folder.mkdir(parents=True, exist_ok=True)
    known = [*problem_files(), *PROGRAMS]
    for name in names or known:
        if name not in known:
            sys.exit(f"gallery: there is no problem {name!r}; there are {', '.join(known)}.")
        print(draw(name, folder))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--out", type=Path, default=HERE / "pictures")
    parser.add_argument("--page", action="store_true", help="write the page of all pictures")
    arguments = parser.parse_args()
    if arguments.page:
        write_page(arguments.out)
    else:
        main(arguments.names, arguments.out)
