"""Speed of the adapters to other libraries, compared with the vector environment that they wrap.

The first table has environment steps per second with random actions, on one core. In each round every adapter makes six steps in turn, and
the table has medians over the rounds. Libraries that are not installed are skipped; `make adapters` installs them. The second table shows
the time that overlapping saves on two cores: a policy acts on one core while environments step on the other.

    python benches/adapters.py                          # HalfCheetah and Ant with 1,024 environments
    python benches/adapters.py Humanoid --num-envs 256
"""

import argparse
import statistics
import time
import warnings
from collections.abc import Callable
from importlib.util import find_spec
from typing import Any

import gymnasium
import numpy as np
from stepper.adapters.envpool import StepperPool
from stepper.adapters.native import make_native
from stepper.envs import TASKS
from stepper.shared.machine import cpu_name, one_core

STEPS = 6
"""Number of steps that each adapter makes per round of the measurement. A step moves all environments."""
SETTINGS: dict[str, Any] = {"precision": "f32", "autoreset_mode": "SameStep"}
"""Settings of the environments of all adapters. Some adapters set the autoreset mode themselves."""

Step = Callable[[], Any]


def native(name: str, num_envs: int) -> Step:
    """Create a `StepperVectorEnv` without an adapter, and return a function that steps all environments once with a fixed action."""
    envs = make_native(name, num_envs, **SETTINGS)
    action = _action(envs.single_action_space, num_envs)
    envs.reset(seed=0)
    return lambda: envs.step(action)


def envpool(name: str, num_envs: int) -> Step:
    """Create environments in the adapter with EnvPool's interface, and return a function that steps each environment once.

    The environments are stepped in four batches, one after the other.
    """
    pool = StepperPool(name, num_envs, num_envs // 4, seed=0, precision="f32")
    action = _action(pool.action_space, num_envs)
    pool.async_reset()
    for _ in range(4):
        pool.recv()
    pool.send(action)

    def step() -> None:
        for _ in range(4):
            ids = pool.recv()[-1]["env_id"]
            pool.send(action[ids], ids)

    return step


def sb3(infos: str) -> Callable[[str, int], Step]:
    """Return a function that creates environments in the adapter to Stable-Baselines3's `VecEnv`.

    The created function takes the id and the number of environments, and returns a function that steps all environments once.

    Args:
        infos: Argument `infos` of the adapter `StepperVecEnv`.
    """

    def make(name: str, num_envs: int) -> Step:
        from stepper.adapters.sb3 import StepperVecEnv  # noqa: PLC0415

        envs = StepperVecEnv(name, num_envs, infos=infos, precision="f32")  # type: ignore[arg-type]
        action = _action(envs.action_space, num_envs)
        envs.reset()
        return lambda: envs.step(action)

    return make


def pytorch(name: str, num_envs: int) -> Step:
    """Create a vector environment with PyTorch tensors, and return a function that steps all its environments once."""
    import torch  # noqa: PLC0415
    from stepper.adapters.torch import TorchVectorEnv  # noqa: PLC0415

    envs = TorchVectorEnv(name, num_envs, **SETTINGS)
    action = torch.from_numpy(_action(envs.single_action_space, num_envs))
    envs.reset(seed=0)
    return lambda: envs.step(action)


def torchrl(name: str, num_envs: int) -> Step:
    """Create the adapter to TorchRL, and return a function that steps all environments once by its method `step_and_maybe_reset`."""
    import torch  # noqa: PLC0415
    from stepper.adapters.torchrl import StepperTorchRLEnv  # noqa: PLC0415

    env = StepperTorchRLEnv(name, num_envs, precision="f32")
    action = torch.from_numpy(_action(env.envs.single_action_space, num_envs))
    state = env.reset()

    def step() -> None:
        nonlocal state
        state["action"] = action
        _, state = env.step_and_maybe_reset(state)

    return step


def rllib(name: str, num_envs: int) -> Step:
    """Create a vector environment in RLlib's wrapper, and return a function that steps all its environments once.

    The wrapper turns the dictionary of infos into a list with one dictionary per environment.
    """
    from gymnasium.wrappers.vector import DictInfoToList  # noqa: PLC0415

    envs = DictInfoToList(make_native(name, num_envs, precision="f32", dtype="float32"))
    action = _action(envs.single_action_space, num_envs)
    envs.reset(seed=0)
    return lambda: envs.step(action)


def pufferlib(name: str, num_envs: int) -> Step:
    """Create the adapter to PufferLib's `PufferEnv`, and return a function that steps all its environments once."""
    from stepper.adapters.pufferlib import StepperPufferEnv  # noqa: PLC0415

    env = StepperPufferEnv(name, num_envs, precision="f32")
    action = _action(env.single_action_space, num_envs)
    env.reset()
    return lambda: env.step(action)


def ray(name: str, num_envs: int) -> Step:
    """Create the adapter to Ray, and return a function that steps all its environments once, by one remote call.

    One actor has the environments, in four blocks.
    """
    import ray  # noqa: PLC0415
    from stepper.adapters.ray import RayVectorEnv  # noqa: PLC0415

    if not ray.is_initialized():
        ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    envs = RayVectorEnv(name, num_envs, num_actors=1, block_size=num_envs // 4, precision="f32")
    action = _action(envs.single_action_space, num_envs)
    envs.reset(seed=0)
    return lambda: envs.step(action)


def ray_rollout(name: str, num_envs: int) -> Step:
    """Create the adapter to Ray, and return a function that steps all its environments `STEPS` times, by one remote call.

    The function works only in every `STEPS`-th of its calls, so that on average one call is one step. One actor has the environments, in
    four blocks.
    """
    import ray  # noqa: PLC0415
    from stepper.adapters.ray import RayVectorEnv  # noqa: PLC0415

    if not ray.is_initialized():
        ray.init(num_cpus=2, include_dashboard=False, log_to_driver=False)
    envs = RayVectorEnv(name, num_envs, num_actors=1, block_size=num_envs // 4, precision="f32")
    action = _action(envs.single_action_space, num_envs // 4)
    envs.reset(seed=0)
    calls = 0

    def step() -> None:
        nonlocal calls
        if calls % STEPS == 0:
            envs.run_policy(lambda observation, draws: action, STEPS)
        calls += 1

    return step


CONTESTANTS: dict[str, tuple[str | None, Callable[[str, int], Step]]] = {
    "`StepperVectorEnv`": (None, native),
    "`envpool.StepperPool`, four batches": (None, envpool),
    "`sb3.StepperVecEnv`": ("stable_baselines3", sb3("all")),
    '`sb3.StepperVecEnv`, `infos="ended"`': ("stable_baselines3", sb3("ended")),
    "`torch.TorchVectorEnv`": ("torch", pytorch),
    "`torchrl.StepperTorchRLEnv`": ("torchrl", torchrl),
    "`rllib`, with RLlib's `DictInfoToList`": ("ray", rllib),
    "`pufferlib.StepperPufferEnv`": ("pufferlib", pufferlib),
    "`ray.RayVectorEnv.step`, one actor": ("ray", ray),
    "`ray.RayVectorEnv.run_policy`, one actor": ("ray", ray_rollout),
}
"""Adapters to measure, by their name in the table.

A value has the name of the required library (None if no library is required), and a function that creates the environments and returns a
function that steps them.
"""


def race(name: str, num_envs: int, rounds: int) -> dict[str, tuple[float, float]]:
    """Speed of each adapter, environment steps/s, and its ratio to the speed of `StepperVectorEnv` in the same round.

    Both numbers are medians over the rounds.
    """
    made = {label: make(name, num_envs) for label, (library, make) in CONTESTANTS.items() if library is None or find_spec(library)}
    times: dict[str, list[float]] = {label: [] for label in made}
    for k in range(rounds + 2):
        for label, step in made.items():
            begin = time.perf_counter()
            for _ in range(STEPS):
                step()
            if k > 1:
                times[label].append(time.perf_counter() - begin)
    first = next(iter(times.values()))
    return {
        label: (STEPS * num_envs / statistics.median(own), statistics.median(a / b for a, b in zip(first, own, strict=True)))
        for label, own in times.items()
    }


def overlap(name: str, num_envs: int, rounds: int) -> tuple[float, float, float, float]:
    """Median times per step of all environments, s: policy alone, environments alone, both in sequence, and both overlapping.

    Policy and environments overlap through `StepperPool` with two batches: the policy acts on one batch while the other one steps.
    """
    envs = make_native(name, num_envs, **SETTINGS)
    pool = StepperPool(name, num_envs, num_envs // 2, seed=0, precision="f32")
    width, size = envs.single_observation_space.shape[0], envs.single_action_space.shape[0]  # type: ignore[index]
    draws = np.random.default_rng(0)
    layers = [draws.normal(size=shape, scale=shape[0] ** -0.5).astype(np.float32) for shape in ((width, 256), (256, 256), (256, size))]

    def act(observation: Any) -> Any:
        for layer in layers:
            observation = np.tanh(observation.astype(np.float32, copy=False) @ layer)
        return observation

    observation, _ = envs.reset(seed=0)
    pool.async_reset()
    seen = [pool.recv() for _ in range(2)]
    times: list[tuple[float, ...]] = []
    for _ in range(rounds + 2):
        acting, begin = 0.0, time.perf_counter()
        for _ in range(STEPS):
            started = time.perf_counter()
            action = act(observation)
            acting += time.perf_counter() - started
            observation = envs.step(action)[0]
        between = time.perf_counter()
        for k in range(2):
            pool.send(act(seen[k][0]), seen[k][-1]["env_id"])
        for _ in range(2 * (STEPS - 1)):
            ahead, *_, infos = pool.recv()
            pool.send(act(ahead), infos["env_id"])
        seen = [pool.recv() for _ in range(2)]  # Wait for both batches: none may step while the next round measures the sequence.
        times.append((acting, between - begin - acting, between - begin, time.perf_counter() - between))
    policy, steps, both, pooled = (statistics.median(part) / STEPS for part in zip(*times[2:], strict=True))
    return policy, steps, both, pooled


def _action(space: Any, num_envs: int) -> Any:
    """Random actions for all environments of an action space, (num_envs, nu)."""
    assert isinstance(space, gymnasium.spaces.Box)
    return np.random.default_rng(0).uniform(space.low, space.high, (num_envs, *space.shape)).astype(np.float32)


def main() -> None:
    """Print markdown tables with the speed of each adapter, and with the time that overlapping policy and environments saves."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=("HalfCheetah", "Ant"), metavar="TASK", help=f"one of {', '.join(sorted(TASKS))}")
    parser.add_argument("--num-envs", type=int, default=1024)
    parser.add_argument("--rounds", type=int, default=25)
    given = parser.parse_args()
    warnings.simplefilter("ignore")
    ids = [f"stepper/{name}-v5" for name in given.names]
    with one_core():
        rates = [race(name, given.num_envs, given.rounds) for name in ids]
    print(f"{given.num_envs} environments, f32, one core, {cpu_name()}\n")
    print("| | " + " | ".join(f"{name}, steps/s | ratio" for name in given.names) + " |")
    print("|---" * (1 + 2 * len(ids)) + "|")
    for label in rates[0]:
        print(f"| {label} | " + " | ".join(f"{rate[label][0]:,.0f} | {rate[label][1]:.2f}" for rate in rates) + " |")
    print("\nA policy of 256 x 256 on one core, environments on one thread; ms per step of all environments\n")
    print("| task | policy | environments | in sequence | `StepperPool`, two batches | speedup |\n|---|---|---|---|---|---|")
    for name, task in zip(given.names, ids, strict=True):
        policy, steps, both, pooled = overlap(task, given.num_envs, given.rounds)
        figures = " | ".join(f"{1e3 * value:.2f}" for value in (policy, steps, both, pooled))
        print(f"| {name} | {figures} | {both / pooled:.2f} |")


if __name__ == "__main__":
    main()
