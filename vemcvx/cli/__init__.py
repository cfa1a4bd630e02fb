"""The command line, `vemcvx run FILE`, `vemcvx show FILE`, `vemcvx compare FILE` and `vemcvx cost FILE`."""

from vemcvx.cli.commands import app, main

__all__ = ["app", "main"]
