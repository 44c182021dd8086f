"""Check of an installation: versions, CPU level, optional packages, and a self-test that compares a short trajectory bit for bit."""

from stepper._stepper import cpu_levels
from stepper.doctor.diagnosis import Diagnosis, diagnose
from stepper.doctor.extras import Extra

__all__ = ["Diagnosis", "Extra", "cpu_levels", "diagnose"]
