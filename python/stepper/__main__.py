"""Entry point of `python -m stepper`, which runs the command `stepper`."""

from stepper.cli import main

if __name__ == "__main__":
    main()
