//! Builder of a body, with its joints and geoms.

use crate::builder::{GeomBuilder, JointBuilder, WORLD};
use crate::orientation::Orientation;
use crate::{Body, Description, Geom, Joint, MassProperties};

/// Builder of a body, with its joints and geoms.
#[derive(Clone, Debug)]
pub struct BodyBuilder {
    pub(super) body: Body,
    inertial: bool,
    joints: Vec<JointBuilder>,
    pub(super) geoms: Vec<GeomBuilder>,
}

impl BodyBuilder {
    /// Creates a builder of a body at the origin of its parent's frame. A body without joints is fixed to its parent.
    pub fn new(name: &str) -> Self {
        let unit = [1.0, 0.0, 0.0, 0.0];
        let body = Body { name: name.into(), quat: unit, iquat: unit, ..Body::default() };
        Self { body, inertial: false, joints: vec![], geoms: vec![] }
    }

    /// Creates a builder of a body with a free joint of the same name. The body must be a child of the world.
    pub fn free(name: &str) -> Self {
        Self::new(name).joint(JointBuilder::free(name))
    }

    /// Sets the pose in the parent's frame.
    #[cfg(feature = "nalgebra")]
    pub fn pose(self, pose: nalgebra::Isometry3<f64>) -> Self {
        self.pos(pose.translation.vector).quat(pose.rotation)
    }

    /// Adds a joint. If a body has several joints, they apply in the order in which they were added.
    pub fn joint(mut self, joint: JointBuilder) -> Self {
        self.joints.push(joint);
        self
    }

    /// Adds a geom.
    pub fn geom(mut self, geom: GeomBuilder) -> Self {
        self.geoms.push(geom);
        self
    }

    pub(super) fn add_to(&self, model: &mut Description, index: usize) {
        let mut body = self.body.clone();
        if !self.inertial && index != WORLD {
            let total = self.geoms.iter().map(|g| g.mass_properties(model)).fold(MassProperties::default(), |sum, g| sum.plus(&g));
            let (axes, moments) = total.principal();
            (body.mass, body.ipos, body.inertia) = (total.mass, total.com.into(), moments.into());
            body.iquat = [axes.w, axes.i, axes.j, axes.k];
        }
        for joint in &self.joints {
            let (q0, rest) = joint.reference(&body);
            model.qpos0.extend(q0);
            model.qpos_spring.extend(rest);
            model.joints.push(Joint { body: index, ..joint.joint.clone() });
        }
        model.geoms.extend(self.geoms.iter().map(|g| Geom { body: index, ..g.geom.clone() }));
        model.bodies.push(body);
    }
}

setters! { BodyBuilder
    /// Sets the position in the parent's frame, m.
    pos(pos: impl Into<[f64; 3]>) { body.pos = pos.into() }
    /// Sets the orientation in the parent's frame: quaternion [w, x, y, z], or nalgebra's `UnitQuaternion` with the feature `nalgebra`.
    quat(quat: impl Into<Orientation>) { body.quat = quat.into().0 }
    /// Sets mass (kg), centre of mass (m) and principal moments of inertia (kg m^2). These replace the values from the geoms. The principal
    /// axes are the body's axes, unless [`BodyBuilder::inertial_quat`] sets others.
    inertial(mass: f64, com: impl Into<[f64; 3]>, moments: impl Into<[f64; 3]>) {
        body.mass = mass; body.ipos = com.into(); body.inertia = moments.into(); inertial = true
    }
    /// Sets the orientation of the principal axes for [`BodyBuilder::inertial`]: quaternion [w, x, y, z], or nalgebra's `UnitQuaternion`
    /// with the feature `nalgebra`.
    inertial_quat(quat: impl Into<Orientation>) { body.iquat = quat.into().0 }
    /// Compensates the fraction `share` of the body's weight (`gravcomp`). A share of 1 compensates the whole weight.
    gravcomp(share: f64) { body.gravcomp = share }
    /// Makes the body a mocap body, whose pose the user sets. The body must be a child of the world and have no joints.
    mocap() { body.mocap = true }
}
