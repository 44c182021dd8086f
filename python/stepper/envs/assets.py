"""Model files of Gymnasium's MuJoCo environments."""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path


def model_file(name: str) -> str:
    """The path of a model's file.

    Args:
        name: A file of Gymnasium's, as "ant.xml", or a path that begins with "/", "." or "~".

    Raises:
        FileNotFoundError: There is no such file.
    """
    if Path(name).is_absolute() or name.startswith((".", "~")):
        file = Path(name).expanduser()
        remedy = "give the path of an MJCF file"
    else:
        spec = find_spec("gymnasium.envs.mujoco")
        folders = [] if spec is None else list(spec.submodule_search_locations or [])
        file = Path(folders[0] if folders else "gymnasium/envs/mujoco", "assets", name)
        remedy = 'pip install "gymnasium[mujoco]", or give a path that begins with "/", "." or "~"'
    if not file.is_file():
        raise FileNotFoundError(f"there is no model file {file}: {remedy}")
    return str(file)
