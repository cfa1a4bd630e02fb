"""Files of programs in the formats NPZ, Matrix Market, CBF, MPS and FCLIB, with descriptions in JSON."""

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
