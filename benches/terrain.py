"""Cost of terrain: processor time of a step of one ball that rolls over each kind of ground.

Usage:

    python -m terrain
"""

import time
import warnings

import numpy as np
import stepper

POINTS, SIDE, STEPS = 101, 10.0, 2000


def main() -> None:
    """Print the time of a step for each kind of ground."""
    for name, model in _grounds().items():
        sim = stepper.Stepper(model)
        sim.set_state(qvel=[1.0, 0.3, 0, 0, 0, 0])
        begin = time.process_time()
        sim.step(nstep=STEPS)
        print(f"| {name} | {1e6 * (time.process_time() - begin) / STEPS:.1f} |")


def _grounds() -> dict[str, stepper.Model]:
    """Models with a ball on each kind of ground, by name."""
    line = np.linspace(-SIDE / 2, SIDE / 2, POINTS)
    height = 0.1 * np.sin(2 * line)[:, None] * np.sin(2 * line)[None, :] + 0.2
    elevation = " ".join(f"{z:.4f}" for z in height.ravel())
    size = f"{SIDE / 2} {SIDE / 2} {height.max() - height.min()} 1"
    field = f'<hfield name="h" nrow="{POINTS}" ncol="{POINTS}" size="{size}" elevation="{elevation}"/>'
    vertices = " ".join(f"{x:.4f} {y:.4f} {height[i, j]:.4f}" for i, y in enumerate(line) for j, x in enumerate(line))
    corners = [i * POINTS + j for i in range(POINTS - 1) for j in range(POINTS - 1)]
    faces = " ".join(f"{a} {a + 1} {a + POINTS} {a + 1} {a + POINTS + 1} {a + POINTS}" for a in corners)
    mesh = f'<mesh name="m" inertia="shell" vertex="{vertices}" face="{faces}"/>'
    tiles = "".join(
        f'<geom type="box" size=".25 .25 .2" pos="{x} {y} 0"/>' for x in np.arange(-4.75, 5, 0.5) for y in np.arange(-4.75, 5, 0.5)
    )
    scenes = {
        "plane": ("", '<geom type="plane" size="9 9 1"/>'),
        "height field": (field, '<geom type="hfield" hfield="h"/>'),
        "concave mesh": (mesh, '<geom type="mesh" mesh="m"/>'),
        "convex hull of the mesh": (mesh, '<geom type="mesh" mesh="m"/>'),
        "400 boxes": ("", tiles),
    }
    ball = '<body pos="0 0 .6"><freejoint/><geom size=".1" mass="1"/></body>'
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", stepper.ModelWarning)
        models = {
            name: stepper.load(f"<mujoco><asset>{asset}</asset><worldbody>{ground}{ball}</worldbody></mujoco>")
            for name, (asset, ground) in scenes.items()
        }
    models["concave mesh"] = models["concave mesh"].replace(geom_concave=[1, 0])
    return models


if __name__ == "__main__":
    main()
