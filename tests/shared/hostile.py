"""Damaged files, and functions that read files in separate processes with limited time and memory."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np

import vemcvx as vx

ROOT = Path(vx.__file__).parent.parent
MEMORY = 2 * 2**30
"""Bytes that a process may use. The limit of the address space is four times as large."""
SECONDS = 30
"""CPU seconds for a batch of files. The wall-clock limit is ten times as large."""

STRANGE = (b"1000000000000", b"-1", b"nan", b"inf", b"1e400", b"99999999999999999999", b"", b"\xff\xfe", b"300000000")
READER = textwrap.dedent(
    """
    import sys, warnings
    from pathlib import Path
    if sys.platform == "linux":  # Other systems have no limits.
        import resource
        resource.setrlimit(resource.RLIMIT_AS, (4 * int(sys.argv[1]),) * 2)
        resource.setrlimit(resource.RLIMIT_CPU, (int(sys.argv[2]),) * 2)
    import vemcvx as vx
    from vemcvx.results.files import read_archive
    warnings.simplefilter("ignore")
    read = {"mesh": vx.meshes.read, "program": vx.read_program, "history": lambda path: read_archive(Path(path))}
    for path in sys.argv[4:]:
        print("reading", path, flush=True)
        try:
            read[sys.argv[3]](path)
        except vx.VemcvxError as error:
            print(error)
            assert str(error).startswith(path), error
        if sys.platform == "linux":
            assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < int(sys.argv[1]) / 1024, path
    print("done")
    """
)


def read_all(paths, kind="mesh"):
    """Read files in a separate process. Return the error message of each file, or ""."""
    command = [sys.executable, "-c", READER, str(MEMORY), str(SECONDS), kind, *map(str, paths)]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=10 * SECONDS,
        cwd=ROOT,
        check=False,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )
    assert done.stdout.endswith("done\n"), f"{done.returncode}\n{done.stdout[-300:]}\n{done.stderr[-1500:]}"
    return [part.partition("\n")[2].strip() for part in done.stdout.removesuffix("done\n").split("reading ")[1:]]


def mutated(data, rng):
    """Return the bytes of a file, damaged in one of several ways."""
    at, kind = int(rng.integers(len(data))), rng.integers(8)
    if kind == 0:
        return data[:at]
    if kind == 1:
        return data[:at] + bytes([rng.integers(256)]) + data[at + 1 :]
    if kind == 2:
        lines = data.split(b"\n")
        i, j = rng.integers(len(lines), size=2)
        lines[i], lines[j] = lines[j], lines[i]
        return b"\n".join(lines)
    if kind == 3:
        return data[:at] + data[at // 2 :]
    words = data.split(b" ")
    i = int(rng.integers(len(words)))
    words[i] = STRANGE[rng.integers(len(STRANGE))]
    if kind == 4:
        return b" ".join(words)
    if kind == 5:
        return data[:at] + bytes(rng.integers(256, size=16).tolist()) + data[at:]
    if kind == 6:
        return data[:at] + bytes([data[at] ^ 1 << int(rng.integers(8))]) + data[at + 1 :]
    digits = [k for k, c in enumerate(data) if 48 <= c <= 57]
    if not digits:
        return b""
    k = digits[int(rng.integers(len(digits)))]
    return data[:k] + bytes([48 + rng.integers(10)]) * int(rng.integers(1, 14)) + data[k + 1 :]


def mutated_archive(data, rng):
    """Return the bytes of an NPZ file with one damaged array and correct check sums."""
    arrays = dict(np.load(io.BytesIO(data)))
    name = sorted(arrays)[int(rng.integers(len(arrays)))]
    array = arrays[name]
    if array.dtype.kind not in "if" or not array.size or rng.integers(4) == 0:
        arrays[name] = np.concatenate([array.ravel(), array.ravel()])[: int(rng.integers(2 * array.size + 1))]
    else:
        flat = array.ravel().copy()
        wrong = [-1, 2**31 - 1, -(2**31), 10**6, 0] + [np.nan, 1e308] * (array.dtype.kind == "f")
        flat[int(rng.integers(flat.size))] = wrong[int(rng.integers(len(wrong)))]
        arrays[name] = flat.reshape(array.shape)
    made = io.BytesIO()
    np.savez(made, **arrays)
    return made.getvalue()
