"""Corpus: robot models of many Python packages, loaded and stepped by stepper and by MuJoCo.

The module `packages` lists the packages, `download` fetches and unpacks them, and `files` finds and compiles models.
`dynamics` and `episode` compare both engines. `measure` does all of this for one file in a separate process, and `sweep` for all files.
`judge` has the criteria of a model that steps well, and `report` writes the page.
"""
