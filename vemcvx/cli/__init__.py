"""The command line: `vemcvx run`, `show`, `compare`, `export` and `cost`, each of a problem file."""

from vemcvx.cli.commands import app, main

__all__ = ["app", "main"]
