"""The corpus: every robot model of the packages in `packages`, loaded and stepped by stepper and by MuJoCo.

`download` fetches and unpacks the packages, `files` finds models and compiles them, `dynamics` and `episode` compare both engines,
`measure` does all of that for one file in a process of its own, `sweep` for all files; `judge` says which models step well, and `report`
writes the page.
"""
