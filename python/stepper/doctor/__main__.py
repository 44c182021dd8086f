"""`python -m stepper.doctor`: the command `stepper doctor`, for an installation without the packages of the command line."""

import sys

from stepper.doctor.diagnosis import diagnose

if __name__ == "__main__":
    found = diagnose()
    print(found)
    sys.exit(not found)
