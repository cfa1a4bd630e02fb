"""The commands and their options; the modules that do the work are imported when a command needs them.

Results go to standard output; errors, warnings and the progress bar (on a terminal only) go to standard error.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from importlib import import_module
from pathlib import Path
from typing import Annotated, Any

import typer

from vemcvx.cli.terminal import NOT_CERTIFIED, check_writable, reported, say
from vemcvx.errors import ProblemError
from vemcvx.interrupt import as_usual
from vemcvx.version import __version__

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Quasistatic frictional contact on polygonal meshes, posed as certified convex programs.",
    epilog="Exit codes: 0 done, 2 invalid input, 3 not certified.",
)

# Names that shells complete, `vemcvx --install-completion` turns it on; and options that several commands have.


def _completing(module: str, names: Callable[[Any], Iterable[object]]) -> Callable[[str], list[str]]:
    """A function for typer that completes the last of words with commas by the names that a module knows."""

    def complete(incomplete: str) -> list[str]:
        before, comma, last = incomplete.rpartition(",")
        return [f"{before}{comma}{name}" for name in names(import_module(module)) if str(name).startswith(last)]

    return complete


def _here() -> list[str]:
    return sorted(path.name for path in Path().glob("*.py"))


problem_names = _completing("vemcvx.cli.supplied", lambda module: [*module.problem_files(), *_here()])
families = _completing("vemcvx.meshes", lambda module: module.FAMILIES)
solver_names = _completing("vemcvx.cli.solver_names", lambda module: module.completions())
linear_solvers = _completing("vemcvx.cli.solver_names", lambda module: module.LINEAR)
lesson_numbers = _completing("vemcvx.cli.supplied", lambda module: module.lessons())

File = Annotated[
    str,
    typer.Argument(
        metavar="FILE",
        autocompletion=problem_names,
        help="A problem file: Python with scene(**parameters), mesh(n), times(steps); or a name that `problems` lists.",
    ),
]
Mesh = Annotated[
    str | None,
    typer.Option(
        autocompletion=families,
        help="Family of meshes, such as squares; or a mesh file that names its boundaries. (default: the problem's)",
    ),
]
Accuracy = Annotated[
    float | None, typer.Option(help="Certified relative energy error of a step. (default: the solver's own)")
]
Linear = Annotated[
    str | None,
    typer.Option(
        autocompletion=linear_solvers,
        help="superlu, pardiso or multigrid. (default: by size and what is installed)",
    ),
]
CELLS = "Cells across the shortest side."
N = Annotated[int | None, typer.Option("--n", min=1, help=f"{CELLS} (default: 16; 8 in space)")]
Steps = Annotated[int, typer.Option(min=1, help="Steps of backward Euler.")]
Condense = Annotated[bool, typer.Option(help="Solve on the contact unknowns, or on all.")]
Settings = Annotated[
    list[str], typer.Option("--set", metavar="NAME=VALUE", help="A parameter of the scene; may be repeated.")
]
Solver = Annotated[
    str,
    typer.Option(
        autocompletion=solver_names,
        help="newton, clarabel, osqp, direct, a solver that cvxpy finds (scs, highs ...), or FILE.py:CLASS.",
    ),
]
NONE: list[str] = []
"""The default of options that may be repeated."""


@app.command()
def run(
    file: File,
    mesh: Mesh = None,
    n: Annotated[
        int | None, typer.Option("--n", min=1, help=f"{CELLS} (default: 64; 8 in space and with --target)")
    ] = None,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Steps of backward Euler. (default: 64; 8, with --target)")
    ] = None,
    solver: Solver = "newton",
    accuracy: Accuracy = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the history there, for ParaView and scripts.")
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Write pictures into DIR, or results/<problem>.")] = False,
    report: Annotated[
        bool, typer.Option("--report", help="Write report.html there, too; a run that is refused writes none.")
    ] = False,
    store: Annotated[str, typer.Option(metavar="all|last|N", help="Steps to keep: all, the last, every N-th.")] = "all",
    condense: Condense = True,
    resume: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Continue the interrupted run whose --out was DIR.")
    ] = None,
    linear: Linear = None,
    target: Annotated[
        float | None, typer.Option(metavar="X", help="Choose mesh and instants for this relative energy error: 0.02.")
    ] = None,
    probes: Annotated[
        list[str], typer.Option("--probe", metavar="X,Y", help="A point (X,Y,Z in space) to follow; may be repeated.")
    ] = NONE,
    settings: Settings = NONE,
) -> None:
    """Simulate a problem, and say what came out and how certain it is."""
    with reported():
        from vemcvx.cli.problem_file import read_problem
        from vemcvx.cli.run import simulate_problem
        from vemcvx.cli.run_options import RunOptions

        if resume is not None and out is not None:
            raise ProblemError("--resume: a run goes on in the folder that holds it; leave --out away.")
        problem, usual = read_problem(file), 64 if target is None else 8
        asked = RunOptions(
            family=mesh,
            n=n or problem.usual_n(usual, mesh),
            steps=steps or usual,
            solver=solver,
            accuracy=accuracy,
            out=out or resume,
            plot=plot,
            store=store,
            condense=condense,
            settings=tuple(settings),
            resume=resume is not None,
            linear=linear,
            target=target,
            probes=tuple(probes),
            report=report,
        )
        say(simulate_problem(problem, asked))


@app.command()
def show(
    file: File,
    mesh: Mesh = None,
    n: Annotated[int | None, typer.Option("--n", min=1, help=f"{CELLS} (default: 64; 8 in space)")] = None,
    settings: Settings = NONE,
) -> None:
    """Describe a problem's scene in words: effects, unknowns, the convex program, who can solve it."""
    with reported():
        from vemcvx.cli.problem_file import read_problem
        from vemcvx.cli.show import problem_in_words

        problem = read_problem(file)
        say(problem_in_words(problem, mesh, n or problem.usual_n(64, mesh), tuple(settings)))


@app.command()
def compare(
    file: File,
    mesh: Mesh = None,
    n: N = None,
    steps: Steps = 8,
    solvers: Annotated[
        str,
        typer.Option(
            metavar="A,B,...",
            autocompletion=solver_names,
            help="Names of solvers, FILE.py:CLASS for your own, or all for every solver that is installed.",
        ),
    ] = "newton,clarabel,osqp,direct",
    accuracy: Accuracy = None,
    options: Annotated[
        list[str], typer.Option("--option", metavar="SOLVER.NAME=VALUE", help="A setting of a solver; may be repeated.")
    ] = NONE,
    tuning: Annotated[
        str, typer.Option(metavar="both|tuned|default", help="Settings of solvers that cvxpy calls.")
    ] = "both",
    time_limit: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="End each solver, in a process of its own, after so long.")
    ] = None,
    json: Annotated[Path | None, typer.Option(metavar="PATH", help="Write all figures there.")] = None,
    csv: Annotated[Path | None, typer.Option(metavar="PATH", help="Write the table there.")] = None,
    html: Annotated[Path | None, typer.Option(metavar="PATH", help="Write a page with the tables there.")] = None,
    settings: Settings = NONE,
) -> None:
    """Solve a problem by several solvers, and hold their answers against each other and their certificates."""
    with reported():
        from vemcvx.cli.compare import WRITERS, Asked, compare_solvers, in_words
        from vemcvx.cli.problem_file import read_problem

        paths = {kind: path for kind, path in (("json", json), ("csv", csv), ("html", html)) if path is not None}
        for kind, path in paths.items():
            check_writable(path, f"--{kind}")
        problem = read_problem(file)
        asked = Asked(
            family=mesh,
            n=n or problem.usual_n(16, mesh),
            steps=steps,
            solvers=solvers,
            accuracy=accuracy,
            settings=tuple(settings),
            options=tuple(options),
            tuning=tuning,
            time_limit=time_limit,
        )
        found = compare_solvers(problem, asked, lambda sentence: say(sentence, err=True))
        for kind, path in paths.items():
            path.write_text(WRITERS[kind](found), encoding="utf-8")
        typer.echo(in_words(found))
        if not found.judged.trustworthy:
            raise typer.Exit(NOT_CERTIFIED)


@app.command()
def export(
    file: File,
    steps: Annotated[str, typer.Option(metavar="N,N,...", help="The steps to write; 1 is the first.")],
    form: Annotated[str, typer.Option("--format", help="npz, mtx, cbf, qps, mps or hdf5.")] = "npz",
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="(default: results/programs_<problem>)")] = None,
    mesh: Mesh = None,
    n: N = None,
    of: Annotated[int, typer.Option(min=1, help="Steps of backward Euler that the run has.")] = 64,
    solver: Solver = "newton",
    accuracy: Accuracy = None,
    condense: Condense = True,
    linear: Linear = None,
    settings: Settings = NONE,
) -> None:
    """Write the convex programs of some steps, for other solvers, with their certified optima."""
    with reported():
        from vemcvx.cli.problem_file import read_problem
        from vemcvx.cli.run import export_programs
        from vemcvx.cli.run_options import RunOptions

        problem = read_problem(file)
        asked = RunOptions(
            family=mesh,
            n=n or problem.usual_n(16, mesh),
            steps=of,
            solver=solver,
            accuracy=accuracy,
            out=out,
            condense=condense,
            settings=tuple(settings),
            linear=linear,
        )
        say(export_programs(problem, asked, steps, form))


@app.command()
def collection(
    out: Annotated[Path, typer.Option(metavar="DIR", help="The folder to write to.")] = Path("collection"),
    form: Annotated[
        str | None, typer.Option("--format", metavar="mtx|cbf|qps|mps", help="A format to write beside npz.")
    ] = None,
) -> None:
    """Write the graded collection of convex programs, with certified optima and a script that confirms them."""
    with reported():
        from vemcvx.cli.collection import write_collection
        from vemcvx.cli.terminal import progress_bar

        with progress_bar("reading") as shown:
            say(write_collection(out, form, told=shown))


@app.command()
def cost(
    file: File,
    mesh: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            autocompletion=families,
            help="Families of meshes. (default: squares,triangles,voronoi)",
        ),
    ] = None,
    n: Annotated[str | None, typer.Option("--n", metavar="N,N,...", help=f"{CELLS} (default: 8,16,32,64,128)")] = None,
    steps: Annotated[str, typer.Option(metavar="N,N,...", help="Steps of backward Euler.")] = "8,32",
    solver: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            autocompletion=solver_names,
            help="Solvers. (default: newton, and clarabel and osqp at a few points)",
        ),
    ] = None,
    accuracy: Annotated[
        str | None, typer.Option(metavar="X,X,...", help="Certified relative energy errors of a step. (default: 1e-8)")
    ] = None,
    adaptive: Annotated[bool, typer.Option(help="Adaptive runs beside the uniform ones.")] = True,
    target: Annotated[
        str | None,
        typer.Option(
            metavar="X,X,...",
            help="Relative errors to aim at, and to give advice for. (default: 0.05,0.02,0.01; none, with --n)",
        ),
    ] = None,
    workers: Annotated[int, typer.Option(help="Processes at once.")] = 2,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Take the workers of this dask.distributed scheduler.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Table, picture, journal. (default: results/cost_<problem>)")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume/--fresh", help="Leave out the runs that DIR holds already, or begin anew.")
    ] = True,
    settings: Settings = NONE,
) -> None:
    """Measure what accuracy costs: true errors against seconds and unknowns, over meshes, steps and solvers."""
    with reported():
        from vemcvx.cli.cost import cost_of_accuracy, grid_typed
        from vemcvx.cli.problem_file import read_problem

        problem = read_problem(file)
        grid = grid_typed(problem, mesh, n, steps, solver, accuracy, target, adaptive)
        say(cost_of_accuracy(problem, grid, out, tuple(settings), workers, scheduler, not resume))


@app.command()
def problems() -> None:
    """List the problem files that came with the package; run, show, compare, cost and export take their names."""
    with reported():
        from vemcvx.cli.supplied import problem_files, problems_folder
        from vemcvx.outline import Table

        typer.echo(Table((), [(name, file.sentence) for name, file in problem_files().items()]).text())
        say(f"\nvemcvx run NAME simulates one. The files are in {problems_folder()}")


@app.command()
def lesson(
    number: Annotated[
        int | None,
        typer.Argument(metavar="[N]", autocompletion=lesson_numbers, help="Its number; without it they are listed."),
    ] = None,
) -> None:
    """List the lessons, or copy lesson N and its solutions into this folder; no file is overwritten."""
    with reported():
        from vemcvx.cli.supplied import copy_lesson, lessons
        from vemcvx.outline import Table

        if number is None:
            rows = [(str(n), file.sentence.removeprefix(f"Lesson {n}, ")) for n, file in lessons().items()]
            typer.echo(Table((), rows).text())
            say("\nvemcvx lesson N copies lesson N and its solutions into this folder.")
            return
        for path in copy_lesson(number, Path()):
            say(f"{path}")
        say("Open it as a notebook in VS Code, Jupyter (jupytext) or marimo, or run it by python.")


@app.command("app")
def live_app(
    port: Annotated[
        int | None, typer.Option(min=1, max=65535, help="Port of the page on this machine. (default: a free one)")
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
    check: Annotated[bool, typer.Option("--check", help="Run it without a browser, and say whether it works.")] = False,
    html: Annotated[Path | None, typer.Option(metavar="FILE", help="Write it as a page that needs no Python.")] = None,
) -> None:
    """Open a live page: change scene, mesh, friction, load and solver, and see what sticks and slips (extra app)."""
    with reported():
        from vemcvx.cli import live_page

        if check and html is not None:
            raise ProblemError("app: found --check and --html; give one of them.")
        if html is not None:
            check_writable(html, "--html")
            say(live_page.write(html))
        elif check:
            say(live_page.check())
        else:
            try:
                live_page.serve(port, browser)
            except KeyboardInterrupt:
                say("The page has ended.")


@app.command()
def doctor() -> None:
    """List what is installed and which solvers work, and test a closed form; exit code 1 if not all is well."""
    with reported():
        from vemcvx.cli.doctor import findings
        from vemcvx.outline import Table

        ill = []
        for found in findings():
            typer.echo(Table((), [(f"{found.subject:14}", found.words)]).text())
            ill += [] if found.well else [found.subject]
        say(f"\nNot well: {', '.join(ill)}." if ill else "\nAll is well.")
        if ill:
            raise typer.Exit(1)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"vemcvx {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Say which.")] = False,
) -> None:
    """Options of the program itself."""
    # Typer has built its commands by now, so Ctrl-C may end what follows in order.
    as_usual()


def main() -> None:
    """Run the command line on the program's arguments."""
    app(prog_name="vemcvx")
