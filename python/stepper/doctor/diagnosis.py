"""Diagnosis of an installation, which `stepper doctor` prints."""

from __future__ import annotations

import os
import platform
import subprocess
from dataclasses import dataclass

from stepper._stepper import __version__, cpu_levels
from stepper.doctor.self_test import digest_at, expected_digest
from stepper.shared.machine import allowed_cores, cpu_name, package_version

PACKAGES = {
    "mjcf": ("mujoco-core",),
    "cli": ("jinja2", "matplotlib", "rich", "scipy", "typer"),
    "envs": ("glfw", "gymnasium", "imageio", "mujoco-core", "packaging"),
    "viewer": ("moviepy", "mujoco-core", "viser"),
    "train": ("gymnasium", "imageio", "matplotlib", "moviepy", "mujoco-core", "packaging", "rich", "scipy", "torch", "typer"),
    "identify": ("scipy",),
}
"""Names of the packages of each extra (group of optional packages), as in pyproject.toml."""


@dataclass(frozen=True)
class Extra:
    """Group of optional packages, as in `pip install "stepper-sim[viewer]"`.

    Attributes:
        name: Name of the extra.
        versions: Installed version of each package of the extra by name; None if it is not installed.
    """

    name: str
    versions: dict[str, str | None]

    @property
    def missing(self) -> list[str]:
        """Names of the packages that are not installed."""
        return [name for name, version in self.versions.items() if version is None]

    @property
    def command(self) -> str:
        """Command that installs the extra."""
        return f'pip install "stepper-sim[{self.name}]"'

    def __str__(self) -> str:
        if self.missing:
            return f"missing {', '.join(self.missing)}: {self.command}"
        return ", ".join(f"{name} {version}" for name, version in self.versions.items())


def extras() -> tuple[Extra, ...]:
    """All extras (groups of optional packages) with the installed versions of their packages."""
    return tuple(Extra(name, {package: package_version(package) for package in packages}) for name, packages in PACKAGES.items())


_LEVEL = "STEPPER_CPU_LEVEL"
_VERSIONS = ("numpy", "mujoco-core", "mujoco")
_MEANING = (
    "At the CPU levels with a failed self-test, this build computes other results than the tested build. Recordings and saved "
    "trajectories of other machines will differ. Report this output, and use another level meanwhile: STEPPER_CPU_LEVEL=baseline."
)


@dataclass(frozen=True)
class Diagnosis:
    """Diagnosis of an installation. Its text is the output of `stepper doctor`, and its truth value is True if there is no fault.

    Attributes:
        versions: Versions of stepper, Python, the operating system, NumPy and MuJoCo, by name.
        cpu: Name of the processor.
        cores: Number of cores that this process may use.
        cpu_levels: Sets of CPU instructions that this machine and this build support, slowest first.
        cpu_level: Level that is used: the value of the environment variable STEPPER_CPU_LEVEL if it is set, otherwise the fastest level.
        level_error: Reason why the value of STEPPER_CPU_LEVEL cannot be used; empty if there is none.
        extras: Groups of optional packages.
        self_test: Result of the self-test by CPU level: the fault, or an empty string if the trajectory is as expected.
    """

    versions: dict[str, str]
    cpu: str
    cores: int
    cpu_levels: list[str]
    cpu_level: str
    level_error: str
    extras: tuple[Extra, ...]
    self_test: dict[str, str]

    def __bool__(self) -> bool:
        """Whether the installation has no fault: the CPU level is available, there is one version of MuJoCo, and no self-test failed.

        Missing optional packages are no fault.
        """
        return not (self.level_error or self._mujoco_error or any(self.self_test.values()))

    @property
    def _mujoco_error(self) -> str:
        """Reason why MuJoCo cannot be used: `mujoco` and `mujoco-core`, which have the same files, have different versions.

        Empty if there is no such fault.
        """
        whole, core = self.versions.get("mujoco"), self.versions.get("mujoco-core")
        if whole is None or core is None or whole == core:
            return ""
        return (
            f"mujoco {whole} and mujoco-core {core} overwrite each other's files, so that models may not load: "
            'pip uninstall mujoco mujoco-core, then pip install "stepper-sim[mjcf]"'
        )

    def __str__(self) -> str:
        lines = ["Versions", *(f"  {name:<12} {version}" for name, version in self.versions.items())]
        lines += ["", self._mujoco_error] if self._mujoco_error else []
        lines += ["", "Processor", f"  {self.cpu}, {self.cores} cores"]
        lines += [f"  {'CPU levels':<12} {', '.join(self.cpu_levels)}; in use: {self.level_error or self.cpu_level}"]
        lines += ["", "Extras", *(f"  {extra.name:<12} {extra}" for extra in self.extras)]
        if self.self_test:
            lines += ["", "Self-test", *(f"  {level:<12} {wrong or 'trajectory as expected'}" for level, wrong in self.self_test.items())]
        if any(self.self_test.values()):
            lines += ["", _MEANING]
        return "\n".join(lines)


def diagnose(*, self_test: bool = True) -> Diagnosis:
    """Checks this installation.

    Args:
        self_test: Whether to compute a short trajectory at every CPU level, in a separate process each, and compare it bit for bit. This
            takes one or two seconds.
    """
    levels = cpu_levels()
    requested = os.environ.get(_LEVEL, "")
    error = f"none, because {_LEVEL}={requested} names no level of this machine and build; unset it, or use one of {', '.join(levels)}"
    return Diagnosis(
        versions=_versions(),
        cpu=cpu_name(),
        cores=len(allowed_cores()),
        cpu_levels=levels,
        cpu_level=requested or levels[-1],
        level_error="" if requested in {"", *levels} else error,
        extras=extras(),
        self_test={level: _verdict(level) for level in levels} if self_test else {},
    )


def _versions() -> dict[str, str]:
    """Versions of stepper, Python, the operating system and installed packages, in the order of the report."""
    system = {"stepper": __version__, "python": platform.python_version(), "system": platform.platform()}
    return system | {name: version for name in _VERSIONS if (version := package_version(name))}


def _verdict(level: str) -> str:
    """Fault in the self-test at a CPU level, as text; an empty string if the trajectory is identical bit for bit to the expected one."""
    try:
        digest = digest_at(level)
    except (RuntimeError, subprocess.TimeoutExpired) as error:
        return str(error)
    expected = expected_digest()
    return "" if digest == expected else f"other bits: {digest[:16]}, expected {expected[:16]}"
