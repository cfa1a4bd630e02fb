"""Commands as tests call them, in the same process."""

from typer.testing import CliRunner

from vemcvx.cli import app


def call(*words):
    """Exit code and output of a command."""
    done = CliRunner().invoke(app, words)
    return done.exit_code, done.output
