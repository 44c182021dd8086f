"""JAX: gradients of rollouts beside differences, under jit."""

from pathlib import Path

import gymnasium
import jax
import numpy as np
import stepper
from checks import raises
from stepper.adapters.jax_rollout import rollout

HOPPER = Path(gymnasium.__file__).parent / "envs/mujoco/assets/hopper.xml"
jax.config.update("jax_enable_x64", True)


def test_gradients_under_jit():
    model, rng = stepper.load(HOPPER, strict=False), np.random.default_rng(0)
    sim = stepper.Stepper(model, 2, options=stepper.Options(contact="mujoco", tolerance=1e-12))
    sim.step(rng.uniform(-0.3, 0.3, (2, model.nu)), nstep=100)
    made = rollout(sim, 2, parameters=("body_mass",))
    weights = rng.normal(size=(4, 2, model.nv))
    mass = np.tile(model.body_mass, (2, 1)) * 1.1

    def loss(*given):
        states = made(*given)
        return (states["qvel"] * weights).sum() + (states["qpos"][-1, :, 0] ** 2).sum()

    given = (rng.uniform(-0.3, 0.3, (4, 2, 3)), np.array(sim.qpos), np.array(sim.qvel), np.zeros((2, 0)), mass)
    found = jax.jit(jax.grad(loss, argnums=(0, 1, 2, 4)))(*given)
    h = 1e-6
    for place, gradient in zip((0, 1, 2, 4), found, strict=True):
        direction = rng.normal(size=given[place].shape) * (given[place] != 0)
        ends = [loss(*given[:place], given[place] + s * h * direction, *given[place + 1 :]) for s in (1, -1)]
        # Rounding of the sums over the step of the differences, and the rollout's curvature.
        np.testing.assert_allclose((np.asarray(gradient) * direction).sum(), (ends[0] - ends[1]) / (2 * h), rtol=1e-4, atol=1e-5)


def test_controls_of_all_environments_have_the_sum_of_their_gradients():
    model, rng = stepper.load(HOPPER, strict=False), np.random.default_rng(0)
    sim = stepper.Stepper(model, 2, options=stepper.Options(contact="mujoco"))
    made, weights = rollout(sim, 2), rng.normal(size=(2, 2, model.nv))
    state = (np.array(sim.qpos), np.array(sim.qvel), np.zeros((2, 0)))
    # As many controls as environments, so that no shape tells the two axes apart.
    shared = rng.uniform(-0.3, 0.3, (2, 3))
    gradient = jax.grad(lambda ctrl: (made(ctrl, *state)["qvel"] * weights).sum())
    own = gradient(np.tile(shared[:, None], (1, 2, 1)))
    np.testing.assert_allclose(gradient(shared), own.sum(axis=1), rtol=1e-12)


def test_wrong_calls_say_what_to_do():
    model = stepper.load(HOPPER, strict=False)
    sim = stepper.Stepper(model, 2)
    state = (np.array(sim.qpos), np.array(sim.qvel), np.zeros((2, 0)))
    made = rollout(sim, parameters=("body_mass",))
    mass = np.tile(model.body_mass, (2, 1))
    for dtype in (np.int64, np.float16):
        raises(TypeError, r"ctrl has dtype .*float32 or float64", made, np.zeros((2, 2, 3), dtype), *state, mass)
    raises(TypeError, "takes 5 arrays, ctrl, qpos, qvel, act, body_mass; 4 were given", made, np.zeros((2, 2, 3)), *state)
    raises(ValueError, r"^parameters: there is no field 'body_mas'; did you mean body_mass", rollout, sim, parameters=("body_mas",))
    raises(
        TypeError,
        r"^parameters is 'body_mass', must be a sequence of names, for example \('body_mass',\)",
        rollout,
        sim,
        parameters="body_mass",
    )
