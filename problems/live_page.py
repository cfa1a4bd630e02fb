"""A live page: change the load on a block, and see at once which nodes stick or slip, and the certified error.

    vemcvx app [FILE]

This marimo app takes any problem file; `marimo edit live_page.py` opens the app as a notebook. A parameter of the
function `scene` has a slider if its default value is a positive number. If `scene` has the parameter `course` (the load
in time), the page offers load paths.
"""

import marimo

__generated_with = "0.25.2"
app = marimo.App(width="full", app_title="vemcvx: friction, live")

with app.setup:
    import inspect
    import os
    import time
    from base64 import b64encode
    from html import escape
    from pathlib import Path

    import marimo as mo
    import numpy as np

    import vemcvx as vx
    from vemcvx.base.canvas import as_png, light_grid, new_figure
    from vemcvx.cli.problem_file import read_problem, run_user_code
    from vemcvx.plots import (
        along_contact,
        contact_face,
        deformed_body,
        deformed_mesh,
        energy_ledger,
        friction_traction,
        stick_slip_map,
    )
    from vemcvx.plots.body import has_pyvista
    from vemcvx.plots.contact import contact_line
    from vemcvx.plots.faces import contact_faces
    from vemcvx.plots.style import SLIP, STORED, label

    SCENES = {
        "block pushed over an obstacle": ("feng_han_huang", 16),
        "viscous strip under a pull": ("kelvin_voigt_creep", 6),
        "bracket with a sharp corner": ("l_shaped_bracket", 14),
    }
    GIVEN = os.environ.get("VEMCVX_APP", "")  # the FILE of `vemcvx app FILE`
    if GIVEN and GIVEN not in [name for name, _ in SCENES.values()]:
        SCENES = {Path(GIVEN).stem: (GIVEN, None)} | SCENES
    FAMILIES = [name for name in vx.meshes.FAMILIES if name != "l_shape"]  # families that fill a box
    PATHS = {
        "as in the problem file": None,
        "up": (0, 1),
        "there and back": (0, 1, 0),
        "a cycle": (0, 1, -1, 1),
        "growing cycles": (0, 0.5, -0.5, 0.75, -0.75, 1, -1),
    }
    SOLVERS = {"Newton": vx.Newton, "Clarabel": vx.Clarabel, "OSQP": vx.OSQP}
    STEPS = 30  # with this number of steps, every path reverses at the end of a step
    WIDTH, LETTERS = 4.0, 10  # width in inches, letters in points
    GRID = "display:grid;grid-template-columns:repeat(auto-fit,minmax(min(100%,346px),1fr));gap:1.5em"


@app.function
def settings_of(problem):
    """Return the parameters of a scene that are positive numbers, and the values that sliders offer for them."""
    usual = {name: one.default for name, one in inspect.signature(problem.module.scene).parameters.items()}
    positive = {name: value for name, value in usual.items() if type(value) in (int, float) and value > 0}
    tenths = range(1, 26)
    return {
        name: (value, sorted({type(value)(round(value * tenth / 10, 9)) for tenth in tenths} - {0}))
        for name, value in positive.items()
    }


@app.function
def paths_of(problem):
    """Return the load paths of a problem: all paths if `scene` takes a `course`, else only the path of the file."""
    takes = "course" in inspect.signature(problem.module.scene).parameters and hasattr(problem.module, "course")
    return list(PATHS) if takes else list(PATHS)[:1]


@app.function
def course_of(path, problem):
    """Return the load, divided by the largest load, as a function of time; None if the problem file has no `course`."""
    turns = PATHS[path]
    if turns is None:
        return getattr(problem.module, "course", None)
    instants = np.linspace(*np.asarray(problem.times(STEPS))[[0, -1]], len(turns))
    return lambda t: np.interp(t, instants, turns)


@app.function
def solve(problem, mesh, settings, path, solver):
    """Return the history; if a step misses the requested accuracy, its certificate states the accuracy reached."""
    course = {} if PATHS[path] is None else {"course": course_of(path, problem)}
    scene = run_user_code(problem.path, "its scene", lambda: problem.module.scene(**settings, **course))
    times = problem.times(STEPS)
    return vx.simulate(scene, mesh, times, solver=SOLVERS[solver](), initial=problem.initial, check=False)


@app.function
def pictures(history, step, course, units=None):
    """Return the pictures of a step, each as (name, figure, caption)."""
    rubs = bool(history.contact.bound.any())
    if isinstance(history.mesh, vx.PolygonMesh):
        drawn = [
            drawing("deformed body", lambda ax: deformed_mesh(history, step, ax=ax, units=units), height_of(history))
        ]
        if rubs:
            drawn.append(drawing("stick and slip", lambda ax: draw_front(ax, history, step, units)))
            drawn.append(
                drawing("friction and its bound", lambda ax: friction_traction(history, step, ax=ax, units=units))
            )
            if course is not None:
                return [*drawn, drawing("hysteresis", lambda ax: draw_loop(ax, history, step, course, units))]
        elif len(history.contact.nodes):
            drawn.append(drawing("pressure", lambda ax: along_contact(history, "pressure", [step], ax=ax, units=units)))
    else:
        drawn = (
            [drawing("deformed body", lambda ax: deformed_body(history, step, ax=ax, units=units))]
            if has_pyvista()
            else []
        )
        faces = contact_faces(history) if rubs else {}
        for name in faces:
            title = "stick and slip" if len(faces) == 1 else f"stick and slip on {name}"
            drawn.append(drawing(title, lambda ax, on=name: contact_face(history, step, on=on, ax=ax, units=units)))
    return [*drawn, drawing("energies", lambda ax: draw_energies(ax, history, units))]


@app.function
def height_of(history):
    """Return the height in inches of the picture of a body."""
    across, up = np.ptp(history.mesh.points, axis=0)
    return float(np.clip(1.3 + 0.7 * WIDTH * up / across, 2.0, 3.4))


@app.function
def drawing(name, draw, height=3.4):
    """Return one picture (name, figure, caption): the title becomes the caption, the legend moves below the axes."""
    figure = new_figure(WIDTH, height)
    ax = figure.add_subplot()
    draw(ax)
    words = ax.get_title().replace("\n", "; ")
    ax.set_title("")
    for legend in [*figure.legends, *filter(None, [ax.get_legend()])]:
        legend.remove()
    handles, labels = ax.get_legend_handles_labels()
    if labels:
        narrow = {"handlelength": 1.4, "handletextpad": 0.5, "columnspacing": 1.0}
        figure.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False, **narrow)
    for text in figure.findobj(lambda one: hasattr(one, "set_fontsize")):
        text.set_fontsize(LETTERS)
    if ax.get_aspect() != "auto":
        # Labels leave less space for the body, so a second pass draws the figure again.
        for _ in range(2):
            figure.draw_without_rendering()
    return name, figure, words


@app.function
def format_numbers(numbers):
    """Return numbers, each (name, value, explanation), as a list in HTML."""
    grey = 'style="color:#595959"'
    terms = (
        f"<div><dt {grey}>{k}</dt><dd style='margin:0'><b>{v}</b> <small {grey}>{escape(c)}</small></dd></div>"
        for k, v, c in numbers
    )
    return f'<dl style="display:flex;gap:.6em 2em;flex-wrap:wrap;font-size:15px">{"".join(terms)}</dl>'


@app.function
def format_pictures(drawn):
    """Return pictures as HTML, one or two in a row, so that letters have at least 12 px."""
    figures = []
    for name, figure, words in drawn:
        source = f"data:image/png;base64,{b64encode(as_png(figure, dpi=192)).decode()}"
        image = f'<img style="width:100%" alt="{escape(f"{name}: {words}")}" src="{source}">'
        caption = f"<figcaption><b>{name.capitalize()}.</b> {escape(words)}</figcaption>"
        figures.append(f'<figure style="margin:0;max-width:560px">{image}{caption}</figure>')
    return f'<div style="max-width:1050px;{GRID};font-size:15px">{"".join(figures)}</div>'


@app.function
def draw_front(ax, history, step, units):
    """Draw where nodes stick and slip over time, and a line at the shown instant."""
    stick_slip_map(history, ax=ax, units=units)
    ax.axhline(history.times[history.row(step)], color="black", linewidth=1.5, linestyle="--", label="this instant")
    ax.set_title("where the contact boundary sticks and slips, and when")


@app.function
def draw_energies(ax, history, units):
    """Draw the energies of all steps against time."""
    energy_ledger(history, ax=ax, units=units)
    ax.set_title("where the work of the forces goes")


@app.function
def draw_loop(ax, history, step, course, units):
    """Draw the load against the slip of the node that slips farthest. The part after the step is grey."""
    slip = contact_line(history, "the loop").along(history.contact.slip)
    slip = slip[:, np.abs(slip).max(axis=0).argmax()]
    load, now = np.array([course(t) for t in history.times]), history.row(step)
    ax.plot(slip, load, color="0.7", linewidth=1.2)
    ax.plot(slip[: now + 1], load[: now + 1], ".-", color=STORED, linewidth=1.4, markersize=4, label="so far")
    ax.plot(slip[now], load[now], "o", color=SLIP, markersize=8, label="this instant")
    ax.set(
        xlabel=label("largest slip", "length", units),
        ylabel="load / largest load",
        title="the node that slips farthest",
    )
    ax.locator_params(axis="x", nbins=5)
    light_grid(ax)


@app.function
def numbers_of(history, step):
    """Return the numbers of a step: (name, value, explanation)."""
    now, run = history.row(step), history.trajectory
    stuck, worst, asked = history.contact.sticking[now], run.certified.max(), run.accuracy
    kept = run.above_asked or f"asked: {asked:.0e}"
    lost, work = history.dissipated_second_order[now], history.work_second_order[now]
    return [
        ("sticking", f"{stuck.sum()} of {len(stuck)}", "contact nodes at this step"),
        ("dissipated", f"{lost:.3g}", f"up to this step; the work of the loads is {work:.3g}"),
        ("duality gap", f"{run.gap[now]:.0e}", "the energy of this step exceeds the minimum by at most this number"),
        ("certified error", f"{worst:.0e}", f"relative error, largest of all steps; {kept}"),
    ]


@app.function
def attempt(action, *given):
    """Return the value of an action and its time in seconds; show an error of the action in place of the pictures."""
    start = time.perf_counter()
    try:
        return action(*given), time.perf_counter() - start
    except vx.VemcvxError as error:
        if not mo.running_in_notebook():
            raise
        mo.stop(True, mo.callout(str(error), kind="danger"))


@app.cell
def _():
    _first = next(label for label, (name, _) in SCENES.items() if name == (GIVEN or "feng_han_huang"))
    scene = mo.ui.dropdown(list(SCENES), value=_first, label="scene", full_width=True)
    return (scene,)


@app.cell
def _(scene):
    name, count = SCENES[scene.value]
    problem = read_problem(name)
    _count = count or problem.default_n(16)
    families = FAMILIES if problem.family in FAMILIES else [problem.family or "the problem's"]
    _at_the_end = {"show_value": True, "debounce": True, "full_width": True}
    _first = problem.family if count is None else "voronoi"
    family = mo.ui.dropdown(
        families, value=_first if _first in families else families[0], label="mesh", full_width=True
    )
    n = mo.ui.slider(2, 2 * _count, value=_count, label="n, cells across", **_at_the_end)
    settings = mo.ui.dictionary(
        {
            parameter: mo.ui.slider(steps=values, value=usual, label=parameter, **_at_the_end)
            for parameter, (usual, values) in settings_of(problem).items()
        }
    )
    _paths = paths_of(problem)
    _path = "a cycle" if count and "a cycle" in _paths else _paths[0]
    path = mo.ui.dropdown(_paths, value=_path, label="load path", full_width=True)
    solver = mo.ui.dropdown(list(SOLVERS), value="Newton", label="solver", full_width=True)
    _last = len(problem.times(STEPS)) - 1
    step = mo.ui.slider(1, _last, value=_last, label="step shown", show_value=True, full_width=True)
    return family, n, name, path, problem, settings, solver, step


@app.cell
def _(family, n, name, path, scene, settings, solver, step):
    mo.sidebar(
        [
            # marimo's smallest letters have three quarters of the font size of the root element.
            mo.Html("<style>:root{font-size:16px}</style><h1>friction, live</h1>"),
            mo.vstack([scene, step, path, *settings.elements.values(), family, n, solver], gap=1.2),
        ],
        footer=mo.md(f"`vemcvx run {name}` simulates this problem and writes files."),
        width="17rem",
    )
    return


@app.cell
def _(family, n, problem):
    _family = family.value if family.value in problem.families else None
    mesh, meshing = attempt(problem.mesh, n.value, _family)
    return mesh, meshing


@app.cell
def _(mesh, path, problem, settings, solver):
    history, solving = attempt(solve, problem, mesh, settings.value, path.value, solver.value)
    return history, solving


@app.cell
def _(history, path, problem, step):
    _start = time.perf_counter()
    drawn = format_pictures(pictures(history, step.value, course_of(path.value, problem), problem.units))
    drawing_time = time.perf_counter() - _start
    return drawing_time, drawn


@app.cell
def _(drawing_time, history, meshing, solving, step):
    seconds = (
        "seconds",
        f"{meshing + solving + drawing_time:.2f}",
        f"mesh {meshing:.2f}, {history.steps} steps {solving:.2f}, pictures {drawing_time:.2f}",
    )
    numbers = [*numbers_of(history, step.value), seconds]
    return (numbers,)


@app.cell
def _(drawn, numbers, problem):
    # The buttons of marimo need room above the title.
    _title = f'<h2 style="margin:2rem 0 0"><b>{escape(problem.title)}</b></h2>'
    mo.Html(_title + format_numbers(numbers) + drawn)
    return


if __name__ == "__main__":
    app.run()
