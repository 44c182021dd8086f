"""Command `stepper doctor`: check of the installation."""

from __future__ import annotations

import sys

from stepper.doctor import diagnose


def doctor() -> None:
    """Checks this installation: versions, CPU level, optional packages, and whether a short trajectory is identical bit for bit.

    The exit code is 1 if the trajectory differs, the self-test fails, two versions of MuJoCo are mixed, or the level STEPPER_CPU_LEVEL is
    not available. `python -m stepper.doctor` does the same without the packages of the command line.

    Example: stepper doctor
    """
    found = diagnose()
    print(found)
    if not found:
        sys.exit(1)
