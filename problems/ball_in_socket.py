r"""A ball in a socket, which is pressed from all sides and then pushed aside: it lifts off behind.

Ball and socket are the lower halves of tetrahedra of cubes that were blown up to balls. Cells of both are as wide, so
that they approximate the sphere by one polyhedron: surfaces that do not coincide are no interface.

Up to t = 1 all is pressed by p, as in `cone_clutch.py`: both bodies are in the stress -p, and the joint, too, whatever
its shape. Then the grip, a square in the top of the ball, moves aside. The pressure rises in front and falls behind,
until the joint lifts off there; where the ball slides along the socket, friction holds it back. At each instant

$$
\text{sum of pressure and friction on the ball } - p (\text{area of the top}) e_3 + \text{ reaction of the grip } =
0,
$$

to rounding.

    vemcvx run problems/ball_in_socket.py --n 2 --steps 5 --accuracy 1e-6 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM
from vemcvx.base.canvas import light_grid, new_figure
from vemcvx.plots import deformed_body
from vemcvx.plots.style import COMPUTED, EXACT, SECOND

YOUNG, POISSON, PRESSURE, FRICTION = 1000.0, 0.3, 4.0, 0.3
RADIUS, REACH = 1.0, 2.0
ASIDE = 0.02
JOINT = "ball|socket"
UNITS = MM
SMALL = {"n": 2, "steps": 5, "accuracy": 1e-6}


def pressed(x):
    """The displacement of a body in the stress -p."""
    return -PRESSURE * (1 - 2 * POISSON) / YOUNG * x


def scene(friction=FRICTION, aside=ASIDE):
    def still(x, t):
        return min(t, 1.0) * pressed(x)

    def moved(x, t):
        return still(x, t) + aside * max(t - 1.0, 0.0) * np.array([1.0, 0.0, 0.0])

    def around(x, t):
        return np.full(len(x), PRESSURE * min(t, 1.0))

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(still, on="socket.outer"),
        vx.PrescribedDisplacement(moved, on="ball.grip"),
        vx.Pressure(around, on=["ball.top", "socket.top"]),
        vx.UnilateralContact(on=JOINT),
        vx.CoulombFriction(friction, on=JOINT),
    )


def blown_up(n, size, hollow=False):
    """Tetrahedra of the lower half of a cube, blown up to a half ball; without the cube of half the size if hollow."""
    made = vx.meshes.tetrahedra((2 * n, 2 * n, n), box=((-size, size), (-size, size), (-size, 0.0)))
    far, length = np.abs(made.points).max(axis=1), np.linalg.norm(made.points, axis=1)
    kept = np.flatnonzero(np.abs(made.centroids).max(axis=1) > (RADIUS if hollow else -1.0))
    cells = [made.cells[k] for k in kept]
    used, number = np.unique(np.concatenate([np.concatenate(cell) for cell in cells]), return_inverse=True)
    number = dict(zip(used.tolist(), range(len(used)), strict=True))
    points = made.points * np.divide(far, length, out=np.ones_like(far), where=length > 0)[:, None]
    mesh = vx.PolyhedralMesh(
        points[used], [[[number[k] for k in face.tolist()] for face in cell] for cell in cells], boundaries={}
    )
    parts = {
        "grip": lambda x, r: (x[:, 2] > -1e-9) & (r < 0.6 * RADIUS),
        "top": lambda x, r: (x[:, 2] > -1e-9) & (r >= 0.6 * RADIUS),
        "outer": lambda x, r: (x[:, 2] < -1e-9) & (r > 0.75 * size),
    }
    for name in ("top", "outer") if hollow else parts:
        mesh = mesh.with_boundary(name, lambda x, name=name: parts[name](x, np.linalg.norm(x, axis=1)))
    return mesh


def mesh(n, family="tetrahedra"):
    """A half ball n cells deep, and the socket of n from the hollow out."""
    ball, socket = blown_up(n, RADIUS), blown_up(2 * n, REACH, hollow=True)
    return vx.meshes.bodies({"ball": ball, "socket": socket})


def times(steps):
    """One step presses, the others push."""
    return np.append(0.0, np.linspace(1.0, 2.0, steps))


def joint_force(history):
    """What the joint exerts on the ball at the stored instants, (S, 3)."""
    contact = history.contact
    friction = np.einsum("smd,m->sd", contact.traction, contact.friction_lengths)
    return friction - np.einsum("sm,m,md->sd", contact.pressure, contact.lengths, contact.normals)


def picture(history):
    """The socket's stress as the ball is pushed to the right, and the pressure from behind to the front."""
    figure = new_figure(8.4, 3.4)
    body, graph = figure.subplots(1, 2)
    deformed_body(history, ax=body, view=(-0.3, -1.0, 1.6), units=UNITS)
    contact = history.contact
    for step, colour, mark in ((1, SECOND, "s"), (history.steps, COMPUTED, "o")):
        marks = {"marker": mark, "color": colour, "markersize": 3.5, "linestyle": "none"}
        graph.plot(contact.points[:, 0], contact.pressure[step], **marks, label=f"t = {history.times[step]:g} s")
    graph.axhline(PRESSURE, color=EXACT, linewidth=1.2, label="pressed from all sides")
    light_grid(graph)
    graph.legend(frameon=False, fontsize="small", loc="upper left")
    graph.set(xlabel="$x_1$ (mm)", ylabel="pressure (MPa)")
    return figure
