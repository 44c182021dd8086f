"""How right and how sure `stepper.identify` is, beside `mujoco.sysid`: docs/identification.md."""
