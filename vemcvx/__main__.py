"""python -m vemcvx: the command line."""

from vemcvx.cli import main

main()
