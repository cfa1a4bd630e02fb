r"""An L-shaped bracket in space: adaptive meshes resolve the infinite stress at the re-entrant edge.

The displacement is the field of Williams in a corner of 270 degrees with free sides (J. Appl. Mech. 19, 1952). In polar
coordinates r, f about the edge, with f = 0 on the bisector of the body,

$$
2 \mu u_r = r^a (-(a + 1) \cos((a + 1) f) + C (\kappa - a) \cos((a - 1) f)), \\
2 \mu u_f = r^a ((a + 1) \sin((a + 1) f) + C (\kappa + a) \sin((a - 1) f)), \\
C = -\cos((a + 1) b) / \cos((a - 1) b),
$$

with the shear modulus mu, b = 3 pi / 4, kappa = 3 - 4 nu and the root a = 0.5445 of sin(2 a b) = a. This displacement
is prescribed on the sides far from the edge. The ends z = const slide in their planes. The exact strains give the true
error.

Cells at the distance r from the edge have the size h(r). Up to constants, the squared error is int r^(2a - 3) h^2 dr,
and the number N of cells is int r / h^3 dr. N equal cubes have h = N^(-1/3). Integrated from r = h, the first integral
gives the error h^a = N^(-a/3). The error is least if h is proportional to r^((4 - 2a) / 5). Then both integrals
converge, because a > 1/3, and the error is N^(-1/3), as for smooth fields. At the relative error d < 1, adaptive meshes
have d^(3/a - 3) = d^2.5 times as many cells as equal cubes, up to a constant. Measured ratios of nodes (adaptive
tetrahedra to equal cubes) are .20 at d = 19 % and .16 at d = 17 %.

    vemcvx run problems/bracket_in_space.py --n 16 --steps 1 --plot
"""

import numpy as np

import vemcvx as vx

YOUNG, POISSON, DEPTH, SIZE = 200.0, 0.3, 0.25, 1e-2
EXPONENT = 0.5444837367824622
BEND = 0.75 * np.pi
SHEAR, KAPPA = YOUNG / (2 * (1 + POISSON)), 3 - 4 * POISSON
RATIO = -np.cos((EXPONENT + 1) * BEND) / np.cos((EXPONENT - 1) * BEND)
FAR, ENDS = ["left", "right", "front", "back"], ["bottom", "top"]
AXES = np.array([[-1.0, -1.0], [1.0, -1.0]]) / np.sqrt(2)
"""Unit vectors along the bisector into the body, and across it."""
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 8, "steps": 1}


def exact(x):
    """Return the displacement (m, 2) at points (m, 2 or 3)."""
    a, (along, across) = EXPONENT, AXES @ (x[:, :2] - 0.5).T
    r, f = np.hypot(along, across), np.arctan2(across, along)
    u_r = -(a + 1) * np.cos((a + 1) * f) + RATIO * (KAPPA - a) * np.cos((a - 1) * f)
    u_f = (a + 1) * np.sin((a + 1) * f) + RATIO * (KAPPA + a) * np.sin((a - 1) * f)
    inside = np.column_stack([u_r * np.cos(f) - u_f * np.sin(f), u_r * np.sin(f) + u_f * np.cos(f)])
    return SIZE * (r**a / (2 * SHEAR))[:, None] * inside @ AXES


def strain(x, t):
    """Return strains (m, 6) at points (m, 3) by central differences."""
    step = 1e-5 * np.linalg.norm(x[:, :2] - 0.5, axis=1)[:, None]
    xx, xy = ((exact(x + step * axis) - exact(x - step * axis)).T / (2 * step[:, 0]) for axis in np.eye(3)[:2])
    none = 0.0 * xx[0]
    return t * np.column_stack([xx[0], xy[1], none, xx[1] + xy[0], none, none])


def scene():
    def far(x, t):
        return t * np.column_stack([exact(x), 0.0 * x[:, 0]])

    return vx.Scene(vx.Elasticity(YOUNG, POISSON), vx.PrescribedDisplacement(far, on=FAR), vx.Symmetry(on=ENDS))


def mesh(n, family="l_shape"):
    """Return equal cubes, n along each arm."""
    return vx.meshes.l_shape(n).extruded(np.linspace(0.0, DEPTH, max(1, round(n * DEPTH)) + 1))


def tetrahedra(n):
    """Return equal tetrahedra, six per cube of `mesh`."""
    whole = vx.meshes.tetrahedra((n, n, max(1, round(n * DEPTH))), ((0.0, 1.0), (0.0, 1.0), (0.0, DEPTH)))
    inside = whole.centroids[:, :2].min(axis=1) < 0.5
    used, cells = np.unique(np.array(whole.cells)[inside], return_inverse=True)
    return vx.PolyhedralMesh(whole.points[used], cells.reshape(-1, 4, 3))


def times(steps):
    return np.linspace(0.0, 1.0, steps + 1)


def relative_error(history):
    """Return the relative energy error against the closed form."""
    return vx.measures.energy_error(history, strain).relative


def adapt(target):
    """Refine `tetrahedra(4)` until the estimated error is at most the target; return the last run."""
    return vx.adapt(scene(), tetrahedra(4), times(1), target).history


def picture(history):
    """Draw the bracket on an adaptive mesh, and true errors against the number of nodes."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 3.4), layout="constrained")
    body, graph = figure.subplots(1, 2)
    uniform = [vx.simulate(scene(), mesh(n), times(1)) for n in (8, 12, 16, 24)]
    fine = [adapt(target) for target in (0.3, 0.25, 0.2, 0.16)]
    vx.plots.deformed_body(fine[-1], ax=body, view=(1.0, 0.6, 1.2), units=UNITS)
    for runs, power, words, marks in ((uniform, EXPONENT / 3, "equal cubes", "C0o"), (fine, 1 / 3, "adaptive", "C1s")):
        nodes = np.array([run.mesh.n_nodes for run in runs])
        errors = np.array([relative_error(run) for run in runs])
        line = errors[-1] * (nodes / nodes[-1]) ** -power
        graph.plot(nodes, line, f"{marks[:2]}-", label=f"$N^{{-{power:.2f}}}$")
        graph.plot(nodes, errors, marks, label=words)
    graph.set(xscale="log", yscale="log", xlabel="nodes", ylabel="relative energy error")
    graph.set_xticks([100, 200, 500, 1000, 2000, 4000], ["100", "200", "500", "1000", "2000", "4000"])
    graph.set_yticks([0.14, 0.16, 0.2, 0.24, 0.28], ["0.14", "0.16", "0.2", "0.24", "0.28"])
    graph.minorticks_off()
    graph.grid()
    graph.legend()
    return figure
