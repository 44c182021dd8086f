"""PyTorch: gradients of rollouts beside differences of PyTorch's own, and an optimiser that uses them."""

from pathlib import Path

import gymnasium
import numpy as np
import pytest
import stepper
import torch
from checks import raises
from stepper.adapters.torch_rollout import rollout

HOPPER = Path(gymnasium.__file__).parent / "envs/mujoco/assets/hopper.xml"
SOFT = stepper.Options(contact="mujoco", tolerance=1e-12)


@pytest.fixture
def hoppers():
    model, rng = stepper.load(HOPPER, strict=False), np.random.default_rng(0)
    sim = stepper.Stepper(model, 2, options=SOFT)
    sim.step(rng.uniform(-0.3, 0.3, (2, model.nu)), nstep=100)
    return sim, rng


def test_gradcheck(hoppers):
    sim, rng = hoppers
    tensors = [torch.tensor(np.array(x), requires_grad=True) for x in (rng.uniform(-0.3, 0.3, (3, 2, 3)), sim.qpos, sim.qvel)]
    mass = torch.tensor(np.tile(sim.model.body_mass, (2, 1)) * 1.1)

    def states(ctrl, qpos, qvel, scale):
        made = rollout(sim, ctrl, 2, qpos=qpos, qvel=qvel, parameters={"body_mass": mass * scale})
        return made.qpos, made.qvel

    scale = torch.tensor(1.0, dtype=torch.float64, requires_grad=True)
    # Both take differences; the rollout's curvature is 1e-5 of its slope over its step.
    assert torch.autograd.gradcheck(states, (*tensors, scale), eps=1e-6, atol=1e-4, rtol=1e-4)


def test_gradients_have_the_type_of_what_they_belong_to(hoppers):
    sim, _ = hoppers
    ctrl = torch.zeros((2, 2, 3), dtype=torch.float32, requires_grad=True)
    made = rollout(sim, ctrl, sensors=True)
    assert made.qpos.dtype == torch.float32
    assert made.sensors.shape == (2, 2, sim.model.nsensordata)
    made.qvel.sum().backward()
    assert ctrl.grad.dtype == torch.float32
    assert ctrl.grad.abs().max() > 0
    before = sim.get_state()
    raises(ValueError, "ctrl has shape", lambda: rollout(sim, torch.zeros((2, 4, 3))))
    with pytest.raises(ValueError, match=r"^parameters: there is no field 'body_mas'; did you mean body_mass"):
        rollout(sim, ctrl, parameters={"body_mas": torch.ones(2, 5)})
    assert sim.get_state() == before


def test_controls_of_all_environments_have_the_sum_of_their_gradients(hoppers):
    sim, rng = hoppers
    # As many controls as environments, so that no shape tells the two axes apart.
    shared = torch.tensor(rng.uniform(-0.3, 0.3, (2, 3)), requires_grad=True)
    weights = torch.tensor(rng.normal(size=(2, 2, sim.model.nv)))
    own = shared.detach()[:, None].repeat(1, 2, 1).requires_grad_()
    for ctrl in (shared, own):
        (rollout(sim, ctrl, 2).qvel * weights).sum().backward()
    torch.testing.assert_close(shared.grad, own.grad.sum(dim=1), rtol=1e-12, atol=0)


@pytest.mark.parametrize("dtype", [torch.int64, torch.float16, torch.bfloat16])
def test_other_types_are_refused(hoppers, dtype):
    sim, _ = hoppers
    raises(TypeError, r"ctrl has dtype .*ctrl\.double\(\)", lambda: rollout(sim, torch.zeros((2, 2, 3), dtype=dtype)))
    raises(TypeError, "qvel has dtype", lambda: rollout(sim, torch.zeros((2, 2, 3)), qvel=torch.zeros(sim.qvel.shape, dtype=dtype)))


def test_a_cart_is_brought_to_a_goal():
    model = stepper.load(
        '<mujoco><worldbody><body><joint name="x" type="slide" axis="1 0 0"/><geom size=".1" mass="1"/></body></worldbody>'
        '<actuator><motor joint="x"/></actuator></mujoco>'
    )
    sim = stepper.Stepper(model, 4)
    goal, ctrl = torch.tensor([0.1, -0.2, 0.3, 0.4], dtype=torch.float64), torch.zeros((10, 4, 1), dtype=torch.float64, requires_grad=True)
    optimiser = torch.optim.LBFGS([ctrl], max_iter=20, line_search_fn="strong_wolfe")

    def miss():
        optimiser.zero_grad()
        made = rollout(sim, ctrl, 50)
        loss = ((made.qpos[-1, :, 0] - goal) ** 2).sum() + (made.qvel[-1] ** 2).sum()
        loss.backward()
        return loss

    optimiser.step(miss)
    assert miss() < 1e-8
