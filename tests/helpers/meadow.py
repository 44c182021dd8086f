"""A scene with shapes, joints, actuators and sensors of many kinds, and parameters that its environments may have of their own."""

import numpy as np

MEADOW = """
<mujoco model="meadow">
  <option timestep="0.004" density="1.2" viscosity="1e-3"/>
  <default><geom condim="4" friction="0.8 0.01 0.001"/></default>
  <worldbody>
    <geom name="floor" type="plane" size="5 5 1"/>
    <geom name="step" type="box" size="0.3 0.3 0.05" pos="0.5 0 0.05"/>
    <body name="ball" pos="0 0 0.3"><freejoint/><geom name="ball" size="0.1"/><site name="ball"/></body>
    <body name="box" pos="0.5 0 0.4" euler="20 10 0"><freejoint/>
      <geom name="box" type="box" size="0.1 0.15 0.08" condim="6"/></body>
    <body name="box_on_box" pos="0.5 0.05 0.7"><freejoint/><geom type="box" size="0.08 0.08 0.08" condim="1"/></body>
    <body name="pill" pos="0.3 -0.4 0.4" euler="0 70 0"><freejoint/><geom name="pill" type="capsule" size="0.06 0.1"/></body>
    <body name="tin" pos="-0.4 0.4 0.4" euler="30 0 0"><freejoint/><geom type="cylinder" size="0.08 0.1"/></body>
    <body name="egg" pos="-0.4 -0.4 0.4"><freejoint/><geom type="ellipsoid" size="0.08 0.1 0.12"/></body>
    <body name="arm" pos="-1 0 0.8">
      <joint name="shoulder" axis="0 1 0" range="-60 60" stiffness="3" damping="0.2" armature="0.01" frictionloss="0.1"/>
      <geom type="capsule" fromto="0 0 0 0.4 0 0" size="0.04"/>
      <body name="forearm" pos="0.4 0 0" gravcomp="0.5">
        <joint name="elbow" axis="0 1 0" range="-120 120" damping="0.1" armature="0.02" frictionloss="0.05" stiffness="-0.1"/>
        <geom name="forearm" type="capsule" fromto="0 0 0 0.3 0 0" size="0.03"/>
        <body pos="0.3 0 0"><geom name="fist" type="box" size="0.04 0.05 0.06" density="2000"/><site name="hand" size="0.1"/></body>
      </body>
    </body>
    <body name="bob" pos="1.5 0 1">
      <joint name="socket" type="ball" range="0 40" damping="0.02" stiffness="1" armature="0.001"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.4" size="0.03"/>
    </body>
  </worldbody>
  <actuator>
    <position name="servo" joint="shoulder" kp="30" kv="1" ctrlrange="-1 1" forcerange="-6 6"/>
    <motor name="motor" joint="elbow" gear="2" ctrlrange="-1 1"/>
  </actuator>
  <sensor>
    <subtreecom body="arm"/><subtreelinvel body="arm"/><subtreeangmom body="arm"/>
    <framepos objtype="body" objname="forearm"/><framelinacc objtype="geom" objname="fist"/>
    <force site="hand"/><torque site="hand"/><accelerometer site="ball"/><jointlimitpos joint="elbow"/><jointlimitvel joint="shoulder"/>
    <jointlimitfrc joint="shoulder"/><actuatorfrc actuator="servo"/><e_potential/><e_kinetic/>
    <distance geom1="ball" geom2="pill" cutoff="9"/><rangefinder site="hand"/><touch site="hand"/>
  </sensor>
</mujoco>
"""


def scaled(values, n, rng, low, high):
    """Every number of every environment times one of its own."""
    return values * rng.uniform(low, high, (n, *values.shape))


def affine(values, n, rng):
    """Constant, length and velocity term of every actuator, each times a factor; the other numbers are 0."""
    terms = scaled(values[:, :3], n, rng, 0.5, 2.0)
    return np.concatenate([terms, np.zeros((n, len(values), values.shape[1] - 3))], axis=2)


def per_joint(model, values, n, rng):
    """The same factor for the degrees of freedom of a joint, which the model keeps as one number."""
    first = np.r_[True, values[1:] != values[:-1]] if len(values) else np.zeros(0, bool)
    factors = rng.uniform(0.5, 2.0, (n, len(values)))
    return values * factors[:, np.maximum.accumulate(np.where(first, np.arange(len(values)), 0))]


FIELDS = {
    "gravity": lambda m, n, r: m.gravity + r.uniform(-3, 3, (n, 3)),
    "body_mass": lambda m, n, r: scaled(m.body_mass, n, r, 0.5, 2.0),
    "body_ipos": lambda m, n, r: m.body_ipos + r.uniform(-0.02, 0.02, (n, *m.body_ipos.shape)),
    # Up to 1.15 times apart, so that no principal moments break the triangle inequality.
    "body_inertia": lambda m, n, r: m.body_inertia.mean(axis=1, keepdims=True) * r.uniform(1.0, 1.15, (n, *m.body_inertia.shape)),
    "geom_friction": lambda m, n, r: scaled(m.geom_friction, n, r, 0.2, 2.0),
    "geom_restitution": lambda m, n, r: r.uniform(0, 0.9, (n, m.ngeom)),
    "geom_size": lambda m, n, r: scaled(m.geom_size, n, r, 0.8, 1.2),
    "geom_pos": lambda m, n, r: m.geom_pos + r.uniform(-0.02, 0.02, (n, *m.geom_pos.shape)),
    "jnt_stiffness": lambda m, n, r: scaled(m.jnt_stiffness, n, r, 0.0, 2.0),
    "jnt_range": lambda m, n, r: np.where(np.isfinite(m.jnt_range), scaled(m.jnt_range, n, r, 0.6, 1.0), m.jnt_range),
    "dof_damping": lambda m, n, r: per_joint(m, m.dof_damping, n, r),
    "dof_armature": lambda m, n, r: per_joint(m, m.dof_armature, n, r),
    "dof_frictionloss": lambda m, n, r: per_joint(m, m.dof_frictionloss, n, r),
    "actuator_gainprm": lambda m, n, r: affine(m.actuator_gainprm, n, r),
    "actuator_biasprm": lambda m, n, r: affine(m.actuator_biasprm, n, r),
}
