"""The command line: `vemcvx run`, `show`, `compare`, `export`, `cost`; `collection`; `problems`, `lesson`, `doctor`."""

from vemcvx.cli.commands import app, main

__all__ = ["app", "main"]
