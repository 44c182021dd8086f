"""MJCF: what MuJoCo's compiler made of it, as a description that the Rust crate checks."""

from stepper.loading.mjcf.describe import describe

__all__ = ["describe"]
