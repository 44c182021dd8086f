"""Models from what others wrote: files, text, compiled models."""

from stepper.loading.load import ModelWarning, compile_source, load
from stepper.loading.origins import Origin, origin_of

__all__ = ["ModelWarning", "Origin", "compile_source", "load", "origin_of"]
