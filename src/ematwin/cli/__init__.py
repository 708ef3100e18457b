"""The command line: thin. Each command reads its options, calls the library, prints the answer."""

from ematwin.cli.app import main

__all__ = ["main"]
