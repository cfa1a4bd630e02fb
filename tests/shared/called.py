"""Call commands without a new process."""

from typer.testing import CliRunner

from vemcvx.cli import app


def call(*words):
    """Return the exit code and the output of a command."""
    done = CliRunner().invoke(app, words)
    return done.exit_code, done.output
