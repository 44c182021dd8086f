"""Models from installed packages: those of gymnasium and dm_control's suite, and twenty more."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from stepper.shared.machine import MissingPackageError, package_file

FILES = {
    "gymnasium": "envs/mujoco/assets/*.xml",
    "dm_control": "suite/*.xml",
}
"""Packages with patterns of files; all matching models are used."""

OTHERS = {
    "gymnasium_robotics": [
        *(f"envs/assets/fetch/{name}.xml" for name in ("reach", "push", "slide", "pick_and_place")),
        *(f"envs/assets/hand/{name}.xml" for name in ("reach", "manipulate_block", "manipulate_egg", "manipulate_pen")),
    ],
    "robosuite": [
        *(
            f"models/assets/robots/{name}/robot.xml"
            for name in ("baxter", "gr1", "iiwa", "jaco", "kinova3", "panda", "sawyer", "spot", "ur5e", "xarm7")
        ),
        *(
            f"models/assets/grippers/{name}.xml"
            for name in ("panda_gripper", "robotiq_gripper_85", "jaco_three_finger_gripper", "inspire_left_hand")
        ),
    ],
}
"""Packages with lists of further model files."""

NO_MODELS = ("common", "shared", "shared_asset", "point")
"""Stems of files that are not complete models."""


@dataclass(frozen=True)
class Source:
    """Model file of an installed package.

    Attributes:
        name: Package and name, separated by a space.
        path: Path of the file.
    """

    name: str
    path: Path


def sources(only: list[str]) -> Iterator[Source]:
    """Yield the installed models whose name contains at least one of the texts in `only`. An empty list selects all models."""
    for package, pattern in FILES.items():
        for folder in _folders(package):
            for path in sorted(folder.glob(pattern)):
                yield from _wanted(f"{package} {path.stem}", path, only)
    for package, files in OTHERS.items():
        for path in (folder / file for folder in _folders(package) for file in files):
            stem = path.parent.name if path.stem in ("robot", "reach") else path.stem
            yield from _wanted(f"{package} {stem}", path, only)


def _wanted(name: str, path: Path, only: list[str]) -> Iterator[Source]:
    """Yield one model file if it is a complete model, and if its name contains at least one of the texts in `only`.

    An empty list `only` selects all files.
    """
    if path.exists() and path.stem not in NO_MODELS and (not only or any(part in name for part in only)):
        yield Source(name, path)


def _folders(package: str) -> list[Path]:
    """List with the folder of an installed Python package. The list is empty if the package is not installed."""
    try:
        return [Path(package_file(package, "__init__.py", "for its models")).parent]
    except MissingPackageError:
        return []
