"""Command line of stepper. Each command has a file, whose function `register` adds the command and its options to the application."""

from stepper.cli.app import main

__all__ = ["main"]
