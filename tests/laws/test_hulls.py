"""Tumbling rocks: what the search for their normals keeps of the last step is the environment's own, and changes nothing."""

from __future__ import annotations

import numpy as np
import pytest
import stepper
from models import contact_bits, random_quaternion

ROCKS, ENVS, STEPS = 4, 19, 200


def rock(rng: np.random.Generator, corners: int) -> str:
    points = rng.normal(size=(corners, 3))
    return " ".join(f"{x:.6f}" for x in (0.1 * points / np.linalg.norm(points, axis=1, keepdims=True)).ravel())


@pytest.fixture(scope="module")
def model() -> stepper.Model:
    """Rocks of few and of many corners in a pit of walls that are meshes too."""
    rng = np.random.default_rng(2)
    meshes = "".join(f'<mesh name="rock{k}" vertex="{rock(rng, n)}"/>' for k, n in enumerate((8, 14, 60, 90)))
    wall = " ".join(f"{x} {y} {z}" for x in (-0.05, 0.05) for y in (-0.3, 0.3) for z in (-0.3, 0.3))
    walls = "".join(f'<geom type="mesh" mesh="wall" pos="{x} {y} .2" euler="0 0 {a}"/>' for x, y, a in
                    ((0.25, 0, 0), (-0.25, 0, 0), (0, 0.25, 90), (0, -0.25, 90)))  # fmt: skip
    bodies = "".join(f'<body><freejoint/><geom type="mesh" mesh="rock{k}" density="2000"/></body>' for k in range(ROCKS))
    return stepper.load(f"""
    <mujoco>
      <asset>{meshes}<mesh name="wall" vertex="{wall}"/></asset>
      <worldbody><geom type="plane" size="1 1 1"/>{walls}{bodies}</worldbody>
    </mujoco>""")


def starts() -> np.ndarray:
    rng = np.random.default_rng(4)
    place = lambda k: np.concatenate([rng.uniform(-0.05, 0.05, 2), [0.12 + 0.17 * k], random_quaternion(rng)])  # noqa: E731
    return np.array([np.concatenate([place(k) for k in range(ROCKS)]) for _ in range(ENVS)])


def start(model: stepper.Model, precision: str, envs=slice(None), steps: int = STEPS) -> stepper.Stepper:
    qpos = starts()[envs]
    sim = stepper.Stepper(model, len(qpos), precision=precision)
    sim.reset(qpos=qpos)
    sim.step(nstep=steps)
    return sim


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_the_bits_are_those_of_any_place_in_the_batch(model, precision):
    whole = start(model, precision)
    assert sum(len(whole.contacts(env)) for env in range(ENVS)) > 3 * ENVS
    for envs in ([0], [7, 3], list(range(ENVS))[::-1]):
        part = start(model, precision, envs)
        for here, there in enumerate(envs):
            assert part.qpos[here].tobytes() == whole.qpos[there].tobytes()
            assert contact_bits(part.contacts(here)) == contact_bits(whole.contacts(there))


@pytest.mark.parametrize("precision", ["f64", "f32"])
def test_a_restored_state_goes_on_with_the_same_bits(model, precision):
    sim = start(model, precision)
    state, other = sim.get_state(), start(model, precision, steps=3)
    other.set_state(state)
    for running in (sim, other):
        running.step(nstep=20)
    assert other.qpos.tobytes() == sim.qpos.tobytes()


def test_a_masked_reset_leaves_nothing_behind(model):
    mask = np.arange(ENVS) % 3 == 0
    sim, fresh = start(model, "f64"), start(model, "f64", steps=0)
    sim.reset(mask, qpos=starts())
    for running in (sim, fresh):
        running.step(nstep=STEPS)
    assert sim.qpos[mask].tobytes() == fresh.qpos[mask].tobytes()


def test_a_saved_model_goes_the_same_way(model, tmp_path):
    model.save(tmp_path / "rocks.stepper")
    for again in (stepper.load(tmp_path / "rocks.stepper"), model.replace(timestep=model.timestep)):
        first, second = (start(m, "f64", envs=slice(3)) for m in (model, again))
        assert second.qpos.tobytes() == first.qpos.tobytes()
        assert all(contact_bits(second.contacts(env)) == contact_bits(first.contacts(env)) for env in range(3))


@pytest.mark.parametrize("thickness", [1.0, 1e-2, 3e-4, 1e-4, 1e-5, 1e-6, 1e-8, 1e-12])
def test_a_hull_of_any_thickness_lies_on_the_floor(thickness):
    points = np.random.default_rng(0).uniform(-1, 1, (250, 3)) * [thickness, 1, 1]
    vertices = " ".join(map(repr, points.ravel().tolist()))
    sim = stepper.Stepper(
        stepper.load(f"""
    <mujoco>
      <asset><mesh name="leaf" vertex="{vertices}"/></asset>
      <worldbody>
        <geom type="plane" size="1 1 1"/>
        <body euler="0 90 0" pos="0 0 {thickness + 0.01}"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia=".5 .3 .3"/>
          <geom type="mesh" mesh="leaf"/></body>
      </worldbody>
    </mujoco>""")
    )
    sim.step(nstep=1000)
    assert not sim.status
    assert len(sim.contacts()) >= 3
    # It lies on its flat side, its centre no further from the floor than it is thick, up to MuJoCo's vertices in single precision.
    assert abs(sim.qpos[2]) < thickness + 1e-5
    assert np.abs(sim.qvel).max() < 1e-3
