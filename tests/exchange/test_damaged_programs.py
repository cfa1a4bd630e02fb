"""Programs in files that went wrong: refused in a sentence, or read; no process ends, and no memory is written over."""

from __future__ import annotations

import re

import hostile
import numpy as np
import pytest
import scipy.sparse as sp

import vemcvx as vx
from vemcvx.exchange.arrays import read_matrix
from vemcvx.program import Operators, StepProgram

FORMS = "npz", "mtx", "cbf", "mps"


def program(block=1, n=8):
    """One of norm terms and limits, soft and hard, with a sparse K."""
    rng = np.random.default_rng(0)
    K = sp.csr_matrix(sp.diags_array([np.full(n, 4.0), np.full(n - 1, -1.0), np.full(n - 1, -1.0)], offsets=[0, 1, -1]))
    B, D = (sp.csr_matrix(rng.normal(size=(rows, n))) for rows in (3 * block, 2))
    operators = Operators(K, B, block=block, D=D, compliance=np.array([0.0, 0.3]))
    return StepProgram(operators, rng.normal(size=n), np.full(3, 0.7), rng.normal(size=3 * block), np.full(2, 0.05))


@pytest.fixture
def written(tmp_path):
    """Sound files, sound.npz and so on; those of Matrix Market are several."""
    for form in FORMS:
        vx.write_program(program(1 if form == "mps" else 2), tmp_path / f"sound.{form}")
    return tmp_path


@pytest.mark.long
def test_columns_and_rows_that_lead_out_of_a_matrix(written):
    """SciPy writes where they lead: of ten such files nine ended the process."""
    kept, paths = dict(np.load(written / "sound.npz")), []
    for name in ("K", "B", "D"):
        wrong = {"indices": (10**9, -5, 8), "indptr": (10**9, -3), "shape": (10**12, -1, 3)}
        for part, values in wrong.items():
            for value in values:
                array = kept[f"{name}_{part}"].astype(np.int64)
                array[len(array) // 2] = value
                paths.append(written / f"{name}_{part}{value}.npz")
                np.savez(paths[-1], **{**kept, f"{name}_{part}": array})
        # The last end before the first row, where SciPy's own check looks at nothing, and differences may overflow.
        for k, last in enumerate((-1, -(2**31))):
            paths.append(written / f"{name}_indptr_back{k}.npz")
            ends = np.append(kept[f"{name}_indptr"][:-1], last).astype(np.int32)
            np.savez(paths[-1], **{**kept, f"{name}_indptr": ends})
        for part in ("data", "indices", "indptr"):
            paths.append(written / f"{name}_{part}.npz")
            np.savez(paths[-1], **{**kept, f"{name}_{part}": kept[f"{name}_{part}"][:-2]})
    for path, says in zip(paths, hostile.read_all(paths, "program"), strict=True):
        lead_out = f"{path}: {path.stem[0]}: found "
        assert says.startswith((lead_out, f"{path}: Operators: {path.stem[0]}: found ", f"{path}: found K of shape")), (
            says
        )


NONE = "A: this is no Matrix Market file of a real matrix"


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "A: the file is cut short or is no text"),
        ("%%MatrixMarket matrix array complex general\n1 1\n1 1\n", NONE + ".*complex"),
        ("%%MatrixMarket matrix array real general\n", NONE),
        ("%%MatrixMarket matrix array real general\n1 -1\n", NONE),
        ("%%MatrixMarket matrix array real symmetric\n1 2\n", NONE),
        ("%%MatrixMarket matrix array real general\n1000000 1000000\n1\n", NONE),
        ("%%MatrixMarket matrix coordinate real general\n2 2 1\n3 1 1\n", NONE + ".*[Rr]ow index"),
        ("%%MatrixMarket matrix coordinate real general\n2 2 1\nnan 1 1\n", NONE),
        ("%%MatrixMarket matrix coordinate real general\n99999999999 1 1\n1 1 1\n", NONE + ".*99999999999 rows"),
    ],
)
def test_matrices_that_are_refused(tmp_path, text, says):
    (tmp_path / "a.mtx").write_text(text)
    with pytest.raises(vx.ProgramError, match=says):
        read_matrix(tmp_path / "a.mtx", "A")


ANY = "the file is damaged, or no .* file of a program"
CHANGES = [
    ("cbf", "block 2", "block -5", "found no first line .* only files written by write_program"),
    ("cbf", "block 2", "block 0", "its cones do not fit the sizes in the first line"),
    ("cbf", "terms 3", "terms 7", "its cones do not fit the sizes in the first line"),
    ("cbf", "unknowns 8", "unknowns 300000000", "in the first line; a file of this size cannot hold so many"),
    ("cbf", "unknowns 8", "unknown 8", "found no first line"),
    ("cbf", "\nCON\n", "\nCONE\n", ANY),
    ("cbf", "\nQ 3\n", "\nQ 4\n", "its cones do not fit"),
    ("cbf", "\nBCOORD\n[0-9]+\n", "\\g<0>9\n", ANY),
    ("cbf", "\nACOORD\n[0-9]+\n[0-9]+", "\\g<0>999", ANY),
    ("cbf", "\nOBJACOORD\n[0-9]+\n", "\\g<0>-1", ANY),
    ("mps", "^.*\n", "", "found no first line .* only files written by write_program"),
    (
        "mps",
        "motions 0",
        "motions 99",
        "found K of shape .8, 8. and N of shape .8, 8.|found N that is not in the kernel",
    ),
    ("mps", "motions 0", "motions 1", "found N that is not in the kernel of K"),
    ("mps", " d1 cost", " d0 cost", f"{ANY}: 'd0'"),
    ("mps", " rhs U1", " rhs Y1", f"{ANY}: 'Y1'"),
    ("mps", " d1 d1 ", " d1 ", ANY),
]


@pytest.mark.parametrize(("form", "old", "new", "says"), CHANGES)
def test_malformed_texts_are_refused_in_a_sentence(written, form, old, new, says):
    text = (written / f"sound.{form}").read_text()
    changed, count = re.subn(old, new, text, count=1)
    assert count
    (written / f"bad.{form}").write_text(changed)
    with pytest.raises(vx.ProgramError, match=f"bad.{form}: .*{says}"):
        vx.read_program(written / f"bad.{form}")


def test_parts_of_other_kinds_and_shapes(written):
    kept = dict(np.load(written / "sound.npz"))
    changes = {
        "g": (kept["g"] + 1j, "g: found .* does not read as an array of real numbers"),
        "w": (np.array(["a", "b", "c"]), "w: found .* does not read as an array of real numbers"),
        "K_data": (kept["K_data"].astype(complex), "K"),
        "K_indices": (kept["K_indices"].astype(float), "K: found compressed rows that are no matrix"),
        "K_shape": (np.array([10**12, 8]), "K: found compressed rows that are no matrix"),
        "d": (np.zeros(3), "d: found an array of shape"),
        "t": (np.array(np.nan), "t: found NaN"),
    }
    answer = {"d": np.zeros(8), "lam": np.zeros((3, 2)), "p": np.zeros(2), "step": np.array(1), "t": np.array(0.5)}
    np.savez(written / "solved.npz", **kept, **answer)
    assert vx.read_program(written / "solved.npz").step == 1
    for name, (value, says) in changes.items():
        np.savez(written / "bad.npz", **{**kept, **answer, name: value})
        with pytest.raises(vx.ProgramError, match=f"bad.npz: .*{says}"):
            vx.read_program(written / "bad.npz")
    for name in ("K_indptr", "lam", "g"):
        np.savez(written / "bad.npz", **{k: v for k, v in {**kept, **answer}.items() if k != name})
        with pytest.raises(vx.ProgramError, match=f"bad.npz: .*{name}"):
            vx.read_program(written / "bad.npz")
    for N, says in (np.ones((7, 1)), r"N of shape \(7, 1\); g has 8 unknowns"), (np.ones((8, 1)), "K N is not zero"):
        np.savez(written / "bad.npz", **{**kept, "N": N})
        with pytest.raises(vx.ProgramError, match=says):
            vx.read_program(written / "bad.npz")
