"""MuJoCo's contact law beside MuJoCo: one step from the same state, motion over time, and speed."""
