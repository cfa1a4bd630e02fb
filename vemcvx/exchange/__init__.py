"""Programs of steps as files, for solvers and people outside: NPZ, Matrix Market, CBF, QPS, each with words in JSON."""

from vemcvx.exchange.arrays import sequence_from_npz, sequence_to_npz
from vemcvx.exchange.files import FORMATS, description, encoded, in_json, put, read_program, write_program

__all__ = [
    "FORMATS",
    "description",
    "encoded",
    "in_json",
    "put",
    "read_program",
    "sequence_from_npz",
    "sequence_to_npz",
    "write_program",
]
