"""Perfect sensors inflate scores: a policy that balances two poles, with encoders that have noise, drift and delay.

The policy was trained in Gymnasium's InvertedDoublePendulum-v5, where it sees the state itself. Here it sees what sensors say of the same
numbers. encoders_trained.py has the same episodes with a policy that was trained on such sensors:

    stepper report examples/studies/encoders.py
    stepper report examples/studies/encoders_trained.py
    python examples/studies/encoders.py out/encoders.png                        # both, in one picture
    python examples/studies/encoders.py train stepper/Encoders-v0 --steps 3000000 --threads 1    # trains the second one
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import stepper

HERE = Path(__file__).resolve().parent
POLICIES = HERE.parent / "policies"
ANGLES, RATES = ("angle1", "angle2"), ("rate1", "rate2")
CART = 0.01
"""m: noise of the cart's own encoder in training, and none in the study."""
TIP = 1.0
"""m: the poles have fallen below it."""


def model() -> Any:
    """Gymnasium's model, with encoders and rate sensors on its three joints."""
    spec = mujoco.MjSpec.from_file(str(Path(gymnasium.__file__).parent / "envs/mujoco/assets/inverted_double_pendulum.xml"))
    for kind, names in (("JOINTPOS", ("place", *ANGLES)), ("JOINTVEL", ("speed", *RATES))):
        for name, joint in zip(names, ("slider", "hinge", "hinge2"), strict=True):
            spec.add_sensor(
                name=name, type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"), objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint
            )
    return spec.compile()


def seen(readings: Any) -> Any:
    """The observation of the task, (num_envs, 9), of the readings: sines and cosines of angles, bounded velocities; no force of the limit."""
    place, angles, velocities = readings[:, :1], readings[:, 1:3], np.clip(readings[:, 3:], -10.0, 10.0)
    return np.concatenate([place, np.sin(angles), np.cos(angles), velocities, np.zeros_like(place)], axis=1)


class Balance:
    """A policy behind the sensors.

    Args:
        file: Of `stepper.policies`.
    """

    def __init__(self, file: str):
        import stepper.policies  # noqa: PLC0415, the training does not need it

        self.policy = stepper.policies.load(POLICIES / file)
        self.file = file

    def __call__(self, now: Any) -> Any:
        """Controls, (num_envs, 1)."""
        return self.policy(seen(now.observation))


def balancing(name: str, file: str) -> Any:
    """The study of a policy: 10 s upright."""
    return stepper.Study(
        name=name,
        model=model,
        drive=Balance(file),
        outcomes=[
            stepper.Outcome(name="lowest tip", measure="site tip z", over="min", success=f">= {TIP}", unit="m"),
            stepper.Outcome(name="time upright", measure=lambda now: 10.0 * (now.site("tip")[:, 2] > TIP), over="mean", unit="s"),
        ],
        parameters={
            "angle noise": stepper.Parameter(
                target="sensor.noise_std", names=ANGLES, low=0.0, high=0.1, unit="rad", source="potentiometers and magnets: 0.001 to 0.05"
            ),
            "rate noise": stepper.Parameter(
                target="sensor.noise_std", names=RATES, low=0.0, high=2.0, unit="rad/s", source="differences of encoders over 5 to 20 ms"
            ),
            "drift": stepper.Parameter(
                target="sensor.drift_std", names=ANGLES, low=0.0, high=0.08, unit="rad/sqrt(s)", source="angles that are integrated"
            ),
            "delay": stepper.Parameter(
                target="sensor.delay", names=("*",), low=0.0, high=0.08, unit="s", source="buses and filters: 1 to 50 ms"
            ),
        },
        options=stepper.Options(contact="mujoco", integrator="rk4"),
        seconds=10.0,
        control=0.05,
        episodes=16,
        qpos_noise=0.05,
        qvel_noise=0.1,
    )


def task() -> Any:
    """The same task for training, whose sensors err, and its registration as stepper/Encoders-v0."""
    import stepper.envs  # noqa: PLC0415
    from stepper.envs.tasks.inverted_double_pendulum import InvertedDoublePendulum  # noqa: PLC0415
    from stepper.envs.task import Quantity  # noqa: PLC0415

    @dataclass(frozen=True, kw_only=True)
    class Encoders(InvertedDoublePendulum):
        """Keep the tip above 1 m by what encoders say."""

        def model(self) -> Any:
            return stepper.load(model(), strict=False)

        def sensors(self) -> Any:
            angle = stepper.Transfer(noise_std=0.03, drift_std=0.02, delay=0.02)
            rate = stepper.Transfer(noise_std=0.5, delay=0.02)
            rest = stepper.Transfer(noise_std=CART, delay=0.02)
            return stepper.SensorModel(dict.fromkeys(ANGLES, angle) | dict.fromkeys(RATES, rate), default=rest)

        def quantities(self) -> Any:
            return (Quantity("encoders", of=lambda now: seen(now.observation)),)

    gymnasium.register(
        "stepper/Encoders-v0", vector_entry_point="stepper.envs.vector:StepperVectorEnv", max_episode_steps=1000, kwargs={"task": Encoders}
    )
    return Encoders


study = balancing("encoders", "inverted_double_pendulum.npz")


def picture(file: str) -> None:
    """Both policies, a panel for every error."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(10, 2.9), dpi=130, layout="constrained")
    panels = figure.subplots(1, len(study.parameters), sharey=True)
    both = {
        "trained on the state": study,
        "trained on encoders": balancing("encoders_trained", "inverted_double_pendulum_encoders.npz"),
    }
    for number, (label, own) in enumerate(both.items()):
        found = stepper.sweep(own, cliffs=False).sweep
        for panel, name in zip(panels, own.parameters, strict=True):
            levels = found.of(name)
            share = np.array([level.share for level in levels])
            ends = np.array([level.interval for level in levels]).T
            x = [float(level.value) for level in levels]
            panel.errorbar(x, share, abs(ends - share), fmt="o-" if number == 0 else "s--", label=label, capsize=2, markersize=3.5)
            panel.set_xlabel(f"{name}, {own.parameters[name].unit}")
            panel.grid(visible=True, color="#dddddd")
    panels[0].set_ylabel("share upright for 10 s")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    figure.savefig(file)


if __name__ == "__main__":
    if sys.argv[1:2] == ["train"]:
        sys.path.insert(0, str(HERE.parent))
        import train

        task()
        del sys.argv[1]
        train.main()
    else:
        picture(sys.argv[1])
