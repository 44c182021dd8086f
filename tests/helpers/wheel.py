"""The wheel that `make wheel` builds, and an environment that has nothing but it and NumPy. Run it to print figures."""

import json
import statistics
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from importlib import metadata
from pathlib import Path

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "python/stepper"
WHEELS = ROOT / "target/wheels"
MADE = ("__pycache__", "_stepper.abi3.so")
"""What lies in the package's folder and is no source: compiled Python, and the binary of `maturin develop`."""

IMPORT = """
import json, time
began = time.perf_counter()
import numpy
between = time.perf_counter()
import stepper
print(json.dumps([1e3 * (between - began), 1e3 * (time.perf_counter() - between)]))
"""


def sources() -> list[Path]:
    """Files of the package as its authors wrote them."""
    return [file for file in sorted(PACKAGE.rglob("*")) if file.is_file() and not set(MADE) & set(file.parts)]


def built() -> Path | None:
    """The wheel, if it is there and no file that goes into it has changed since."""
    wheels = sorted(WHEELS.glob("stepper_sim-*.whl"))
    if len(wheels) != 1:
        return None
    inputs = [*sources(), *PACKAGE.glob("*.so"), ROOT / "NOTICES", ROOT / "pyproject.toml"]
    return wheels[0] if wheels[0].stat().st_mtime >= max(file.stat().st_mtime for file in inputs) else None


def install(wheel: Path, folder: Path) -> Path:
    """Makes a virtual environment of a wheel and the NumPy that runs this, without asking any registry: returns its Python."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", folder], check=True)
    python = folder / "bin/python"
    (site,) = folder.glob("lib/python*/site-packages")
    numpy = metadata.distribution("numpy")
    for name in {file.parts[0] for file in numpy.files or [] if file.parts[0] != ".."}:
        (site / name).symlink_to(Path(str(numpy.locate_file(name))).resolve())
    pip = [sys.executable, "-m", "pip", "--python", python, "--quiet", "--disable-pip-version-check"]
    subprocess.run([*pip, "install", "--no-index", "--no-deps", wheel], check=True)
    # Whatever it asks for is there.
    subprocess.run([*pip, "check"], check=True, stdout=subprocess.DEVNULL)
    return python


def install_beside_tests(wheel: Path, folder: Path) -> Path:
    """Makes a virtual environment of a wheel, in which the other packages of this one can be imported, too: returns its Python."""
    # The wheel comes first, so that `stepper` is that of the wheel.
    python = install(wheel, folder)
    (site,) = folder.glob("lib/python*/site-packages")
    (site / "others.pth").write_text(f"{sysconfig.get_path('purelib')}\n")
    return python


def call(python: Path, *arguments: str, cwd: Path) -> str:
    """Output of a Python program, whose errors are an error. It finds no compiler."""
    environment = {"PATH": str(python.parent), "HOME": str(cwd)}
    done = subprocess.run([python, *arguments], env=environment, cwd=cwd, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise RuntimeError(f"{done.stdout[-4000:]}\n{done.stderr[-4000:]}")
    return done.stdout


def run(python: Path, program: str, *arguments: str) -> list:
    """What a program prints as JSON: it finds no compiler, and no module but those of its environment."""
    return json.loads(call(python, "-I", "-c", program, *arguments, cwd=python.parent))


def figures(wheel: Path, imports: int = 21) -> str:
    """Size, unpacked size and time of an import."""
    with zipfile.ZipFile(wheel) as archive:
        files = {item.filename: item.file_size for item in archive.infolist()}
    binary = sum(size for name, size in files.items() if name.endswith(".so"))
    with tempfile.TemporaryDirectory() as folder:
        python = install(wheel, Path(folder))
        times = [run(python, IMPORT) for _ in range(imports)]
    numpy, own = (statistics.median(column) for column in zip(*times, strict=True))
    return (
        f"{wheel.name}\n"
        f"{wheel.stat().st_size / 1e6:.1f} MB, {sum(files.values()) / 1e6:.1f} MB unpacked ({binary / 1e6:.1f} MB of them the binary)\n"
        f"import stepper: {own:.0f} ms after import numpy, which takes {numpy:.0f} ms (medians of {imports} processes)"
    )


if __name__ == "__main__":
    wheel = built()
    if wheel is None:
        raise SystemExit("there is no wheel of this state of the sources: make wheel")
    print(figures(wheel))
