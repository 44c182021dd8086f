"""Films of policies."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stepper.policies.evaluation import make
from stepper.shared.machine import require

Array = NDArray[Any]


def check_film(env: str, **settings: Any) -> None:
    """Checks that an environment can be filmed here, by one picture: before a training whose end is a film.

    Args:
        env: Name of an environment in Gymnasium's registry.
        **settings: Arguments of the environment.

    Raises:
        RuntimeError: OpenGL cannot draw here, with the remedy.
        MissingPackageError: Gymnasium or MoviePy is not installed.
    """
    require("moviepy", "to write films")
    single = make(env, render_mode="rgb_array", **settings)
    try:
        single.reset(seed=0)
        single.render()
    finally:
        single.close()


def film(
    policy: Callable[[Array], Array],
    env: str,
    file: Path,
    *,
    actions: int = 300,
    seed: int = 0,
    progress: Callable[[int], object] | None = None,
    **settings: Any,
) -> None:
    """Writes the beginning of an episode as a video, by Gymnasium's recorder, which needs MoviePy.

    Args:
        policy: What acts.
        env: Name of an environment in Gymnasium.
        file: An mp4; what is there is replaced.
        actions: Actions of the film, if the episode is not over before.
        seed: Seed of the episode.
        progress: Called after each action with the number of actions so far: on a machine without a graphics card a picture takes a
            tenth of a second or more.
        **settings: Arguments of the environment.

    Raises:
        ValueError: No such environment.
        MissingPackageError: Gymnasium or MoviePy is not installed.
    """
    require("moviepy", "to write films")
    gymnasium = require("gymnasium", "to film policies")
    with tempfile.TemporaryDirectory() as temporary:
        folder = str(Path(temporary, "film"))
        single = make(env, render_mode="rgb_array", **settings)
        recorded = gymnasium.wrappers.RecordVideo(single, folder, episode_trigger=lambda _: True, disable_logger=True)
        observation, _ = recorded.reset(seed=seed)
        for k in range(actions):
            observation, _, terminated, truncated, _ = recorded.step(policy(np.asarray(observation)))
            if progress is not None:
                progress(k + 1)
            if terminated or truncated:
                break
        recorded.close()
        file.parent.mkdir(parents=True, exist_ok=True)
        shutil.move(next(Path(folder).glob("*.mp4")), file)
