"""Accuracy and confidence intervals of `stepper.sysid`, compared with `mujoco.sysid`: docs/benchmarks/identification.md."""
