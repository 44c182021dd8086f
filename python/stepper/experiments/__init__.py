"""Experiments: stepper beside other engines, speed and error together."""
