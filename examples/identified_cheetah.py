"""System identification of HalfCheetah from a recording, and evaluation of a policy on the identified model.

The "robot" is simulated, so that its true parameters are known: a torso of 7.5 kg instead of 6.25 kg, friction of 0.3 instead of 0.4. Four
runs of one second under the policy are recorded, with encoder noise. The identification gives a distribution of the parameters. The policy
is then evaluated in environments whose parameters are drawn from this distribution.

    python examples/identified_cheetah.py
"""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import stepper
from stepper import policies
from stepper.envs.vector import StepperVectorEnv
from stepper.sysid import episodes_of

POLICY = Path(__file__).parent / "policies/half_cheetah.npz"
MASS, FRICTION = 7.5, 0.3
"""True parameters of the simulated robot: mass of the torso, kg, and friction of all geoms."""
PARAMETERS = ("body_mass[torso]", "geom_friction[floor,?foot][0]")
NOISE = {"qpos": 1e-3, "qvel": 0.02}
SECONDS, ROWS = 1.0, 3


def robot(model: stepper.Model) -> stepper.Model:
    """The nominal model `model` with the true parameters of the robot. The identification does not use these parameters."""
    mass, inertia = np.array(model.body_mass), np.array(model.body_inertia)
    torso = model.body("torso").id
    inertia[torso] *= MASS / mass[torso]
    mass[torso] = MASS
    friction = np.array(model.geom_friction)
    friction[:, 0] = FRICTION
    return model.replace(body_mass=mass, body_inertia=inertia, geom_friction=friction)


def recorded(folder: Path, runs: int = 4) -> None:
    """Record runs of the robot under its policy."""
    envs = StepperVectorEnv("HalfCheetah", runs, model=robot(nominal()), options=options())
    policy = policies.load(POLICY)
    observation, _ = envs.reset(seed=0)
    with envs.sim.record(folder):
        for _ in range(round(SECONDS / envs.dt)):
            observation, *_ = envs.step(policy(observation))


def nominal() -> stepper.Model:
    """Model with nominal parameters, from the environment in which the policy was trained."""
    return StepperVectorEnv("HalfCheetah", 1).sim.model


def options() -> stepper.Options:
    """Simulation options of the environment in which the policy was trained."""
    return StepperVectorEnv("HalfCheetah", 1).sim.options


def pieces(episode: stepper.sysid.Episode, rng: np.random.Generator) -> list[stepper.sysid.Episode]:
    """Split an episode into segments of `ROWS` samples, and add noise to the readings.

    Each segment starts from the measured state of the preceding sample. The segments are short, because prediction errors of a gait grow
    too fast for predictions of a second.

    Args:
        episode: Episode of the recording.
        rng: Random number generator of the noise.
    """
    rows = {name: np.asarray(array) for name, array in episode.readings.items()}
    rows = {name: array + NOISE[name] * rng.standard_normal(array.shape) for name, array in rows.items()}
    ctrl = np.asarray(episode.ctrl)
    return [
        dataclasses.replace(
            episode, ctrl=ctrl[k : k + ROWS], readings={"qpos": rows["qpos"][k : k + ROWS]}, qpos=rows["qpos"][k - 1],
            qvel=rows["qvel"][k - 1], start_std=(NOISE["qpos"], NOISE["qvel"]), name=f"{episode.name}, from sample {k}",
        )
        for k in range(1, len(ctrl) - ROWS + 1, ROWS)
    ]  # fmt: skip


def identified(folder: Path) -> stepper.sysid.Identification:
    """Parameters identified from the recording with encoder noise."""
    model, rng = nominal(), np.random.default_rng(0)
    episodes = [piece for whole in episodes_of(folder, model, channels=["qpos", "qvel"]) for piece in pieces(whole, rng)]
    return stepper.sysid.identify(model, episodes, PARAMETERS, options=options(), noise={"qpos": NOISE["qpos"]}, starts=2)


def returns(parameters: dict[str, Any], episodes: int = 32, actions: int = 200) -> Any:
    """Simulate episodes of the policy, and return the sums of rewards, (episodes,).

    Args:
        parameters: Model parameters, as keyword arguments of `Stepper.randomize`, for each episode. Empty keeps the nominal parameters.
        episodes: Number of episodes.
        actions: Number of actions per episode.
    """
    envs = StepperVectorEnv("HalfCheetah", episodes, options=options(), max_episode_steps=actions + 1)
    policy = policies.load(POLICY)
    if parameters:
        envs.sim.randomize(**parameters)
    observation, _ = envs.reset(seed=1)
    total = np.zeros(episodes)
    for _ in range(actions):
        observation, reward, *_ = envs.step(policy(observation))
        total += reward
    return total


def main() -> None:
    """Identify the robot's parameters, and print them with the returns of the policy in three batches of environments.

    The batches have the nominal parameters, samples of the identified parameters, and the true parameters.
    """
    with tempfile.TemporaryDirectory() as folder:
        recorded(Path(folder) / "run")
        found = identified(Path(folder) / "run")
    print(found)
    true = robot(nominal())
    truth = {name: np.stack([getattr(true, name)] * 32) for name in ("body_mass", "body_inertia", "geom_friction")}
    for name, parameters in (("the model", {}), ("what was identified", found.sample(32)), ("the robot", truth)):
        total = returns(parameters)
        print(f"{name}: {total.mean():.0f} +- {total.std(ddof=1) / np.sqrt(len(total)):.0f} in ten seconds")


if __name__ == "__main__":
    main()
