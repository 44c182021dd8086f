"""UniSim: its conformance checks, and what is behind its calls."""

import gymnasium.envs.mujoco
import numpy as np
import pytest
import stepper
import torch
from stepper.adapters.unisim import StepperBackend
from unisim.backend.base import SelectedResetPublication
from unisim.conformance import assert_backend_conformance
from unisim.dr.types import TensorResetRandomizationPayload

ASSETS = gymnasium.envs.mujoco.__path__[0] + "/assets/"
NUM_ENVS = 3
SCENE = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body name="cart" pos="0 0 0.5">
      <freejoint name="root"/>
      <geom type="box" size="0.2 0.1 0.05"/>
      <site name="middle"/>
      <body name="pole">
        <joint name="hinge" axis="0 1 0" range="-1 1"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.4" size="0.02"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="push" joint="hinge" ctrlrange="-2 2"/></actuator>
  <sensor><jointpos name="angle" joint="hinge"/><gyro name="rate" site="middle"/></sensor>
  <keyframe><key name="home" qpos="0 0 0.5 1 0 0 0 0.3"/></keyframe>
</mujoco>
"""


@pytest.mark.filterwarnings("ignore::UserWarning")
@pytest.mark.parametrize("name", ["ant", "humanoid", "half_cheetah", "walker2d_v5", "swimmer"])
@pytest.mark.parametrize("num_envs", [1, 4])
def test_its_conformance_checks_pass(name, num_envs):
    assert_backend_conformance(StepperBackend(stepper.load(ASSETS + name + ".xml", strict=False), num_envs))


@pytest.fixture
def backend():
    return StepperBackend(stepper.load(SCENE), NUM_ENVS, precision="f64")


def test_the_model_is_described(backend):
    assert (backend.num_envs, backend.num_actuators, backend.num_dof_vel) == (NUM_ENVS, 1, 1)
    assert (backend.get_public_state_widths().nq, backend.get_public_state_widths().nv) == (8, 7)
    np.testing.assert_array_equal(backend.get_actuator_ctrl_range(), [[-2, 2]])
    np.testing.assert_array_equal(backend.get_joint_range(), [[-1, 1]])
    np.testing.assert_array_equal(backend.get_joint_range(names=["hinge"]), [[-1, 1]])
    np.testing.assert_array_equal(backend.get_keyframe_qpos("home"), [0, 0, 0.5, 1, 0, 0, 0, 0.3])
    layout = backend.get_root_state_layout("cart")
    assert (layout.qpos_indices, layout.qvel_indices) == (tuple(range(7)), tuple(range(6)))
    assert backend.get_actuator_names() == ("push",)
    assert [(sensor.name, sensor.width) for sensor in backend.get_sensor_inventory()] == [("angle", 1), ("rate", 3)]
    assert backend.get_tensor_capabilities().selected_reset_publication is SelectedResetPublication.AUTHORITATIVE_VIEWS
    for call in (
        lambda: backend.get_root_state_layout("pole"),
        lambda: backend.get_body_ids(["wheel"]),
        lambda: backend.get_joint_range(names=["root"]),
    ):
        with pytest.raises(ValueError, match=r"pole|wheel|root"):
            call()
    with pytest.raises(KeyError):
        backend.get_keyframe_qpos("stand")


def test_steps_and_resets_are_those_of_the_stepper(backend):
    sim = stepper.Stepper(stepper.load(SCENE), NUM_ENVS)
    ctrl = torch.tensor([[0.5], [-1.0], [2.0]])
    backend.step_tensor(ctrl, nsteps=20)
    sim.step(ctrl.numpy(), 20)
    views = backend.get_state_views()
    for name in ("qpos", "qvel", "ctrl"):
        assert views[name].dtype == torch.float32
        np.testing.assert_array_equal(views[name].numpy(), getattr(sim, name).astype(np.float32))
    np.testing.assert_array_equal(backend.get_sensor_view("rate").numpy(), sim.sensordata[:, 1:].astype(np.float32))
    bodies = backend.get_tracked_body_views(("pole", "cart"))
    np.testing.assert_array_equal(bodies.pos_w.numpy(), sim.xpos[:, [2, 1]].astype(np.float32))
    np.testing.assert_array_equal(bodies.ang_vel_w.numpy(), sim.body_angvel[:, [2, 1]].astype(np.float32))

    home = torch.from_numpy(backend.get_keyframe_qpos("home")).float()
    backend.set_state_tensor(torch.tensor([2, 0]), torch.stack([home, home + torch.eye(8)[0]]), torch.zeros(2, 7))
    after = backend.get_state_views("qpos")["qpos"]
    torch.testing.assert_close(after[2], home, rtol=0, atol=0)
    assert after[0, 0] == 1
    torch.testing.assert_close(after[1], views["qpos"][1], rtol=0, atol=0)
    np.testing.assert_array_equal(backend.get_sensor_view("angle").numpy()[[0, 2], 0], np.float32([0.3, 0.3]))

    backend.set_state_tensor_mask(torch.tensor([False, True, False]), home.expand(NUM_ENVS, 8).contiguous(), torch.zeros(NUM_ENVS, 7))
    torch.testing.assert_close(backend.get_state_views("qpos")["qpos"][1], home, rtol=0, atol=0)
    assert backend.get_state_views("qpos")["qpos"][0, 0] == 1


@pytest.mark.parametrize(("call", "error"), [
    (lambda backend: backend.step_tensor(torch.zeros(2, 1)), ValueError),
    (lambda backend: backend.step_tensor(torch.full((3, 1), torch.nan)), ValueError),
    (lambda backend: backend.step_tensor(torch.zeros(3, 1, dtype=torch.float64)), TypeError),
    (lambda backend: backend.step_tensor(torch.zeros(3, 1), nsteps=0), ValueError),
    (lambda backend: backend.set_state_tensor(torch.tensor([0, 0]), torch.zeros(2, 8), torch.zeros(2, 7)), ValueError),
    (lambda backend: backend.set_state_tensor(torch.tensor([3]), torch.zeros(1, 8), torch.zeros(1, 7)), ValueError),
    (lambda backend: backend.get_state_views("act"), KeyError),
    (lambda backend: backend.get_state_views("qpos", device="cuda"), ValueError),
    (lambda backend: backend.get_sensor_view("no such sensor"), KeyError),
    (lambda backend: backend.get_physics_state(), NotImplementedError),
])  # fmt: skip
def test_calls_that_make_no_sense_are_named_and_change_nothing(backend, call, error):
    before = backend.get_state_views("qpos")["qpos"]
    with pytest.raises(error):
        call(backend)
    torch.testing.assert_close(backend.get_state_views("qpos")["qpos"], before, rtol=0, atol=0)


def test_randomization_is_refused_and_not_dropped(backend):
    payload = TensorResetRandomizationPayload(kp=torch.ones(1, 1))
    home = torch.from_numpy(backend.get_keyframe_qpos("home")).float()[None]
    with pytest.raises(ValueError, match="use randomize"):
        backend.set_state_tensor(torch.tensor([0]), home, torch.zeros(1, 7), payload)
