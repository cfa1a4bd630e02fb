r"""An L-shaped bracket in space: stress is infinite along its re-entrant edge, and adaptive meshes win back the order.

Under the field that Williams found in a corner of 270 degrees with free sides (J. Appl. Mech. 19, 1952), displacements

$$
2 \mu u_r = r^a (-(a + 1) \cos(a + 1) f + C (\kappa - a) \cos(a - 1) f), \\
2 \mu u_\phi = r^a ((a + 1) \sin(a + 1) f + C (\kappa + a) \sin(a - 1) f),
\qquad C = -\cos(a + 1) b / \cos(a - 1) b,
$$

with f from the bisector of the body, b = 3 pi / 4, kappa = 3 - 4 nu and the root a = 0.5445 of sin 2 a b = a. It is
prescribed on the sides that are far from the edge; the ends slide in their planes, and strains are known everywhere.

Cells of size h(r) at the distance r from an edge make the squared error int r^(2a - 3) h^2 dr, and there are
int r / h^3 dr of them. So N equal cubes have the error N^(-a/3), and the least error has h = c r^((4 - 2a) / 5): both
integrals then converge for a > 1/3, and the error is N^(-1/3), as of smooth fields, although cells are as short along
the edge as across. For the error e adaptive meshes need e^(3/a - 3) = e^2.5 times a constant of the cells of equal
ones: measured are .20 of the nodes of equal cubes at 19 % and .16 at 17 %, although the cells are tetrahedra.

    vemcvx run problems/bracket_in_space.py --n 16 --steps 1 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form
from vemcvx.base.canvas import new_figure, plain_logarithms
from vemcvx.plots import deformed_body
from vemcvx.plots.style import SECOND

YOUNG, POISSON, DEPTH, SIZE = 200.0, 0.3, 0.25, 1e-2
EXPONENT = 0.5444837367824622
BEND = 0.75 * np.pi
SHEAR, KAPPA = YOUNG / (2 * (1 + POISSON)), 3 - 4 * POISSON
SHARE = -np.cos((EXPONENT + 1) * BEND) / np.cos((EXPONENT - 1) * BEND)
FAR, ENDS = ["left", "right", "front", "back"], ["bottom", "top"]
AXES = np.array([[-1.0, -1.0], [1.0, -1.0]]) / np.sqrt(2)
"""Along the bisector into the body, and across."""
UNITS = MM
SMALL = {"n": 8, "steps": 1}


def exact(x):
    """The displacement (m, 2) at points (m, 2 or 3)."""
    a, (along, across) = EXPONENT, AXES @ (x[:, :2] - 0.5).T
    r, f = np.hypot(along, across), np.arctan2(across, along)
    u_r = -(a + 1) * np.cos((a + 1) * f) + SHARE * (KAPPA - a) * np.cos((a - 1) * f)
    u_f = (a + 1) * np.sin((a + 1) * f) + SHARE * (KAPPA + a) * np.sin((a - 1) * f)
    inside = np.column_stack([u_r * np.cos(f) - u_f * np.sin(f), u_r * np.sin(f) + u_f * np.cos(f)])
    return SIZE * (r**a / (2 * SHEAR))[:, None] * inside @ AXES


def strain(x, t):
    """Strains (m, 6) at points (m, 3), by central differences: eight digits, for the field is a power of r."""
    step = 1e-5 * np.linalg.norm(x[:, :2] - 0.5, axis=1)[:, None]
    xx, xy = ((exact(x + step * axis) - exact(x - step * axis)).T / (2 * step[:, 0]) for axis in np.eye(3)[:2])
    none = 0.0 * xx[0]
    return t * np.column_stack([xx[0], xy[1], none, xx[1] + xy[0], none, none])


def scene():
    def far(x, t):
        return t * np.column_stack([exact(x), 0.0 * x[:, 0]])

    return vx.Scene(vx.Elasticity(YOUNG, POISSON), vx.PrescribedDisplacement(far, on=FAR), vx.Symmetry(on=ENDS))


def mesh(n, family="l_shape"):
    """Equal cubes, n along each arm."""
    return vx.meshes.l_shape(n).extruded(np.linspace(0.0, DEPTH, max(1, round(n * DEPTH)) + 1))


def tetrahedra(n):
    """Equal tetrahedra, six to each cube of `mesh`."""
    whole = vx.meshes.tetrahedra((n, n, max(1, round(n * DEPTH))), ((0.0, 1.0), (0.0, 1.0), (0.0, DEPTH)))
    inside = whole.centroids[:, :2].min(axis=1) < 0.5
    used, cells = np.unique(np.array(whole.cells)[inside], return_inverse=True)
    return vx.PolyhedralMesh(whole.points[used], cells.reshape(-1, 4, 3))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def error(history):
    """The relative energy error, against the closed form."""
    return vx.measures.energy_error(history, strain).relative


def adaptive(target):
    """The run on an adaptive mesh whose estimated error is the target, from 4 cubes of tetrahedra along each arm."""
    return vx.adapt(scene(), tetrahedra(4), times(1), target).history


def picture(history):
    """The bracket on an adaptive mesh, and true errors over nodes beside the powers of the closed form."""
    figure = new_figure(8.4, 3.4)
    body, graph = figure.subplots(1, 2)
    uniform = [vx.simulate(scene(), mesh(n), times(1)) for n in (8, 12, 16, 24)]
    fine = [adaptive(target) for target in (0.3, 0.25, 0.2, 0.16)]
    deformed_body(fine[-1], ax=body, view=(1.0, 0.6, 1.2), units=UNITS)
    for runs, power, words, how in (
        (uniform, EXPONENT / 3, "equal cubes", {}),
        (fine, 1 / 3, "adaptive", {"colour": SECOND, "marker": "s"}),
    ):
        nodes, errors = (np.array(x) for x in zip(*((run.mesh.n_nodes, error(run)) for run in runs), strict=True))
        line = nodes, errors[-1] * (nodes / nodes[-1]) ** -power
        beside_closed_form(graph, (nodes, errors), line, label=words, exact_label=f"$N^{{-{power:.2f}}}$", **how)
    graph.set(xscale="log", yscale="log", xlabel="nodes", ylabel="relative energy error")
    plain_logarithms(graph.yaxis)
    graph.set_xticks([100, 200, 500, 1000, 2000, 4000], ["100", "200", "500", "1000", "2000", "4000"])
    graph.minorticks_off()
    return figure
