"""Check of an installation: versions, CPU level, optional packages, and a self-test that compares a short trajectory bit for bit."""

from stepper._stepper import cpu_levels
from stepper.doctor.diagnosis import Diagnosis, Extra, diagnose

__all__ = ["Diagnosis", "Extra", "cpu_levels", "diagnose"]
