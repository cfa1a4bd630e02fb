"""Two thousand random scenes against the stored answers of an earlier commit: tests/shared/frozen_scenes.py.

A failure names the seed of the scene: ``frozen_scenes.draw(seed)`` builds it.
"""

from __future__ import annotations

from dataclasses import replace

import frozen_answers
import frozen_scenes
import pytest

import vemcvx as vx

DEFAULT = range(12)
MORE_REFUSALS = 0.02
"""Part of all scenes that may be refused beyond those which were refused before."""
OTHER_ANSWERS = 0.02
"""Part of all scenes, with friction that follows the answer, that may have another solution than before."""


def in_words(seeds):
    return "\n".join(f"seed {seed}: {words}" for seed, words in seeds.items())


def check(seeds):
    """Judge scenes; return the judgement."""
    told = frozen_scenes.judge(seeds)
    assert not told.wrong, f"{len(told.wrong)} answers outside both certificates:\n{in_words(told.wrong)}"
    assert not told.crashed, f"errors that are none of vemcvx: {told.crashed}\n{in_words(told.messages)}"
    unclear = {seed: words for seed, words in told.messages.items() if not (words.endswith(".") and " " in words)}
    assert not unclear, f"errors without a sentence:\n{in_words(unclear)}"
    assert len(told.other) <= OTHER_ANSWERS * len(seeds), in_words(told.other)
    # One scene is a larger part of few scenes.
    more, allowed = told.refused.total() - told.refused_before.total(), max(1.0, MORE_REFUSALS * len(seeds))
    assert more <= allowed, f"{more} more refusals, allowed are {allowed:g}:\n{in_words(told.newly_refused)}"
    return told


def test_scenes_have_the_stored_answers():
    told = check(DEFAULT)
    assert len(told.ratios) > 0.9 * len(DEFAULT)


@pytest.mark.long
def test_all_scenes_have_the_stored_answers():
    check(range(frozen_scenes.COUNT))


def test_a_wrong_answer_is_seen():
    """A millionth more displacement, energy or loss is outside the certificates of a sharp answer."""
    scene = frozen_scenes.draw(5)
    new, history = frozen_answers.answer(scene.run)
    assert new.certified < 1e-9
    assert frozen_answers.compare(new, new, history).ratio == 0.0
    for name in ("displacement", "energy", "dissipated"):
        off = replace(new, **{name: getattr(new, name) * (1 + 1e-6)})
        assert frozen_answers.compare(off, new, history).faults


def test_rigid_motions_are_no_difference_of_strains():
    """Bodies that float have no unique place."""
    scene = frozen_scenes.draw(1)
    new, history = frozen_answers.answer(scene.run)
    moved = replace(new, displacement=new.displacement + abs(new.displacement).max())
    assert not frozen_answers.compare(moved, new, history).faults


def test_a_refusal_is_an_answer_with_its_class_and_message():
    def refuse():
        raise vx.SceneError("scene: this one is refused.")

    kept, history = frozen_answers.answer(refuse)
    assert (kept.refused, kept.message, history) == ("SceneError", "scene: this one is refused.", None)
