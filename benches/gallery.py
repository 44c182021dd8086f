"""Pictures of environments: docs/images/gallery_*.jpg, which docs/reference/gallery.md shows.

    MUJOCO_GL=egl python benches/gallery.py --update-docs

Each picture is a sheet of one family, with the environments in the order of the page. A family whose package is not installed is left out.
"""

import argparse
import warnings
from pathlib import Path
from tempfile import TemporaryDirectory

import gymnasium
import numpy as np
import stepper.envs  # noqa: F401, its import registers the environments
from PIL import Image, ImageDraw

IMAGES = Path(__file__).parents[1] / "docs/images"
SIZE, COLUMNS = (240, 180), 4
FAMILIES = {
    "mujoco": (
        *("Ant-v5", "HalfCheetah-v5", "Hopper-v5", "Humanoid-v5", "HumanoidStandup-v5", "InvertedDoublePendulum-v5"),
        *("InvertedPendulum-v5", "Pusher-v5", "Reacher-v5", "Swimmer-v5", "Walker2d-v5"),
    ),
    "stepper": ("Go1Velocity-v0", "Go1Rough-v0", "G1Velocity-v0", "G1Rough-v0", "FallingBlock-v0", "Grasp-v0"),
    "dm_control": tuple(
        f"dm_control.{name}-v0"
        for name in (
            *("acrobot-swingup", "cartpole-swingup", "cheetah-run", "dog-walk", "finger-spin", "fish-swim", "hopper-hop", "humanoid-walk"),
            *("humanoid_CMU-walk", "manipulator-bring_ball", "pendulum-swingup", "point_mass-easy", "quadruped-walk", "reacher-easy"),
            *("stacker-stack_4", "swimmer-swimmer6", "walker-walk"),
        )
    ),
}
"""Environments of each picture, without their namespace."""


def picture(name: str) -> np.ndarray:
    """Picture (height, width, 3) of an environment after 20 actions of zero."""
    width, height = SIZE
    env = gymnasium.make(f"stepper/{name}", render_mode="rgb_array", width=width, height=height)
    env.reset(seed=0)
    for _ in range(20):
        env.step(np.zeros(env.action_space.shape))
    frame = env.render()
    env.close()
    return frame


def sheet(names: tuple[str, ...]) -> Image.Image:
    """Pictures of environments in rows of four, with their names."""
    width, height = SIZE
    made = Image.new("RGB", (COLUMNS * width, -(-len(names) // COLUMNS) * height), "white")
    for k, name in enumerate(names):
        corner = (k % COLUMNS * width, k // COLUMNS * height)
        made.paste(Image.fromarray(picture(name)), corner)
        ImageDraw.Draw(made).text((corner[0] + 6, corner[1] + 4), name, fill="white", stroke_width=1, stroke_fill="black")
    return made


def main() -> None:
    """Draws all families into docs/images with --update-docs, otherwise into a temporary folder as a test of the drawing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--update-docs", action="store_true", help="replace the pictures in docs/images")
    update = parser.parse_args().update_docs
    warnings.simplefilter("ignore")
    with TemporaryDirectory() as temporary:
        for family, names in FAMILIES.items():
            try:
                made = sheet(names)
            except ModuleNotFoundError as error:
                print(f"{family}: left out, {error}")
                continue
            file = (IMAGES if update else Path(temporary)) / f"gallery_{family}.jpg"
            made.save(file, quality=82)
            print(f"{file.name}: {file.stat().st_size / 1e3:.0f} kB")


if __name__ == "__main__":
    main()
