"""Optional packages, processor cores, and the machine and versions of a measurement."""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import os
import platform
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType

from stepper._stepper import __version__, cpu_levels

INSTALL = {
    "matplotlib": 'pip install "stepper-sim[cli]"',
    "mujoco": 'pip install "stepper-sim[mjcf]"',
    "mujoco.batch": 'pip install "mujoco>=4.0,<5"',
    "gymnasium": 'pip install "stepper-sim[envs]"',
    "moviepy": 'pip install "stepper-sim[viewer]"',
    "jinja2": 'pip install "stepper-sim[cli]"',
    "rich": 'pip install "stepper-sim[cli]"',
    "rsl_rl": "pip install rsl-rl-lib",
    "stable_baselines3": "pip install stable-baselines3",
    "onnx": "pip install onnx",
    "torch": "pip install torch",
    "torchrl": "pip install torchrl",
    "ray": "pip install ray",
    "ray.rllib": 'pip install "ray[rllib]" torch',
    "robosuite": "pip install --no-deps robosuite",
    "dm_control": "pip install dm_control",
    "jax": "pip install jax",
    "mjlab": "pip install --no-deps mjlab",
    "gymnasium_robotics": "pip install --no-deps gymnasium-robotics",
    "myo_sim": "pip install --no-deps myo-sim",
    "scipy": 'pip install "stepper-sim[identify]"',
    "mujoco.sysid": 'pip install "mujoco[sysid]"',
    "typer": 'pip install "stepper-sim[cli]"',
    "viser": 'pip install "stepper-sim[viewer]"',
}
"""Command that installs an optional module, by name of the module."""


class MissingPackageError(ImportError):
    """An optional package is not installed; the message explains how to install it."""


def require(module: str, purpose: str, extra: str = "") -> ModuleType:
    """Imports an optional module.

    Args:
        module: Dotted name of the module.
        purpose: End of the sentence "<module> is needed ..." of the error message: "to draw charts".
        extra: Extra of the package stepper-sim that contains the module, such as "cli". With "", the message has the command in `INSTALL`.

    Returns:
        The module.

    Raises:
        MissingPackageError: The module is not installed.
    """
    import importlib.metadata  # noqa: PLC0415  imported late: slow, and seldom used

    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        top = module.split(".", maxsplit=1)[0]
        if error.name is not None and error.name.split(".", maxsplit=1)[0] != top:
            raise
        raise _missing(module, purpose, extra) from error


def require_all(modules: Sequence[str], purpose: str, extra: str) -> None:
    """Checks that optional modules are installed, without importing them.

    Args:
        modules: Names of the modules.
        purpose: End of the sentence "<module> is needed ..." of the error message: "to draw charts".
        extra: Extra of stepper that installs all of them.
    """
    missing = [module for module in modules if importlib.util.find_spec(module) is None]
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        text = f'{", ".join(missing)} {verb} needed {purpose}, and {verb} not installed: pip install "stepper-sim[{extra}]"'
        raise MissingPackageError(text, name=missing[0])


def package_file(package: str, file: str, purpose: str) -> str:
    """Path of a file in an installed package. The package is not imported.

    Args:
        package: Name of the package.
        file: Path inside the package.
        purpose: End of the sentence "<package> is needed ..." of the error message: "for its robot".

    Raises:
        MissingPackageError: The package is not installed.
    """
    spec = importlib.util.find_spec(package)
    folders = list(spec.submodule_search_locations or ()) if spec else []
    if not folders:
        raise _missing(package, purpose)
    return os.path.join(folders[0], file)


def _missing(module: str, purpose: str, extra: str = "") -> MissingPackageError:
    """Error for a missing package, with the command that installs it.

    `purpose` ends the sentence "<module> is needed ...". `extra` is that of the package stepper-sim; with "", the command is from
    `INSTALL`.
    """
    top = module.split(".", maxsplit=1)[0]
    how = f'pip install "stepper-sim[{extra}]"' if extra else INSTALL.get(module) or INSTALL.get(top) or f"pip install {top}"
    return MissingPackageError(f"{module} is needed {purpose}, and is not installed: {how}", name=module)


def allowed_cores() -> set[int]:
    """Indices of the processor cores that this process may use; all cores on systems other than Linux."""
    if sys.platform == "linux":
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))


@contextlib.contextmanager
def one_core() -> Iterator[int | None]:
    """Context manager that pins this process to one core, the last of those that it may use.

    Yields:
        Index of the core; None on systems other than Linux, where the process is not pinned.
    """
    if sys.platform != "linux":
        yield None
        return
    before = os.sched_getaffinity(0)
    core = max(before)
    os.sched_setaffinity(0, {core})
    try:
        yield core
    finally:
        os.sched_setaffinity(0, before)


def cpu_name() -> str:
    """Name of the processor as the operating system reports it."""
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.exists():
        for line in cpuinfo.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def package_version(name: str) -> str | None:
    """Version of an installed distribution, None if it is not installed."""
    import importlib.metadata  # noqa: PLC0415  imported late: slow, and seldom used

    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def provenance() -> dict[str, object]:
    """Provenance of a measurement: command, time, processor, load average and versions of packages, by name."""
    packages = ("mujoco-core", "dm_control", "numpy", "scipy", "matplotlib")
    load = round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None
    return {
        "command": " ".join([Path(sys.argv[0]).name, *sys.argv[1:]]),
        "utc": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
        "cpu": cpu_name(),
        "cores": len(allowed_cores()),
        "cpu_levels": cpu_levels(),
        "cpu_level": os.environ.get("STEPPER_CPU_LEVEL") or cpu_levels()[-1],
        "STEPPER_CPU_LEVEL": os.environ.get("STEPPER_CPU_LEVEL"),
        "load_average": load,
        "platform": platform.platform(),
        "versions": {"python": platform.python_version(), "stepper": __version__} | {p: v for p in packages if (v := package_version(p))},
    }
