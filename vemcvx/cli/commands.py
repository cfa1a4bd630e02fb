"""The commands and their options; what they do stands in the modules they call, imported when needed.

Results go to standard output; errors, warnings and the progress bar (on a terminal only) go to standard error.
"""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from vemcvx.cli import completion, learn
from vemcvx.cli.options import Accuracy, File, Linear, Mesh, N, Settings, Solver
from vemcvx.cli.terminal import NOT_CERTIFIED, reported, say
from vemcvx.errors import ProblemError
from vemcvx.interrupt import as_usual
from vemcvx.version import __version__

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    help="Quasistatic frictional contact on polygonal meshes, posed as certified convex programs.",
    epilog="Exit codes: 0 done, 2 invalid input, 3 not certified.",
)


@app.command()
def run(
    file: File,
    mesh: Mesh = None,
    n: Annotated[
        int | None,
        typer.Option("--n", min=1, help="Cells across the shortest side. (default: 64; 8 in space and with --target)"),
    ] = None,
    steps: Annotated[
        int | None, typer.Option(min=1, help="Steps of backward Euler. (default: 64; 8, with --target)")
    ] = None,
    solver: Solver = "newton",
    accuracy: Accuracy = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the history there, for ParaView and scripts.")
    ] = None,
    plot: Annotated[bool, typer.Option("--plot", help="Draw it: into DIR, or results/<problem>.")] = False,
    report: Annotated[
        bool, typer.Option("--report", help="Write report.html there, too; a run that is refused writes none.")
    ] = False,
    store: Annotated[str, typer.Option(metavar="all|last|N", help="Steps to keep: all, the last, every N-th.")] = "all",
    condense: Annotated[bool, typer.Option(help="Solve on the contact unknowns, or on all.")] = True,
    resume: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Go on with a run that was interrupted; its --out was DIR.")
    ] = None,
    linear: Linear = None,
    target: Annotated[
        float | None, typer.Option(metavar="X", help="Choose mesh and instants for this relative energy error: 0.02.")
    ] = None,
    probes: Annotated[
        list[str], typer.Option("--probe", metavar="X,Y", help="A point (X,Y,Z in space) to follow; may be repeated.")
    ] = [],  # noqa: B006 - typer wants a list and never changes it
    settings: Settings = [],  # noqa: B006 - as above
) -> None:
    """Simulate a problem, and say what came out and how certain it is."""
    with reported():
        from vemcvx.cli.problem_file import read_problem
        from vemcvx.cli.run import simulate_problem
        from vemcvx.cli.run_options import RunOptions

        if resume is not None and out is not None:
            raise ProblemError("--resume: a run goes on in the folder that holds it; leave --out away.")
        folder, going_on = (out, False) if resume is None else (resume, True)
        problem, usual = read_problem(file), 64 if target is None else 8
        asked = RunOptions(
            family=mesh,
            n=n or problem.usual_n(usual, mesh),
            steps=steps or usual,
            solver=solver,
            accuracy=accuracy,
            out=folder,
            plot=plot,
            store=store,
            condense=condense,
            settings=tuple(settings),
            resume=going_on,
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
    n: Annotated[
        int | None, typer.Option("--n", min=1, help="Cells across the shortest side. (default: 64; 8 in space)")
    ] = None,
    settings: Settings = [],  # noqa: B006 - as above
) -> None:
    """Say a problem's scene in words: effects, unknowns, the convex program, who can solve it."""
    with reported():
        from vemcvx.cli.problem_file import read_problem
        from vemcvx.cli.show import print_scene

        problem = read_problem(file)
        print_scene(problem, mesh, n or problem.usual_n(64, mesh), tuple(settings))


@app.command()
def compare(
    file: File,
    mesh: Mesh = None,
    n: N = None,
    steps: Annotated[int, typer.Option(min=1, help="Steps of backward Euler.")] = 8,
    solvers: Annotated[
        str,
        typer.Option(
            metavar="A,B,...",
            autocompletion=completion.solvers,
            help="By name, in any case; FILE.py:CLASS; all: what there is.",
        ),
    ] = "newton,clarabel,osqp,direct",
    accuracy: Accuracy = None,
    options: Annotated[
        list[str], typer.Option("--option", metavar="SOLVER.NAME=VALUE", help="A setting of a solver; may be repeated.")
    ] = [],  # noqa: B006 - as above
    tuning: Annotated[
        str, typer.Option(metavar="both|tuned|default", help="Settings of solvers that cvxpy calls.")
    ] = "both",
    time_limit: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", help="Wall-clock, for each solver: its own process is then ended."),
    ] = None,
    json: Annotated[Path | None, typer.Option(metavar="PATH", help="Write all figures there.")] = None,
    csv: Annotated[Path | None, typer.Option(metavar="PATH", help="Write the table there.")] = None,
    html: Annotated[Path | None, typer.Option(metavar="PATH", help="Write a page of its own there.")] = None,
    settings: Settings = [],  # noqa: B006 - as above
) -> None:
    """Solve a problem by several solvers, and hold their answers against each other and their certificates."""
    with reported():
        from vemcvx.cli.compare import WRITERS, Comparison, check_writable, compare_solvers, in_words
        from vemcvx.cli.problem_file import read_problem

        paths = {kind: path for kind, path in (("json", json), ("csv", csv), ("html", html)) if path is not None}
        for kind, path in paths.items():
            check_writable(path, f"--{kind}")
        problem = read_problem(file)
        asked = Comparison(
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
        found = compare_solvers(problem, asked, partial(say, err=True))
        for kind, path in paths.items():
            path.write_text(WRITERS[kind](found), encoding="utf-8")
        typer.echo(in_words(found))
        if not found.judged.trustworthy:
            raise typer.Exit(NOT_CERTIFIED)


@app.command()
def export(
    file: File,
    steps: Annotated[str, typer.Option(metavar="N,N,...", help="Which steps; 1 is the first.")],
    form: Annotated[str, typer.Option("--format", help="Of the files: npz, mtx, cbf, qps, mps or hdf5.")] = "npz",
    out: Annotated[Path | None, typer.Option(metavar="DIR", help="(default: results/programs_<problem>)")] = None,
    mesh: Mesh = None,
    n: N = None,
    of: Annotated[int, typer.Option(min=1, help="Steps of backward Euler that the run has.")] = 64,
    solver: Solver = "newton",
    accuracy: Accuracy = None,
    condense: Annotated[bool, typer.Option(help="Programs on the contact unknowns, or on all.")] = True,
    linear: Linear = None,
    settings: Settings = [],  # noqa: B006 - as above
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
            plot=False,
            store=(),
            condense=condense,
            settings=tuple(settings),
            linear=linear,
        )
        say(export_programs(problem, asked, steps, form))


@app.command()
def collection(
    out: Annotated[Path, typer.Option(metavar="DIR", help="Where to.")] = Path("collection"),
    form: Annotated[
        str | None, typer.Option("--format", metavar="mtx|cbf|qps|mps", help="One more format, beside npz.")
    ] = None,
) -> None:
    """Write the graded collection of convex programs, with certified optima and a script that confirms them."""
    with reported():
        from rich.progress import TimeRemainingColumn

        from vemcvx.cli.collection import write_collection
        from vemcvx.cli.terminal import progress_bar

        with progress_bar("reading", TimeRemainingColumn()) as shown:
            say(write_collection(out, form, told=shown))


@app.command()
def cost(
    file: File,
    mesh: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            autocompletion=completion.families,
            help="Families of meshes. (default: squares,triangles,voronoi)",
        ),
    ] = None,
    n: Annotated[
        str | None,
        typer.Option("--n", metavar="N,N,...", help="Cells across the shortest side. (default: 8,16,32,64,128)"),
    ] = None,
    steps: Annotated[str, typer.Option(metavar="N,N,...", help="Steps of backward Euler.")] = "8,32",
    solver: Annotated[
        str | None,
        typer.Option(
            metavar="A,B,...",
            autocompletion=completion.solvers,
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
        str | None, typer.Option(metavar="ADDRESS", help="A dask.distributed scheduler, whose workers are taken.")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Table, picture, journal. (default: results/cost_<problem>)")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume/--fresh", help="Leave out what DIR holds already, or begin anew.")
    ] = True,
    settings: Settings = [],  # noqa: B006 - as above
) -> None:
    """Measure what accuracy costs: true errors against seconds and unknowns, over meshes, steps and solvers."""
    with reported():
        from vemcvx.cli.cost import cost_of_accuracy, grid_typed
        from vemcvx.cli.problem_file import read_problem

        problem = read_problem(file)
        grid = grid_typed(
            problem,
            families=mesh,
            ns=n,
            steps=steps,
            solvers=solver,
            accuracies=accuracy,
            targets=target,
            adaptive=adaptive,
        )
        found = cost_of_accuracy(
            problem, grid, out, tuple(settings), workers=workers, scheduler=scheduler, fresh=not resume
        )
        say(found)


app.command()(learn.problems)
app.command()(learn.lesson)
app.command()(learn.app)
app.command()(learn.doctor)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"vemcvx {__version__}")
        raise typer.Exit


@app.callback()
def options(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Say which.")] = False,
) -> None:
    """Options of the program itself."""
    # Typer has built its commands by now; what follows ends in order.
    as_usual()


def main() -> None:
    """Run the command line on the program's arguments."""
    app(prog_name="vemcvx")
