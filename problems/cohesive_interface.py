r"""A user-defined effect: two blocks, joined by glue that softens, are pulled apart and pressed together.

The blocks have heights H_1, H_2 and moduli M_1, M_2 of uniaxial strain. The sides of the blocks stay plane, and the
meshes do not match. The top is moved up by U(t) = 0, U0, -U0/4, 3 U0/2 at t = 0, 1, 2, 3; U0 is a length. The glue
between the blocks is rigid up to its strength c. At this stress the glue flows, across and along the interface. The
accumulated flow A at a place reduces the strength to c(A) = max(c_0 (1 - A / A_c), 0), with the initial strength c_0
and the flow A_c at which all strength is lost. Contact keeps the opening a >= 0. The stress across the interface is

$$ \sigma = (U - a) / C, \qquad C = H_1 / M_1 + H_2 / M_2. $$

In step n, let sigma* = (U_n - a_{n-1}) / C be the stress without flow. If |sigma*| > c(A_{n-1}) > 0, the glue flows by

$$ |a_n - a_{n-1}| = (|\sigma^*| - c(A_{n-1})) / (1 / C - c_0 / A_c) $$

If the blocks touch or all strength is lost during the step, the glue flows less. If c_0 / A_c < 1 / C, a step has one
solution, and the blocks do not snap apart. Once the strength is lost, the stress is zero until the blocks touch again.

    vemcvx run problems/cohesive_interface.py --mesh nonconvex --n 4 --steps 60
"""

from dataclasses import dataclass, replace

import numpy as np

import vemcvx as vx
from vemcvx.effects import Contribution, Friction, Law


@dataclass(frozen=True)
class Glue(vx.Effect):
    """Glue between two bodies: it flows at its strength, along the interface and across it, and softens.

    Parameters
    ----------
    strength : float
        c_0 > 0, the initial strength: a force per length.
    way : float
        A_c, the accumulated flow at which a place has lost all strength.
    on : str or sequence of str
        Names of interfaces.
    """

    strength: float
    way: float
    on: str

    def contribute(self, space):
        rows = space.part(self.on, "Glue", contact=True).node_normals
        initial = rows.lengths * self.strength

        def weights(t, p, past, slip):
            return initial * np.maximum(1.0 - (past + slip) / self.way, 0.0)

        law = Law(weights, softening=initial / self.way)
        along = replace(Friction.from_rows(rows, "Glue"), law=law)
        across = replace(along, directions=rows.normals)
        return Contribution(frictions=(along, across))

    def describe(self):
        return f"Glue: strength {self.strength}, lost over {self.way} on {self.on}"


LENGTH, HEIGHTS, YOUNG, POISSON, STRENGTH = 1.5, (0.6, 0.4), (1000.0, 3000.0), 0.3, 1.0
MODULI = tuple(young * (1 - POISSON) / ((1 + POISSON) * (1 - 2 * POISSON)) for young in YOUNG)
COMPLIANCE = sum(height / modulus for height, modulus in zip(HEIGHTS, MODULI, strict=True))
WAY = 2.0 * STRENGTH * COMPLIANCE
AMPLITUDE = 1.5 * STRENGTH * COMPLIANCE
JOINT = "lower|upper"
UNITS = {"length": "mm", "force": "N", "time": "s", "force per area": "MPa"}
SMALL = {"n": 4, "steps": 60}


def top(t):
    """Return U(t)."""
    return AMPLITUDE * np.interp(t, [0, 1, 2, 3], [0.0, 1.0, -0.25, 1.5])


def exact_solution(instants):
    """Return the stress sigma and the opening a of the interface at every instant."""
    sigma, a, way = np.zeros(len(instants)), np.zeros(len(instants)), 0.0
    for n, U in enumerate(top(instants[1:]), start=1):
        trial, fall = (U - a[n - 1]) / COMPLIANCE, STRENGTH / WAY
        flow = max(abs(trial) - max(STRENGTH - fall * way, 0.0), 0.0) / (1 / COMPLIANCE - fall)
        if fall * (way + flow) > STRENGTH:
            flow = abs(trial) * COMPLIANCE
        if trial < 0:
            flow = min(flow, a[n - 1])
        a[n], way = a[n - 1] + np.sign(trial) * flow, way + flow
        sigma[n] = (U - a[n]) / COMPLIANCE
    return sigma, a


def scene(way=WAY):
    def move_top(x, t):
        return np.full(len(x), top(t))

    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON, on="lower"),
        vx.Elasticity(YOUNG[1], POISSON, on="upper"),
        vx.Symmetry(on=["lower.bottom", "lower.left", "lower.right", "upper.left", "upper.right"]),
        vx.PrescribedDisplacement(move_top, on="upper.top", direction=(0.0, 1.0)),
        vx.UnilateralContact(on=JOINT),
        Glue(STRENGTH, way, on=JOINT),
    )


def mesh(n, family="hexagons"):
    """Return the lower block in cells of `family`, and the upper block in n + 3 rows of squares."""
    lower = vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, HEIGHTS[0])))
    upper = vx.meshes.squares(n + 3, box=((0, LENGTH), (HEIGHTS[0], sum(HEIGHTS))))
    return vx.meshes.bodies({"lower": lower, "upper": upper})


def times(steps):
    return np.linspace(0.0, 3.0, steps + 1)


def picture(history):
    """Draw both blocks at t = 1, and the stress against the displacement of the top."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.4, 3.9), layout="constrained")
    body, graph = figure.subplots(1, 2, width_ratios=(1.0, 1.2))
    vx.plots.stressed_body(history, ax=body, step=history.steps // 3, stress="yy", units=UNITS)
    dense = times(1500)
    graph.plot(top(dense), exact_solution(dense)[0], "k-", label="closed form")
    graph.plot(top(history.times), -history.contact.pressure.mean(axis=1), "C0o", label="computed")
    graph.axhline(0.0, color="0.5", linewidth=0.8)
    graph.set(xlabel="displacement $U$ of the top (mm)", ylabel="stress across the glue (MPa, tension positive)")
    graph.locator_params(nbins=6)
    graph.grid()
    graph.legend()
    return figure
