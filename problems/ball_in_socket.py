r"""A ball in a socket, pressed from all sides and then pushed aside: the joint opens behind the ball.

Both bodies lie below the plane x_3 = 0. Each mesh is half a cube of tetrahedra, inflated to a half ball. At the joint,
cells of both bodies have the same width, so that both meshes replace the sphere by the same polyhedron.

Up to t = 1 the pressure p acts on both bodies from all sides. The stress is -p I in both bodies, with the identity I.
Then the grip, the middle of the flat top of the ball, moves aside. The pressure of the joint rises in front of the ball
and falls behind the ball, until the joint opens. Let A be the area of the top outside the grip, and e_3 the unit vector
along x_3. The forces on the ball balance up to rounding:

$$ \text{sum of pressure and friction of the joint } - p A e_3 + \text{ reaction of the grip } = 0. $$

    vemcvx run problems/ball_in_socket.py --n 2 --steps 5 --accuracy 1e-6 --plot
"""

import numpy as np

import vemcvx as vx

YOUNG, POISSON, PRESSURE, FRICTION = 1000.0, 0.3, 4.0, 0.3
RADIUS, REACH = 1.0, 2.0
ASIDE = 0.02
JOINT = "ball|socket"
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 2, "steps": 5, "accuracy": 1e-6}


def uniform_compression(x):
    """Return the displacements at points x (m, 3) under the stress -p I, with p = PRESSURE."""
    return -PRESSURE * (1 - 2 * POISSON) / YOUNG * x


def scene(friction=FRICTION, aside=ASIDE):
    def compress(x, t):
        return min(t, 1.0) * uniform_compression(x)

    def move_grip(x, t):
        return compress(x, t) + aside * max(t - 1.0, 0.0) * np.array([1.0, 0.0, 0.0])

    def press(x, t):
        return np.full(len(x), PRESSURE * min(t, 1.0))

    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.PrescribedDisplacement(compress, on="socket.outer"),
        vx.PrescribedDisplacement(move_grip, on="ball.grip"),
        vx.Pressure(press, on=["ball.top", "socket.top"]),
        vx.UnilateralContact(on=JOINT),
        vx.CoulombFriction(friction, on=JOINT),
    )


def inflate_cube(n, size, hollow=False):
    """Return a half ball of the radius `size`; if `hollow`, without the inner half ball of the radius `RADIUS`."""
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
    """Return a half ball and its socket; each is n cells thick."""
    ball, socket = inflate_cube(n, RADIUS), inflate_cube(2 * n, REACH, hollow=True)
    return vx.meshes.bodies({"ball": ball, "socket": socket})


def times(steps):
    """Return the instants: in the first step the bodies are pressed, in the others the grip moves."""
    return np.append(0.0, np.linspace(1.0, 2.0, steps))


def joint_force(history):
    """Return the force of the joint on the ball at the stored instants, (S, 3)."""
    contact = history.contact
    friction = np.einsum("smd,m->sd", contact.traction, contact.friction_lengths)
    return friction - np.einsum("sm,m,md->sd", contact.pressure, contact.lengths, contact.normals)


def picture(history):
    """Draw the pushed ball in its socket, and the pressure along the joint before and after the push."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 3.4), layout="constrained")
    body, graph = figure.subplots(1, 2)
    vx.plots.deformed_body(history, ax=body, view=(-0.3, -1.0, 1.6), units=UNITS)
    contact = history.contact
    for step, marks in ((1, "C1s"), (history.steps, "C0o")):
        graph.plot(contact.points[:, 0], contact.pressure[step], marks, label=f"t = {history.times[step]:g} s")
    graph.axhline(PRESSURE, color="black", label="pressed from all sides")
    graph.set(xlabel="$x_1$ (mm)", ylabel="pressure (MPa)")
    graph.grid()
    graph.legend(loc="upper left")
    return figure
