"""Programs of steps as files, for solvers and people outside: NPZ, Matrix Market, CBF, QPS, each with words in JSON."""

from vemcvx.exchange.files import FORMATS, encoded, put, read_program, write_program

__all__ = ["FORMATS", "encoded", "put", "read_program", "write_program"]
