"""Study of a policy that balances a double pendulum, and that was trained on encoders with noise, drift and delay.

The study is that of encoders.py, except for the policy.

Usage:

    stepper report examples/studies/encoders_trained.py
"""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))

from encoders import trained as study  # type: ignore[import-not-found]  # noqa: F401
