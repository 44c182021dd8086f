"""Training with Stable-Baselines3's PPO in stepper's environments, with learning curve, saved policy, evaluation and film.

    pip install 'stepper-sim[train]' stable-baselines3
    python examples/train_sb3.py stepper/HalfCheetah-v5 --seed 1 --film half_cheetah.mp4

`StepperVecEnv` implements Stable-Baselines3's `VecEnv`. `VecNormalize`, PPO and `evaluate_policy` are those of Stable-Baselines3. The
script saves the policy in two formats: `model.zip` with `normalize.pkl` for Stable-Baselines3, and `policy.npz` for `stepper evaluate`
and `stepper.policies`, which need NumPy alone.
"""

from __future__ import annotations

import argparse
import csv
import os
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from stepper.adapters.sb3 import StepperVecEnv
from stepper.policies import Policy, describe, film, load

# Idle OpenMP threads spin by default, which takes processor time from the physics. The variable must be set before PyTorch is imported.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecNormalize

Array = NDArray[Any]

FRESH = 2**31
"""First seed of evaluation episodes, which no training uses. Stable-Baselines3 accepts 32-bit seeds."""
SETTINGS: dict[str, Any] = {
    "n_steps": 64,
    "batch_size": 1024,
    "n_epochs": 8,
    "learning_rate": 3e-4,
    "gamma": 0.99,
    "gae_lambda": 0.95,
    "clip_range": 0.2,
    "max_grad_norm": 0.5,
    "policy_kwargs": {"net_arch": [64, 64], "log_std_init": -0.5},
}
"""Arguments of `PPO`: short rollouts of 64 steps per environment."""


class Curve(BaseCallback):
    """Callback that writes a row of the learning curve after each rollout.

    Args:
        file: CSV file to write. An existing file is overwritten.
    """

    def __init__(self, file: Path):
        super().__init__()
        self._file, self._begun = file, time.process_time()
        file.write_text("steps,processor,return,length\n")

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        episodes = self.model.ep_info_buffer or []
        row = [float(np.mean([episode[key] for episode in episodes])) if episodes else float("nan") for key in ("r", "l")]
        with self._file.open("a", newline="") as file:
            csv.writer(file).writerow([self.num_timesteps, round(time.process_time() - self._begun, 2), *row])


def make(env: str, num_envs: int, seed: int, **settings: Any) -> VecNormalize:
    """Vector environment of stepper for Stable-Baselines3, with normalised observations and rewards.

    Args:
        env: Name of the environment.
        num_envs: Number of environments.
        seed: Seed of the first episodes.
        settings: Arguments of the environment.
    """
    envs = StepperVecEnv(env, num_envs, infos="ended", **settings)
    envs.seed(seed)
    return VecNormalize(envs, gamma=SETTINGS["gamma"])


def train(env: str, folder: Path, *, steps: int, num_envs: int = 128, seed: int = 1, threads: int = 1, **settings: Any) -> PPO:
    """Train a policy for a task.

    Args:
        env: Name of the environment, such as "stepper/HalfCheetah-v5".
        folder: Folder for curve.csv, model.zip, normalize.pkl and policy.npz.
        steps: Number of environment steps in all.
        num_envs: Number of environments.
        seed: Seed of all random numbers.
        threads: Number of threads of the physics and of PyTorch.
        settings: Arguments of the environment: contact, precision, and those of the task.
    """
    torch.set_num_threads(threads)
    folder.mkdir(parents=True, exist_ok=True)
    envs = make(env, num_envs, seed * 1_000_003, threads=threads, **settings)
    model = PPO("MlpPolicy", envs, seed=seed, device="cpu", **SETTINGS)
    model.learn(total_timesteps=steps, callback=Curve(folder / "curve.csv"))
    model.save(folder / "model.zip")
    envs.save(str(folder / "normalize.pkl"))
    policy_of(model, {"env": env, "seed": seed, "steps": steps, **settings}).save(folder / "policy.npz")
    return model


def policy_of(model: PPO, training: dict[str, Any]) -> Policy:
    """Learned policy as a NumPy policy: the mean of the actions, with the normalisation of the observations.

    Args:
        model: Trained model with an `MlpPolicy`, whose activation is tanh.
        training: Entries for the field `training` of the policy.
    """
    envs: VecNormalize = model.get_env()
    modules = [*model.policy.mlp_extractor.policy_net, model.policy.action_net]
    linear = [layer for layer in modules if isinstance(layer, torch.nn.Linear)]
    layers = [(layer.weight.detach().numpy().T.copy(), layer.bias.detach().numpy().copy()) for layer in linear]
    space = envs.action_space
    middle, half = (space.high + space.low) / 2.0, (space.high - space.low) / 2.0
    # Stable-Baselines3's network outputs actions in the units of the task; that of a `Policy` outputs -1 to 1, scaled to the bounds.
    weight, bias = layers[-1]
    layers[-1] = (weight / half, (bias - middle) / half)
    return Policy(
        mean=envs.obs_rms.mean,
        std=np.sqrt(envs.obs_rms.var + envs.epsilon),
        clip=envs.clip_obs,
        layers=tuple(layers),
        activation="tanh",
        low=np.asarray(space.low, dtype=np.float64),
        high=np.asarray(space.high, dtype=np.float64),
        environment=describe(envs.venv.envs),
        training={**training, "learner": "Stable-Baselines3", "torch": torch.__version__},
    )


def evaluate(model: PPO, env: str, *, episodes: int = 20, **settings: Any) -> Array:
    """Returns of fresh episodes, (episodes,), by Stable-Baselines3's `evaluate_policy`."""
    trained: VecNormalize = model.get_env()
    fresh = make(env, episodes, FRESH, **settings)
    fresh.training, fresh.norm_reward, fresh.obs_rms = False, False, trained.obs_rms
    returns, _ = evaluate_policy(model, fresh, n_eval_episodes=episodes, return_episode_rewards=True)
    return np.array(returns)


def main() -> None:
    """Train, evaluate and film a policy."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("env", nargs="?", default="stepper/HalfCheetah-v5", help="name of the environment [stepper/HalfCheetah-v5]")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--steps", type=int, default=2_000_000, help="number of environment steps in all [2000000]")
    parser.add_argument("--num-envs", type=int, default=128, help="number of environments [128]")
    parser.add_argument("--contact", choices=("mujoco", "hard"), help="contact law [that of the task]")
    parser.add_argument("--precision", choices=("f64", "f32"), default="f32")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--out", type=Path, help="folder for the results [out/train_sb3/ENV/seedN]")
    parser.add_argument("--film", type=Path, metavar="FILE", help="mp4 file for a film of one more episode")
    given = parser.parse_args()
    settings = {"precision": given.precision} | ({"contact": given.contact} if given.contact else {})
    folder = given.out or Path("out/train_sb3", given.env.replace("/", "_"), f"seed{given.seed}")
    begun, spent = time.perf_counter(), time.process_time()
    options = {"num_envs": given.num_envs, "seed": given.seed, "threads": given.threads}
    model = train(given.env, folder, steps=given.steps, **options, **settings)
    seconds, spent = time.perf_counter() - begun, time.process_time() - spent
    returns = evaluate(model, given.env, **settings)
    print(f"{model.num_timesteps:,} steps in {seconds:.0f} s, {spent:.0f} s of processor time; wrote the results to {folder}")
    print(f"{given.env}: {returns.mean():.1f} mean return of {len(returns)} episodes, worst {returns.min():.1f}, best {returns.max():.1f}")
    if given.film is not None:
        film(load(folder / "policy.npz"), given.env, given.film, seed=FRESH, **settings)
        print(f"wrote {given.film}")


if __name__ == "__main__":
    main()
