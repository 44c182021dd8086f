"""Effect of encoder noise, drift and delay on a policy that balances a double pendulum.

The policy was trained in Gymnasium's InvertedDoublePendulum-v5, where it observes the true state. In this study it observes sensor readings
instead. encoders_trained.py is the same study with a policy that was trained on sensor readings:

    stepper report examples/studies/encoders.py
    stepper report examples/studies/encoders_trained.py
    python examples/studies/encoders.py [FILE]   # both: prints a table, writes a figure to FILE [out/encoders.png]

encoders_task.py trains the second policy.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import mujoco
import numpy as np
import stepper

HERE = Path(__file__).resolve().parent
POLICIES = HERE.parent / "policies"
ANGLES, RATES = ("angle1", "angle2"), ("rate1", "rate2")
TIP = 1.0
"""Height of the tip below which the poles count as fallen, m."""


def model() -> Any:
    """Gymnasium's model, with position and velocity sensors on its three joints."""
    spec = mujoco.MjSpec.from_file(str(Path(gymnasium.__file__).parent / "envs/mujoco/assets/inverted_double_pendulum.xml"))
    for kind, names in (("JOINTPOS", ("place", *ANGLES)), ("JOINTVEL", ("speed", *RATES))):
        for name, joint in zip(names, ("slider", "hinge", "hinge2"), strict=True):
            spec.add_sensor(name=name, type=getattr(mujoco.mjtSensor, f"mjSENS_{kind}"), objtype=mujoco.mjtObj.mjOBJ_JOINT, objname=joint)
    return spec.compile()


def seen(readings: Any) -> Any:
    """Observations of the task, (num_envs, 9), from sensor readings. The constraint force, which no encoder measures, is 0."""
    place, angles, velocities = readings[:, :1], readings[:, 1:3], np.clip(readings[:, 3:], -10.0, 10.0)
    return np.concatenate([place, np.sin(angles), np.cos(angles), velocities, np.zeros_like(place)], axis=1)


def encoders() -> Any:
    """Sensor model of encoders with noise of 0.02 rad and 0.2 rad/s, drift, and 10 ms of delay.

    The study encoders_trained.py has a policy that was trained with this sensor model.
    """
    angle = stepper.Transfer(noise_std=0.02, drift_std=0.005, delay=0.01)
    rate = stepper.Transfer(noise_std=0.2, delay=0.01)
    named = dict.fromkeys(ANGLES, angle) | dict.fromkeys(RATES, rate)
    return stepper.SensorModel(named, default=stepper.Transfer(delay=0.01))


class Balance:
    """Controller that applies a policy to the sensor readings.

    Args:
        file: File name of the policy in examples/policies.
    """

    def __init__(self, file: str):
        import stepper.policies  # noqa: PLC0415, unused in the training

        self.policy = stepper.policies.load(POLICIES / file)
        self.file = file

    def __call__(self, now: Any) -> Any:
        """Controls of the policy for the present sensor readings, (num_envs, 1)."""
        return self.policy(seen(now.sensordata))


def balancing(name: str, file: str) -> Any:
    """Study of a policy: whether the poles stay upright for 10 s.

    Args:
        name: Name of the study.
        file: File name of the policy in examples/policies.
    """
    return stepper.lab.Study(
        name=name,
        model=model,
        controller=Balance(file),
        outcomes=[
            stepper.lab.Outcome(name="lowest tip", measure="site tip z", reduce="min", success=f">= {TIP}", unit="m"),
            stepper.lab.Outcome(
                name="time upright", measure=lambda now: 10.0 * (now.read("site_xpos", "tip")[:, 2] > TIP), reduce="mean", unit="s"
            ),
        ],
        parameters={
            "angle noise": stepper.lab.Parameter(
                "sensor.noise_std[angle1,angle2]", low=0.0, high=0.06, unit="rad", source="potentiometers and magnets: 0.001 to 0.05"
            ),
            "rate noise": stepper.lab.Parameter(
                "sensor.noise_std[rate1,rate2]", low=0.0, high=0.6, unit="rad/s", source="differences of encoders over 5 to 20 ms"
            ),
            "drift": stepper.lab.Parameter(
                "sensor.drift_std[angle1,angle2]", low=0.0, high=0.03, unit="rad/sqrt(s)", source="angles from integrated rates"
            ),
            "delay": stepper.lab.Parameter("sensor.delay[*]", low=0.0, high=0.04, unit="s", source="buses and filters: 1 to 50 ms"),
        },
        options=stepper.Options(contact="mujoco", integrator="rk4"),
        seconds=10.0,
        control=0.05,
        episodes=16,
        qpos_noise=0.05,
        qvel_noise=0.1,
    )


study = balancing("encoders", "inverted_double_pendulum.npz")
trained = balancing("encoders_trained", "inverted_double_pendulum_encoders.npz")


def table() -> None:
    """Print how often each policy keeps the poles upright, with ideal sensors and with `encoders()`."""
    for own in (study, trained):
        for kind, sensors in (("ideal sensors", None), ("encoders", encoders())):
            given = replace(own, name=f"{own.name}_{kind}".replace(" ", "_"), sensors=sensors, parameters={}, episodes=64)
            (level,) = stepper.lab.sweep(given).sweep.levels
            low, high = level.interval
            print(f"{own.name}, {kind}: {level.successes} of {level.episodes} upright for 10 s, 95 % {low:.3f} to {high:.3f}")


def picture(file: str) -> None:
    """Plot the fraction of successful episodes of both policies against the size of each sensor error, into an image file."""
    from matplotlib.figure import Figure  # noqa: PLC0415

    figure = Figure(figsize=(10, 2.9), dpi=130, layout="constrained")
    panels = figure.subplots(1, len(study.parameters), sharey=True)
    both = {"trained on the state": study, "trained on encoders": trained}
    for number, (label, own) in enumerate(both.items()):
        found = stepper.lab.sweep(own, cliffs=False).sweep
        for panel, name in zip(panels, own.parameters, strict=True):
            levels = found.levels_of(name)
            share = np.array([level.share for level in levels])
            ends = np.array([level.interval for level in levels]).T
            x = [float(level.value or 0) for level in levels]
            panel.errorbar(x, share, abs(ends - share), fmt="o-" if number == 0 else "s--", label=label, capsize=2, markersize=3.5)
            panel.set_xlabel(f"{name}, {own.parameters[name].unit}")
            panel.grid(visible=True, color="#dddddd")
    panels[0].set_ylabel("share upright for 10 s")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=2, frameon=False)
    Path(file).parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(file)


if __name__ == "__main__":
    table()
    picture(sys.argv[1] if len(sys.argv) > 1 else "out/encoders.png")
