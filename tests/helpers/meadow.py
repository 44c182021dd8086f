"""A scene with shapes, joints, actuators and sensors of many kinds, and parameters that its environments may have of their own."""

import numpy as np
from models import mjcf

MEADOW = mjcf("meadow")


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
