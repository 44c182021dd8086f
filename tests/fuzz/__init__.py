"""Inputs that nobody means well: what is saved, sent and called, damaged at random. `make fuzz` runs it; see `fuzz.__main__`."""
