"""Entry point of `python -m stepper.doctor`.

It does the same as `stepper doctor`, but does not need the optional packages of the command line.
"""

import sys

from stepper.doctor.diagnosis import diagnose

if __name__ == "__main__":
    found = diagnose()
    print(found)
    sys.exit(not found)
