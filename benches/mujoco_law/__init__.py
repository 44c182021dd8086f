"""Comparison of MuJoCo's contact law in stepper with MuJoCo: single steps, motion over time, and speed."""
