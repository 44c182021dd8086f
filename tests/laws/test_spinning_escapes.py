"""Elastic bodies that spin by turns per step in a closed room: one that leaves it is reported.

Their contact points move away from a wall while the body approaches it. The search for the time of an impact then moves the evaluation
point behind the wall.
"""

import numpy as np
import pytest
import stepper
from hypothesis import given
from hypothesis import strategies as st
from stepper import Status

HALF, THICKNESS = 0.5, 0.002
REPORTED = int(Status.TUNNELLED | Status.DEEP | Status.UNRESOLVED | Status.NOT_CONVERGED)
BODIES = {
    "cylinder": 'type="cylinder" size=".0429 .0107"',
    "box": 'type="box" size=".03 .02 .0107"',
    "ellipsoid": 'type="ellipsoid" size=".04 .03 .0107"',
    "capsule": 'type="capsule" size=".0107 .03"',
}


def room(body: str) -> stepper.Model:
    """Closed room of thin walls with one elastic body."""
    walls = ""
    for axis in range(3):
        for side in (-1, 1):
            size, pos = [HALF + 2 * THICKNESS] * 3, [0.0] * 3
            size[axis], pos[axis] = THICKNESS / 2, side * (HALF + THICKNESS / 2)
            walls += f'<geom type="box" size="{size[0]} {size[1]} {size[2]}" pos="{pos[0]} {pos[1]} {pos[2]}"/>'
    body = f'<body><freejoint/><geom {BODIES[body]} mass="1"/></body>'
    model = stepper.load(f'<mujoco><option gravity="0 0 0" timestep=".02"/><worldbody>{walls}{body}</worldbody></mujoco>')
    return model.replace(geom_restitution=np.ones(model.ngeom))


def silent_escapes(model: stepper.Model, qpos: np.ndarray, qvel: np.ndarray, steps: int) -> np.ndarray:
    """Environments whose body is outside for three steps without a flag until then."""
    sim = stepper.Stepper(model, len(qpos))
    sim.set_state(qpos, qvel)
    flags, outside, escaped = np.zeros(len(qpos), int), np.zeros(len(qpos), int), np.zeros(len(qpos), bool)
    for _ in range(steps):
        sim.step()
        flags |= np.asarray(sim.status).astype(int)
        outside = np.where((np.abs(sim.qpos[:, :3]) > HALF + THICKNESS).any(1), outside + 1, 0)
        # A step that carries the body through a wall is reported in the same step, or in the next one, which finds the overlap.
        escaped |= (outside >= 3) & ((flags & REPORTED) == 0)
    return np.flatnonzero(escaped)


QPOS = [-0.19982786, 0.19002877, 0.25768235, -0.21121246, -0.36171695, 0.896269, 0.14578076]
QVEL = [3.9051275, -13.2611547, 9.56810626, 417.2804496, 426.5595043, -0.66683644]
"""State of a disc at 17 m/s that turns by 12 rad per step."""


@pytest.mark.parametrize("change", [0.0, 1e-4, 1e-3])
def test_a_spinning_disc_that_leaves_a_room_is_reported(change):
    velocities = np.array(QVEL) * (1 + change * np.random.default_rng(1).normal(size=(20, 6)))
    assert silent_escapes(room("cylinder"), np.tile(QPOS, (20, 1)), velocities, 6).size == 0


@given(body=st.sampled_from(sorted(BODIES)), seed=st.integers(0, 2**32 - 1))
def test_spinning_bodies_that_leave_a_room_are_reported(body, seed):
    rng, envs = np.random.default_rng(seed), 64
    qpos = np.array(QPOS) + 0.1 * rng.normal(size=(envs, 7))
    qpos[:, :3] = np.clip(qpos[:, :3], -0.4, 0.4)
    qpos[:, 3:] /= np.linalg.norm(qpos[:, 3:], axis=1)[:, None]
    assert silent_escapes(room(body), qpos, np.array(QVEL) * (1 + 0.1 * rng.normal(size=(envs, 6))), 6).size == 0
