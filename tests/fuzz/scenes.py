"""Scenes that have one of everything, small enough to be tried thousands of times."""

ROBOT = "everything"

SCENES = {
    ROBOT: """
<mujoco model="everything"><option timestep="0.002" density="1.2" viscosity="1e-5" wind="0 0 1"/>
  <asset><mesh name="rock" vertex="0 0 0 .2 0 0 0 .2 0 0 0 .2"/><hfield name="hills" nrow="3" ncol="3" size="1 1 .1 .1"
    elevation="0 1 0 1 0 1 0 1 0"/></asset>
  <worldbody><geom type="plane" size="9 9 1"/><geom type="hfield" hfield="hills" pos="5 5 0"/>
  <body name="hand" mocap="true" pos="0 0 3"><geom size=".05"/></body>
  <body name="ball" pos="0 0 .1" gravcomp=".5"><freejoint/><geom size=".1" condim="6" friction="1 .1 .1" fluidshape="ellipsoid"/></body>
  <body name="rock" pos=".05 0 .3"><freejoint/><geom type="mesh" mesh="rock"/></body>
  <body name="stone" pos=".05 .1 .5"><freejoint/><geom type="mesh" mesh="rock" euler="30 20 10"/></body>
  <body name="can" pos="5 5 .3"><freejoint/><geom type="cylinder" size=".1 .1"/><geom type="ellipsoid" size=".1 .1 .2" pos=".1 0 0"/></body>
  <body name="arm" pos="2 0 1"><joint name="a" axis="0 1 0" range="-1 1" stiffness="1" damping=".1" frictionloss=".1" armature=".01"/>
    <geom type="capsule" size=".05 .2"/><site name="here"/>
    <body name="tool" pos="0 0 .5"><joint name="b" type="slide" actuatorfrcrange="-5 5"/><geom type="box" size=".1 .1 .1"/>
      <body name="tip" pos="0 0 .2"><joint name="c" type="ball" range="0 1" damping=".01"/>
      <geom size=".05" pos=".1 0 0"/></body></body></body>
  </worldbody>
  <tendon><fixed name="belt" range="-3 3" stiffness="1" springlength="-1 1" damping=".1"><joint joint="a" coef="1"/><joint joint="b"
    coef="-1"/></fixed></tendon>
  <equality><joint joint1="a" joint2="b" polycoef="0 1 0 0 0"/><weld body1="ball" body2="hand" active="false"/></equality>
  <actuator><position name="servo" joint="a" kp="10" kv="1" ctrlrange="-1 1" forcerange="-9 9"/><motor tendon="belt" gear="2"/>
    <general joint="b" dyntype="filter" dynprm=".1" gainprm="3"/><motor site="here" gear="0 0 1 0 0 0"/></actuator>
  <sensor><jointpos joint="a"/><accelerometer site="here" noise=".1"/><force site="here"/><touch site="here"/><rangefinder site="here"/>
    <tendonpos tendon="belt"/><actuatorfrc actuator="servo"/></sensor>
  <keyframe><key name="up" qvel="1 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0 0"/></keyframe>
</mujoco>""",
    "stack": """
<mujoco model="stack"><option timestep="0.004" cone="elliptic"/><worldbody><geom type="plane" size="5 5 1"/>
  <body pos="0 0 .1"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
  <body pos="0 0 .3"><freejoint/><geom type="box" size=".1 .1 .1"/></body>
  <body pos=".02 0 .5"><freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody></mujoco>""",
    "pendulum": """
<mujoco model="pendulum"><option timestep="0.01" integrator="RK4"/><worldbody><body><joint name="j" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.5" size=".05"/><body pos="0 0 -.5"><joint axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 -.5" size=".05"/></body></body></worldbody>
  <actuator><motor joint="j"/></actuator><sensor><jointvel joint="j"/></sensor></mujoco>""",
}
