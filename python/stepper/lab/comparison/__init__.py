"""Comparison of hard contact, MuJoCo's law of contact and MuJoCo on one model.

- `trial`: run of one engine, recorded step by step
- `comparison`: figures of all engines as a table
- `draw`: picture
"""

from stepper.lab.comparison.comparison import Comparison, compare

__all__ = ["Comparison", "compare"]
