"""Functions outside kernels that compute with SIMD lanes, with the number of their calls of CPU intrinsics.

Lane operations are fast only in a kernel (`kernel!` of crates/real) and in functions that the compiler inlines into one. Elsewhere each
operation calls a function, which reads and writes memory. This command builds the extension with symbols for one CPU level, and finds
these calls in its machine code. Functions that run in each step should not be in the list.

    python benches/kernels.py
    python benches/kernels.py --level avx512 --limit 100
"""

import argparse
import os
import re
import shutil
import subprocess
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
"""Root folder of the repository."""

TARGET = ROOT / "target" / "kernels"
"""Folder of the build. The usual build is stripped of symbols."""

FEATURES = "pyo3/abi3-py311,stepper-core/nalgebra,stepper-core/internals"
"""Cargo features of the extension, as in pyproject.toml, but without the linking of an executable."""

FUNCTION = re.compile(r"^[0-9a-f]+ <(?P<name>.*)>:$")
"""First line of a function in the output of objdump."""

INTRINSIC = re.compile(r"\bcall\b.*<core::core_arch::")
"""Call of a CPU intrinsic in the output of objdump."""


def main() -> None:
    """Print a markdown table of the functions, those with most calls first."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--level", default="avx2", choices=("avx2", "avx512"), help="CPU level of the build [%(default)s]")
    parser.add_argument("--limit", type=int, default=40, help="largest number of functions in the table [%(default)s]")
    given = parser.parse_args()
    if shutil.which("objdump") is None:
        raise SystemExit("objdump is needed to read machine code, and is not installed: install the Debian package binutils")
    calls = intrinsic_calls(build(given.level))
    print("| function | calls of intrinsics |\n|---|---|")
    for name, count in calls.most_common(given.limit):
        print(f"| `{name}` | {count} |")
    print(f"\n{calls.total()} calls in {len(calls)} functions")


def build(level: str) -> Path:
    """Builds the extension with symbols for one CPU level, and returns its file."""
    settings = {"STEPPER_ONE_LEVEL": level, "CARGO_PROFILE_RELEASE_STRIP": "none", "CARGO_TARGET_DIR": str(TARGET)}
    command = ["cargo", "build", "--release", "-p", "stepper-python", "--lib", "--features", FEATURES]
    subprocess.run(command, check=True, cwd=ROOT, env=os.environ | settings)
    return TARGET / "release" / "lib_stepper.so"


def intrinsic_calls(library: Path) -> Counter[str]:
    """Number of calls of CPU intrinsics in each function of a library. Instances of a generic function count as one function."""
    calls: Counter[str] = Counter()
    function = ""
    command = ["objdump", "--disassemble", "--demangle", "--no-show-raw-insn", str(library)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if found := FUNCTION.match(line):
                function = found["name"]
            elif INTRINSIC.search(line):
                calls[function] += 1
    return calls


if __name__ == "__main__":
    main()
