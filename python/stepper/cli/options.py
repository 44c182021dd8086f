"""What options say of themselves that several commands have."""

OUT = "Folder for what is written."
RECORDING = "A folder that Stepper.record wrote."
