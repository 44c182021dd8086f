"""What options say of themselves that several commands have."""

OUT = "Folder for what is written."
STUDY = "A study: a .toml file, or a .py file that has a stepper.Study named study."
RECORDING = "A folder that Stepper.record wrote."
