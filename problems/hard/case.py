"""A hard case: what a correct program must do with it, and what is found when it is run.

The claim under test is the certificate's. With u_n* the exact answer of every step and u_n' the exact evolution,

    |u_n - u_n'|_a <= sum over m <= n of sqrt(2 gap_m)  + what the stated round-off floors allow.

Where a case has a closed form, the left side is measured; elsewhere two solvers' answers may differ by no more than the
sum of their two bounds. A solver that misses its accuracy must say so; one that says nothing must be right.
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
SOLVERS = (vx.Newton(accuracy=1e-8), vx.Clarabel(accuracy=1e-6), vx.OSQP(accuracy=1e-6))
ROUNDING = 1e-13
"""Relative rounding of closed forms and of the energy norm itself."""


@dataclass(frozen=True)
class Setting:
    """What is simulated."""

    scene: vx.Scene
    mesh: vx.PolygonMesh
    times: Any
    exact: np.ndarray | None = None
    """(N + 1, n_nodes, 2) the displacement, where it is known to the last digit"""
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
    """words that the warning or the error has"""
    holds: Callable[[Setting, vx.History], str] = lambda setting, history: ""
    """a further claim: empty where it holds, else what is wrong"""
    solvers: tuple[vx.Solver, ...] = SOLVERS
    beyond: bool = False
    """whether it is beyond what doubles certify, so that Newton, too, may say that it cannot"""


@dataclass(frozen=True)
class Finding:
    """What one solver made of a case."""

    solver: str
    did: str
    words: str = ""
    certified: float = np.nan
    asked: float = np.nan
    floor: float = np.nan
    error: float = np.nan
    """true relative energy error, where there is a closed form"""
    allowed: float = np.nan
    """certified error of all steps plus floors"""
    iterations: int = 0
    seconds: float = 0.0
    complaint: str = ""
    history: vx.History | None = None


def run(case: Case) -> list[Finding]:
    """Every solver's finding; complaints of one against another are added to the second."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            setting = case.make()
        except vx.VemcvxError as error:
            return [judged(case, refusal(solver, error)) for solver in case.solvers]
    findings = [attempt(case, setting, solver, caught) for solver in case.solvers]
    answers = [i for i, finding in enumerate(findings) if finding.history is not None]
    for i, j in combinations(answers, 2):
        apart = disagreement(setting, findings[i], findings[j])
        if apart:
            findings[j] = replace_complaint(findings[j], apart)
    return findings


def refusal(solver: vx.Solver, error: vx.VemcvxError, seconds: float = 0.0) -> Finding:
    """An error is a finding, too."""
    did = REFUSAL if not isinstance(error, vx.NotAccepted | vx.NotCertified) else "says it cannot"
    return Finding(solver.name, did, str(error), seconds=seconds)


def attempt(case: Case, setting: Setting, solver: vx.Solver, earlier: Sequence[warnings.WarningMessage]) -> Finding:
    """Simulate a case; `earlier` is what was warned of when its setting was made."""
    start = time.perf_counter()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            options = {"check": False, **setting.options}
            history = vx.simulate(setting.scene, setting.mesh, setting.times, solver=solver, **options)
        except vx.VemcvxError as error:
            return judged(case, refusal(solver, error, time.perf_counter() - start))
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
        true_error(setting, history),
        float(run.certificate_total[-1] + floors[-1]) + ROUNDING,
        int(run.iterations.max()),
        time.perf_counter() - start,
        history=history,
    )
    return judged(case, finding, setting)


def true_error(setting: Setting, history: vx.History) -> float:
    """Largest distance from the closed form in the energy norm, relative to the largest norm."""
    if setting.exact is None:
        return np.nan
    apart = (history.displacement - setting.exact[history.stored]).reshape(len(history.times), -1)
    A = setting.posed.A
    distance = np.sqrt(np.maximum(np.einsum("si,is->s", apart, A @ apart.T), 0.0))
    return float(distance.max() / history.trajectory.norm.max())


def judged(case: Case, finding: Finding, setting: Setting | None = None) -> Finding:
    """With a complaint, if the finding is not what the case calls for."""
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


def disagreement(setting: Setting, one: Finding, other: Finding) -> str:
    """Empty where two answers differ by no more than their certificates and floors allow."""
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
    """Run all cases."""
    return [(subject, case, run(case)) for subject, case in cases]
