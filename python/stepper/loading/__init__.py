"""Loading of models from files, text and compiled models."""

from stepper.loading.findings import ModelWarning
from stepper.loading.load import compile_source, is_saved, load
from stepper.loading.mjcf import describe
from stepper.loading.origins import Origin, origin_of, remember

__all__ = ["ModelWarning", "Origin", "compile_source", "describe", "is_saved", "load", "origin_of", "remember"]
