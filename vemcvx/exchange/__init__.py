"""Programs of steps as files, each with a description in JSON: NPZ, Matrix Market, CBF, MPS, FCLIB."""

from vemcvx.exchange.arrays import sequence_from_npz, sequence_to_npz
from vemcvx.exchange.files import FORMATS, description, encode_program, in_json, read_program, write_program

__all__ = [
    "FORMATS",
    "description",
    "encode_program",
    "in_json",
    "read_program",
    "sequence_from_npz",
    "sequence_to_npz",
    "write_program",
]
