"""A hard case: the required behaviour of a correct program, and the findings of a run.

Let u_n be the answer to step n, gap_n its certified duality gap, and |.|_a the energy norm. Let u_n' be the answers of
a run in which every step is solved exactly. Then

    |u_n - u_n'|_a <= sum over m <= n of sqrt(2 gap_m)  + floors (bounds of rounding errors).

If a case has a closed form, the left side is measured. The answers of two solvers may differ by at most the sum of
their bounds. A solver that misses its accuracy must report the failure.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np

import vemcvx as vx
from vemcvx.scene import PosedScene, pose_scene

ANSWER, WARNING, REFUSAL = "answer", "answer with a warning", "refuse with an error"
ACCURACY = 1e-6
"""The requested relative error of Clarabel and OSQP."""
SOLVERS = (vx.Newton(accuracy=1e-8), vx.Clarabel(accuracy=ACCURACY), vx.OSQP(accuracy=ACCURACY))
ROUNDING = 1e-13
"""Relative rounding error of closed forms and of the energy norm itself."""


@dataclass(frozen=True)
class Setting:
    """A scene, its mesh, its instants, and the exact displacement if known."""

    scene: vx.Scene
    mesh: vx.PolygonMesh
    times: Any
    exact: np.ndarray | None = None
    """Exact displacement (N + 1, n_nodes, 2), if known."""
    options: dict[str, Any] = field(default_factory=dict)

    @cached_property
    def posed(self) -> PosedScene:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return pose_scene(self.scene, self.mesh)


@dataclass(frozen=True)
class Case:
    """One hard case."""

    name: str
    make: Callable[[], Setting]
    must: str = ANSWER
    says: str = ""
    """Words that the warning or the error must contain."""
    holds: Callable[[Setting, vx.History], str] = lambda setting, history: ""
    """Further check, which returns a fault or an empty string."""
    solvers: tuple[vx.Solver, ...] = SOLVERS
    beyond: bool = False
    """True if double precision cannot certify the case."""


@dataclass(frozen=True)
class Finding:
    """The behaviour of one solver in a case."""

    solver: str
    did: str
    words: str = ""
    certified: float = np.nan
    asked: float = np.nan
    floor: float = np.nan
    error: float = np.nan
    """The true relative energy error, if there is a closed form."""
    allowed: float = np.nan
    """The certified error of all steps plus the floors of all steps."""
    iterations: int = 0
    seconds: float = 0.0
    complaint: str = ""
    history: vx.History | None = None


def run(case: Case) -> list[Finding]:
    """Return every solver's finding."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            setting = case.make()
        except vx.VemcvxError as error:
            return [judge(case, make_refusal(solver, error)) for solver in case.solvers]
    findings = [attempt(case, setting, solver, caught) for solver in case.solvers]
    answers = [i for i, finding in enumerate(findings) if finding.history is not None]
    for i, j in combinations(answers, 2):
        apart = compare_findings(setting, findings[i], findings[j])
        if apart:
            findings[j] = replace_complaint(findings[j], apart)
    return findings


def make_refusal(solver: vx.Solver, error: vx.VemcvxError, seconds: float = 0.0) -> Finding:
    """Return the finding for a solver that raised an error."""
    did = REFUSAL if not isinstance(error, vx.NotAccepted | vx.NotCertified) else "says it cannot"
    return Finding(solver.name, did, str(error), seconds=seconds)


def attempt(case: Case, setting: Setting, solver: vx.Solver, earlier: Sequence[warnings.WarningMessage]) -> Finding:
    """Simulate a case and return the finding; `earlier` are the warnings issued when the setting was made."""
    start = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            options = {"check": False, **setting.options}
            history = vx.simulate(setting.scene, setting.mesh, setting.times, solver=solver, **options)
        except vx.VemcvxError as error:
            return judge(case, make_refusal(solver, error, time.perf_counter() - start))
    noted = [w for w in (*earlier, *caught) if issubclass(w.category, vx.SceneWarning | vx.MeshWarning)]
    said = [str(w.message) for w in noted]
    did = WARNING if said else ANSWER
    run = history.trajectory
    if run.certificate.max() > solver.accuracy:
        did = "says it cannot"
        said = [f"NotCertified: reached {run.certificate.max():.1e}, asked {solver.accuracy:.0e}"]
    floors = np.cumsum(np.sqrt(2 * run.floor)) / max(run.norm.max(), np.finfo(float).tiny)
    finding = Finding(
        solver.name,
        did,
        " ".join(said),
        float(run.certificate.max()),
        solver.accuracy,
        float(run.certificate_floor.max()),
        measure_error(setting, history),
        float(run.certificate_total[-1] + floors[-1]) + ROUNDING,
        int(run.iterations.max()),
        time.perf_counter() - start,
        history=history,
    )
    return judge(case, finding, setting)


def measure_error(setting: Setting, history: vx.History) -> float:
    """Return the largest error in the energy norm, relative to the largest norm of the run."""
    if setting.exact is None:
        return np.nan
    apart = (history.displacement - setting.exact[history.stored]).reshape(len(history.times), -1)
    A = setting.posed.A
    distance = np.sqrt(np.maximum(np.einsum("si,is->s", apart, A @ apart.T), 0.0))
    return float(distance.max() / history.trajectory.norm.max())


def judge(case: Case, finding: Finding, setting: Setting | None = None) -> Finding:
    """Return the finding, with a complaint if the solver's behaviour is not what the case requires."""
    newton = finding.solver == "Newton"
    if finding.did != case.must and not (finding.did == "says it cannot" and (case.beyond or not newton)):
        return replace_complaint(finding, f"must {case.must}, but: {finding.did} ({finding.words})")
    if case.says and finding.did == case.must and case.says not in finding.words:
        return replace_complaint(finding, f"does not say {case.says!r}, but: {finding.words}")
    if finding.error > finding.allowed:
        return replace_complaint(finding, f"true error {finding.error:.1e} above certificate {finding.allowed:.1e}")
    if finding.history is not None and finding.did == case.must and setting is not None:
        wrong = case.holds(setting, finding.history)
        if wrong:
            return replace_complaint(finding, wrong)
    return finding


def compare_findings(setting: Setting, one: Finding, other: Finding) -> str:
    """Return an empty string if two answers differ by no more than their certificates and floors, else a complaint."""
    first, second = one.history.trajectory, other.history.trajectory
    K = setting.posed.system.K
    apart = first.state - second.state
    distance = np.sqrt(np.maximum(np.einsum("si,is->s", apart, K @ apart.T), 0.0)).max()
    size = max(first.norm.max(), second.norm.max())
    allowed = (one.allowed + other.allowed) * size
    if not distance <= allowed:
        return f"differs from {one.solver} by {distance / size:.1e}, allowed is {allowed / size:.1e}"
    return ""


def replace_complaint(finding: Finding, complaint: str) -> Finding:
    return Finding(**{**vars(finding), "complaint": complaint})


def table(cases: Sequence[tuple[str, Case]]) -> list[tuple[str, Case, list[Finding]]]:
    """Run all cases and return (subject, case, findings) for each."""
    return [(subject, case, run(case)) for subject, case in cases]
