"""Rapier as an engine of studies: the motion is the same where physics leaves no choice, and what it cannot do is said."""

import numpy as np
import pytest
import stepper
from stepper.lab.accuracy.candidates import lines, no_rapier
from stepper.lab.accuracy.invariants import MOMENTUM, Invariants
from stepper.lab.accuracy.traces import Distance, run

pytest.importorskip("rapier3d", reason="pip install 'rapier3d>=0.36,<0.37'")

# A free body with a part fixed to it, two hinges with limits, a slide; shapes that do not collide, but for the hinges' limits.
MACHINE = """<mujoco><option timestep=".002"/><default><geom contype="0" conaffinity="0"/></default><worldbody>
<body pos="0 0 .5" euler="20 30 40"><freejoint/><geom type="box" size=".1 .2 .05"/>
  <body pos=".2 0 .1" euler="0 40 0"><geom size=".05"/></body></body>
<body pos="2 0 1" euler="10 20 30"><joint name="a" axis="0 1 .3" pos=".05 .02 0" ref="20"/>
  <geom type="capsule" size=".02" fromto="0 0 0 .5 0 0"/>
  <body pos=".5 0 0" euler="0 30 0"><joint name="b" axis="0 1 0" range="-170 170"/><geom type="cylinder" size=".03 .2"/></body></body>
<body pos="4 0 1" euler="0 30 0"><joint name="s" type="slide" axis="0 0 1"/><geom type="cylinder" size=".1 .2"/></body>
</worldbody></mujoco>"""
BLOCK = """<mujoco><option timestep=".002"/><worldbody><geom type="plane" size="9 9 1" friction=".2"/>
<body name="block" pos="0 0 .0501"><freejoint/><geom type="box" size=".1 .1 .05" friction=".3"/></body></worldbody></mujoco>"""


def study(model, **changed):
    return stepper.lab.Study.from_model(model, **({"seconds": 0.2, "qvel_noise": 0.3, "controller": None} | changed))


def test_a_motion_without_contacts_is_the_same():
    own = study(MACHINE)
    right, distance = run(own, range(3), timestep=0.000125), Distance("m", 0.2)
    errors = [distance(right, run(own, range(3), engine="rapier", iterations=20, timestep=dt)).max() for dt in (0.004, 0.002, 0.001)]
    # Of first order in the time step, down to what joints of 32 bits keep: some hundredths of a millimetre.
    assert errors[0] > 1.5 * errors[1]
    assert errors[2] < 1.5e-4
    # States are read as they were set: the first control's angles and velocities, whose errors are of one step's size.
    one, other = run(own, range(3), until=0.02), run(own, range(3), until=0.02, engine="rapier", iterations=20)
    np.testing.assert_allclose(other.path[0], one.path[0], atol=5e-4)
    np.testing.assert_allclose(other.path[1], one.path[1], atol=2e-2)


def test_a_block_slides_with_the_larger_friction():
    """Coulomb's deceleration mu g, with the friction of the block."""
    start = np.zeros(6)
    start[0] = 1.0
    own = study(BLOCK, qvel_noise=0.0, start=lambda now, rng: (np.tile(now.model.qpos0, (1, 1)), start[None]))
    speed = run(own, [0], engine="rapier").path[1][-1, 0, 0]
    # Two steps' worth of friction: the block begins 0.1 mm above the plane, which it takes 4.5 ms to fall.
    assert speed == pytest.approx(1.0 - 0.3 * 9.81 * 0.2, abs=0.012)


def test_forces_of_a_drive_act():
    def drive(now):
        now.xfrc_applied[:, 1, 0] = 2.0

    own = study(MACHINE, controller=drive, qvel_noise=0.0)
    one, other = run(own, [0]), run(own, [0], engine="rapier")
    # The same push at the centre of mass of a body of 5.5 kg for a fifth of a second.
    assert one.path[1][-1, 0, 0] == pytest.approx(other.path[1][-1, 0, 0], abs=1e-3)
    assert abs(one.path[1][-1, 0, 0]) > 0.02


def test_invariants_are_measured_alike():
    own = study(MACHINE[: MACHINE.index('<body pos="2 0 1"')] + "</worldbody></mujoco>")
    found = Invariants(own)
    # Impulses of 32 bits in a hundred steps, of a momentum of some kg m/s.
    assert found.measure(run(own, range(2), engine="rapier"))[MOMENTUM].max() < 0.02


def test_a_chart_has_rapier_where_it_can(tmp_path):
    own = study(BLOCK, name="block")
    assert no_rapier(own) is None
    found = stepper.lab.chart(own, tmp_path, quick=True, episodes=2, horizon=0.1)
    theirs = [dot for dot in found.dots if dot.engine == "rapier"]
    assert {dot.setting for dot in theirs} == {"its defaults", "20 iterations"}
    assert all(np.isfinite(dot.error) and dot.alone > 0 and dot.batch > 0 for dot in theirs)
    assert not any("rapier" in reason for reason in found.skipped)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda text: text.replace("<freejoint/>", '<joint damping="1"/>'), "no damping"),
        (lambda text: text.replace('type="box" size=".1 .1 .05"', 'type="ellipsoid" size=".1 .1 .05"'), "other colliding shapes"),
        (lambda text: text.replace("</worldbody>", '</worldbody><equality><weld body1="block"/></equality>'), "no equalities"),
        (lambda text: text.replace("<freejoint/>", '<joint type="ball"/>'), "one joint per body"),
        (lambda text: text.replace('timestep=".002"', 'timestep=".002" density="1.2"'), "no fluid forces"),
        (lambda text: text.replace('friction=".3"', 'friction=".3" condim="6"'), "condim"),
    ],
)
def test_what_it_cannot_do_is_said(change, reason):
    own = study(change(BLOCK))
    assert reason in no_rapier(own)
    assert not any(line.engine == "rapier" for line in lines(own, quick=True))
    with pytest.raises(ValueError, match=r"rapier cannot run this study: .*" + reason):
        run(own, [0], engine="rapier")
