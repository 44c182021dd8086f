//! The description of a scene: every field may be edited.

use serde::{Deserialize, Serialize};

use crate::added_fields;
use crate::asset::{HeightField, Mesh};
use crate::equality::Equality;
use crate::fluid::{Ellipsoid, Medium};
use crate::force_model::ForceModel;
use crate::sensor::{Sensor, Site};
use crate::shape::Shape;
use crate::softness::{ContactSpring, SoftSettings, Softness};
use crate::tendon::Tendon;

/// A scene before it is checked: bodies in a tree, their joints, shapes, actuators and sensors. Body 0 is the world.
///
/// [`ModelBuilder`](crate::ModelBuilder) is the convenient way to a model. A description is for readers of files, and for edits that
/// the builder does not know.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// Name of the scene; may be empty.
    pub name: String,
    /// Default time step, s.
    pub timestep: f64,
    /// Gravitational acceleration in the world frame, m/s^2.
    pub gravity: [f64; 3],
    /// Magnetic field in the world frame, T.
    pub magnetic: [f64; 3],
    /// What fills the space between the bodies.
    pub medium: Medium,
    /// Whether the integrator `euler` takes the joints' damping explicitly; the others never do.
    pub explicit_damping: bool,
    /// Bodies, parents before children; body 0 is the world.
    pub bodies: Vec<Body>,
    /// Joints in the order of their bodies.
    pub joints: Vec<Joint>,
    /// Collision and mass shapes, in the order of their bodies.
    pub geoms: Vec<Geom>,
    /// Meshes that geoms refer to.
    pub meshes: Vec<Mesh>,
    /// Height fields that geoms refer to.
    pub height_fields: Vec<HeightField>,
    /// Geom pairs that collide whatever their filters say.
    pub pairs: Vec<Pair>,
    /// Pairs of bodies whose geoms never collide.
    pub excludes: Vec<[usize; 2]>,
    /// Overlaps whose geoms and bodies never collide: see [`Model::exclude_overlaps`](crate::Model::exclude_overlaps).
    #[serde(default, with = "added_fields")]
    pub excluded_overlaps: Vec<Overlap>,
    /// Fixed tendons: linear combinations of joint positions.
    pub tendons: Vec<Tendon>,
    /// Equalities: closed loops and coupled joints.
    pub equalities: Vec<Equality>,
    /// Actuators, one control each.
    pub actuators: Vec<Actuator>,
    /// Places on bodies that sensors refer to.
    pub sites: Vec<Site>,
    /// Sensors that are simulated.
    pub sensors: Vec<Sensor>,
    /// Named states to reset to.
    pub keyframes: Vec<Keyframe>,
    /// Configuration at reset and reference of the joint angles, length nq.
    pub qpos0: Vec<f64>,
    /// Configuration in which joint springs are at rest, length nq.
    pub qpos_spring: Vec<f64>,
    /// What MuJoCo's contact law needs besides the softness of single elements.
    pub soft: SoftSettings,
    /// What the source described and this model leaves out.
    pub omitted: Vec<Omission>,
    /// What the source asks of a simulator that stepper does in its own way; nothing where the model was made in code.
    pub requested: Option<Requested>,
}

/// Two geoms that overlap at the reference pose.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Overlap {
    /// Indices of the geoms in the model.
    pub geoms: [usize; 2],
    /// Depth of the deepest point beyond the pair's margin, m.
    pub depth: f64,
}

/// A rigid body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Body {
    /// Name; may be empty.
    pub name: String,
    /// Index of the parent; the world's is 0.
    pub parent: usize,
    /// Position in the parent's frame, m.
    pub pos: [f64; 3],
    /// Orientation in the parent's frame.
    pub quat: [f64; 4],
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the body's frame, m.
    pub ipos: [f64; 3],
    /// Orientation of the principal axes in the body's frame.
    pub iquat: [f64; 4],
    /// Principal moments of inertia, kg m^2.
    pub inertia: [f64; 3],
    /// Posed by the user (a child of the world without joints).
    pub mocap: bool,
    /// Share of its weight that a force at its centre of mass holds up.
    pub gravcomp: f64,
}

/// How a joint moves.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum JointKind {
    /// Six degrees of freedom: position and velocity of the body's origin in the world frame, orientation, and angular velocity in the
    /// body's frame. nq 7, nv 6.
    Free,
    /// Three rotations: orientation relative to the parent, angular velocity in the body's frame. nq 4, nv 3.
    Ball,
    /// Translation along an axis. nq 1, nv 1.
    Slide,
    /// Rotation about an axis. nq 1, nv 1.
    Hinge,
}

impl JointKind {
    /// Number of configuration coordinates.
    #[inline]
    pub const fn nq(self) -> usize {
        match self {
            Self::Free => 7,
            Self::Ball => 4,
            Self::Slide | Self::Hinge => 1,
        }
    }

    /// Number of degrees of freedom.
    #[inline]
    pub const fn nv(self) -> usize {
        match self {
            Self::Free => 6,
            Self::Ball => 3,
            Self::Slide | Self::Hinge => 1,
        }
    }
}

/// A joint between a body and its parent. A body may have several, applied in order.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Joint {
    /// Name; may be empty.
    pub name: String,
    /// The body that it moves.
    pub body: usize,
    /// How it moves.
    pub kind: JointKind,
    /// Anchor in the body's frame, m.
    pub pos: [f64; 3],
    /// Unit axis of a slide or hinge in the body's frame.
    pub axis: [f64; 3],
    /// Spring stiffness towards `qpos_spring`, N/m or N m/rad.
    pub stiffness: f64,
    /// Viscous damping of every degree of freedom, N s/m or N m s/rad.
    pub damping: f64,
    /// Rotor inertia added to the diagonal of the mass matrix, kg or kg m^2.
    pub armature: f64,
    /// Dry friction, N or N m.
    pub frictionloss: f64,
    /// Lowest and highest position, m or rad.
    pub range: Option<[f64; 2]>,
    /// Bounds of the sum of actuator forces on this joint, N or N m.
    pub actuator_force_range: Option<[f64; 2]>,
    /// Highest speed that the source allows, rad/s or m/s. The step does not enforce it.
    #[serde(default, with = "added_fields")]
    pub velocity_limit: Option<f64>,
    /// Softness of the limit by MuJoCo's law.
    pub limit_softness: Softness,
    /// Softness of dry friction by MuJoCo's law.
    pub friction_softness: Softness,
}

/// A shape fixed to a body.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Geom {
    /// Name; may be empty.
    pub name: String,
    /// The body that it is fixed to.
    pub body: usize,
    /// Shape and size.
    pub shape: Shape,
    /// Position in the body's frame, m.
    pub pos: [f64; 3],
    /// Orientation in the body's frame.
    pub quat: [f64; 4],
    /// Bit mask: two geoms may collide if one's contype meets the other's conaffinity.
    pub contype: u32,
    /// Bit mask, see `contype`.
    pub conaffinity: u32,
    /// Rows of a contact: 1 frictionless, 3 sliding friction, 4 and torsional, 6 and rolling. A pair takes the larger.
    pub condim: u8,
    /// The pair takes the friction and condim of the geom with the higher priority.
    pub priority: i32,
    /// Sliding (1), torsional (m), rolling (m). A pair takes the larger of each.
    pub friction: [f64; 3],
    /// Newton's coefficient of restitution, 0 to 1. A pair takes the larger; one whose contacts are springs has none.
    pub restitution: f64,
    /// Distance at which a contact begins to push, m. A pair takes the sum.
    pub margin: f64,
    /// Distance beyond the margin within which MuJoCo reports a contact that does not push, m. A pair takes the sum.
    pub gap: f64,
    /// Velocity of its surface as contacts see it (linear, m/s; angular about its origin, rad/s), in its own axes.
    pub surface_velocity: [f64; 6],
    /// How the medium acts on it, if not on the body's box.
    pub fluid: Option<Ellipsoid>,
    /// Softness of its contacts by MuJoCo's law. A pair takes that of the geom with the higher priority, or mixes both.
    pub softness: Softness,
    /// Weight of its softness when a pair mixes two.
    pub solmix: f64,
    /// Physical softness of its surface. A pair has both springs in series.
    #[serde(default)]
    pub spring: ContactSpring,
}

/// A pair of geoms that collides whatever the filters say, with its own parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    /// Name; may be empty.
    pub name: String,
    /// The geoms.
    pub geoms: [usize; 2],
    /// As in [`Geom`].
    pub condim: u8,
    /// As in [`Geom`].
    pub friction: [f64; 3],
    /// As in [`Geom`].
    pub restitution: f64,
    /// As in [`Geom`].
    pub margin: f64,
    /// As in [`Geom`].
    pub gap: f64,
    /// Softness by MuJoCo's law.
    pub softness: Softness,
    /// The same as [`Softness::solref`] for the rows of friction; zeros where they have that of the normal.
    pub solref_friction: [f64; 2],
    /// Ratio of sliding friction along the second tangent to that along the first, and the same of rolling friction; MuJoCo's law alone
    /// knows of them.
    pub anisotropy: [f64; 2],
    /// Physical softness of the contact.
    #[serde(default)]
    pub spring: ContactSpring,
}

/// What an actuator pulls on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Transmission {
    /// A hinge or slide.
    Joint(usize),
    /// A fixed tendon.
    Tendon(usize),
    /// A site, with a wrench.
    Site {
        /// The site.
        site: usize,
        /// The site in whose frame the wrench is given and against which it acts; without one it is the site's own frame, and the length is
        /// 0.
        reference: Option<usize>,
        /// Force and torque (N, N m) per unit of the actuator's force.
        wrench: [f64; 6],
    },
}

/// Dynamics between the control and the force.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Activation {
    /// The control acts at once.
    None,
    /// The control is the rate of the activation.
    Integrator,
    /// First-order lag with this time constant (s), integrated by Euler's rule.
    Filter(f64),
    /// First-order lag with this time constant (s), integrated exactly.
    FilterExact(f64),
}

/// An actuator: force = (gain . (1, length, velocity)) * input + bias . (1, length, velocity), input = control or activation.
///
/// [`Actuator::affine_force`] gives this gain and bias; other types of gain and bias ([`ForceModel`]) have other parameters.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Actuator {
    /// Name; may be empty.
    pub name: String,
    /// What it pulls on.
    pub transmission: Transmission,
    /// Scale of length, velocity and force.
    pub gear: f64,
    /// s by which the control acts later.
    pub delay: f64,
    /// Whether between two controls the older one acts, and not what lies between them.
    pub delay_holds: bool,
    /// Control is clamped to it.
    pub ctrl_range: Option<[f64; 2]>,
    /// Force is clamped to it, N or N m.
    pub force_range: Option<[f64; 2]>,
    /// Activation is clamped to it.
    pub act_range: Option<[f64; 2]>,
    /// Dynamics of the activation.
    pub activation: Activation,
    /// Parameters of the gain: constant, per length, per velocity; of a DC motor resistance and motor constant.
    pub gain: [f64; 3],
    /// Parameters of the bias: constant, per length, per velocity.
    pub bias: [f64; 3],
    /// Formula by which the force follows from these parameters.
    #[serde(default, with = "added_fields")]
    pub force_model: ForceModel,
}

/// A named state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Keyframe {
    /// Name; may be empty.
    pub name: String,
    /// s
    pub time: f64,
    /// Length nq.
    pub qpos: Vec<f64>,
    /// Length nv.
    pub qvel: Vec<f64>,
    /// Length na.
    pub act: Vec<f64>,
    /// Length nu.
    pub ctrl: Vec<f64>,
}

/// Something in the source that this model does without.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Omission {
    /// What kind of element, e.g. "equality connect".
    pub kind: String,
    /// Its name, or its index as "#3".
    pub name: String,
    /// Why it is left out and what that means.
    pub reason: String,
    /// Whether the motion would be different with it.
    pub changes_motion: bool,
}

/// What a source asks of a simulator, where stepper has a way of its own, in the source's words.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Requested {
    /// Integrator: "Euler", "RK4", "implicit", "implicitfast" or "discrete".
    pub integrator: String,
    /// Solver: "PGS", "CG" or "Newton".
    pub solver: String,
    /// Iterations of that solver at the most.
    pub iterations: u32,
    /// Shape of the friction cone, "pyramidal" or "elliptic"; nothing where nothing can touch.
    pub cone: Option<String>,
    /// Whether it has constraints, which are soft there.
    pub constrained: bool,
    /// What has a softness of its own, other than the source's default: "2 geoms: foot, floor".
    pub soft: Vec<String>,
}

impl Description {
    /// Number of configuration coordinates.
    pub fn nq(&self) -> usize {
        self.joints.iter().map(|j| j.kind.nq()).sum()
    }

    /// Number of degrees of freedom.
    pub fn nv(&self) -> usize {
        self.joints.iter().map(|j| j.kind.nv()).sum()
    }

    /// Number of controls.
    pub fn nu(&self) -> usize {
        self.actuators.len()
    }

    /// Number of actuator activations.
    pub fn na(&self) -> usize {
        self.actuators.iter().filter(|a| a.activation != Activation::None).count()
    }

    /// Number of scalar sensor readings.
    pub fn nsensordata(&self) -> usize {
        self.sensors.iter().map(|s| s.dim(&self.sensors)).sum()
    }

    /// Address of every sensor's first reading.
    pub fn sensor_addresses(&self) -> Vec<usize> {
        let dims = self.sensors.iter().map(|s| s.dim(&self.sensors));
        dims.scan(0, |next, dim| Some(std::mem::replace(next, *next + dim))).collect()
    }

    /// Address of every joint's first coordinate in q and first degree of freedom in v.
    pub fn joint_addresses(&self) -> Vec<(usize, usize)> {
        let (mut q, mut v) = (0, 0);
        self.joints
            .iter()
            .map(|j| {
                let here = (q, v);
                q += j.kind.nq();
                v += j.kind.nv();
                here
            })
            .collect()
    }

    /// "torso", or "#3" when the body has no name, or the model has no such body.
    pub fn body_label(&self, i: usize) -> String {
        self.bodies.get(i).map_or_else(|| label("", i), |x| label(&x.name, i))
    }

    /// "ankle", or "#3" when the joint has no name, or the model has no such joint.
    pub fn joint_label(&self, i: usize) -> String {
        self.joints.get(i).map_or_else(|| label("", i), |x| label(&x.name, i))
    }

    /// "imu", or "#3" when the sensor has no name, or the model has no such sensor.
    pub fn sensor_label(&self, i: usize) -> String {
        self.sensors.get(i).map_or_else(|| label("", i), |x| label(&x.name, i))
    }

    /// "floor", or "#3" when the geom has no name, or the model has no such geom.
    pub fn geom_label(&self, i: usize) -> String {
        self.geoms.get(i).map_or_else(|| label("", i), |x| label(&x.name, i))
    }

    /// "floor", "#3 of body torso" when the geom has no name, or "#3" when the model has no such geom.
    pub fn geom_label_with_body(&self, i: usize) -> String {
        match self.geoms.get(i) {
            Some(geom) if geom.name.is_empty() => format!("#{i} of body {}", self.body_label(geom.body)),
            _ => self.geom_label(i),
        }
    }
}

/// Name of an element, or its index if it has none.
pub fn label(name: &str, index: usize) -> String {
    if name.is_empty() { format!("#{index}") } else { name.to_owned() }
}

impl Geom {
    /// Semi-axes of the ellipsoid that stands for a shape, m, if it has a finite size of its own.
    pub fn semi_axes(&self) -> Option<[f64; 3]> {
        match self.shape {
            Shape::Sphere { radius } => Some([radius; 3]),
            Shape::Capsule { radius, half_length } => Some([radius, radius, half_length + radius]),
            Shape::Cylinder { radius, half_length } => Some([radius, radius, half_length]),
            Shape::Ellipsoid { radii } => Some(radii),
            Shape::Box { half } => Some(half),
            Shape::Plane | Shape::Mesh { .. } | Shape::HeightField { .. } => None,
        }
    }
}

impl Description {
    /// The mesh that a geom's shape refers to.
    pub fn mesh_of(&self, shape: &Shape) -> Option<&Mesh> {
        Some(&self.meshes[self.mesh_index(shape)?])
    }

    /// The height field that a geom's shape refers to.
    pub fn height_field_of(&self, shape: &Shape) -> Option<&HeightField> {
        match shape {
            Shape::HeightField { asset } => self.height_fields.iter().find(|h| h.name == *asset),
            _ => None,
        }
    }
}

impl Tendon {
    /// Length at a configuration of the model.
    pub fn length(&self, model: &Description, qpos: &[f64]) -> f64 {
        let addresses = model.joint_addresses();
        self.joints.iter().map(|&(j, c)| c * qpos[addresses[j].0]).sum()
    }
}
