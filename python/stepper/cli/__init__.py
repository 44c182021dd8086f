"""Command line of stepper. Each command has a file with a function, whose annotations have the options and their help texts."""

from stepper.cli.app import main

__all__ = ["main"]
