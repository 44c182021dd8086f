"""Models from what others wrote: files, text, compiled models."""

from stepper.loading.load import ModelWarning, compiled_of, load
from stepper.loading.mjcf import describe

__all__ = ["ModelWarning", "compiled_of", "describe", "load"]
