"""Comparison of hard contact, MuJoCo's law of contact and MuJoCo on one model.

- `trial`: run of one engine, recorded step by step
- `comparison`: numbers of all engines (depths, forces, energies), and their table
- `draw`: picture of the recorded runs
"""

from stepper.lab.comparison.comparison import Comparison, compare

__all__ = ["Comparison", "compare"]
