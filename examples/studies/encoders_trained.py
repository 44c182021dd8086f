"""The episodes of encoders.py, with a policy that was trained on encoders with noise, drift and delay.

stepper report examples/studies/encoders_trained.py
"""

from __future__ import annotations

import importlib.util
from pathlib import Path

_spec = importlib.util.spec_from_file_location("encoders", Path(__file__).with_name("encoders.py"))
assert _spec is not None
assert _spec.loader is not None
_encoders = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(_encoders)

study = _encoders.balancing("encoders_trained", "inverted_double_pendulum_encoders.npz")
