"""Two thousand random scenes against the stored answers of an earlier commit; see tests/shared/frozen_scenes.py.

A failure names the seed of the scene: ``frozen_scenes.draw(seed)`` builds it.
"""

from __future__ import annotations

from dataclasses import replace

import frozen_answers
import frozen_scenes
import pytest

DEFAULT = range(12)
MORE_REFUSALS = 0.02
"""Largest increase of the fraction of refused scenes."""
OTHER_ANSWERS = 0.02
"""Largest fraction of scenes with another solution than before: with a law of friction, a step may have several."""


def join_words(seeds):
    return "\n".join(f"seed {seed}: {words}" for seed, words in seeds.items())


def check(seeds):
    """Check the scenes of all seeds against their stored answers, and return the judgement."""
    judgement = frozen_scenes.judge(seeds)
    assert not judgement.wrong, (
        f"{len(judgement.wrong)} answers differ by more than both certificates:\n{join_words(judgement.wrong)}"
    )
    assert not judgement.crashed, (
        f"errors of other classes than VemcvxError: {judgement.crashed}\n{join_words(judgement.messages)}"
    )
    unclear = {seed: words for seed, words in judgement.messages.items() if not (words.endswith(".") and " " in words)}
    assert not unclear, f"errors without a sentence:\n{join_words(unclear)}"
    assert len(judgement.other) <= OTHER_ANSWERS * len(seeds), join_words(judgement.other)
    # One newly refused scene is allowed, even if few scenes are judged.
    more, allowed = judgement.refused.total() - judgement.refused_before.total(), max(1.0, MORE_REFUSALS * len(seeds))
    assert more <= allowed, f"{more} more refusals, {allowed:g} are allowed:\n{join_words(judgement.newly_refused)}"
    return judgement


def test_scenes_have_the_stored_answers():
    judgement = check(DEFAULT)
    assert len(judgement.ratios) > 0.9 * len(DEFAULT)


@pytest.mark.slow
def test_all_scenes_have_the_stored_answers():
    check(range(frozen_scenes.COUNT))


def test_the_judgement_finds_relative_errors_of_a_millionth():
    scene = frozen_scenes.draw(5)
    new, history = frozen_answers.answer(scene.run)
    assert new.certified < 1e-9
    assert frozen_answers.compare(new, new, history).ratio == 0.0
    for name in ("displacement", "energy", "dissipated"):
        off = replace(new, **{name: getattr(new, name) * (1 + 1e-6)})
        assert frozen_answers.compare(off, new, history).faults


def test_the_judgement_ignores_rigid_motions():
    scene = frozen_scenes.draw(1)
    new, history = frozen_answers.answer(scene.run)
    moved = replace(new, displacement=new.displacement + abs(new.displacement).max())
    assert not frozen_answers.compare(moved, new, history).faults
