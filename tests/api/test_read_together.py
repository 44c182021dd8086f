"""Quantities of bodies that are read after every step are computed in one pass: the same numbers as read alone, of the present state."""

import numpy as np
import pytest
import stepper
from models import stepper_model

NAMES = ("xpos", "xquat", "body_linvel", "body_angvel", "site_xpos", "geom_xpos", "geom_xquat", "subtree_com", "xipos", "cinert", "cvel",
         "cfrc_ext", "actuator_force", "qfrc_actuator", "qacc", "qfrc_constraint", "body_contact_force")  # fmt: skip
ENVS = 21
"""No multiple of the lanes."""


def batch(precision="f64", threads=1):
    options = stepper.Options(contact="mujoco")
    return stepper.Stepper(stepper_model("gymnasium/humanoid", strict=False), ENVS, options=options, precision=precision, threads=threads)


def controls(k):
    return np.random.default_rng(k).uniform(-0.4, 0.4, (ENVS, 17))


@pytest.mark.parametrize(("precision", "threads"), [("f64", 1), ("f32", 1), ("f32", 2)])
def test_together_they_have_the_bits_of_each_alone(precision, threads):
    sim = batch(precision, threads)
    alone = {name: batch(precision) for name in NAMES}
    rng = np.random.default_rng(0)
    for k in range(40):
        order = rng.permutation(NAMES)[: rng.integers(1, len(NAMES) + 1)]
        for other in (sim, *alone.values()):
            if k % 9 == 4:
                other.reset(np.arange(ENVS) % 3 == k % 3)
            other.step(controls(k), nstep=3)
        for name in order:
            np.testing.assert_array_equal(getattr(sim, name), getattr(alone[name], name), err_msg=name)


def test_every_change_is_seen():
    """After each change of state, parameters or what is applied, what was read together is that of a stepper made for it."""
    sim = batch()
    read = ("xpos", "cinert", "cvel", "cfrc_ext", "subtree_com", "qfrc_actuator")
    heavy = np.tile(sim.model.body_mass, (ENVS, 1)) * np.linspace(1.0, 2.0, ENVS)[:, None]
    changes = (
        lambda s: s.step(controls(1), nstep=20),
        lambda s: s.set_state(qvel=np.ones(sim.model.nv)),
        lambda s: s.randomize(body_mass=heavy),
        lambda s: s.step(controls(2), nstep=20),
        lambda s: s.reset(np.arange(ENVS) < 7),
        lambda s: s.set_state(qpos=sim.model.qpos0 + np.array([0, 0, 1.0, *np.zeros(sim.model.nq - 3)]), envs=np.arange(ENVS) > 15),
        lambda s: s.randomize(),
    )
    before: dict[str, np.ndarray] = {}
    for k, change in enumerate(changes):
        change(sim)
        other = batch()
        for again in changes[: k + 1]:
            again(other)
        for name in read:
            now = getattr(sim, name)
            assert now is getattr(sim, name)
            np.testing.assert_array_equal(now, getattr(other, name), err_msg=f"{name} after change {k}")
            assert name not in before or before[name] is not now
            before[name] = now
