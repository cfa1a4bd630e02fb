"""A live page: pull a block over its obstacle, and see at once what sticks, what slips, and how certain the answer is.

    vemcvx app

It is a marimo app: `marimo edit live_page.py` opens it as a notebook. Problem files whose scene takes a `bound` of
friction and the `course` of its load in time can stand in SCENES.
"""

import marimo

__generated_with = "0.25.2"
app = marimo.App(width="full", app_title="vemcvx: friction, live")

with app.setup:
    import inspect
    import io
    import time

    import marimo as mo
    import numpy as np

    import vemcvx as vx
    from vemcvx.canvas import light_grid, new_figure
    from vemcvx.cli.problem_file import read_problem
    from vemcvx.plots import deformed_mesh, friction_traction, stick_slip_map
    from vemcvx.plots.contact import contact_line
    from vemcvx.plots.style import SLIP, STORED

    SCENES = {
        "block pulled over an obstacle": ("feng_han_huang", 16),
        "viscous strip under a pull": ("kelvin_voigt_creep", 6),
        "bracket with a sharp corner": ("l_shaped_bracket", 14),
    }
    FAMILIES = [name for name in vx.meshes.FAMILIES if name != "l_shape"]  # those that fill a box
    PATHS = {
        "as in the problem file": None,
        "up": (0, 1),
        "there and back": (0, 1, 0),
        "a cycle": (0, 1, -1, 1),
        "growing cycles": (0, 0.5, -0.5, 0.75, -0.75, 1, -1),
    }
    SOLVERS = {"Newton": vx.Newton, "Clarabel": vx.Clarabel, "OSQP": vx.OSQP}
    STEPS = 30  # every turn of every path is an instant


@app.function
def course_of(path, problem):
    """The load in time, as part of the largest: the problem's own, or straight lines between the turns of a path."""
    turns = PATHS[path]
    if turns is None:
        return problem.module.course
    instants = np.linspace(*problem.times(STEPS)[[0, -1]], len(turns))
    return lambda t: np.interp(t, instants, turns)


@app.function
def solved(problem, mesh, bound, path, solver):
    """The history; where a step misses the accuracy asked for, its certificate says so."""
    scene = problem.module.scene(bound=bound, course=course_of(path, problem))
    times = problem.times(STEPS)
    return vx.simulate(scene, mesh, times, solver=SOLVERS[solver](), initial=problem.initial, check=False)


@app.function
def picture(history, step, course):
    """The body, its contact, the front between stick and slip, and the loop of load and slip, as a PNG."""
    figure = new_figure(12.4, 7.4)
    figure.set_layout_engine(None)  # fixed places: looking for good ones takes as long as all the drawing
    axes = figure.subplots(2, 2, gridspec_kw={"width_ratios": (1.0, 1.15)})
    figure.subplots_adjust(left=0.075, right=0.98, bottom=0.13, top=0.93, wspace=0.36, hspace=0.62)
    (body, front), (traction, loop) = axes
    deformed_mesh(history, step, ax=body)
    stick_slip_map(history, ax=front)
    front.axhline(history.times[history.row(step)], color="black", linewidth=1.2)
    friction_traction(history, step, ax=traction)
    draw_loop(loop, history, step, course)
    for ax in axes.flat:
        ax.set_title(ax.get_title(), y=1.02, fontsize="medium")
        ax.locator_params(nbins=5)
        where = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "borderaxespad": 4.4}
        ax.legend(ncols=3, frameon=False, fontsize="small", **where)
    png = io.BytesIO()
    figure.savefig(png, format="png", dpi=110, pil_kwargs={"compress_level": 1})
    return png.getvalue()


@app.function
def draw_loop(ax, history, step, course):
    """The load over the slip of the node that slips farthest, up to a step, and faintly what follows."""
    slip = contact_line(history, "the loop").along(history.contact.slip)
    slip = slip[:, np.abs(slip).max(axis=0).argmax()]
    load, now = course(history.times), history.row(step)
    ax.plot(slip, load, color="0.8", linewidth=1.2)
    ax.plot(slip[: now + 1], load[: now + 1], ".-", color=STORED, linewidth=1.4, markersize=4, label="so far")
    ax.plot(slip[now], load[now], "o", color=SLIP, markersize=8, label="at this instant")
    ax.set(xlabel="slip of the node that slips farthest (length)", ylabel="load / largest load", title="Hysteresis")
    light_grid(ax)


@app.function
def numbers_of(history, step):
    """What is worth knowing at a step: (name, value, what it means)."""
    now, run = history.row(step), history.trajectory
    stuck, worst, asked = history.contact.sticking[now], run.certificate.max(), run.accuracy
    kept = "asked" if worst <= asked else "missed"
    return [
        ("sticking", f"{stuck.sum()} of {len(stuck)}", "contact nodes at this step"),
        ("lost to friction", f"{run.dissipated[now]:.3g}", f"so far, of work {run.work[now]:.3g}"),
        ("gap", f"{run.gap[now]:.0e}", "energy of this step, above its minimum"),
        ("certified error", f"{worst:.0e}", f"relative, of any step; {kept}: {asked:.0e}"),
    ]


@app.cell
def _():
    scene = mo.ui.dropdown(list(SCENES), value=next(iter(SCENES)), label="scene", full_width=True)
    return (scene,)


@app.cell
def _(scene):
    name, count = SCENES[scene.value]
    problem = read_problem(name)
    usual = inspect.signature(problem.module.scene).parameters["bound"].default
    families = FAMILIES if problem.family in FAMILIES else [problem.family]
    bounds = [round(usual * tenths / 10, 9) for tenths in range(1, 26)]
    _at_the_end = {"show_value": True, "debounce": True, "full_width": True}
    _first = "voronoi" if "voronoi" in families else families[0]
    family = mo.ui.dropdown(families, value=_first, label="mesh", full_width=True)
    n = mo.ui.slider(2, 2 * count, value=count, label="n, cells across", **_at_the_end)
    bound = mo.ui.slider(steps=bounds, value=usual, label="friction bound g", **_at_the_end)
    path = mo.ui.dropdown(list(PATHS), value="a cycle", label="load path", full_width=True)
    solver = mo.ui.dropdown(list(SOLVERS), value="Newton", label="solver", full_width=True)
    step = mo.ui.slider(1, STEPS, value=STEPS, label="step shown", show_value=True, full_width=True)
    return bound, family, n, name, path, problem, solver, step


@app.cell
def _(bound, family, n, name, path, scene, solver, step):
    mo.sidebar(
        [
            mo.md("# friction, live"),
            mo.vstack([scene, family, n, bound, path, solver, step], gap=1.2),
        ],
        footer=mo.md(f"`vemcvx run {name}` simulates this problem and writes files."),
        width="19rem",
    )
    return


@app.cell
def _(family, n, problem):
    _start = time.perf_counter()
    mesh = problem.mesh(n.value, family.value)
    meshing = time.perf_counter() - _start
    return mesh, meshing


@app.cell
def _(bound, mesh, path, problem, solver):
    _start = time.perf_counter()
    history = solved(problem, mesh, bound.value, path.value, solver.value)
    solving = time.perf_counter() - _start
    return history, solving


@app.cell
def _(history, path, problem, step):
    _start = time.perf_counter()
    png = picture(history, step.value, course_of(path.value, problem))
    drawing = time.perf_counter() - _start
    return drawing, png


@app.cell
def _(drawing, history, meshing, solving, step):
    seconds = (
        "seconds",
        f"{meshing + solving + drawing:.2f}",
        f"mesh {meshing:.2f}, {history.steps} steps {solving:.2f}, picture {drawing:.2f}",
    )
    numbers = [*numbers_of(history, step.value), seconds]
    return (numbers,)


@app.cell
def _(numbers, png, problem):
    mo.vstack(
        [
            mo.md(f"**{problem.title}**"),
            mo.hstack([mo.stat(v, label=k, caption=c, bordered=True) for k, v, c in numbers], wrap=True),
            mo.image(png, alt="deformed body, stick and slip, friction and its bound, hysteresis", width="100%"),
        ]
    )
    return


if __name__ == "__main__":
    app.run()
