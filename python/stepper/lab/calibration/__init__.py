"""Calibration: the smallest set of parameters that must be measured, with a certificate (`calibrate`).

- `search`: the smallest set, the widest tolerances, and certificates on fresh worlds
- `calibrate`: the search with a study, and its document
- `trajectories`: the same for measured trajectories of a real system
- `fit`: fits of parameters to trajectories with impacts, whose losses are rough
"""
