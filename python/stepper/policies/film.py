"""Videos of policies."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.policies.evaluation import make
from stepper.shared.arguments import check_takes
from stepper.shared.machine import require
from stepper.shared.progress import ProgressCallback, silent
from stepper.shared.streams import seeds

Array = NDArray[Any]
FILMED = 300
"""Default largest number of actions in a film."""


def check_film(env: str, file: str | Path, **settings: Any) -> None:
    """Checks, before a training, that `film` can film an environment on this machine. Renders one frame, and writes no file.

    Args:
        env: Id of an environment in Gymnasium's registry.
        file: Video file of the later film; only its ending is checked.
        **settings: Arguments of the environment.

    Raises:
        ValueError: The id is not registered, or the file's name does not end in .mp4.
        RuntimeError: OpenGL cannot render on this machine; the message has the remedy.
        MissingPackageError: Gymnasium or MoviePy is not installed.
    """
    _check_file(file)
    require("moviepy", "to write films")
    single = make(env, render_mode="rgb_array", **settings)
    try:
        single.reset(seed=0)
        single.render()
    finally:
        single.close()


def _check_file(file: str | Path) -> None:
    """Raises ValueError if the name of a film does not end in .mp4."""
    if Path(file).suffix.lower() != ".mp4":
        raise ValueError(f"the film's file is {str(file)!r}, must end in .mp4: films have this format alone")


def film(
    policy: Callable[[Array], Array],
    env: str,
    file: str | Path,
    *,
    actions: int = FILMED,
    seed: int = 0,
    progress: ProgressCallback | None = None,
    **settings: Any,
) -> int:
    """Films the start of an episode as a video, with Gymnasium's `RecordVideo`, which needs MoviePy.

    Args:
        policy: Function of an observation, (n,), that returns an action, (nu,): a `Policy` or any other.
        env: Id of an environment in Gymnasium's registry.
        file: Video file, mp4; an existing file is replaced.
        actions: Number of actions to film; fewer if the episode ends earlier.
        seed: Seed of the film. The filmed episode is the first episode of `evaluate` with this seed.
        progress: Function that is called after each action with the name of the film and the completed fraction. The fraction is the number
            of filmed actions divided by `actions`, or by the episode's time limit in actions if that is smaller. At the end it is 1.
        **settings: Arguments of the environment.

    Returns:
        Number of filmed actions.

    Raises:
        ValueError: The id is not registered, or the file's name does not end in .mp4.
        MissingPackageError: Gymnasium or MoviePy is not installed.
    """
    _check_file(file)
    check_takes(policy, ["observation"], "policy")
    require("moviepy", "to write films")
    progress = progress or silent
    gymnasium = require("gymnasium", "to film policies")
    with tempfile.TemporaryDirectory() as temporary:
        folder = str(Path(temporary, "film"))
        single = make(env, render_mode="rgb_array", **settings)
        recorded = gymnasium.wrappers.RecordVideo(single, folder, episode_trigger=lambda _: True, disable_logger=True)
        longest = min(actions, recorded.spec.max_episode_steps or actions)
        observation, _ = recorded.reset(seed=seeds(seed, 1)[0])
        count, over = 0, False
        while count < actions and not over:
            observation, _, terminated, truncated, _ = recorded.step(policy(np.asarray(observation)))
            count, over = count + 1, terminated or truncated
            progress(f"film {Path(file).name}", 1.0 if over else min(count / longest, 1.0))
        recorded.close()
        Path(file).parent.mkdir(parents=True, exist_ok=True)
        shutil.move(next(Path(folder).glob("*.mp4")), file)
    return count
