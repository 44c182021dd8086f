"""`python -m stepper.doctor`, which is `stepper doctor` for installations without the packages of the command line."""

import sys

from stepper.doctor.diagnosis import diagnose

if __name__ == "__main__":
    found = diagnose()
    print(found)
    sys.exit(not found)
