"""Sizes on disk of the optional extras of the package, each installed from PyPI into an empty folder: the table of docs/index.md.

python benches/extras.py [EXTRA ...]
"""

import argparse
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def megabytes(requirements):
    """Size on disk of packages and of all their dependencies, MB (10^6 bytes). `requirements` are arguments of `pip install`."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-compile", "--target", folder, *requirements]
        subprocess.run(command, check=True)
        return sum(path.lstat().st_size for path in Path(folder).rglob("*") if path.is_file()) / 1e6


def main():
    """Print the size on disk of each extra that the command line names, or of all extras if it names none. NumPy is included."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("extras", nargs="*", choices=[*PROJECT["optional-dependencies"], []], help="extras to measure [all]")
    names = parser.parse_args().extras or [*PROJECT["optional-dependencies"]]
    print(f"{'without extras':16}{megabytes(PROJECT['dependencies']):8.0f} MB", flush=True)
    for name in names:
        print(f"{name:16}{megabytes(PROJECT['dependencies'] + PROJECT['optional-dependencies'][name]):8.0f} MB", flush=True)


if __name__ == "__main__":
    main()
