"""Models from what others wrote: files, text, compiled models."""

from stepper.loading.load import ModelWarning, load

__all__ = ["ModelWarning", "load"]
