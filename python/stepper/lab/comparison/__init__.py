"""One model under both laws of contact, and beside MuJoCo: what differs.

`trial` steps an engine and keeps what it did, `comparison` says it, `draw` shows it.
"""

from stepper.lab.comparison.comparison import Comparison, compare

__all__ = ["Comparison", "compare"]
