"""Environments of `stepper.envs` as other libraries want them: one module for each library, imported by its name.

    from stepper.adapters.sb3 import StepperVecEnv

docs/adapters.md has an example of each. Importing one needs its library; importing this package needs none.
"""
