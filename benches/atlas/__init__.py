"""The failure atlas: scenes with known answers where methods fail, in every engine and setting, over time steps.

`scene` says what a scene is, `scenes` holds them, `world` and `engines` how to run them; `run` sweeps, `report` and `picture` write
the report, `known` says what stepper does not hold and why.
"""
