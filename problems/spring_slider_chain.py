r"""Springs and sliders: the plays and stops of Prandtl and Ishlinskii as a variational inequality.

The *play* p of half width r stays within r of the input x, and changes only if it must. The *stop* is input minus play:

$$
p_n = \operatorname{clip}(p_{n-1}, x_n - r, x_n + r),
\qquad \operatorname{stop}_r = x - \operatorname{play}_r \qquad (x \text{ monotone between two instants}).
$$

Plays compose: play_r o play_s = play_{r+s}. Sums of weighted plays are Prandtl-Ishlinskii operators (Krasnoselskii and
Pokrovskii, Systems with Hysteresis, 1989; Brokate and Sprekels, Hysteresis and Phase Transitions, 1996, chapter 2).
Three systems follow. Each is Problem 2.1 of Feng, Han and Huang with a(u, v) = v'Ku and j(v) = sum_i w_i |v_i|. The
solution of each system is a sum of weighted plays.

1. **Chain.** The force F(t) pulls at the end u_0. Spring 0 joins this end to block 1, spring j joins block j to block
   j + 1, and spring N joins the last block to a wall, u_{N+1} = 0. Spring j has the stiffness k_j. Block i slides on
   the floor with the friction bound w_i. K is tridiagonal, with the energy 1/2 sum_j k_j (u_j - u_{j+1})^2. Friction at
   block i reduces the force T_{i-1} of spring i - 1 to T_i = play_{w_i}(T_{i-1}), because u_i and T_i change at the
   same times and in the same direction. Hence, with T_0 = F and r_j = w_1 + ... + w_j,

   $$ T_j = \operatorname{play}_{r_j}(F), \qquad u_i = \sum_{j \ge i} T_j / k_j, \qquad \lambda_i = T_{i-1} - T_i. $$

2. **Parallel elements under a given strain e(t).** Element i is a spring E_i in series with a slider of yield stress
   y_i and position p_i, and E_0 is a spring without slider. The energy of the elements is 1/2 sum E_i (e - p_i)^2, so
   K = diag(E), load = E e(t), and the stress is sigma:

   $$
   p_i = \operatorname{play}_{y_i/E_i}(e), \qquad \lambda_i = E_i (e - p_i), \qquad \sigma = E_0 e + \sum_i \lambda_i.
   $$

3. **The same elements under a given stress.** Now e is an unknown too. With the column E of all E_i and its transpose
   E', K = [[E_0 + sum E, -E'], [-E, diag(E)]] has the shape of an arrow. Friction does not act on e. The elimination of
   e leaves diag(E) - E E' / (E_0 + sum E), diagonal plus rank one.

The third system inverts the second. The inverse of a Prandtl-Ishlinskii operator is a Prandtl-Ishlinskii operator with
the inverse curve of first loading. So there are elements whose stress is F if their strain is the displacement u_0 of
the chain (:func:`inverse`). Backward Euler makes no error here as long as the input is monotone between instants.

Sums of plays have three properties. *Return-point memory*: when the input returns to an earlier turning point without a
larger excursion, the state returns, too. The closed loop has no later effect. *Congruency*: closed loops between
the same two inputs have the same shape, for any past. *Loss*: a closed loop dissipates its area. For the loop of force
and displacement of the chain, between forces that differ by dF, the loss is

$$ \sum_j 2 r_j (dF - 2 r_j)_+ / k_j = \sum_i w_i (\text{path of block } i). $$

    python problems/spring_slider_chain.py --picture spring_slider_chain.png
"""

import argparse
import time
from itertools import pairwise

import numpy as np

import vemcvx as vx

SPRINGS = np.array([4.0, 3.0, 2.0, 1.0, 1.5])
BOUNDS = np.array([0.5, 1.0, 1.5, 2.0])
TURNS = (0, 6, -6, 2, -3, 0.5, -3, 2, 6, -6)
"""Turning points of the force: three nested loops, and then the outermost loop again."""

SOLVERS = (vx.Newton(), vx.Clarabel(accuracy=1e-5), vx.OSQP(accuracy=1e-5))
"""Clarabel and OSQP converge slowly at returns to turning points, so we request the accuracy 1e-5."""


def course(turns, increment=0.5, first=None):
    """Return the samples of an input between turning points, in equal increments after a `first` increment.

    Errors of solvers are relative to the largest energy norm so far. This norm is zero until a block moves, so `first`
    should be large enough to cause slip.
    """
    turns = turns if first is None else (turns[0] + first, *turns[1:])
    legs = [np.linspace(a, b, round(abs(b - a) / increment) + 1)[1:] for a, b in pairwise(turns)]
    return np.concatenate([[0.0] * (first is not None), [float(turns[0])], *legs])


def turning_instants(force, turns=TURNS):
    """Return the instants at which a course reaches its turning points."""
    at = [0]
    for turn in turns[1:]:
        at.append(at[-1] + int(np.argmax(force[at[-1] :] == turn)))
    return np.array(at)


def play(r, x):
    """Return plays of the input x, one column for each half width in r and one row per instant; plays start at zero."""
    r = np.atleast_1d(r)
    p = np.zeros((len(x), len(r)))
    for n in range(1, len(x)):
        p[n] = np.clip(p[n - 1], x[n] - r, x[n] + r)
    return p


def sample(values):
    """Return the function of t whose value is values[n] at t = n."""
    return lambda t: values[round(t)]


def chain(force, springs=SPRINGS, bounds=BOUNDS):
    """Return system 1, with the unknowns u_0 ... u_N."""
    K = np.diag(springs + np.append(0.0, springs[:-1])) - np.diag(springs[:-1], 1) - np.diag(springs[:-1], -1)
    end = np.eye(len(springs))[0]
    return vx.System(K, lambda t: end * sample(force)(t), vx.Norms(np.eye(len(springs))[1:], bounds))


def chain_exactly(force, springs=SPRINGS, bounds=BOUNDS):
    """Return displacements and friction forces, one row per instant."""
    T = play(np.append(0.0, np.cumsum(bounds)), force)
    return np.cumsum((T / springs)[:, ::-1], axis=1)[:, ::-1], T[:, :-1] - T[:, 1:]


def loop_area(swing, springs=SPRINGS, bounds=BOUNDS):
    """Return the dissipation of a closed loop of the chain between two forces whose difference is `swing`."""
    r = np.append(0.0, np.cumsum(bounds))
    return float(np.sum(2 * r * np.maximum(swing - 2 * r, 0.0) / springs))


def inverse(springs=SPRINGS, bounds=BOUNDS):
    """Return E_0, E and y of the parallel elements whose stress is the force of the chain."""
    compliance = np.cumsum(1.0 / springs)
    r = np.append(0.0, np.cumsum(bounds))
    # The curve of first loading of the chain has the slope 1/k_0 + ... + 1/k_j from F = r_j on.
    yielding = np.cumsum(compliance[:-1] * np.diff(r))
    E = 1.0 / compliance[:-1] - 1.0 / compliance[1:]
    return 1.0 / compliance[-1], E, E * yielding


def pose_under_strain(strain, E, y):
    """Return system 2, with the positions p_i of the sliders as unknowns."""
    return vx.System(np.diag(E), lambda t: E * sample(strain)(t), vx.Norms(np.eye(len(E)), y))


def pose_under_stress(stress, E_0, E, y):
    """Return system 3, with the strain and the positions of the sliders as unknowns."""
    m = len(E)
    K = np.block([[np.array([[E_0 + E.sum()]]), -E[None]], [-E[:, None], np.diag(E)]])
    unit = np.eye(m + 1)
    return vx.System(K, lambda t: unit[0] * sample(stress)(t), vx.Norms(unit[1:], y))


def march(system, values, solver=None):
    """Return the trajectory of a system with one instant for each value of its input."""
    return vx.march(system, np.arange(float(len(values))), solver=solver)


def picture(path, force, u, strain, stress):
    """Draw the force against the displacement of the chain, and the stress of the parallel elements."""
    from vemcvx.base.canvas import new_figure
    from vemcvx.plots.style import SERIES

    figure = new_figure(9.0, 4.2)
    left, right = figure.subplots(1, 2)
    left.plot(u[:, 0], force, "o-", color=SERIES[0], markersize=2.5, linewidth=1, label="closed form")
    left.set(xlabel="displacement of the end", ylabel="force", title="chain: plays of the force")
    right.plot(strain, stress, color=SERIES[1], linewidth=1, label="stress of the elements under that strain")
    right.plot(strain, force, ".", color=SERIES[0], markersize=3, label="force on the chain, closed form")
    right.set(
        xlabel="strain = displacement of the chain", ylabel="stress", title="in parallel: the stress is the force"
    )
    left.legend(frameon=False, fontsize="small", loc="upper left")
    right.legend(fontsize="small", loc="lower right")
    figure.savefig(path, dpi=120)


def main(path=None):
    force = course(TURNS, first=1.0)
    exact, forces = chain_exactly(force)
    print("chain of four blocks, by three solvers")
    print("solver      error of u   certified   error of lam        lost in loops   seconds")
    for solver in SOLVERS:
        start = time.perf_counter()
        trajectory = march(chain(force), force, solver)
        seconds = time.perf_counter() - start
        lost = np.ptp(trajectory.dissipated[turning_instants(force)[[1, 8]]])
        print(
            f"{solver.name:9s}{np.abs(trajectory.state - exact).max():12.1e}{trajectory.certificate_total[-1]:12.1e}"
            f"{np.abs(trajectory.multipliers[:, :, 0] - forces).max():15.1e}{lost:25.10f}{seconds:10.2f}"
        )
    between = loop_area(12), loop_area(5), loop_area(3.5)
    print(f"in closed form: {between[0]:g} + {between[1]:g} + {between[2]:g} (outer, middle and inner loop)")
    E_0, E, y = inverse()
    sliders = march(pose_under_strain(exact[:, 0], E, y), force)
    stress = E_0 * exact[:, 0] + sliders.multipliers[:, :, 0].sum(axis=1)
    print(
        f"inverse: the stress of the elements under the displacement u_0 is F up to {np.abs(stress - force).max():.1e}"
    )
    strain = march(pose_under_stress(force, E_0, E, y), force).state[:, 0]
    print(f"inverse of the inverse: the strain under F is u_0 up to {np.abs(strain - exact[:, 0]).max():.1e}")
    if path:
        picture(path, force, exact, exact[:, 0], stress)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--picture", metavar="FILE")
    main(parser.parse_args().picture)
