r"""An orthotropic block sheared over a floor: it slides more easily one way than the other.

The block (0, 2) x (0, H) in plane stress, with H = 1/2, is of wood. Young's modulus is E1 along the grain and E2 across
the grain. The grain rises at the angle `grain` from the x-axis. The top is pressed down by D and then moved by U(t),
back and forth. Coulomb friction of the coefficient mu acts on the bottom. The elastic matrix C (Lekhnitskii 1963;
Jones, *Mechanics of Composite Materials*, 1999, 2.6) couples shear to pressure by C26. Let e = D / H. In a uniform
state u = (a + gamma y, -e y) the block has the shear gamma and the slip a. The shear traction tau and the pressure p on
the floor are

$$ \tau = C_{66} \gamma - C_{26} e, \qquad p = C_{22} e - C_{26} \gamma. $$

Here C26 > 0, so gamma > 0 lowers the pressure, and gamma < 0 raises the pressure. The block slips if |tau| = mu p, that
is at

$$
\gamma^+ = e (\mu C_{22} + C_{26}) / (C_{66} + \mu C_{26}),
\qquad \gamma^{-} = -e (\mu C_{22} - C_{26}) / (C_{66} - \mu C_{26}),
$$

and step n of a run gives gamma_n = clip((U_n - a_{n-1}) / H, gamma-, gamma+), a_n = U_n - gamma_n H. The tractions of
this state act on the sides. The displacement is linear, so virtual elements reproduce displacement and friction on
every mesh.

    vemcvx run problems/block_with_grain.py --mesh voronoi --n 4 --steps 48 --plot
"""

import numpy as np

import vemcvx as vx

YOUNG, POISSON, SHEAR, GRAIN, FRICTION = (10.0, 2.0), 0.3, 1.2, 0.5, 0.5
LENGTH, HEIGHT, PRESS, AMPLITUDE = 2.0, 0.5, 0.02, 0.05
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 8, "steps": 48}


def elastic_matrix(grain=GRAIN):
    """Return the elastic matrix C (3, 3) in the axes x and y."""
    (E1, E2), nu = YOUNG, POISSON
    C = np.zeros((3, 3))
    C[:2, :2] = np.linalg.inv([[1 / E1, -nu / E1], [-nu / E1, 1 / E2]])
    C[2, 2] = SHEAR
    c, s = np.cos(grain), np.sin(grain)
    Q = np.array([[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2 * c * s, 2 * c * s, c * c - s * s]])
    return Q.T @ C @ Q


def top(t):
    """Return U(t) and D(t)."""
    return AMPLITUDE * np.interp(t, [1, 2, 4, 6], [0, 1, -1, 1]), PRESS * np.interp(t, [0, 1], [0, 1])


def exact_solution(instants, grain=GRAIN):
    """Return the shear gamma, the slip a and the stresses (xx, yy, xy) at every instant."""
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
    stress = exact_solution(instants, grain)[2]

    def side(sign):
        def force(x, t):
            xx, _, xy = (np.interp(t, instants, part) for part in stress.T)
            return np.tile([sign * xx, sign * xy], (len(x), 1))

        return force

    def move_top(x, t):
        aside, down = top(t)
        return np.tile([aside, -down], (len(x), 1))

    return vx.Scene(
        vx.Orthotropic(young=YOUNG, poisson=POISSON, shear=SHEAR, angle=grain),
        vx.PrescribedDisplacement(move_top, on="top"),
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
    """Draw the block at the last instant, and the unsymmetric friction loop."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2, width_ratios=(1.2, 1.0))
    vx.plots.stressed_body(history, ax=body, stress="shear", stretch=2.0, units=UNITS)
    dense = times(1200)
    U = top(dense)[0]
    graph.plot(U, exact_solution(dense)[2][:, 2], "k-", label="closed form")
    graph.plot(U, exact_solution(dense, 0.0)[2][:, 2], "--", color="0.55", label="grain along the floor")
    friction = -history.contact.traction[:, :, 0].mean(axis=1)
    graph.plot(top(history.times)[0], friction, "C0o", label=f"grain at {np.rad2deg(GRAIN):.0f} degrees")
    graph.set(xlabel="displacement $U$ of the top (mm)", ylabel="friction on the floor (MPa)", ylim=(-0.07, 0.105))
    graph.grid()
    graph.legend(loc="upper left")
    return figure
