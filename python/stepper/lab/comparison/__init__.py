"""Comparison of hard contact, MuJoCo's contact law (both in stepper), and the engine MuJoCo on one model.

- `trial`: run of one engine, recorded step by step
- `comparison`: numbers of all engines (depths, forces, energies), and their table
- `draw`: picture of the recorded runs
"""

from stepper.lab.comparison.comparison import LawComparison, compare

__all__ = ["LawComparison", "compare"]
