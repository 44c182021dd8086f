"""Models from what others wrote: files, text, compiled models."""

from stepper.loading.load import ModelWarning, compiled_of, load

__all__ = ["ModelWarning", "compiled_of", "load"]
