"""Check of an installation: CPU level, versions, optional packages, and whether a short trajectory has the expected bits."""

from stepper._stepper import cpu_levels
from stepper.doctor.diagnosis import Diagnosis, diagnose
from stepper.doctor.extras import Extra

__all__ = ["Diagnosis", "Extra", "cpu_levels", "diagnose"]
