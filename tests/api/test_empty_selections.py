"""Selections of environments: every method with `envs` takes an empty one, and a boolean mask, which selects what its indices do."""

import inspect

import numpy as np
import pytest
import stepper
from stepper import ActuatorModel, Drive, Stepper
from stepper.envs import StepperVectorEnv
from stepper.viewer.frames import shown_envs

ARM = """<mujoco><worldbody><geom name="floor" type="plane" size="1 1 .1"/>
  <body name="ball" pos="0 0 .1"><freejoint/><geom name="g" size=".1"/></body>
  <body name="arm"><joint name="j" axis="0 1 0" damping=".1"/><geom type="capsule" fromto="1 0 .5 1.3 0 .5" size=".02"/></body>
  </worldbody><actuator><motor name="m" joint="j" ctrlrange="-1 1"/></actuator></mujoco>"""
N = 4
EMPTY = {
    "list": [],
    "tuple": (),
    "floats": np.array([]),
    "integers": np.array([], dtype=np.int64),
    "where": np.flatnonzero(np.zeros(N)),
    "mask": np.zeros(N, dtype=bool),
    "masks of Python": [False] * N,
}


def made(*, recorded=None):
    sim = Stepper(stepper.load(ARM), N, seed=3)
    sim.step(np.linspace(-1, 1, N)[:, None], 3)
    if recorded is not None:
        sim.record(recorded)
    return sim


def rows(envs, full):
    """Values for a method: a row for each index, or for each environment with a mask."""
    envs = np.asarray(envs)
    return full if envs.dtype == np.bool_ else full[envs.astype(np.int64)]


CALLS = {
    "reset": lambda sim, envs: sim.reset(envs, qpos=rows(envs, np.array(sim.qpos) + 0.5), seed=4),
    "reset to a keyframe": lambda sim, envs: sim.reset(envs=envs),
    "step": lambda sim, envs: sim.step(rows(envs, np.ones((N, 1))), 2, envs=envs),
    "set_state": lambda sim, envs: sim.set_state(rows(envs, np.array(sim.qpos)), rows(envs, np.array(sim.qvel) + 1.0), envs=envs),
    "set_state of a state": lambda sim, envs: sim.set_state(sim.get_state(env=0), envs=envs),
    "set_state of time": lambda sim, envs: sim.set_state(time=rows(envs, np.arange(N) + 1.0), envs=envs),
    "copy_state": lambda sim, envs: sim.copy_state(0, envs),
    "contacts": lambda sim, envs: sim.contacts(envs),
    "randomize": lambda sim, envs: sim.randomize(envs, geom_friction=rows(envs, np.full((N, 3, 3), 0.2))),
    "randomize a selector": lambda sim, envs: sim.randomize({"gravity[2]": -1.0}, envs=envs),
    "randomize rows of a selector": lambda sim, envs: sim.randomize({"body_mass[ball,arm]": rows(envs, np.full((N, 2), 3.0))}, envs=envs),
    "randomize a compound": lambda sim, envs: sim.randomize({"geom_friction[g][0]": rows(envs, np.full(N, 0.5))}, envs=envs),
    "randomize to the model": lambda sim, envs: sim.randomize({"gravity": None}, envs=envs),
    "randomize all": lambda sim, envs: sim.randomize(envs=envs),
}
"""Calls of methods with `envs`; each changes the selected environments."""


def everything(sim):
    """State and parameters of a stepper, as bytes."""
    return repr(
        [np.asarray(getattr(sim, name)).tobytes() for name in ("qpos", "qvel", "time", "ctrl", "status")]
        + sorted((name, np.asarray(values).tobytes()) for name, values in sim.randomized.items())
    )


@pytest.mark.parametrize("recorded", [False, True])
@pytest.mark.parametrize("call", CALLS)
def test_an_empty_selection_changes_nothing(call, recorded, tmp_path):
    sim = made(recorded=tmp_path / "run" if recorded else None)
    before = everything(sim)
    for envs in EMPTY.values():
        result = CALLS[call](sim, envs)
        assert result is None or len(result) == 0
        assert everything(sim) == before


@pytest.mark.parametrize("call", CALLS)
def test_a_mask_selects_what_its_indices_do(call):
    one, other, mask = made(), made(), np.array([True, False, False, True])
    found = CALLS[call](one, mask), CALLS[call](other, np.flatnonzero(mask))
    assert everything(one) == everything(other)
    if found[0] is not None:
        np.testing.assert_array_equal(*found)


def test_all_methods_with_envs_are_tested():
    methods = {name for name in dir(Stepper) if not name.startswith("_") and callable(getattr(Stepper, name))}
    with_envs = {name for name in methods if "envs" in inspect.signature(getattr(Stepper, name)).parameters}
    assert with_envs == {call.split()[0] for call in CALLS}


@pytest.mark.parametrize("envs", EMPTY.values(), ids=EMPTY)
def test_environments_take_an_empty_selection(envs):
    batch = StepperVectorEnv("HalfCheetah", N)
    observation, _ = batch.reset(seed=0)
    with_indices = np.asarray(envs).dtype != np.bool_
    np.testing.assert_array_equal(batch.reset(envs=envs)[0], observation)
    np.testing.assert_array_equal(batch.reset(envs=envs, seed=[] if with_indices else [None] * N)[0], observation)
    shape = (0, 9) if with_indices else (N, 9)
    np.testing.assert_array_equal(batch.set_state(np.ones(shape), np.ones(shape), envs=envs), observation)


@pytest.mark.parametrize("envs", EMPTY.values(), ids=EMPTY)
def test_drives_of_no_environment_are_empty(envs):
    model = ActuatorModel({"m": Drive(delay=np.arange(N) * 0.01)})
    sim = made()
    assert model.drives(sim.model, N, envs)[0]["delay"] == []


def test_a_view_shows_the_environments_of_a_mask():
    sim = made()
    assert shown_envs(sim, np.array([True, False, False, True]), 16).tolist() == [0, 3]
    assert shown_envs(sim, [2, 0], 16).tolist() == [2, 0]
    assert shown_envs(sim, 2, 16).tolist() == [0, 1]
    for envs in EMPTY.values():
        with pytest.raises(ValueError, match="envs selects no environment"):
            shown_envs(sim, envs, 16)
