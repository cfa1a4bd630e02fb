"""The command line: `vemcvx run`, `show`, `compare`, `export`, `cost`, `collection`, and others on what came along."""

from vemcvx.cli.commands import app, main

__all__ = ["app", "main"]
