"""Models from installed packages: those of gymnasium and dm_control's suite, and twenty more."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from stepper.shared.machine import MissingPackageError, package_file

ROBOTS = ("baxter", "gr1", "iiwa", "jaco", "kinova3", "panda", "sawyer", "spot", "ur5e", "xarm7")
GRIPPERS = ("panda_gripper", "robotiq_gripper_85", "jaco_three_finger_gripper", "inspire_left_hand")
FILES = {
    "gymnasium": ("envs/mujoco/assets/*.xml",),
    "dm_control": ("suite/*.xml",),
    "gymnasium_robotics": (
        *(f"envs/assets/fetch/{name}.xml" for name in ("reach", "push", "slide", "pick_and_place")),
        *(f"envs/assets/hand/{name}.xml" for name in ("reach", "manipulate_block", "manipulate_egg", "manipulate_pen")),
    ),
    "robosuite": (
        *(f"models/assets/robots/{name}/robot.xml" for name in ROBOTS),
        *(f"models/assets/grippers/{name}.xml" for name in GRIPPERS),
    ),
}
"""Packages with patterns of files. Packages that are not installed are left out."""

NO_MODELS = ("common", "shared", "shared_asset", "point")
"""Stems of files that are not complete models."""


@dataclass(frozen=True)
class Source:
    """Model file of an installed package: package and name, separated by a space, and path of the file."""

    name: str
    path: Path


def sources(only: list[str]) -> Iterator[Source]:
    """Yield the installed models whose name contains at least one of the texts in `only`. An empty list selects all models."""
    for package, patterns in FILES.items():
        try:
            folder = Path(package_file(package, "__init__.py", "for its models")).parent
        except MissingPackageError:
            continue
        for path in (path for pattern in patterns for path in sorted(folder.glob(pattern))):
            source = Source(f"{package} {path.parent.name if path.stem in ('robot', 'reach') else path.stem}", path)
            if path.stem not in NO_MODELS and (not only or any(part in source.name for part in only)):
                yield source
