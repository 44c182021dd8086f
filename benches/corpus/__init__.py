"""Corpus: all robot models of the packages in `packages`, loaded and stepped by stepper and by MuJoCo.

`download` fetches and unpacks the packages, and `files` finds and compiles models. `dynamics` and `episode` compare both engines. `measure`
does all of this for one file in a separate process, and `sweep` for all files. `judge` has the criteria of a model that steps well, and
`report` writes the page.
"""
