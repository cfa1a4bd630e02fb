"""A history in a folder: a series for ParaView, a summary for scripts, and everything, to the bit, for us."""

from vemcvx.files.folder import read_history, writable_folder, write_history
from vemcvx.files.summary import Origin

__all__ = ["Origin", "read_history", "writable_folder", "write_history"]
