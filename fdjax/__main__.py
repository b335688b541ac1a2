"""`python -m fdjax` is the command line."""

from fdjax.app.cli import command

command()
