"""Damaged files of programs cause a ProgramError."""

from __future__ import annotations

import re

import numpy as np
import pytest
import scipy.sparse as sp

import vemcvx as vx
from vemcvx.exchange.arrays import read_matrix
from vemcvx.program import Operators, StepProgram


@pytest.fixture
def sound(tmp_path):
    """A folder of undamaged program files."""
    rng, n = np.random.default_rng(0), 8
    K = sp.csr_matrix(sp.diags_array([np.full(n, 4.0), np.full(n - 1, -1.0), np.full(n - 1, -1.0)], offsets=[0, 1, -1]))
    for form in ("npz", "cbf", "mps"):
        block = 1 if form == "mps" else 2
        B, D = (sp.csr_matrix(rng.normal(size=(rows, n))) for rows in (3 * block, 2))
        operators = Operators(K, B, block=block, D=D, compliance=np.array([0.0, 0.3]))
        data = rng.normal(size=n), np.full(3, 0.7), rng.normal(size=3 * block), np.full(2, 0.05)
        vx.write_program(StepProgram(operators, *data), tmp_path / f"sound.{form}")
    return tmp_path


ARRAY, ENTRIES = "%%MatrixMarket matrix array real ", "%%MatrixMarket matrix coordinate real general\n"


@pytest.mark.parametrize(
    "text",
    [
        "",
        "%%MatrixMarket matrix array complex general\n1 1\n1 1\n",
        f"{ARRAY}general\n1 -1\n",
        f"{ARRAY}symmetric\n1 2\n",
        f"{ARRAY}general\n1000000 1000000\n1\n",
        f"{ENTRIES}2 2 1\n3 1 1\n",
        f"{ENTRIES}99999999999 1 1\n1 1 1\n",
    ],
)
def test_damaged_matrices_are_refused(tmp_path, text):
    (tmp_path / "a.mtx").write_text(text)
    with pytest.raises(vx.ProgramError, match="A: "):
        read_matrix(tmp_path / "a.mtx", "A")


@pytest.mark.parametrize(
    ("form", "old", "new", "says"),
    [
        ("cbf", "block 2", "block -5", "found no first line"),
        ("cbf", "unknowns 8", "unknowns 300000000", "cannot hold so many"),
        ("cbf", "\nQ 3\n", "\nQ 4\n", "cones do not fit"),
        ("cbf", "\nACOORD\n[0-9]+\n[0-9]+", "\\g<0>999", "damaged"),
        ("mps", "motions 0", "motions 1", "found N that is not in the kernel of K"),
        ("mps", " d1 cost", " d0 cost", "damaged"),
    ],
)
def test_damaged_text_files_are_refused(sound, form, old, new, says):
    changed, count = re.subn(old, new, (sound / f"sound.{form}").read_text(), count=1)
    assert count
    (sound / f"bad.{form}").write_text(changed)
    with pytest.raises(vx.ProgramError, match=rf"bad\.{form}: .*{says}"):
        vx.read_program(sound / f"bad.{form}")


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        ("g", lambda g: g + 1j, "g: "),
        ("g", lambda g: g[1:], "found K of shape"),
        ("w", lambda w: -w, "weights >= 0"),
        ("b", lambda b: b + np.nan, "NaN"),
        ("K_indices", lambda K: K + 10**9, "K: "),
        ("K_shape", lambda shape: np.array([10**12, 8]), "damaged"),
        ("N", lambda N: np.ones((8, 1)), "K N is not zero"),
        ("d", lambda d: np.zeros(3), "d: "),
        ("t", lambda t: np.array(np.nan), "t: "),
    ],
)
def test_damaged_arrays_are_refused(sound, name, change, says):
    answer = {"d": np.zeros(8), "lam": np.zeros((3, 2)), "p": np.zeros(2), "step": np.array(1), "t": np.array(0.5)}
    arrays = dict(np.load(sound / "sound.npz")) | answer
    np.savez(sound / "solved.npz", **arrays)
    assert vx.read_program(sound / "solved.npz").step == 1
    np.savez(sound / "bad.npz", **{**arrays, name: change(arrays[name])})
    with pytest.raises(vx.ProgramError, match=rf"bad\.npz: .*{says}"):
        vx.read_program(sound / "bad.npz")
    del arrays["lam" if name in answer else "K_indptr"]
    np.savez(sound / "bad.npz", **arrays)
    with pytest.raises(vx.ProgramError, match=r"bad\.npz: "):
        vx.read_program(sound / "bad.npz")
