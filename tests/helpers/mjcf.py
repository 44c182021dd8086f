"""Scenes of tests, which are files in tests/scenes."""

from pathlib import Path


def mjcf(name: str) -> str:
    """Text of a scene."""
    return (Path(__file__).parents[1] / "scenes" / f"{name}.xml").read_text(encoding="utf-8")
