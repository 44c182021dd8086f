"""The accuracy of a mechanism depends on nothing that it does not touch: it moves as in a model of its own."""

import functools
from dataclasses import dataclass, field

import numpy as np
import pytest
import stepper
from hypothesis import given
from hypothesis import strategies as st

# Mechanisms do not share a number, so that both runs round alike. What is left is the position of a mechanism among the others, on which
# sums over all degrees of freedom depend: a few units in the last place of positions up to 500 m.
ROUNDING = {"f64": 1e-9, "f32": 1e-3}

BAR = '<geom type="capsule" size=".02" fromto="0 0 0 .5 0 0" contype="0" conaffinity="0"/>'
SHORT_BAR = '<geom type="capsule" size=".02" fromto="0 0 0 .1 0 0" contype="0" conaffinity="0"/>'
HINGE = '<joint axis="0 1 0"/>'


@dataclass(frozen=True)
class Mechanism:
    """Bodies, their velocity, and what else the model and the run need for them."""

    bodies: str
    qvel: tuple[float, ...]
    nq: int = 0
    equality: str = ""
    actuator: str = ""
    restitution: float = 0.0
    force: tuple[float, ...] = field(default=())


# Mechanisms without contacts: with contacts, the solver's tolerance would decide how alike two runs are.
WATCHED = {
    "falling body": Mechanism(
        '<body pos="0 0 500"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia=".1 .1 .1"/></body>', (0.0,) * 6, 7
    ),
    "tumbling body": Mechanism(
        '<body pos="0 0 500"><freejoint/><inertial pos="0 0 0" mass="1" diaginertia=".1 .2 .3"/></body>', (1, 0, 0, 1, 3, 0.1), 7
    ),
    "pendulum": Mechanism(f'<body pos="0 0 50">{HINGE}{BAR}</body>', (1.0,), 1),
    "double pendulum": Mechanism(f'<body pos="0 0 50">{HINGE}{BAR}<body pos=".5 0 0">{HINGE}{BAR}</body></body>', (1.0, -2.0), 2),
    "servo arm": Mechanism(
        f'<body pos="0 0 50"><joint name="shoulder" axis="0 1 0" damping=".1"/>{BAR}</body>',
        (2.0,),
        1,
        actuator='<position joint="shoulder" kp="20" kv="1"/>',
    ),
    "arm at its limit": Mechanism(f'<body pos="0 0 50"><joint axis="0 1 0" limited="true" range="-90 30"/>{BAR}</body>', (1.0,), 1),
}

SPHERES = "".join(f'<body pos="{10 + 0.2 * i} 0 {0.5 + 0.1 * i}"><freejoint/><geom size=".05" mass=".1"/></body>' for i in range(4))

OTHERS = {
    "rotor beside a plate": Mechanism(
        '<geom type="box" size=".2 .2 .01" pos="10 0 .28"/><body pos="10 0 .3"><joint axis="0 0 1"/><geom type="box" size=".1 .01 .002"/></body>',  # noqa: E501
        (314.0,),
    ),
    "bullet at a thin wall": Mechanism(
        '<geom type="box" size=".001 1 1" pos="12 0 2"/><body pos="10 0 2"><freejoint/><geom size=".02" mass=".1"/></body>',
        (300, 0, 0, 0, 0, 0),
    ),
    "elastic balls": Mechanism(f'<geom type="plane" size="1 1 1"/>{SPHERES}', (0.0,) * 24, restitution=1.0),
    "whipping chain": Mechanism(
        f'<body pos="10 0 50">{HINGE}{SHORT_BAR}<body pos=".1 0 0">{HINGE}{SHORT_BAR}</body></body>', (300.0, -500.0)
    ),
    "weld out of reach": Mechanism(
        '<body name="held" pos="10 0 5"><joint type="slide" axis="1 0 0"/><geom size=".1" mass="1" contype="0" conaffinity="0"/></body>'
        '<body name="holder" mocap="true" pos="10 1 5"/>',
        (0.0,),
        equality='<weld body1="held" body2="holder"/>',
    ),
    "force that is not a number": Mechanism('<body pos="10 0 5"><joint/><geom size=".1" mass="1"/></body>', (0.0,), force=(np.nan,)),
    "jam": Mechanism(
        '<geom type="box" size=".1 .1 .1" pos="10 0 5"/><geom type="box" size=".1 .1 .1" pos="10.25 0 5"/>'
        '<body pos="10.125 0 5"><freejoint/><geom type="box" size=".05 .05 .05" mass="1"/></body>',
        (0.0,) * 6,
    ),
}


def trajectory(mechanisms: list[Mechanism], timestep: float, integrator: str, precision: str) -> np.ndarray:
    """Positions of the first mechanism during 0.5 s, (steps, nq)."""
    part = lambda name: "".join(getattr(m, name) for m in mechanisms)  # noqa: E731
    model = stepper.load(
        f'<mujoco><option timestep="{timestep}"/><worldbody>{part("bodies")}</worldbody><equality>{part("equality")}</equality>'
        f"<actuator>{part('actuator')}</actuator></mujoco>"
    )
    model = model.replace(geom_restitution=np.full(model.ngeom, max(m.restitution for m in mechanisms)))
    sim = stepper.Stepper(model, options=stepper.Options(timestep=timestep, integrator=integrator), precision=precision)
    sim.set_state(qvel=np.concatenate([m.qvel for m in mechanisms]))
    force = np.concatenate([m.force or np.zeros(len(m.qvel)) for m in mechanisms])
    path = []
    for _ in range(round(0.5 / timestep)):
        sim.qfrc_applied[...] = force
        sim.step()
        path.append(sim.qpos[: mechanisms[0].nq].copy())
    return np.array(path)


@functools.cache
def path_alone(watched: str, timestep: float, integrator: str, precision: str) -> np.ndarray:
    """Positions of a mechanism in a model of its own."""
    return trajectory([WATCHED[watched]], timestep, integrator, precision)


timesteps = st.sampled_from([1e-3, 2e-3, 5e-3, 1e-2])
settings = st.tuples(st.sampled_from(["midpoint", "euler", "implicit", "rk4"]), st.sampled_from(["f64", "f32"]))


@pytest.mark.parametrize("other", sorted(OTHERS))
@given(st.sampled_from(sorted(WATCHED)), timesteps, settings)
def test_a_mechanism_moves_as_in_a_model_of_its_own(other, watched, timestep, setting):
    beside = trajectory([WATCHED[watched], OTHERS[other]], timestep, *setting)
    assert np.isfinite(beside).all()
    assert np.abs(beside - path_alone(watched, timestep, *setting)).max() <= ROUNDING[setting[1]]
