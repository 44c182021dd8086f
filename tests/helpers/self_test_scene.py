"""Model and expected digest of the self-test of `stepper.doctor`.

After a change of bits or of the format of saved models, this renews both:

    PYTHONPATH=python:tests/helpers .venv/bin/python tests/helpers/self_test_scene.py
"""

import stepper
from stepper.doctor.self_test import DIGEST, SCENE, digest_at

MJCF = """
<mujoco model="self-test">
  <option timestep="0.004"/>
  <worldbody>
    <geom type="plane" size="3 3 1"/>
    <body pos="0 0 .06"><freejoint/><geom type="box" size=".06 .06 .06" mass=".6"/></body>
    <body pos=".02 .01 .19"><freejoint/><geom type="capsule" size=".04 .05" euler="90 10 0" mass=".3"/></body>
    <body pos="-.3 0 .3">
      <joint name="shoulder" axis="0 1 0" range="-90 90" damping=".05"/>
      <geom type="capsule" fromto="0 0 0 .2 0 0" size=".02" mass=".3"/>
      <body pos=".2 0 0">
        <joint name="elbow" axis="0 1 0" range="-120 120" stiffness="1" frictionloss=".01"/>
        <geom type="cylinder" fromto="0 0 0 .15 0 0" size=".025" mass=".2"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="shoulder"/><position joint="elbow" kp="5" kv=".2"/></actuator>
</mujoco>
"""
"""A box on a floor, a capsule that rolls off it, and an arm with joint limits, dry friction, a spring and a servo."""


def renew() -> None:
    """Writes the model and the digest of this build, provided that all CPU levels of this machine agree."""
    stepper.load(MJCF).save(SCENE)
    digests = {level: digest_at(level) for level in stepper.doctor.cpu_levels()}
    if len(set(digests.values())) > 1:
        raise SystemExit(f"not written, the CPU levels differ: {digests}")
    DIGEST.write_text(f"{next(iter(digests.values()))}\n", encoding="ascii")


if __name__ == "__main__":
    renew()
    print(f"wrote {SCENE} and {DIGEST}")
