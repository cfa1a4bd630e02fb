# %% [markdown]
"""# Solutions to the exercises of lesson 5, active sets and semismooth Newton"""

# %% [markdown]
# The active set iteration of the lesson once more; it takes a start, for exercise 3.

# %%
import numpy as np


def newton_step(program, y, lam, c):
    K, f, w, b = program
    q = lam + c * (y - b)
    side = np.where(np.abs(q) <= w, 0.0, np.sign(q))
    slip = side != 0
    y = np.where(slip, 0.0, b)
    y[slip] = np.linalg.solve(K[np.ix_(slip, slip)], (f - w * side - K @ y)[slip])
    return y, np.where(slip, w * side, f - K @ y), side


def active_sets(program, c, rounds=40, start=None):
    y, lam = (program[3], np.zeros(len(program[3]))) if start is None else start
    sides = []
    while len(sides) < rounds:
        y, lam, side = newton_step(program, y, lam, c)
        if sides and (side == sides[-1]).all():
            break
        sides.append(side)
    return y, lam, np.array(sides)


# %% [markdown]
# **1.** From (back, forward) the system gives $u_2 = -1$, and $q_2 = 1 - c_2$: the guess "sticks" needs $c_2 \le 2$.
# One over the flexibility is $1/(K^{-1})_{22} = 1$, so the circle begins beyond 2. (From (back, back) $q_2 =
# -1 + c_2$, the same.)

# %%
blocks = (np.array([[1.0, -1.0], [-1.0, 2.0]]), np.array([-3.0, 2.0]), np.ones(2), np.zeros(2))


def circles(c_2):
    return len(active_sets(blocks, np.array([1.0, c_2]))[2]) == 40


assert not circles(2.0)
assert circles(2.0 + 1e-9)

# %% [markdown]
# **2.** Let $z = f - Kb$ be the force that holds the one unknown at $b$. From rest the first guess is to stick, with
# $\lambda = z$. If $|z| \le w$, that is the solution. Else, say $z > w$, it slips forward, $s = (z - w)/K > 0$, and
# then $q = w + cs > w$ for any $c$: forward again, done.
#
# From another start it may cycle: let $|z| < w$ and begin with forward, $s = (z - w)/K < 0$. If $c$ is so large that
# $q = w + cs < -w$, the next guess is backward, with $s = (z + w)/K > 0$, and if $-w + cs > w$ it is forward again. A
# shift $c \le K$, one over the flexibility, is safe: $q = w + cs \ge w + (z - w) = z$, which sticks.


# %%
def one(z, c, start):
    """K = 1, w = 1, b = 0: guesses from slips (and forces) of the given start."""
    program = (np.eye(1), np.array([z]), np.ones(1), np.zeros(1))
    return len(active_sets(program, np.array([c]), start=start)[2])


rest, pushed = (np.zeros(1), np.zeros(1)), (np.zeros(1), np.array([5.0]))
pulls, shifts = np.linspace(-3.0, 3.0, 25), 10.0 ** np.linspace(-3, 3, 13)
assert max(one(z, c, rest) for z in pulls for c in shifts) <= 2
assert max(one(z, c, pushed) for z in pulls for c in shifts if c <= 1) <= 3
assert one(0.0, 3.0, pushed) == 40

# %% [markdown]
# **3.** The rod: stiffness $1/h$ between neighbours, friction $w = h$ a node, pulled at the free end by .705. While a
# node sticks, it holds its neighbour, and the next one feels nothing: the front moves by one node a round, and 70 slip
# in the end. On the body every node feels every other through the material, and the front leaps. A start from 9/10 of
# the pull has the front at 63 already, and takes a tenth of the rounds. (So in time: steps start from the sets of the
# last step.)


# %%
def rod(pull, n=100):
    h = 1.0 / n
    K = (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1)) / h
    K[-1, -1] = 1 / h
    return K, pull * np.eye(n)[-1], np.full(n, h), np.zeros(n)


def small_shift(K):
    return 0.1 / np.diag(np.linalg.inv(K))


c = small_shift(rod(0.7)[0])
# Halves, so that no bound is met exactly and rounding decides nothing.
cold = active_sets(rod(0.705), c, rounds=200)[2]
warm_start = active_sets(rod(0.635), c, rounds=200)[:2]
warm = active_sets(rod(0.705), c, rounds=200, start=warm_start)[2]
slipping = np.count_nonzero(cold, axis=1)
assert (np.diff(slipping) == 1).all()
assert slipping[-1] == np.count_nonzero(warm[-1]) == 70
assert len(warm) <= 0.15 * len(cold)
print(f"{len(cold)} rounds from rest, {len(warm)} from the answer to nine tenths of the pull")

# %% [markdown]
# **4.** The projected gradient is sure to shrink its distance to the solution by $1 - 1/\kappa$ a step and no more; the
# condition number $\kappa$ of $K$ is up to $10^3$ here, so thousands of steps for each factor of a thousand. Newton in
# between saves them; a faster sure method needs fewer (with momentum, as in the package, about $\sqrt\kappa$).


# %%
def random_program(seed, n=8):
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    K = Q @ np.diag(10.0 ** rng.uniform(-1.5, 1.5, n)) @ Q.T
    b = rng.normal(size=n) * (rng.random(n) < 0.3)
    return 0.5 * (K + K.T), K @ rng.normal(size=n) + rng.normal(size=n), 10.0 ** rng.uniform(-1, 1, n), b


def sure_steps_alone(program, enough=1e-6, most=20_000):
    K, f, w, b = program
    flexible = np.linalg.inv(K)
    rate, lam = 1.0 / np.linalg.eigvalsh(flexible).max(), np.zeros(len(f))
    for k in range(most):
        s = flexible @ (f - lam) - b
        if np.sum(w * np.abs(s) - lam * s) <= enough * 0.5 * f @ flexible @ f:
            return k
        lam = np.clip(lam + rate * s, -w, w)
    return most


programs = [random_program(seed) for seed in range(60)]
steps = np.array([sure_steps_alone(program) for program in programs])
assert steps.max() > 500
print(f"sure steps alone: {np.median(steps):.0f} at the median, {steps.max()} at worst")

# %% [markdown]
# **5.** Follow the iteration until a set comes back; the rounds between are the length. (Sets determine the next
# iterate, hence everything that follows, so one repetition is enough.) Two is the most frequent, but not the only one.


# %%
def length(program, c, rounds=200):
    """Rounds between two visits to the same sets: 1 is a solution."""
    y, lam, seen = program[3], np.zeros(len(program[3])), {}
    for k in range(rounds):
        y, lam, side = newton_step(program, y, lam, c)
        if (known := seen.setdefault(side.tobytes(), k)) != k:
            return k - known
    return rounds


lengths = [length(program, 100 * small_shift(program[0])) for program in programs]
found = dict(zip(*(part.tolist() for part in np.unique(lengths, return_counts=True)), strict=True))
assert found[2] == max(count for of, count in found.items() if of > 1)
assert max(found) > 2
print("length of the cycle: how many of 60 (1 is a solution)", found)
