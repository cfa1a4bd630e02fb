"""Stored answers of an earlier commit, and the distance of new answers from the stored ones.

An answer is the final displacement with energies, losses and certificates at all instants, or the class and message of
an error. Two answers agree if they differ by no more than both certificates allow.

Let e_m and e'_m be the absolute certificates of step m in the two answers, rounding included: each bounds the error of
step m alone, given the state before it. A step with given friction and two-sided contact is a proximal map, which is
nonexpansive in the energy norm: errors add up. One-sided contact couples normal and tangential forces, by Dundurs' beta
<= 1/2 of an elastic body, and friction that depends on pressure or slip feeds a part q < 1 of an error back into the
step. A step then enlarges an error by a factor of at most (1 - beta^2)^(-1/2) / (1 - q), about 3 for q = 0.6. With
`GROWTH` = 4 in these cases, and 1 in all others,

    delta_n = sum over m <= n of GROWTH^(n - m) (e_m + e'_m) + ROUNDING * (largest energy norm)

bounds |u_n - u'_n|_a, and |E_n - E'_n| <= delta_n (|u_n|_a + |u'_n|_a) / 2. The norm |.|_a depends on strains only, not
on rigid motions: the place of a floating body is not unique.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial.distance import cdist

import vemcvx as vx
from vemcvx.cli.terminal import limit_log

GROWTH = 4.0
"""Largest factor by which a step enlarges the error of the step before, with one-sided contact or a law of friction."""
ROUNDING = 1e-10
"""Allowed rounding error, relative to the largest energy norm: a hundredth of the requested accuracy."""
LOSS = 30.0
"""Factor from relative errors of states to relative errors of losses, which are sums of forces times slips."""
ARRAYS = ("displacement", "energy", "dissipated", "error")
SCALARS = ("refused", "message", "kind", "certified")


@dataclass
class FrozenAnswer:
    """A final displacement (n_nodes, dim), and energies, losses and errors e_n (N + 1,) of a run; or its refusal."""

    refused: str = ""
    message: str = ""
    kind: str = ""
    """`History.certificate_kind`"""
    certified: float = 0.0
    """largest relative certificate of a step, rounding included"""
    displacement: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    energy: np.ndarray = field(default_factory=lambda: np.zeros(0))
    dissipated: np.ndarray = field(default_factory=lambda: np.zeros(0))
    error: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def norm(self):
        """The largest energy norm (sqrt(2 E)) of the run."""
        return float(np.sqrt(2 * self.energy.max(initial=0.0)))


def answer(run):
    """Return the answer of run() and its history, which is None if the run was refused."""
    with warnings.catch_warnings(), limit_log(0):
        warnings.simplefilter("ignore", vx.SceneWarning)
        try:
            history = run()
        except vx.VemcvxError as error:
            return FrozenAnswer(type(error).__name__, str(error)), None
        except Exception as error:
            return FrozenAnswer(f"crash {type(error).__name__}", str(error)), None
    path = history.trajectory
    # If nothing has moved, the error and its unit are zero.
    error = np.where(path.unit > 0, path.certified * np.where(path.unit > 0, path.unit, 1.0), 0.0)
    kept = FrozenAnswer("", "", path.certificate_kind, float(path.certified.max()), history.displacement[-1])
    kept.energy, kept.dissipated, kept.error = path.energy, path.dissipated, error
    return kept, history


@dataclass
class Comparison:
    """The distance of two answers divided by the allowed distance (at most 1 if they agree), and faults in words."""

    ratio: float
    faults: list


def compare(old, new, history, growth=GROWTH):
    """Compare an old answer with a new one."""
    if old.displacement.shape != new.displacement.shape or old.energy.shape != new.energy.shape:
        shapes = f"{new.displacement.shape} displacements where there were {old.displacement.shape}"
        return Comparison(np.inf, [f"other scene: {shapes}"])
    both = old.error + new.error
    if not (np.isfinite(both).all() and np.isfinite(new.displacement).all()):
        return Comparison(np.inf, ["a certificate or a displacement is not finite"])
    norm, allowed, last = max(old.norm, new.norm), [], 0.0
    for error in both:
        last = growth * last + error
        allowed.append(last + ROUNDING * norm)
    allowed = np.array(allowed)
    distance = measure_distance(history, old.displacement)
    if distance > allowed[-1]:
        # Versions of GEOS and SciPy number nodes differently: pair each old displacement with the nearest new one.
        paired = linear_sum_assignment(cdist(new.displacement, old.displacement))[1]
        distance = min(distance, measure_distance(history, old.displacement[paired]))
    norms = np.sqrt(2 * old.energy) + np.sqrt(2 * new.energy)
    size = max(norm, old.dissipated.max() / norm if norm > 0 else 0.0)
    tests = {
        "the final displacement": (distance, allowed[-1]),
        "the energy": _worst(new.energy - old.energy, 0.5 * allowed * norms + ROUNDING * old.energy.max()),
        "the loss": _worst(new.dissipated - old.dissipated, LOSS * np.cumsum(allowed) * size),
    }
    ratios = {name: (off / most if most > 0 else (np.inf if off > 0 else 0.0)) for name, (off, most) in tests.items()}
    faults = [
        f"{name} is off by {tests[name][0]:.2e}, certificates allow {tests[name][1]:.2e} (energy norm {norm:.2e})"
        for name, ratio in ratios.items()
        if not ratio <= 1.0
    ]
    return Comparison(max(ratios.values()), faults)


def measure_distance(history, rows):
    """Return the energy distance of the last displacement of a history from another displacement (n_nodes, dim)."""
    before = vx.measures.Field(history.mesh, rows, history.moduli, stabilisation=history.stabilisation or "shear")
    return vx.measures.energy_distance(history, before, kind="nodal").absolute


def _worst(off, allowed):
    """Return the deviation and the allowed deviation at the instant at which their ratio is largest."""
    n = int(np.argmax(np.abs(off) / np.maximum(allowed, np.finfo(float).tiny)))
    return abs(float(off[n])), float(allowed[n])


def read(path):
    """Return the answers {name: FrozenAnswer} of a file."""
    with np.load(path) as file:
        kept = {key: file[key] for key in file.files}
    rows = zip(*(kept[key].tolist() for key in SCALARS), strict=True)
    answers = {name: FrozenAnswer(*row) for name, row in zip(kept["names"].tolist(), rows, strict=True)}
    for key in ARRAYS:
        shapes = kept[f"{key}_shape"]
        parts = np.split(kept[key], np.cumsum(shapes.prod(axis=1))[:-1])
        for one, part, shape in zip(answers.values(), parts, shapes, strict=True):
            setattr(one, key, part.reshape(shape) if key == "displacement" else part)
    return answers
