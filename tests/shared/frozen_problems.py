"""The problem files in their small settings, with answers of an earlier commit kept as data.

    python tests/shared/frozen_problems.py --judge          compare the package that is imported with the stored answers
    python tests/shared/frozen_problems.py --judge NAME ... the same of some problems
    python tests/shared/frozen_problems.py --make           store answers anew: with the worktree of the old commit only

Answers agree if final displacements, energies and losses differ by at most `RELATIVE` of the largest value, or by what
both certificates allow, added up over all steps. The times are CPU seconds of the mesh and the run.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import frozen_answers
import numpy as np

sys.path.append(str(Path(__file__).parents[2] / "problems"))

import gallery

RELATIVE = 1e-8
ANSWERS = Path(__file__).with_name("frozen_problems.npz")


@dataclass
class Judgement:
    """What became of problems, by their names."""

    faults: dict = field(default_factory=dict)
    """name -> in words, where answers do not agree"""
    seconds: dict = field(default_factory=dict)
    """name -> CPU seconds before and now"""
    apart: dict = field(default_factory=dict)
    """name -> largest relative difference of displacements, energies and losses"""


def judge(names=()):
    """Run problems, by default all that are stored, and compare them with the stored answers."""
    _, answers = frozen_answers.read(ANSWERS)
    told = Judgement()
    for name in names or answers:
        old = answers[name]
        problem = import_module(name)
        new, history = frozen_answers.answer(lambda problem=problem: gallery.small_run(problem))
        told.seconds[name] = old.seconds, new.seconds
        if new.refused or old.refused:
            if new.refused != old.refused:
                told.faults[name] = f"was {old.refused or 'answered'}, now {new.refused}: {new.message}"
            continue
        compared = frozen_answers.compare(old, new, history, growth=1.0)
        told.apart[name] = differences(old, new) if old.displacement.shape == new.displacement.shape else {}
        if compared.faults and not max(told.apart[name].values(), default=np.inf) <= RELATIVE:
            parts = ", ".join(f"{part} {value:.1e}" for part, value in told.apart[name].items())
            told.faults[name] = f"relative differences: {parts}; {'; '.join(compared.faults)}"
    return told


def differences(old, new):
    """The relative differences of final displacements, energies and losses."""
    parts = {}
    for name in ("displacement", "energy", "dissipated"):
        before, now = getattr(old, name), getattr(new, name)
        off, size = np.abs(now - before).max(initial=0.0), np.abs(before).max(initial=0.0)
        # A run without friction loses nothing: losses are small or large beside energies.
        size = max(size, np.abs(old.energy).max(initial=0.0)) if name == "dissipated" else size
        parts[name] = float(off / size) if size > 0 else (np.inf if off > 0 else 0.0)
    return parts


def report(told):
    """Print a judgement."""
    print(f"DISAGREE: {len(told.faults)} of {len(told.seconds)}")
    for name, words in told.faults.items():
        print(f"  {name}: {words}")
    print(f"{'CPU seconds':40s}  before     now   ratio  largest relative difference")
    for name, (before, now) in told.seconds.items():
        apart = max(told.apart.get(name, {}).values(), default=np.nan)
        print(f"{name:40s} {before:7.2f} {now:7.2f} {now / before:7.2f}  {apart:.1e}")
    before, now = np.sum(list(told.seconds.values()), axis=0)
    print(f"{'all':40s} {before:7.2f} {now:7.2f} {now / before:7.2f}")


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--judge", nargs="*", metavar="NAME", help="compare with the stored answers")
    parser.add_argument("--make", action="store_true", help="store answers of the package that is imported")
    options = parser.parse_args(arguments)
    print(frozen_answers.origin())
    if options.make:
        problems = {name: import_module(name) for name in gallery.problem_files()}
        runs = {name: frozen_answers.answer(lambda p=p: gallery.small_run(p)) for name, p in problems.items()}
        frozen_answers.write(ANSWERS, {name: run[0] for name, run in runs.items()})
    if options.judge is not None:
        told = judge(options.judge)
        report(told)
        return 1 if told.faults else 0
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
