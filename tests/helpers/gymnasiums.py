"""Gymnasium's own tests of vector environments, wrappers and environments, around stepper's.

    python tests/helpers/gymnasiums.py CHECKOUT    # a checkout of https://github.com/Farama-Foundation/Gymnasium: its wheel has no tests

Copies its tests, writes names of stepper's environments in the place of the classic ones', and native vector environments in the place of
`SyncVectorEnv` where a test makes one by its name; then runs them. `LEFT_OUT` has the tests that are of what those environments alone
have. What needs a package that is not installed (moviepy, pygame, Box2D) fails in Gymnasium's own hands, too, and is skipped here.
"""

import argparse
import importlib.util
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

NAMES = {
    "CartPole-v1": "stepper/InvertedPendulum-v5",
    "MountainCarContinuous-v0": "stepper/InvertedPendulum-v5",
    "Pendulum-v1": "stepper/InvertedPendulum-v5",
    "FrozenLake-v1": "stepper/Hopper-v5",
    "Ant-v4": "stepper/Ant-v5",
}
FILES = (
    *(
        "envs/test_envs.py",
        "wrappers/vector",
        "vector/test_vector_env.py",
        "vector/test_vector_wrapper.py",
        "vector/test_vector_env_info.py",
    ),
    *("vector/test_autoreset_mode.py", "vector/test_sync_vector_env.py"),
    *(
        f"wrappers/test_{name}.py"
        for name in (
            *("action_repeat", "autoreset", "clip_action", "delay_observation", "flatten_observation", "frame_stack_observation"),
            *("normalize_observation", "normalize_reward", "order_enforcing", "passive_env_checker", "record_episode_statistics"),
            *("record_video", "rescale_action", "sticky_action", "time_aware_observation", "time_limit"),
        )
    ),
)
"""What is run, of its folder of tests."""
LEFT_OUT = {
    "test_call_sync_vector_env": "asks for the cart-pole's gravity",
    "test_vector_env_wrapper_attributes": "asks for the cart-pole's gravity",
    "test_step_sync_vector_env": "gives discrete actions",
    "test_sync_vector_env_seed": "gives discrete actions",
    "test_action_repeat_reward_accumulation": "gives discrete actions",
    "test_video_length": "needs episodes that outlast ten random actions, and those of Gymnasium's own pendulum last six in the mean",
    "test_max_episode_steps": "knows the cart-pole's 500 actions",
    "RescaleObservation": "needs observations with bounds",
    "CarRacing": "is of pictures as observations",
}
"""Tests that are of what other environments have, by a part of their names, and why."""
PACKAGES = {"record_video": "moviepy", "human_rendering": "pygame", "order_enforcing": "pygame", "normalize_obs_with_vector": "Box2D"}
"""Packages that tests need, by a part of their names."""
CONFTEST = """
import pytest
import stepper.envs

LEFT_OUT, MISSING = {left_out!r}, {missing!r}


def pytest_collection_modifyitems(items):
    for item in items:
        for part, reason in (LEFT_OUT | MISSING).items():
            if part in item.nodeid:
                item.add_marker(pytest.mark.skip(reason=reason))
"""


def written(text: str, file: str) -> str:
    """A file of tests with stepper's environments."""
    for theirs, ours in NAMES.items():
        text = text.replace(f'"{theirs}"', f'"{ours}"')
    if file.endswith("envs/utils.py"):  # Every environment of stepper's, in the place of all of Gymnasium's.
        text = text.replace('"gymnasium.envs." in env_spec.entry_point', 'env_spec.id.startswith("stepper/")')
    if file.endswith("vector/test_record_video.py"):
        mode = r'vectorization_mode=gym\.VectorizeMode\.SYNC,\s*vector_kwargs=\{"autoreset_mode": autoreset_mode\},'
        text = re.sub(mode, "autoreset_mode=autoreset_mode,", text)
    if file.endswith("vector/test_record_episode_statistics.py"):
        text = text.replace('vectorization_mode="sync")', 'vectorization_mode="vector_entry_point")')
    if file.endswith("vector/test_vector_wrappers.py"):
        native = 'vectorization_mode="vector_entry_point" if "stepper/" in env_id else vectorization_mode\n'
        text = text.replace("vectorization_mode=vectorization_mode\n", native, 1)
    return text


def main() -> int:
    """Runs the tests of a checkout."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("checkout", type=Path, help="a checkout of Gymnasium's repository")
    parser.add_argument("more", nargs="*", help="further arguments of pytest")
    given = parser.parse_args()
    source = given.checkout / "tests"
    if not (source / "testing_env.py").exists():
        raise SystemExit(f"{given.checkout} has no tests/testing_env.py: give a checkout of https://github.com/Farama-Foundation/Gymnasium")
    missing = {part: f"{package} is not installed" for part, package in PACKAGES.items() if importlib.util.find_spec(package) is None}
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder, "tests")
        shutil.copytree(source, copy)
        for file in copy.rglob("*.py"):
            file.write_text(written(file.read_text("utf-8"), file.as_posix()), "utf-8")
        Path(folder, "conftest.py").write_text(CONFTEST.format(left_out=LEFT_OUT, missing=missing), "utf-8")
        Path(folder, "pytest.ini").write_text("[pytest]\nfilterwarnings = ignore\n", "utf-8")
        command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *(f"tests/{name}" for name in FILES), *given.more]
        return subprocess.run(command, cwd=folder, check=False).returncode


if __name__ == "__main__":
    sys.exit(main())
