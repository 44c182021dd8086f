"""Cost of a step on terrain, compared with MuJoCo: `python -m terrains --help`."""
