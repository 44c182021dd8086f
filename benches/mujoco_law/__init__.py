"""Comparison of MuJoCo's contact law in stepper with MuJoCo: single steps and speed."""
