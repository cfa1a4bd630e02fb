# %% [markdown]
"""# Solutions to the exercises of lesson 5, active sets and semismooth Newton"""

# %% [markdown]
# We repeat the active set iteration of the lesson, with a starting point for exercises 2 and 3. In the code,
# $\hat\lambda = \lambda + \gamma (u - u_{prev})$ is `trial`.

# %%
import numpy as np


def newton_step(program, u, lam, gamma):
    K, f, w, u_prev = program
    trial = lam + gamma * (u - u_prev)
    side = np.where(np.abs(trial) <= w, 0.0, np.sign(trial))
    slips = side != 0
    u = np.where(slips, 0.0, u_prev)
    u[slips] = np.linalg.solve(K[np.ix_(slips, slips)], (f - w * side - K @ u)[slips])
    return u, np.where(slips, w * side, f - K @ u), side


def active_sets(program, gamma, rounds=40, start=None):
    u, lam = (program[3], np.zeros(len(program[3]))) if start is None else start
    sides = []
    while len(sides) < rounds:
        u, lam, side = newton_step(program, u, lam, gamma)
        if sides and (side == sides[-1]).all():
            break
        sides.append(side)
    return u, lam, np.array(sides)


# %% [markdown]
# **1.** The solution for the guess (back, forward) has $u_2 = -1$, so $\hat\lambda_2 = 1 - \gamma_2$. The next guess
# for block 2 is "sticks" if $\gamma_2 \le 2$. The solution for the guess (back, back) has
# $\hat\lambda_2 = -1 + \gamma_2$, and leads to "sticks" under the same condition. So the guesses cycle for
# $\gamma_2 > 2$.

# %%
blocks = (np.array([[1.0, -1.0], [-1.0, 2.0]]), np.array([-3.0, 2.0]), np.ones(2), np.zeros(2))


def has_cycle(gamma_2):
    return len(active_sets(blocks, np.array([1.0, gamma_2]))[2]) == 40


assert not has_cycle(2.0)
assert has_cycle(2.0 + 1e-9)

# %% [markdown]
# **2.** Let $u_{prev} = 0$. From rest the first guess is to stick, with $\lambda = f$. If $|f| \le w$, this is the
# solution. If $f > w$, the next guess is to slip forward, with $s = (f - w)/K > 0$. Then
# $\hat\lambda = w + \gamma s > w$ for any $\gamma$. So the next guess is forward again, and the iteration ends. The
# case $f < -w$ is similar.
#
# From another start the guesses may cycle. Let $|f| < w$, and let the first guess be forward, so $s = (f - w)/K < 0$.
# If $\gamma$ is so large that $\hat\lambda = w + \gamma s < -w$, the next guess is backward, with $s = (f + w)/K > 0$.
# If now $\hat\lambda = -w + \gamma s > w$, the guess after this is forward again. If $\gamma \le K$, a forward guess
# gives $\hat\lambda = w + \gamma s \ge w + (f - w) = f > -w$, so the unknown sticks.


# %%
def count_guesses(f, gamma, start):
    """Return the number of guesses for K = 1, w = 1, u_prev = 0, from a position and a force."""
    program = (np.eye(1), np.array([f]), np.ones(1), np.zeros(1))
    return len(active_sets(program, np.array([gamma]), start=start)[2])


rest, pushed = (np.zeros(1), np.zeros(1)), (np.zeros(1), np.array([5.0]))
pulls, shifts = np.linspace(-3.0, 3.0, 25), 10.0 ** np.linspace(-3, 3, 13)
assert max(count_guesses(f, gamma, rest) for f in pulls for gamma in shifts) <= 2
assert max(count_guesses(f, gamma, pushed) for f in pulls for gamma in shifts if gamma <= 1) <= 3
assert count_guesses(0.0, 3.0, pushed) == 40

# %% [markdown]
# **3.** The rod has the stiffness $1/h$ between neighbours and the friction bound $w = h$ at each node. The rod is
# pulled at its free end by 0.705. As long as a node sticks, the part of the rod between this node and the wall carries
# no force. So slip spreads by one node per round, and 70 nodes slip in the end. In a body every node is coupled to
# every other node, and slip spreads by many nodes per round. If the iteration starts from the solution for 9/10 of the
# pull, 63 nodes slip already, and the iteration takes about a tenth of the rounds. So each time step of the package
# starts from the sets of the step before.


# %%
def rod(pull, n=100):
    h = 1.0 / n
    K = (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)) / h
    K[-1, -1] = 1 / h
    return K, pull * np.eye(n)[-1], np.full(n, h), np.zeros(n)


def small_shift(K):
    return 0.1 / np.diag(np.linalg.inv(K))


gamma = small_shift(rod(0.7)[0])
# The pulls exceed .7 and .63 by half a node's friction. This avoids ties, which rounding would decide.
cold = active_sets(rod(0.705), gamma, rounds=200)[2]
warm_start = active_sets(rod(0.635), gamma, rounds=200)[:2]
warm = active_sets(rod(0.705), gamma, rounds=200, start=warm_start)[2]
slipping = np.count_nonzero(cold, axis=1)
assert (np.diff(slipping) == 1).all()
assert slipping[-1] == np.count_nonzero(warm[-1]) == 70
assert len(warm) <= 0.15 * len(cold)
print(f"{len(cold)} rounds from rest, {len(warm)} from the solution for nine tenths of the pull")

# %% [markdown]
# **4.** A sure step is a projected gradient step for the forces. Let $\kappa_1$ and $\kappa_m$ be the smallest and the
# largest eigenvalue of $K$. One sure step multiplies the distance between the forces and the exact forces by
# $1 - \kappa_1/\kappa_m$ or less. The condition number $\kappa_m/\kappa_1$ is up to $10^3$ here, so it may take
# thousands of sure steps to reduce the distance by a factor of a thousand. Rounds of Newton's method between sure steps
# make most of these steps unnecessary. With accelerated gradients, as in the package, the bound on the number of sure
# steps is proportional to the square root of the condition number.


# %%
def random_program(seed, n=8):
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    K = Q @ np.diag(10.0 ** rng.uniform(-1.5, 1.5, n)) @ Q.T
    u_prev = rng.normal(size=n) * (rng.random(n) < 0.3)
    return 0.5 * (K + K.T), K @ rng.normal(size=n) + rng.normal(size=n), 10.0 ** rng.uniform(-1, 1, n), u_prev


def sure_steps_alone(program, enough=1e-6, most=20_000):
    K, f, w, u_prev = program
    flexibility = np.linalg.inv(K)
    rho, lam = 1.0 / np.linalg.eigvalsh(flexibility).max(), np.zeros(len(f))
    for count in range(most):
        s = flexibility @ (f - lam) - u_prev
        if np.sum(w * np.abs(s) - lam * s) <= enough * 0.5 * f @ flexibility @ f:
            return count
        lam = np.clip(lam + rho * s, -w, w)
    return most


programs = [random_program(seed) for seed in range(60)]
steps = np.array([sure_steps_alone(program) for program in programs])
assert steps.max() > 500
print(f"sure steps alone: {np.median(steps):.0f} at the median, {steps.max()} at worst")

# %% [markdown]
# **5.** Run the iteration until the sets of an earlier round occur again. The length of the cycle is the number of
# rounds from the first occurrence to the second. One repetition is enough, because the sets determine the next iterate,
# and thus all later iterates. The most frequent length is two, but other lengths occur.


# %%
def cycle_length(program, gamma, rounds=200):
    """Return the number of rounds between two visits to the same sets; 1 means a solution."""
    u, lam, seen = program[3], np.zeros(len(program[3])), {}
    for count in range(rounds):
        u, lam, side = newton_step(program, u, lam, gamma)
        if (first := seen.setdefault(side.tobytes(), count)) != count:
            return count - first
    return rounds


lengths = [cycle_length(program, 100 * small_shift(program[0])) for program in programs]
found = dict(zip(*(part.tolist() for part in np.unique(lengths, return_counts=True)), strict=True))
assert found[2] == max(count for length, count in found.items() if length > 1)
assert max(found) > 2
print("programs out of 60, by length of the cycle (1 is a solution):", found)
