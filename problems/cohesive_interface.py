r"""A cohesive interface that softens, an effect of one's own: two glued blocks are pulled apart, and closed again.

The blocks have heights H_1, H_2 and the moduli M_1, M_2 of uniaxial strain, and meshes that do not match; their sides
do not bulge. The top is moved up by U(t) = U0 (0, 1, -1/4, 3/2) at t = 0, 1, 2, 3. The glue between them is rigid up to
its strength c and flows from there on, across the interface and along it; each place loses strength with the way A that
it has flowed: c(A) = max(c_0 (1 - A / A_c), 0). The stress sigma and the opening a >= 0, which contact keeps so, are

$$
\sigma = (U - a) / C, \qquad C = H_1 / M_1 + H_2 / M_2; \qquad da = (|\sigma| - c(A)) / (1 / C - c_0 / A_c)
\qquad \text{where it flows}.
$$

A step has one solution, and the blocks do not snap apart, if c_0 / A_c < 1 / C: the glue softens slowly enough. Once it
has lost all strength they carry nothing, until they touch.

    vemcvx run problems/cohesive_interface.py --mesh nonconvex --n 4 --steps 60
"""

from dataclasses import dataclass, replace

import numpy as np

import vemcvx as vx
from problem_pictures import MM, beside_closed_form, body_and_graph
from vemcvx.effects import Contribution, Friction, Law


@dataclass(frozen=True)
class Glue(vx.Effect):
    """Glue between two bodies that flows at its strength, along the interface and across it, and softens.

    Parameters
    ----------
    strength : float
        c_0 > 0, force per length, of glue that has not flowed.
    way : float
        A_c, over which a place loses all of it.
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
UNITS = MM
SMALL = {"n": 4, "steps": 60}


def top(t):
    """U(t)."""
    return AMPLITUDE * np.interp(t, [0, 1, 2, 3], [0.0, 1.0, -0.25, 1.5])


def closed_form(instants):
    """The stress sigma across the interface, its opening a, at every instant."""
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
    def moved(x, t):
        return np.full(len(x), top(t))

    return vx.Scene(
        vx.Elasticity(YOUNG[0], POISSON, on="lower"),
        vx.Elasticity(YOUNG[1], POISSON, on="upper"),
        vx.Symmetry(on=["lower.bottom", "lower.left", "lower.right", "upper.left", "upper.right"]),
        vx.PrescribedDisplacement(moved, on="upper.top", direction=(0.0, 1.0)),
        vx.UnilateralContact(on=JOINT),
        Glue(STRENGTH, way, on=JOINT),
    )


def mesh(n, family="hexagons"):
    """The lower block in cells of `family`; the upper one in squares, n + 3 across its height."""
    lower = vx.meshes.FAMILIES[family](n, box=((0, LENGTH), (0, HEIGHTS[0])))
    upper = vx.meshes.squares(n + 3, box=((0, LENGTH), (HEIGHTS[0], sum(HEIGHTS))))
    return vx.meshes.bodies({"lower": lower, "upper": upper})


def times(steps):
    return np.linspace(0.0, 3.0, steps + 1)


def picture(history):
    """Both blocks once the glue has flowed, and the stress over the motion of the top."""
    figure, graph = body_and_graph(history, step=history.steps // 3, stress="yy", shares=(1.0, 1.2))
    pressure, dense = history.contact.pressure.mean(axis=1), times(1500)
    beside_closed_form(graph, (top(history.times), -pressure), (top(dense), closed_form(dense)[0]))
    graph.axhline(0.0, color="0.5", linewidth=0.8)
    graph.set(xlabel="top moved up by $U$ (mm)", ylabel="stress across the glue (MPa, tension positive)")
    return figure
