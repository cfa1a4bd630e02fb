r"""An orthotropic block, rubbed over a floor: it slides more easily one way than the other.

The block (0, 2) x (0, 1/2), plane stress, is wood: E1 along a grain that rises at the angle `grain` from x, E2 across
it. Its top is pressed down by D and then moved by U(t), back and forth; Coulomb friction, coefficient mu, resists
below. The elastic matrix C (Lekhnitskii 1963; Jones, *Mechanics of Composite Materials*, 1999, 2.6) couples shear to
pressure by C26: with e = D / H, in the uniform state u = (a + gamma y, -e y) the floor bears

$$ \tau = C_{66} \gamma - C_{26} e, \qquad p = C_{22} e - C_{26} \gamma, $$

so that a shear along the grain's rise relieves the floor and one against it loads it. |tau| = mu p at

$$
\gamma^+ = e (\mu C_{22} + C_{26}) / (C_{66} + \mu C_{26}),
\qquad \gamma^{-} = -e (\mu C_{22} - C_{26}) / (C_{66} - \mu C_{26}),
$$

and step by step gamma_n = clip((U_n - a_{n-1}) / H, gamma-, gamma+), a_n = U_n - gamma_n H. The sides bear the
tractions of this state; it is linear, so virtual elements reproduce it, and the force of friction, on every mesh.

    vemcvx run problems/block_with_grain.py --mesh voronoi --n 4 --steps 48 --plot
"""

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph

YOUNG, POISSON, SHEAR, GRAIN, FRICTION = (10.0, 2.0), 0.3, 1.2, 0.5, 0.5
LENGTH, HEIGHT, PRESS, AMPLITUDE = 2.0, 0.5, 0.02, 0.05
UNITS = MM
SMALL = {"n": 8, "steps": 48}


def elastic_matrix(grain=GRAIN):
    """C (3, 3) in x and y, by turning strains into the axes of the grain."""
    (E1, E2), nu = YOUNG, POISSON
    C = np.zeros((3, 3))
    C[:2, :2] = np.linalg.inv([[1 / E1, -nu / E1], [-nu / E1, 1 / E2]])
    C[2, 2] = SHEAR
    c, s = np.cos(grain), np.sin(grain)
    Q = np.array([[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]])
    return Q.T @ C @ Q


def top(t):
    """How far the top is moved aside, and pressed down."""
    return AMPLITUDE * np.interp(t, [1, 2, 4, 6], [0, 1, -1, 1]), PRESS * np.interp(t, [0, 1], [0, 1])


def closed_form(instants, grain=GRAIN):
    """Shear gamma (N + 1,), slip a (N + 1,), and stresses (N + 1, 3), at every instant."""
    C, (U, D) = elastic_matrix(grain), top(instants)
    e = D / HEIGHT
    high = e * (FRICTION * C[1, 1] + C[1, 2]) / (C[2, 2] + FRICTION * C[1, 2])
    low = -e * (FRICTION * C[1, 1] - C[1, 2]) / (C[2, 2] - FRICTION * C[1, 2])
    gamma, a = np.zeros(len(instants)), np.zeros(len(instants))
    for n in range(1, len(instants)):
        gamma[n] = np.clip((U[n] - a[n - 1]) / HEIGHT, low[n], high[n])
        a[n] = U[n] - gamma[n] * HEIGHT
    return gamma, a, np.column_stack([np.zeros_like(e), -e, gamma]) @ C


def scene(grain=GRAIN, steps=SMALL["steps"]):
    instants = times(steps)
    stress = closed_form(instants, grain)[2]

    def side(sign):
        def force(x, t):
            xx, _, xy = (np.interp(t, instants, part) for part in stress.T)
            return np.tile([sign * xx, sign * xy], (len(x), 1))

        return force

    def moved(x, t):
        aside, down = top(t)
        return np.tile([aside, -down], (len(x), 1))

    return vx.Scene(
        vx.Orthotropic(young=YOUNG, poisson=POISSON, shear=SHEAR, angle=grain),
        vx.PrescribedDisplacement(moved, on="top"),
        vx.Traction(side(1.0), on="right"),
        vx.Traction(side(-1.0), on="left"),
        vx.UnilateralContact(on="bottom"),
        vx.CoulombFriction(FRICTION, on="bottom"),
    )


def mesh(n, family="voronoi"):
    return vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, HEIGHT)))


def times(steps):
    return np.linspace(0.0, 6.0, steps + 1)


def picture(history):
    """The block at the end of its slide, and the loop of friction that leans to one side."""
    figure, graph = body_and_graph(history, stress="shear", stretch=2.0, shares=(1.2, 1.0))
    U, friction = top(history.times)[0], -history.contact.traction[:, :, 0].mean(axis=1)
    dense = times(1200)
    stress = closed_form(dense)[2]
    label = f"grain at {np.rad2deg(GRAIN):.0f} degrees"
    beside_closed_form(graph, (U, friction), (top(dense)[0], stress[:, 2]), label=label)
    smooth = closed_form(dense, 0.0)[2]
    graph.plot(top(dense)[0], smooth[:, 2], "--", color="0.55", linewidth=1.2, label="grain along the floor")
    graph.set(ylim=(-0.07, 0.105))
    graph.legend(frameon=False, fontsize="small", loc="upper left")
    graph.set(xlabel="top moved aside by $U$ (mm)", ylabel="friction on the floor (MPa)")
    graph.set_title("with the slope of the grain, and against it", fontsize="small")
    return figure
