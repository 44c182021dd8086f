"""`python -m stepper.cli`: the command `stepper`."""

from stepper.cli import main

if __name__ == "__main__":
    main()
