"""Study of encoders.py with a policy that was trained on encoders with noise, drift and delay.

Usage:

    stepper report examples/studies/encoders_trained.py
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from encoders import trained as study  # type: ignore[import-not-found]  # noqa: F401
