"""Extras, which are groups of optional packages: installed versions, and commands that install missing packages."""

from __future__ import annotations

from dataclasses import dataclass

from stepper.shared.machine import package_version

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
