"""The command line, `vemcvx run FILE` and `vemcvx show FILE`."""

from vemcvx.cli.commands import app, main

__all__ = ["app", "main"]
