"""The midpoint rule is of second order where contacts hold: what it expects of their impulses is as good as the rule."""

from itertools import pairwise

import numpy as np
import pytest
import stepper

BALL = """<mujoco><worldbody><geom type="plane" size="5 5 .1" friction="2"/>
<body pos="0 0 .1"><freejoint/><geom type="sphere" size=".1" friction="2" mass="2"/>
<body><joint type="ball"/><geom type="capsule" fromto="0 0 .15 .1 0 .4" size=".03" mass=".1" contype="0" conaffinity="0"/></body></body>
</worldbody></mujoco>"""
"""A ball that rolls and carries a pendulum that whirls."""

BOX = '<geom type="box" size=".1 .07 .05" friction=".8" mass="1"/>'
STACK = f"""<mujoco><worldbody><body><joint axis="0 0 1"/><geom type="cylinder" size="1 .05" friction=".8" mass="100"/></body>
{"".join(f'<body pos=".3 0 {0.1 + 0.1 * k}"><freejoint/>{BOX}</body>' for k in range(5))}</worldbody></mujoco>"""
"""Five boxes on a turntable."""


@pytest.mark.parametrize(("text", "qvel", "seconds", "steps"), [
    pytest.param(BALL, [0, 0.5, 0, -5, 0, 0, 4, 6, -5], 0.4, 40, id="ball"),
    pytest.param(STACK, [1.0] + 5 * [0, 0.3, 0, 0, 0, 1.0], 1.0, 25, id="stack"),
])  # fmt: skip
def test_half_the_time_step_has_a_quarter_of_the_error(text, qvel, seconds, steps):
    model = stepper.load(text, strict=False)

    # At the default tolerance of 1e-4 m/s, the solver's error exceeds that of short steps: boxes that stick slide by some 1e-5 m.
    def reached(n):
        sim = stepper.Stepper(model, options=stepper.Options(timestep=seconds / n, tolerance=1e-6))
        sim.set_state(qpos=sim.qpos, qvel=qvel)
        sim.step(nstep=n)
        assert sim.status == stepper.Status.OK
        return np.array(sim.qpos)

    exact = reached(64 * steps)
    errors = [np.abs(reached(n) - exact).max() for n in (steps, 2 * steps, 4 * steps)]
    # The next term of the error is half as large a part with half the step: within a tenth of 4 here, where a first order has 2.
    for coarse, fine in pairwise(errors):
        assert 3.6 < coarse / fine < 4.4
