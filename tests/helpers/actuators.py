"""Scenes with actuators of every kind that is simulated, on joints, tendons, sites and slider-cranks."""

TREE = """<mujoco><option timestep=".002" gravity="0 0 -9.81"><flag contact="disable"/></option>
  <worldbody><site name="base" pos=".3 -.2 .1" euler="10 20 30"/>
  <body pos="0 0 1"><freejoint/><geom type="box" size=".1 .2 .3"/><site name="hull" pos=".1 .05 -.2" euler="40 10 -20"/>
    <body pos=".2 0 .1"><joint name="swing" axis="1 2 0" pos=".05 0 0"/><geom type="capsule" size=".05 .2" euler="10 20 0"/>
      <body pos="0 .4 .1"><joint name="rail" type="slide" axis="1 0 1"/><geom type="sphere" size=".1"/>
        <site name="tip" pos=".1 .2 .3" euler="70 -30 10"/></body></body>
    <body pos="-.2 0 .1"><joint name="socket" type="ball"/><geom type="capsule" size=".05 .2" pos="0 0 .2"/>
      <geom name="hub" size=".1" pos=".1 0 .1"/>
      <body pos="0 0 .4"><joint name="wrist" axis="0 1 0"/><geom type="sphere" size=".08" pos=".1 0 0"/>
        <site name="hand" pos="0 .1 .2" euler="5 6 7"/></body></body></body></worldbody>
  <tendon><fixed name="belt"><joint joint="swing" coef=".7"/><joint joint="wrist" coef="-1.3"/></fixed>
    <spatial name="rope"><site site="base"/><site site="tip"/><site site="hand"/><pulley divisor="2"/><site site="hand"/><geom geom="hub"/>
      <site site="hull"/></spatial></tendon>
  <actuator>{actuators}</actuator><sensor>{sensors}</sensor></mujoco>"""

GEAR = 'gear="1 -2 3 .5 -.4 .3"'
TARGETS = {
    "joint": 'joint="swing" gear="3"',
    "slide": 'joint="rail" gear="-2"',
    "tendon": 'tendon="belt" gear="1.5"',
    "spatial tendon": 'tendon="rope" gear="-1.5"',
    "slider-crank": 'cranksite="tip" slidersite="hull" cranklength="3" gear="2"',
    "short slider-crank": 'cranksite="hand" slidersite="base" cranklength=".01" gear="2"',
    "site": f'site="tip" {GEAR}',
    "site on the world": f'site="tip" refsite="base" {GEAR}',
    "site on the same tree": f'site="tip" refsite="hand" {GEAR}',
    "site on an ancestor": f'site="hand" refsite="hull" {GEAR}',
    "site on its own body": f'site="hull" refsite="hull" {GEAR}',
    "translation": 'site="hand" refsite="base" gear="1 2 3 0 0 0"',
    "rotation": 'site="hand" refsite="base" gear="0 0 0 1 2 3"',
}
KINDS = {
    "motor": "motor {}",
    "bounded motor": 'motor {} ctrllimited="true" ctrlrange="-.5 .5" forcelimited="true" forcerange="-.4 .3"',
    "position": 'position {} kp="20" kv="3"',
    "velocity": 'velocity {} kv="4"',
    "intvelocity": 'intvelocity {} kp="20" kv="2" actrange="-1 1"',
    "damper": 'damper {} kv="3" ctrlrange="0 1"',
    "DC motor": 'dcmotor {} motorconst=".5 .6" resistance="2" ctrlrange="-.7 .7"',
    "bounded DC motor": 'dcmotor {} nominal="12 .5 6" saturation=".03 0 0"',
    "PID without an integral": 'pid {} kp="20" kv="3" input="pos" posrange="-.5 .5"',
    "PID of the speed": 'pid {} kp="20" kv="3" input="vel"',
    "affine": 'general {} gaintype="affine" gainprm="1 2 -3" biastype="affine" biasprm=".1 -4 -5"',
    "integrator": 'general {} dyntype="integrator" gainprm="3" biastype="affine" biasprm="0 -2 -1" actlimited="true" actrange="-.3 .3"',
    "filter": 'general {} dyntype="filter" dynprm=".05" gainprm="2"',
    "muscle": 'general {} gaintype="muscle" gainprm=".75 1.05 30 200 .5 1.6 1.5 1.3 1.2" biastype="muscle" lengthrange="-2 2" '
    'biasprm=".75 1.05 30 200 .5 1.6 1.5 1.3 1.2" dyntype="muscle" dynprm=".02 .06 .3"',
    "muscle without a passive force": 'general {} gaintype="muscle" gainprm=".8 1.1 20 200 .4 1.7 2 1.3 1.3" lengthrange="-1 3"',
    "exact filter": 'general {} dyntype="filterexact" dynprm=".05" gainprm="2" biastype="affine" biasprm="0 -3 -1"',
}
# The golden trajectories have the targets and kinds above alone.
ALL_TARGETS = {
    **TARGETS,
    "ball": 'joint="socket" gear="1 -2 3 0 0 0"',
    "ball in its parent": 'jointinparent="socket" gear="1 -2 3 0 0 0"',
    "free joint": f'joint="root" {GEAR}',
    "free joint in the world": f'jointinparent="root" {GEAR}',
}
ALL_KINDS = {
    **KINDS,
    "early filter": 'general {} dyntype="filter" dynprm=".05" gainprm="2" actearly="true"',
    "early exact filter": 'general {} dyntype="filterexact" dynprm=".02" gainprm="2" biastype="affine" biasprm="0 -3 -1" actearly="true"',
    "early integrator": 'general {} dyntype="integrator" gainprm="3" actlimited="true" actrange="-.3 .3" actearly="true"',
    "early muscle": 'general {} gaintype="muscle" gainprm=".75 1.05 30 200 .5 1.6 1.5 1.3 1.2" lengthrange="-2 2" dyntype="muscle" '
    'dynprm=".02 .06 .3" actearly="true"',
}


def scene(kind: str) -> str:
    """One actuator of a kind on every target, with sensors of each and of the joints."""
    names = [f"a{k}" for k in range(len(ALL_TARGETS))]
    made = [f'<{ALL_KINDS[kind].format(target)} name="{name}"/>' for name, target in zip(names, ALL_TARGETS.values(), strict=True)]
    read = "".join(f'<{s} actuator="{name}"/>' for name in names for s in ("actuatorpos", "actuatorvel", "actuatorfrc"))
    joints = "".join(f'<jointactuatorfrc joint="{j}"/>' for j in ("swing", "rail", "wrist"))
    tree = TREE.replace("<freejoint/>", '<freejoint name="root"/>')
    return tree.format(actuators="".join(made), sensors=read + joints)
