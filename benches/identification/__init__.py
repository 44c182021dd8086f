"""How right and how sure `stepper.sysid.identify` is, beside `mujoco.sysid`: docs/benchmarks/identification.md."""
