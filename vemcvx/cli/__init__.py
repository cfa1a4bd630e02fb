"""The command line: `vemcvx run`, `show`, `compare`, `export` and `cost` of a problem file, and `vemcvx collection`."""

from vemcvx.cli.commands import app, main

__all__ = ["app", "main"]
