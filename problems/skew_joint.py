r"""Two blocks in space with a skew joint: a friction spring, whose loop is in closed form.

A column of square section is cut by a plane whose normal leans by theta from the vertical, across both of its sides.
The upper block is loaded by a vertical force P(t) and slides down the slope against springs at its sides, which bear
the horizontal force S. With phi = atan mu, equilibrium of the upper block says that it slides

$$ \text{down while } S = P \tan(\theta - \phi), \qquad \text{up while } S = P \tan(\theta + \phi), $$

and sticks between: S_n = clip(S_{n-1}, P_n tan(theta - phi), P_n tan(theta + phi)), as stiff blocks have it. (Ring
springs of railway buffers work so: S and the way are in proportion, and in every cycle two thirds of the work are lost
with tan(theta + phi) = 3 tan(theta - phi), as here.) Forces balance exactly on any two meshes; the blocks' own
elasticity adds what the springs' stiffness is of theirs, and lets slip turn a little near edges.

    vemcvx run problems/skew_joint.py --n 4 --steps 36 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import beside_closed_form, face_and_graph

YOUNG, POISSON, HEIGHT = 1000.0, 0.3, 0.5
SLOPE = np.array([0.2, 0.1])
"""The joint is z = SLOPE . (x, y)."""
THETA = float(np.arctan(np.linalg.norm(SLOPE)))
FRICTION = float(np.tan(0.5 * np.arcsin(0.5 * np.sin(2 * THETA))))
"""By which the slopes of the loop are as three to one: sin 2 theta = 2 sin 2 phi."""
PHI = float(np.arctan(FRICTION))
DOWN, UP = float(np.tan(THETA - PHI)), float(np.tan(THETA + PHI))
FORCE, SPRINGS, JOINT = 1.0, 10.0, "lower|upper"
SMALL = {"n": 3, "steps": 18}


def load(t):
    """P(t)."""
    return FORCE * np.interp(t, [0, 1, 2, 3], [0, 1, 0.2, 1])


def closed_form(instants):
    """S at all instants, of blocks that do not deform."""
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


def leaning(mesh):
    """The mesh between planes that are parallel to the joint."""
    named = {name: faces for name, faces in mesh.boundaries.items() if name != "boundary"}
    points = mesh.points + np.column_stack([*np.zeros((2, mesh.n_nodes)), mesh.points[:, :2] @ SLOPE])
    return vx.PolyhedralMesh(points, mesh.cells, boundaries=named)


def mesh(n, family="tetrahedra"):
    """The lower block in cells of `family`, n across; the upper one in n + 1 cubes, sheared as the joint is."""
    square = (-0.5, 0.5), (-0.5, 0.5)
    lower = vx.meshes.SPACE_FAMILIES[family]((n, n, 1 + n // 2), box=(*square, (-HEIGHT, 0.0)))
    upper = vx.meshes.cubes((n + 1, n + 1, 1 + n // 2), box=(*square, (0.0, HEIGHT)))
    return vx.meshes.bodies({"lower": leaning(lower), "upper": leaning(upper)})


def times(steps):
    return np.linspace(0.0, 3.0, steps + 1)


def forces(history):
    """What the joint exerts on the lower block, at the stored instants, (S, 3)."""
    contact = history.contact
    friction = np.einsum("smd,m->sd", contact.traction, contact.friction_lengths)
    return friction - np.einsum("sm,m,md->sd", contact.pressure, contact.lengths, contact.normals)


def springs(history):
    """S, the horizontal force down the slope that the springs bear, at the stored instants."""
    return forces(history)[:, :2] @ SLOPE / np.linalg.norm(SLOPE)


def picture(history):
    """The joint as it begins to slide up, and the loop of the springs' force."""
    figure, graph = face_and_graph(history, step=int(history.steps * 0.6), show="pressure")
    dense = times(3000)
    beside_closed_form(
        graph, (load(history.times), springs(history)), (load(dense), closed_form(dense)), exact_label="rigid blocks"
    )
    for P, slope, side, words in ((0.75, DOWN, "left", "-"), (0.25, UP, "right", "+")):
        graph.plot([0, 1], [0, slope], color="0.6", linestyle=":", linewidth=1.0)
        words = rf" $P\,\tan(\theta {words} \varphi)$ "
        graph.text(
            P, P * slope, words, fontsize="small", color="0.4", ha=side, va="top" if side == "left" else "bottom"
        )
    graph.set(xlabel="load $P$ (N)", ylabel="force of the springs $S$ (N)", ylim=(0, 1.3 * DOWN))
    return figure
