"""Failure atlas: difficult scenes with known answers, simulated by several engines and settings at several time steps.

`scene` defines the class `Scene`, and `scenes` has all scenes. `world` and `engines` run a scene in an engine. `run` makes the sweep: it
runs all scenes in all engines. `report` and `picture` write the page docs/benchmarks/atlas.md. `known` lists the known failures of stepper
with their reasons.
"""
