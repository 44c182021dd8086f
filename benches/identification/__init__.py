"""How right and how sure `stepper.sysid.identify` is, beside `mujoco.sysid`: docs/identification.md."""
