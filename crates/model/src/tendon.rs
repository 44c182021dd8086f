//! Tendons: linear combinations of joint positions (fixed tendons), and paths through sites and around geoms (spatial tendons).

use serde::{Deserialize, Serialize};
use stepper_geometry::Obstacle;
use stepper_geometry::linear_algebra::*;

use crate::added_fields;
use crate::softness::Softness;
use crate::{Description, Shape};

/// Tendon. Its length is the sum of a linear combination of the positions of hinges and slides, and of the length of a path. A fixed tendon
/// has no path, and a spatial tendon no joints. The length has the unit u, m or rad; that of a path is in m.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Tendon {
    /// Name of the tendon; may be empty.
    pub name: String,
    /// Terms of the length: index of the joint, and coefficient.
    pub joints: Vec<(usize, f64)>,
    /// Path of a spatial tendon; empty for a fixed tendon.
    #[serde(default, with = "added_fields")]
    pub path: Vec<PathElement>,
    /// Lowest and highest tendon length, in the unit u (m or rad); `None` without limits.
    pub range: Option<[f64; 2]>,
    /// Stiffness of the tendon's spring, N/u, where u is the unit of the length (m or rad).
    pub stiffness: f64,
    /// Lowest and highest tendon length at which the spring is slack, in the unit u (m or rad).
    pub spring_length: [f64; 2],
    /// Viscous damping of the tendon, N s/u, where u is the unit of the length (m or rad).
    pub damping: f64,
    /// Inertia that resists changes of the tendon length, N s^2/u, where u is the unit of the length (m or rad).
    pub armature: f64,
    /// Dry friction of the tendon, N.
    pub frictionloss: f64,
    /// Softness of the tendon's limit in MuJoCo's contact law.
    pub limit_softness: Softness,
    /// Softness of the tendon's dry friction in MuJoCo's contact law.
    pub friction_softness: Softness,
}

/// Element of the path of a spatial tendon.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum PathElement {
    /// Site through which the tendon passes, by its index.
    Site(usize),
    /// Sphere or cylinder around which the tendon wraps between the sites before and after it. A cylinder has no ends here.
    Wrap {
        /// Index of the geom.
        geom: usize,
        /// Index of the side site, near which the tendon passes. A tendon whose side site is inside the geom passes through the geom, and
        /// touches it from the inside. `None` selects the shorter way.
        side: Option<usize>,
    },
    /// Pulley with this divisor. It ends one branch of the path. The length of the next branch counts divided by the divisor.
    Pulley(f64),
}

/// Part of a path between two sites.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathSegment {
    /// Indices of the sites.
    pub sites: [usize; 2],
    /// Geom around which the tendon wraps between them, and side site, by their indices.
    pub wrap: Option<(usize, Option<usize>)>,
    /// Divisor of the length.
    pub divisor: f64,
}

impl Tendon {
    /// Parts of the path between two sites each, in the order of the path.
    pub fn segments(&self) -> Vec<PathSegment> {
        let (mut segments, mut divisor, mut last, mut wrap) = (vec![], 1.0, None, None);
        for &element in &self.path {
            match element {
                PathElement::Pulley(by) => (divisor, last, wrap) = (by, None, None),
                PathElement::Wrap { geom, side } => wrap = Some((geom, side)),
                PathElement::Site(site) => {
                    segments.extend(last.map(|from| PathSegment { sites: [from, site], wrap, divisor }));
                    (last, wrap) = (Some(site), None);
                }
            }
        }
        segments
    }

    /// Length of the tendon in the reference configuration, with the joint positions `qpos0` and all bodies at their poses in the parent.
    pub fn reference_length(&self, model: &Description) -> f64 {
        let addresses = model.joint_addresses();
        let joints: f64 = self.joints.iter().map(|&(j, c)| c * model.qpos0[addresses[j].0]).sum();
        let pose = |body: usize, pos: [f64; 3], quat: [f64; 4]| {
            let (mut pos, mut quat, mut body) = (pos, quat, body);
            while body != 0 {
                let at = &model.bodies[body];
                (pos, quat) = (add(at.pos, rotate(&quat_to_mat(at.quat), pos)), quat_mul(at.quat, quat));
                body = at.parent;
            }
            (pos, quat_to_mat(quat))
        };
        let site = |s: usize| pose(model.sites[s].body, model.sites[s].pos, model.sites[s].quat).0;
        let path = self.segments().into_iter().map(|segment| {
            let ends = segment.sites.map(site);
            let straight = norm(sub(ends[1], ends[0]));
            let length = segment.wrap.map_or(straight, |(g, side)| {
                let geom = &model.geoms[g];
                let (pos, mat) = pose(geom.body, geom.pos, geom.quat);
                let Some((radius, is_cylinder)) = round(&geom.shape) else { return straight };
                let wrap = Obstacle { pos, mat, radius, is_cylinder }.wrap(ends, side.map(site));
                let around = norm(sub(wrap.points[0], ends[0])) + wrap.arc + norm(sub(ends[1], wrap.points[1]));
                if wrap.touches { around } else { straight }
            });
            length / segment.divisor
        });
        joints + path.sum::<f64>()
    }
}

/// Radius of a sphere or cylinder, and whether it is a cylinder; `None` for other shapes, around which no tendon wraps.
pub fn round(shape: &Shape) -> Option<(f64, bool)> {
    match *shape {
        Shape::Sphere { radius } => Some((radius, false)),
        Shape::Cylinder { radius, .. } => Some((radius, true)),
        _ => None,
    }
}
