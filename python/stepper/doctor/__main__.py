"""Entry point of `python -m stepper.doctor`, which does the same as `stepper doctor` without the packages of the command line."""

import sys

from stepper.doctor.diagnosis import diagnose

if __name__ == "__main__":
    found = diagnose()
    print(found)
    sys.exit(not found)
