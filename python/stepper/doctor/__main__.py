"""Entry point of `python -m stepper.doctor`.

The output is that of `stepper doctor`, but the optional packages of the command line need not be installed.
"""

import sys

from stepper.doctor.diagnosis import diagnose

if __name__ == "__main__":
    found = diagnose()
    print(found)
    sys.exit(not found)
