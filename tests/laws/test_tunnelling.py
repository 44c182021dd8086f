"""Nothing passes through a wall of a millimetre, however fast; where that cannot be excluded, the step says so."""

import numpy as np
import pytest
from models import simulate
from stepper import Status

HEAD = '<mujoco><option gravity="0 0 0"/><worldbody>'
TAIL = "</worldbody></mujoco>"
WALL = '<geom type="box" size=".0005 2 2"/>'
BODIES = {
    "sphere": 'type="sphere" size=".05" mass="1"',
    "bullet": 'type="sphere" size=".003" mass="1"',
    "capsule ahead": 'type="capsule" size=".02 .1" euler="0 90 0" mass="1"',
    "capsule across": 'type="capsule" size=".02 .1" mass="1"',
    "leaning capsule": 'type="capsule" size=".02 .1" euler="0 50 20" mass="1"',
}
ENVS = 32
every_dt = pytest.mark.parametrize("dt", [1e-4, 1e-3, 5e-3, 2e-2])
every_integrator = pytest.mark.parametrize("integrator", ["euler", "midpoint", "rk4"])
every_stabilization = pytest.mark.parametrize("stabilization", ["baumgarte", "split"])


@every_stabilization
@every_integrator
@every_dt
@pytest.mark.parametrize("body", BODIES)
@pytest.mark.parametrize("way", [0.011, 0.3, 3.0])
def test_a_wall_stops_what_flies_into_it(body, way, dt, integrator, stabilization):
    """`way` in m per step: eleven walls to three thousand. Every environment meets the wall in another phase of the step."""
    text = HEAD + WALL + f"<body><freejoint/><geom {BODIES[body]}/></body>" + TAIL
    sim = simulate(text, ENVS, timestep=dt, integrator=integrator, stabilization=stabilization)
    speed = way / dt
    qpos, qvel = sim.qpos.copy(), sim.qvel.copy()
    qpos[:, 0] = -0.2 - way * np.linspace(0.0, 2.0, ENVS)
    qvel[:, 0] = speed
    sim.set_state(qpos, qvel)
    touched = np.zeros(ENVS, dtype=bool)
    for _ in range(round(0.5 / way) + 8):
        sim.step()
        touched |= [len(sim.contacts(env)) > 0 for env in range(ENVS)]
        # A leaning capsule is turned by the wall; its middle stays on this side as long as any of it does.
        passed = sim.qpos[:, 0] > 0
        assert not passed.any() or (sim.status[passed] & Status.TUNNELLED).all()
        if "leaning" not in body:
            assert not passed.any()
            assert not (sim.status & Status.TUNNELLED).any()
    assert touched.all()


@every_integrator
@every_dt
def test_a_flying_wall_takes_along_what_it_meets(dt, integrator):
    """The sphere stands, the wall flies: the same to an observer on the wall."""
    wall = '<body><joint type="slide" axis="1 0 0"/><geom type="box" size=".0005 2 2" mass="1000"/></body>'
    sim = simulate(HEAD + wall + f"<body><freejoint/><geom {BODIES['sphere']}/></body>" + TAIL, ENVS, timestep=dt, integrator=integrator)
    way = 0.3
    qpos, qvel = sim.qpos.copy(), sim.qvel.copy()
    qpos[:, 0] = -0.2 - way * np.linspace(0.0, 2.0, ENVS)
    qvel[:, 0] = way / dt
    sim.set_state(qpos, qvel)
    for _ in range(12):
        sim.step()
        assert (sim.qpos[:, 1] > sim.qpos[:, 0]).all()
    assert (sim.qvel[:, 1] > 0.9 * way / dt).all()


@every_integrator
@every_dt
@pytest.mark.parametrize("angle", [0.03, 0.3, 1.2])
def test_a_swinging_bar_stops_at_a_post_or_says_that_it_may_not_have(angle, dt, integrator):
    """`angle` in rad per step. The post is a millimetre thick, a radian ahead, and as long as the outer half of the bar."""
    post = '<body euler="0 0 57.29577951308232"><geom type="box" size=".25 .0005 .1" pos=".75 0 0"/></body>'
    bar = '<body><joint axis="0 0 1"/><geom type="capsule" size=".01" fromto=".02 0 0 1 0 0" mass="1"/></body>'
    sim = simulate(HEAD + post + bar + TAIL, ENVS, timestep=dt, integrator=integrator)
    qpos, qvel = sim.qpos.copy(), sim.qvel.copy()
    qpos[:, 0] = -angle * np.linspace(0.0, 1.0, ENVS)
    qvel[:, 0] = angle / dt
    sim.set_state(qpos, qvel)
    suspected = np.zeros(ENVS, dtype=bool)
    for _ in range(int(2.5 / angle)):
        sim.step()
        suspected |= (sim.status & Status.TUNNELLED) != 0
    assert ((sim.qpos[:, 0] < 1.0) | suspected).all()
    if angle < 0.05:
        assert not suspected.any()


def test_what_is_struck_fast_and_unforeseen_is_reported():
    """A heavy ball drives a light one, which stood still, through the wall behind it within one step: its own velocity foretold nothing."""
    heavy = '<body pos="-.5 0 0"><freejoint/><geom type="sphere" size=".1" mass="100" margin="0"/></body>'
    light = '<body pos="-.3 0 0"><freejoint/><geom type="sphere" size=".02" mass=".01"/></body>'
    sim = simulate(HEAD + WALL + heavy + light + TAIL, timestep=1e-2, integrator="euler")
    qvel = sim.qvel.copy()
    qvel[0] = 100.0
    sim.set_state(qvel=qvel)
    passed = False
    for _ in range(4):
        sim.step()
        passed |= sim.qpos[7] > 0
        assert not passed or sim.status & Status.TUNNELLED
        if passed:
            break
