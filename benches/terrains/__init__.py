"""Cost of a step on terrain beside MuJoCo: `python -m terrains --help`."""
