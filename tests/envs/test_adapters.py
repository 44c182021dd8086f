"""Adapters are optional, and say how to install what they need."""

import subprocess
import sys
from pathlib import Path

import pytest
import stepper.adapters

MODULES = sorted(path.stem for path in Path(stepper.adapters.__file__).parent.glob("[a-z]*.py"))
LIBRARIES = {
    "jax_rollout": ("jax", "pip install jax"),
    "ray": ("ray", "pip install ray"),
    "rllib": ("ray.rllib", 'pip install "ray[rllib]"'),
    "rsl_rl": ("rsl_rl", "pip install rsl-rl-lib"),
    "sb3": ("stable_baselines3", "pip install stable-baselines3"),
    "torch_rollout": ("torch", "pip install torch"),
    "torchrl": ("torchrl", "pip install torchrl"),
}
"""Library of each adapter, and the command that installs it."""


def test_every_adapter_is_here():
    assert set(MODULES) == LIBRARIES.keys() | {"native"}


@pytest.mark.parametrize("module", LIBRARIES)
def test_a_library_that_is_missing_is_named_with_its_remedy(module):
    library, remedy = LIBRARIES[module]
    code = f"import sys; sys.modules[{library!r}] = None; import stepper.adapters.{module}"
    ended = subprocess.run([sys.executable, "-W", "ignore", "-c", code], capture_output=True, text=True, check=False)
    error = ended.stderr.splitlines()[-1]
    assert "MissingPackageError" in error
    assert f"{library.partition('.')[0]}" in error
    assert f"for stepper.adapters.{module}" in error
    assert remedy in error


def test_the_package_needs_no_library():
    code = "import sys, stepper.adapters.native; assert not {'torch', 'ray'} & sys.modules.keys()"
    subprocess.run([sys.executable, "-c", code], check=True)
