//! Description of a scene: all elements, with fields that can be edited.

use serde::{Deserialize, Serialize};
use stepper_geometry::Obstacle;
use stepper_geometry::linear_algebra::*;

use crate::asset::{HeightField, Mesh};
use crate::equality::Equality;
use crate::fluid::{Ellipsoid, Medium};
use crate::force_model::ForceModel;
use crate::muscle::Muscle;
use crate::sensor::{Sensor, Site};
use crate::shape::Shape;
use crate::softness::{ContactSpring, SoftSettings, Softness};
use crate::tendon::{Tendon, round};

/// Description of a scene before its checks: bodies in a tree, joints, shapes, actuators and sensors. Body 0 is the world.
///
/// [`ModelBuilder`](crate::ModelBuilder) is more convenient for new models in code. Descriptions are for readers of files, and for edits
/// that the builder does not support.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Description {
    /// Name of the scene; may be empty.
    pub name: String,
    /// Default time step, s.
    pub timestep: f64,
    /// Gravitational acceleration in the world frame, m/s^2.
    pub gravity: [f64; 3],
    /// Magnetic flux density in the world frame, T.
    pub magnetic: [f64; 3],
    /// Fluid that surrounds the bodies.
    pub medium: Medium,
    /// Whether the integrator `euler` treats joint damping explicitly, as MuJoCo does if the flag `eulerdamp` is disabled. Other
    /// integrators ignore this setting.
    pub explicit_damping: bool,
    /// Bodies, parents before children; body 0 is the world.
    pub bodies: Vec<Body>,
    /// Joints in the order of their bodies.
    pub joints: Vec<Joint>,
    /// Geoms (shapes for collisions and mass), in the order of their bodies.
    pub geoms: Vec<Geom>,
    /// Meshes that geoms refer to.
    pub meshes: Vec<Mesh>,
    /// Height fields that geoms refer to.
    pub height_fields: Vec<HeightField>,
    /// Explicit pairs: geoms that collide regardless of filters.
    pub pairs: Vec<Pair>,
    /// Pairs of bodies whose geoms never collide.
    pub excludes: Vec<[usize; 2]>,
    /// Pairs of geoms that overlap in the reference pose and whose collisions are disabled, see
    /// [`Model::exclude_overlaps`](crate::Model::exclude_overlaps).
    #[serde(default)]
    pub excluded_overlaps: Vec<Overlap>,
    /// Tendons: fixed ones, and spatial ones.
    pub tendons: Vec<Tendon>,
    /// Equalities: closed loops and coupled joints.
    pub equalities: Vec<Equality>,
    /// Actuators, one control each.
    pub actuators: Vec<Actuator>,
    /// Frames that are fixed to bodies, for sensors and actuators.
    pub sites: Vec<Site>,
    /// Sensors.
    pub sensors: Vec<Sensor>,
    /// Named states for resets.
    pub keyframes: Vec<Keyframe>,
    /// Configuration at reset, and reference of joint positions and tendon lengths, length nq.
    pub qpos0: Vec<f64>,
    /// Configuration in which joint springs are at rest, length nq.
    pub qpos_spring: Vec<f64>,
    /// Settings of MuJoCo's contact law for the whole scene.
    pub soft: SoftSettings,
    /// Elements of the source file that stepper does not simulate, and that are left out.
    pub omitted: Vec<Omission>,
    /// Settings of the source file that stepper's default options replace; `None` for models made in code.
    pub requested: Option<Requested>,
}

/// Overlap of two geoms in the reference pose of the model.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Overlap {
    /// Indices of the geoms in the model.
    pub geoms: [usize; 2],
    /// Largest penetration of a contact point, m: the margin of the pair minus the signed distance of the geoms.
    pub depth: f64,
}

/// Rigid body.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Body {
    /// Name of the body; may be empty.
    pub name: String,
    /// Index of the parent body; 0 for the world itself.
    pub parent: usize,
    /// Position of the body in the parent's frame, m.
    pub pos: [f64; 3],
    /// Orientation of the body in the parent's frame, a unit quaternion (w, x, y, z).
    pub quat: [f64; 4],
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the body's frame, m.
    pub ipos: [f64; 3],
    /// Orientation of the principal axes in the body's frame, a unit quaternion (w, x, y, z).
    pub iquat: [f64; 4],
    /// Principal moments of inertia, kg m^2.
    pub inertia: [f64; 3],
    /// Whether the user sets the body's pose. Such a body has no joints and is a child of the world.
    pub mocap: bool,
    /// Fraction of the body's weight that gravity compensation carries.
    pub gravcomp: f64,
}

named! {
    /// Kind of joint.
    #[derive(Default, Serialize, Deserialize)]
    pub enum JointKind {
        /// Free joint with nq 7, nv 6: position and velocity of the body's origin in the world frame, orientation, and angular velocity in
        /// the body's frame.
        Free = "free",
        /// Ball joint with nq 4, nv 3: orientation relative to the parent, and angular velocity in the body's frame.
        Ball = "ball",
        /// Slide joint with nq 1, nv 1: translation along an axis.
        Slide = "slide",
        /// Hinge joint with nq 1, nv 1: rotation about an axis.
        #[default]
        Hinge = "hinge",
    }
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

/// Joint between a body and its parent. A body may have several joints, which apply in order.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Joint {
    /// Name of the joint; may be empty.
    pub name: String,
    /// Index of the body that the joint moves.
    pub body: usize,
    /// Kind of joint.
    pub kind: JointKind,
    /// Anchor in the body's frame, m.
    pub pos: [f64; 3],
    /// Unit axis of a slide or hinge in the body's frame.
    pub axis: [f64; 3],
    /// Stiffness of a spring that pulls towards `qpos_spring`, N/m or N m/rad.
    pub stiffness: f64,
    /// Viscous damping of every degree of freedom, N s/m or N m s/rad.
    pub damping: f64,
    /// Armature (rotor inertia), which is added to the diagonal of the mass matrix, kg or kg m^2.
    pub armature: f64,
    /// Dry friction of the joint, N or N m.
    pub frictionloss: f64,
    /// Lowest and highest joint position, m or rad; `None` without limits.
    pub range: Option<[f64; 2]>,
    /// Lowest and highest sum of actuator forces on this joint, N or N m; `None` without bounds.
    pub actuator_force_range: Option<[f64; 2]>,
    /// Largest speed according to the source file, rad/s or m/s. The step does not enforce it.
    #[serde(default)]
    pub velocity_limit: Option<f64>,
    /// Softness of the joint's limit in MuJoCo's contact law.
    pub limit_softness: Softness,
    /// Softness of the joint's dry friction in MuJoCo's contact law.
    pub friction_softness: Softness,
}

/// Geom: a shape fixed to a body, for collisions, mass and fluid forces.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Geom {
    /// Name of the geom; may be empty.
    pub name: String,
    /// Index of the body to which the geom is fixed.
    pub body: usize,
    /// Shape and size of the geom.
    pub shape: Shape,
    /// Position of the geom in the body's frame, m.
    pub pos: [f64; 3],
    /// Orientation of the geom in the body's frame, a unit quaternion (w, x, y, z).
    pub quat: [f64; 4],
    /// Bit mask. Two geoms may collide if the contype of one shares a bit with the conaffinity of the other.
    pub contype: u32,
    /// Bit mask: the geom may collide with geoms whose `contype` shares a bit with it.
    pub conaffinity: u32,
    /// Dimension of contacts: 1 frictionless, 3 sliding friction, 4 also torsional, 6 also rolling. With equal priorities, a contact has
    /// the larger dimension of its two geoms.
    pub condim: u8,
    /// Priority. A contact of two geoms has the friction and condim of the geom with the higher priority.
    pub priority: i32,
    /// Sliding, torsional (m) and rolling (m) friction coefficients. With equal priorities, a contact has the larger value of its two geoms
    /// for each coefficient.
    pub friction: [f64; 3],
    /// Newton's coefficient of restitution, 0 to 1. A contact has the larger value of its two geoms. Compliant contacts have no
    /// restitution.
    pub restitution: f64,
    /// Margin: distance below which a contact pushes, m. A contact has the sum of the margins of its two geoms.
    pub margin: f64,
    /// Gap: distance beyond the margin up to which MuJoCo reports a contact that does not push, m. A contact has the sum of the gaps of its
    /// two geoms.
    pub gap: f64,
    /// Velocity of the surface in contacts, in the geom's axes: linear, m/s, and angular about its origin, rad/s.
    pub surface_velocity: [f64; 6],
    /// Coefficients of the ellipsoid fluid model; `None` uses the equivalent inertia box of the body.
    pub fluid: Option<Ellipsoid>,
    /// Softness of contacts in MuJoCo's contact law. A contact has the softness of the geom with the higher priority; with equal priorities
    /// it has a mixture of both.
    pub softness: Softness,
    /// Weight of the geom's softness in the mixture of two geoms.
    pub solmix: f64,
    /// Spring and damper of the surface, which make it compliant. A contact has the springs of its two geoms in series.
    #[serde(default)]
    pub spring: ContactSpring,
}

/// Explicit pair: two geoms that collide regardless of filters, with separate contact parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Pair {
    /// Name of the pair; may be empty.
    pub name: String,
    /// Indices of the geoms.
    pub geoms: [usize; 2],
    /// Dimension of contacts, see [`Geom::condim`].
    pub condim: u8,
    /// Sliding, torsional (m) and rolling (m) friction coefficients.
    pub friction: [f64; 3],
    /// Newton's coefficient of restitution, see [`Geom::restitution`].
    pub restitution: f64,
    /// Distance below which a contact pushes, m, see [`Geom::margin`].
    pub margin: f64,
    /// Distance beyond the margin up to which a contact is reported, m, see [`Geom::gap`].
    pub gap: f64,
    /// Softness in MuJoCo's contact law.
    pub softness: Softness,
    /// [`Softness::solref`] of the constraints for friction in a contact. Zeros select the solref of the constraint along the normal.
    pub solref_friction: [f64; 2],
    /// Ratio of the friction coefficient along the second tangent to that along the first tangent: for sliding friction, then for rolling
    /// friction. Only MuJoCo's contact law uses these ratios.
    pub anisotropy: [f64; 2],
    /// Spring and damper of the contact, which make it compliant.
    #[serde(default)]
    pub spring: ContactSpring,
}

/// Element on which an actuator acts.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Transmission {
    /// Hinge or slide, by its index.
    Joint(usize),
    /// Tendon, by its index.
    Tendon(usize),
    /// Site on which a wrench acts.
    Site {
        /// Index of the site.
        site: usize,
        /// Index of the reference site. The wrench is in the frame of the reference site, and the body of the reference site receives the
        /// reaction. With `None`, the wrench is in the frame of `site`, and the actuator's length is 0.
        reference: Option<usize>,
        /// Force and torque (N, N m) per unit of actuator force.
        wrench: [f64; 6],
    },
    /// Slider-crank: a rod connects the crank to a point that slides along the z axis of the slider's site. The length is that of the
    /// slide.
    SliderCrank {
        /// Index of the crank's site.
        crank: usize,
        /// Index of the slider's site.
        slider: usize,
        /// Length of the rod, m.
        rod: f64,
    },
    /// Contacts of a body, by its index: the force pulls the body and what touches it together (adhesion, suction). All contacts share the
    /// force equally, and the length is 0.
    Body(usize),
    /// Ball or free joint on which a wrench acts. The length is the projection of a ball's rotation vector; that of a free joint is 0.
    JointWrench {
        /// Index of the joint.
        joint: usize,
        /// Whether torques are in the axes of the parent (for a free joint, of the world) and not in those of the joint's body.
        in_parent: bool,
        /// For a ball the torque (N m, three numbers), for a free joint force (world axes, N) and torque, per unit of actuator force.
        wrench: [f64; 6],
    },
}

impl Default for Transmission {
    fn default() -> Self {
        Self::Joint(0)
    }
}

/// Activation dynamics: the differential equation between the control and the force.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub enum Activation {
    /// No activation dynamics: the control itself is the input of the actuator's gain.
    #[default]
    None,
    /// Integrator: the control is the time derivative of the activation.
    Integrator,
    /// First-order lag with this time constant (s), integrated by Euler's rule.
    Filter(f64),
    /// First-order lag with this time constant (s), integrated exactly.
    FilterExact(f64),
    /// Activation of a muscle. It rises and falls with different time constants, which depend on the activation (Millard et al. 2013).
    Muscle {
        /// Time constant of activation, s.
        rise: f64,
        /// Time constant of deactivation, s.
        fall: f64,
        /// Width of the smooth switch between the two, as a difference of control and activation; 0 for a hard switch.
        smoothing: f64,
    },
}

/// Actuator with force = (gain . (1, length, velocity)) * input + bias . (1, length, velocity), where the input is the control or
/// activation.
///
/// [`Actuator::affine_force`] returns this gain and bias. Other types of gain and bias ([`ForceModel`]) have other parameters.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Actuator {
    /// Name of the actuator; may be empty.
    pub name: String,
    /// Element on which the actuator acts.
    pub transmission: Transmission,
    /// Gear: factor of length, velocity and force.
    pub gear: f64,
    /// Delay of the control, s.
    pub delay: f64,
    /// Whether the delay is rounded up to whole time steps. Otherwise the delayed control is interpolated between the controls of two
    /// steps.
    pub delay_holds: bool,
    /// Range to which the control is clamped.
    pub ctrl_range: Option<[f64; 2]>,
    /// Range to which the force is clamped, N or N m.
    pub force_range: Option<[f64; 2]>,
    /// Range to which the activation is clamped.
    pub act_range: Option<[f64; 2]>,
    /// Activation dynamics.
    pub activation: Activation,
    /// Whether the force uses the activation at the end of the step and not at its beginning (MuJoCo's `actearly`).
    #[serde(default)]
    pub early: bool,
    /// Parameters of the gain: constant, factor of length, factor of velocity. For a DC motor they are resistance and motor constant.
    pub gain: [f64; 3],
    /// Parameters of the bias: constant, factor of length, factor of velocity.
    pub bias: [f64; 3],
    /// Types of gain and bias, which determine how the force follows from these parameters.
    #[serde(default)]
    pub force_model: ForceModel,
    /// Parameters of a muscle; unused by other types of gain and bias.
    #[serde(default)]
    pub muscle: Muscle,
}

/// Keyframe: a named state with controls.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Keyframe {
    /// Name of the keyframe; may be empty.
    pub name: String,
    /// Simulated time, s.
    pub time: f64,
    /// Configuration, length nq.
    pub qpos: Vec<f64>,
    /// Velocity, length nv.
    pub qvel: Vec<f64>,
    /// Activations, length na.
    pub act: Vec<f64>,
    /// Controls, length nu.
    pub ctrl: Vec<f64>,
}

/// Element of a source file that stepper does not simulate, and that the model leaves out.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Omission {
    /// Kind of element, such as "equality connect".
    pub kind: String,
    /// Name of the element, or its index as "#3".
    pub name: String,
    /// Reason for the omission, and its effect.
    pub reason: String,
    /// Whether the element would change the motion.
    pub changes_motion: bool,
}

/// Settings of a source file that stepper's default options replace, with the names that the file uses.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Requested {
    /// Name of the integrator: "Euler", "RK4", "implicit", "implicitfast" or "discrete". Stepper has no "discrete".
    pub integrator: String,
    /// Name of the solver: "PGS", "CG" or "Newton".
    pub solver: String,
    /// Largest number of iterations of the solver.
    pub iterations: u32,
    /// Shape of the friction cone, "pyramidal" or "elliptic"; `None` if no geoms can touch.
    pub cone: Option<String>,
    /// Whether the scene has constraints. They are soft in MuJoCo.
    pub constrained: bool,
    /// Elements whose softness differs from the default, for example "2 geoms: foot, floor".
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

    /// Index of the first reading of every sensor.
    pub fn sensor_addresses(&self) -> Vec<usize> {
        let dims = self.sensors.iter().map(|s| s.dim(&self.sensors));
        dims.scan(0, |next, dim| Some(std::mem::replace(next, *next + dim))).collect()
    }

    /// Index of the first coordinate in q and of the first degree of freedom in v, for every joint.
    pub fn joint_addresses(&self) -> Vec<(usize, usize)> {
        let dims = self.joints.iter().map(|j| (j.kind.nq(), j.kind.nv()));
        dims.scan((0, 0), |next, (nq, nv)| Some(std::mem::replace(next, (next.0 + nq, next.1 + nv)))).collect()
    }

    /// Label of geom `i`, such as "floor"; "#3 of body torso" for a geom without a name, "#3" for an index out of range.
    pub fn geom_label_with_body(&self, i: usize) -> String {
        match self.geoms.get(i) {
            Some(geom) if geom.name.is_empty() => format!("#{i} of body {}", self.body_label(geom.body)),
            _ => self.geom_label(i),
        }
    }
    /// Index of the mesh to which the shape refers. It is `None` for shapes that are no mesh, and if the description has no mesh of that
    /// name.
    pub(super) fn mesh_index(&self, shape: &Shape) -> Option<usize> {
        match shape {
            Shape::Mesh { asset, .. } => self.meshes.iter().position(|m| m.name == *asset),
            _ => None,
        }
    }

    /// Mesh to which the shape refers. It is `None` for shapes that are no mesh, and if the description has no mesh of that name.
    pub fn mesh_of(&self, shape: &Shape) -> Option<&Mesh> {
        Some(&self.meshes[self.mesh_index(shape)?])
    }

    /// Height field to which the shape refers. It is `None` for shapes that are no height field, and if the description has no height field
    /// of that name.
    pub fn height_field_of(&self, shape: &Shape) -> Option<&HeightField> {
        match shape {
            Shape::HeightField { asset } => self.height_fields.iter().find(|h| h.name == *asset),
            _ => None,
        }
    }
}

/// Label of an element: its name, or its index such as "#3" if it has none.
pub fn label(name: &str, index: usize) -> String {
    if name.is_empty() { format!("#{index}") } else { name.to_owned() }
}

impl Geom {
    /// Semi-axes of the ellipsoid that approximates the shape in the fluid model, m; `None` for planes, meshes and height fields.
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

impl Tendon {
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
