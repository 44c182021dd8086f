"""The command line: one command, one file, whose `register` adds it to the application with its options."""

from stepper.cli.app import main

__all__ = ["main"]
