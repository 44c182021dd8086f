"""Command line of stepper. A command is a function, whose annotations have its options with their help texts."""

from stepper.cli.app import main

__all__ = ["main"]
