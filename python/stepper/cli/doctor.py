"""`stepper doctor`."""

from __future__ import annotations

import sys
from types import ModuleType
from typing import TYPE_CHECKING

from stepper.doctor import diagnose

if TYPE_CHECKING:
    from typer import Typer


def doctor() -> None:
    """Checks this installation: versions, CPU level, optional packages, and whether a short trajectory has the expected bits.

    The exit code is 1 if the bits differ, a self-test fails, two versions of MuJoCo are mixed or STEPPER_CPU_LEVEL names an unusable
    level. Without the command line's packages: python -m stepper.doctor

    Example: stepper doctor
    """
    found = diagnose()
    print(found)
    if not found:
        sys.exit(1)


def register(app: Typer, typer: ModuleType) -> None:
    """Adds the command."""
    app.command("doctor")(doctor)
