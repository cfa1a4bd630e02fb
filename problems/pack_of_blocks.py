r"""Blocks under one plate slide one by one: the loop of force and displacement has a closed form.

Bearings of length L stand in a row between the ground and a plate. The plate moves by U(t) = U0 (0, 1, -1, 1) at t = 0,
1, 3, 5, linearly in between. Each bearing consists of two blocks with the friction bound g_i between them. The sides of
the blocks can move along x only, so that both blocks are sheared uniformly. With the heights H_1, H_2 and shear moduli
mu_1, mu_2 of the lower and the upper block, C = H_1 / mu_1 + H_2 / mu_2 is the compliance of a bearing. Shear stress
q_i and slip a_i of a bearing follow from the slip of the step before:

$$ q_i = \operatorname{clip}((U - a_i^{\text{before}}) / C, \pm g_i), \qquad a_i = U - C q_i. $$

So bearing i begins to slide at U_i = g_i C. The force on the plate, L sum q_i, is the force of springs and sliders in
parallel (Iwan, J. Appl. Mech. 33, 1966). In the first loading it is F(U) = L sum min(U / C, g_i). After the reversal at
U0 it is F(U0) - 2 F((U0 - U) / 2) (Masing 1926). A closed loop dissipates L sum 4 g_i (U0 - g_i C)_+, where
(s)_+ = max(s, 0). The computed solution is exact up to rounding.

    vemcvx run problems/pack_of_blocks.py --mesh voronoi --n 4 --steps 60 --plot
"""

import numpy as np

import vemcvx as vx

LENGTH, GAP, HEIGHTS, YOUNG, POISSON = 1.0, 0.5, (0.4, 0.6), (3000.0, 1000.0), 0.3
BOUNDS = np.array([0.3, 0.9, 0.6, 1.2])
MU = tuple(young / (2 * (1 + POISSON)) for young in YOUNG)
COMPLIANCE = sum(height / mu for height, mu in zip(HEIGHTS, MU, strict=True))
STARTS = BOUNDS * COMPLIANCE
"""The displacement U at which each bearing begins to slide."""
AMPLITUDE = 1.4 * STARTS.max()
JOINTS = [f"joint {i + 1}" for i in range(len(BOUNDS))]
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 3, "steps": 60}


def plate(t):
    """Return U(t)."""
    return AMPLITUDE * np.interp(t, [0, 1, 3, 5], [0, 1, -1, 1])


def first_loading(U):
    """Return F(U), the force on the plate in the first loading."""
    return LENGTH * np.minimum(np.asarray(U)[..., None] / COMPLIANCE, BOUNDS).sum(axis=-1)


def force(t):
    """Return the force on the plate at the instants t, by Masing's rule."""
    U, most = plate(t), first_loading(AMPLITUDE)
    back, forth = most - 2 * first_loading((AMPLITUDE - U) / 2), 2 * first_loading((AMPLITUDE + U) / 2) - most
    return np.select([t <= 1, t <= 3], [first_loading(np.abs(U)), back], forth)


def exact_solution(instants):
    """Return shear stresses q, and slips a of the upper over the lower blocks: two arrays (instants, bearings)."""
    q, a = np.zeros((2, len(instants), len(BOUNDS)))
    for n, U in enumerate(plate(instants[1:]), start=1):
        q[n] = np.clip((U - a[n - 1]) / COMPLIANCE, -BOUNDS, BOUNDS)
        a[n] = U - COMPLIANCE * q[n]
    return q, a


def bearing(x):
    """Return the indices of the bearings at places x (m, 2)."""
    return (x[:, 0] // (LENGTH + GAP)).astype(int)


def scene():
    def move_plate(x, t):
        return np.tile([plate(t), 0.0], (len(x), 1))

    halves = [f"{half} {i + 1}" for half in ("lower", "upper") for i in range(len(BOUNDS))]
    lower, upper = halves[: len(BOUNDS)], halves[len(BOUNDS) :]
    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON, on=lower),
        vx.Elasticity(YOUNG[1], POISSON, on=upper),
        vx.Clamp(on=[f"{name}.bottom" for name in lower]),
        vx.PrescribedDisplacement(move_plate, on=[f"{name}.top" for name in upper]),
        vx.PrescribedDisplacement(
            0.0, on=[f"{name}.{side}" for name in halves for side in ("left", "right")], direction=(0.0, 1.0)
        ),
        vx.BilateralContact(on=JOINTS),
        vx.TrescaFriction(lambda x, t: BOUNDS[bearing(x)], on=JOINTS),
    )


def mesh(n, family="hexagons"):
    """Return lower blocks with n cells of `family` across their width, and upper blocks with n + 1 squares."""
    blocks, joints = {}, {}
    for i, joint in enumerate(JOINTS):
        ends = i * (LENGTH + GAP), i * (LENGTH + GAP) + LENGTH
        below, above = (ends, (0, HEIGHTS[0])), (ends, (HEIGHTS[0], sum(HEIGHTS)))
        blocks[f"lower {i + 1}"] = vx.meshes.FAMILIES[family](n, box=below, seed=i)
        blocks[f"upper {i + 1}"] = vx.meshes.squares(n + 1, box=above)
        joints[joint] = f"lower {i + 1}", f"upper {i + 1}"
    return vx.meshes.bodies(blocks, joints)


def times(steps):
    return np.linspace(0.0, 5.0, steps + 1)


def plate_force(history):
    """Return the computed force on the plate at the stored instants."""
    return sum(history.reaction(f"upper {i + 1}.top")[:, 0] for i in range(len(BOUNDS)))


def picture(history):
    """Draw the pack while three of four bearings slide, and the loop of the force on the plate."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 5.0), layout="constrained")
    body, graph = figure.subplots(2, 1, height_ratios=(1.0, 1.9))
    step = int(history.steps / 5 * 0.5 * (STARTS.max() + np.sort(STARTS)[-2]) / AMPLITUDE)
    vx.plots.stressed_body(history, step=step, ax=body, stress="shear", forces="friction", units=UNITS)
    dense = times(2000)
    graph.plot(plate(dense), force(dense), "k-", label="closed form")
    graph.plot(plate(history.times), plate_force(history), "C0o", label="computed")
    for i, start in enumerate(np.sort(STARTS)):
        graph.axvline(start, color="0.6", linestyle=":", linewidth=1.0)
        graph.text(start, 3.25, f"$U_{i + 1}$", fontsize="small", ha="center")
    graph.set(xlabel="displacement $U$ of the plate (mm)", ylabel="force on the plate (N/mm)", ylim=(-3.4, 3.9))
    graph.grid()
    graph.legend(loc="upper left")
    return figure
