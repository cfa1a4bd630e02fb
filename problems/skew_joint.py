r"""Two blocks in space with a skew joint: a friction spring, whose loop has a closed form.

A plane cuts a column of square section. The normal of the plane leans by theta from the vertical, in a direction that
is oblique to all four sides. A vertical force P(t) loads the upper block, which slides down the slope against springs
at its sides. The springs bear the horizontal force S. With the friction coefficient mu, let phi = atan mu. In
equilibrium the upper block slides

$$ \text{down while } S = P \tan(\theta - \phi), \qquad \text{up while } S = P \tan(\theta + \phi), $$

and sticks while S is between these values. For rigid blocks, step n therefore has
S_n = clip(S_{n-1}, P_n tan(theta - phi), P_n tan(theta + phi)). S is proportional to the displacement, so every cycle
dissipates two thirds of the work of loading if tan(theta + phi) = 3 tan(theta - phi), as here. The forces balance up to
rounding although the meshes do not match. For elastic blocks the relative difference from this S is about the stiffness
of the springs divided by the stiffness of the blocks.

    vemcvx run problems/skew_joint.py --n 4 --steps 36 --plot
"""

import numpy as np

import vemcvx as vx

YOUNG, POISSON, HEIGHT = 1000.0, 0.3, 0.5
SLOPE = np.array([0.2, 0.1])
"""The joint is z = SLOPE . (x, y)."""
THETA = float(np.arctan(np.linalg.norm(SLOPE)))
FRICTION = float(np.tan(0.5 * np.arcsin(0.5 * np.sin(2 * THETA))))
"""Coefficient for which the two slopes of the loop have the ratio 3: sin 2 theta = 2 sin 2 phi."""
PHI = float(np.arctan(FRICTION))
DOWN, UP = float(np.tan(THETA - PHI)), float(np.tan(THETA + PHI))
FORCE, SPRINGS, JOINT = 1.0, 10.0, "lower|upper"
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 3, "steps": 18}


def load(t):
    """Return the vertical force P."""
    return FORCE * np.interp(t, [0, 1, 2, 3], [0, 1, 0.2, 1])


def exact_solution(instants):
    """Return S of rigid blocks at all instants."""
    S = [0.0]
    for P in load(np.asarray(instants)[1:]):
        S.append(float(np.clip(S[-1], P * DOWN, P * UP)))
    return np.array(S)


def scene(friction=FRICTION):
    def weight(x, t):
        return np.tile([0.0, 0.0, -load(t) / np.sqrt(1 + SLOPE @ SLOPE)], (len(x), 1))

    sides = [f"upper.{side}" for side in ("left", "right", "front", "back")]
    return vx.Scene(
        vx.Elasticity(YOUNG, POISSON),
        vx.Clamp(on="lower.bottom"),
        vx.Traction(weight, on="upper.top"),
        vx.ElasticFoundation(normal=SPRINGS, tangential=0.0, on=sides),
        vx.UnilateralContact(on=JOINT),
        vx.CoulombFriction(friction, on=JOINT),
    )


def lean(mesh):
    """Return the mesh, sheared so that its horizontal planes become parallel to the joint."""
    points = mesh.points.copy()
    points[:, 2] += points[:, :2] @ SLOPE
    return vx.PolyhedralMesh(points, mesh.cells, boundaries=mesh.boundaries)


def mesh(n, family="tetrahedra"):
    """Return both blocks, sheared: n cells of `family` span the lower block, and n + 1 cubes the upper block."""
    square = (-0.5, 0.5), (-0.5, 0.5)
    lower = vx.meshes.SPACE_FAMILIES[family]((n, n, 1 + n // 2), box=(*square, (-HEIGHT, 0.0)))
    upper = vx.meshes.cubes((n + 1, n + 1, 1 + n // 2), box=(*square, (0.0, HEIGHT)))
    return vx.meshes.bodies({"lower": lean(lower), "upper": lean(upper)})


def times(steps):
    return np.linspace(0.0, 3.0, steps + 1)


def forces(history):
    """Return the force of the joint on the lower block, one row per stored instant."""
    contact = history.contact
    friction = np.einsum("smd,m->sd", contact.traction, contact.friction_lengths)
    return friction - np.einsum("sm,m,md->sd", contact.pressure, contact.lengths, contact.normals)


def springs(history):
    """Return S, the horizontal force of the springs on the upper block, at the stored instants."""
    return forces(history)[:, :2] @ SLOPE / np.linalg.norm(SLOPE)


def picture(history):
    """Draw the pressure on the joint as the block begins to slide up, and the loop of load and spring force."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    face, graph = figure.subplots(1, 2)
    vx.plots.contact_face(history, step=int(history.steps * 0.6), ax=face, show="pressure", units=UNITS)
    dense = times(3000)
    graph.plot(load(dense), exact_solution(dense), "k-", label="rigid blocks")
    graph.plot(load(history.times), springs(history), "C0o", label="computed")
    graph.plot([0, 1], [[0, 0], [DOWN, UP]], ":", color="0.6", linewidth=1.0)
    small = {"fontsize": "small", "color": "0.4"}
    graph.text(0.75, 0.75 * DOWN, r" $P\,\tan(\theta - \varphi)$", ha="left", va="top", **small)
    graph.text(0.25, 0.25 * UP, r"$P\,\tan(\theta + \varphi)$ ", ha="right", va="bottom", **small)
    graph.set(xlabel="load $P$ (N)", ylabel="force of the springs $S$ (N)", ylim=(0, 1.3 * DOWN))
    graph.grid()
    graph.legend()
    return figure
