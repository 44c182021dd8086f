"""examples/shac.py and grasp.py: gradients through the simulation are those of what it does, and a grasp is learned (`make training`)."""

import copy
import dataclasses

import gymnasium
import pytest
from checks import raises
from envs.cases import needs_gymnasiums
from gymnasium.vector import AutoresetMode

torch = pytest.importorskip("torch", reason="torch is not installed: make training")
import grasp  # noqa: E402
import shac  # noqa: E402

pytestmark = needs_gymnasiums
TASKS = shac.TASKS | {grasp.NAME: grasp.TASK}


def learner_of(env, task=None, **given):
    plan = shac.Plan(**{"num_envs": 2, "horizon": 5, **given})
    envs = gymnasium.make_vec(env, num_envs=plan.num_envs, autoreset_mode=AutoresetMode.DISABLED)
    return shac.Learner(envs, task or TASKS[env], plan)


@pytest.mark.parametrize("env", sorted(TASKS))
def test_the_gradient_is_that_of_what_the_simulation_does(env):
    """Beside differences: another policy acts in the same environments with the same noise, and steps are really made."""
    # Little noise: actions beyond their bounds have no derivative, and the learner takes one.
    learner = learner_of(env, std=0.05)
    learner.update()  # Feet are on the floor, and the value network has something to say.
    # Rewards are scaled by their moments, which the policy changes and no gradient counts.
    learner._scale = lambda: 0.5

    def objective(direction, size):
        other = copy.deepcopy(learner)
        for weight, change in zip(other.net.actor.parameters(), direction, strict=True):
            weight.data += size * change
        torch.manual_seed(7)
        return other.objective(other.collect())[0], other

    loss, same = objective([torch.zeros_like(w) for w in learner.net.actor.parameters()], 0.0)
    gradient = torch.autograd.grad(loss, list(same.net.actor.parameters()))
    norm = sum(float(g.square().sum()) for g in gradient) ** 0.5
    direction = [g / norm for g in gradient]
    size = 1e-3
    difference = float((objective(direction, size)[0] - objective(direction, -size)[0]).detach()) / (2 * size)
    # The network and its actions have 32 bits, 1e-7 of an objective of order 1 over a change of 1e-3 of it; curvature does the rest.
    assert difference == pytest.approx(norm, rel=0.02)


def test_functions_that_are_not_the_tasks_are_refused():
    right = shac.TASKS["stepper/Swimmer-v5"]
    wrong = dataclasses.replace(right, reward=lambda *given: 2.0 * right.reward(*given))
    raises(ValueError, "the reward in PyTorch differs", lambda: learner_of("stepper/Swimmer-v5", wrong).update())


def test_horizons_that_do_not_fit_and_models_with_quaternions_are_refused():
    raises(ValueError, "no multiple of the horizon 7", learner_of, "stepper/Swimmer-v5", horizon=7)
    raises(ValueError, "without quaternions", learner_of, "stepper/Ant-v5", shac.TASKS["stepper/Swimmer-v5"])


def test_a_run_writes_its_curve_and_its_policy(tmp_path):
    learner = shac.train("stepper/Swimmer-v5", 0.02, shac.Plan(num_envs=4, horizon=20), tmp_path, quiet=True)
    assert len((tmp_path / "curve.csv").read_text().splitlines()) == learner.updates + 1
    assert (tmp_path / "policy.npz").exists()


def test_a_grasp_is_learned_by_derivatives():
    scores = list(grasp.by_derivatives(96))
    # It begins below 0, a box that stays where it should be returns 40; docs/benchmarks/derivatives.md has 30 after 32 to 80 rollouts.
    assert scores[0].rollouts == 0
    assert scores[0].gain < 0.0
    assert max(s.gain for s in scores) > 25.0
