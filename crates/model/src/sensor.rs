//! Sensors with MuJoCo's types.

use serde::{Deserialize, Serialize};

use crate::Shape;

/// Frame on a body for sensors, with a volume for sensors that have a zone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Site {
    /// Name; may be empty.
    pub name: String,
    /// Index of its body.
    pub body: usize,
    /// Position in the body's frame, m.
    pub pos: [f64; 3],
    /// Orientation in the body's frame.
    pub quat: [f64; 4],
    /// Volume: a sphere, capsule, ellipsoid, cylinder or box.
    pub shape: Shape,
}

/// Object with a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Object {
    /// Centre of mass and principal axes of a body.
    Body(usize),
    /// Frame of a body.
    XBody(usize),
    /// Frame of a geom.
    Geom(usize),
    /// Frame of a site.
    Site(usize),
}

/// Quantity of a frame sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum FrameReading {
    /// Position, m.
    Pos,
    /// Orientation.
    Quat,
    /// The frame's x axis.
    XAxis,
    /// The frame's y axis.
    YAxis,
    /// The frame's z axis.
    ZAxis,
    /// Linear velocity, m/s.
    LinVel,
    /// Angular velocity, rad/s.
    AngVel,
    /// Linear acceleration minus gravity, m/s^2. A frame at rest reads 9.81 upwards.
    LinAcc,
    /// Angular acceleration, rad/s^2.
    AngAcc,
}

/// Quantity of the closest points of two geoms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ProximityReading {
    /// Signed distance, m.
    Distance,
    /// Unit vector from the closest point of the first geom to that of the second. It is reversed if they overlap, and zero beyond the
    /// cutoff.
    Normal,
    /// Closest points of both geoms, m; zero beyond the cutoff.
    FromTo,
}

/// Quantities of each ray of a range finder, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum RayField {
    /// Distance to the nearest surface, m; -1 without a hit.
    Distance,
    /// Unit direction of the ray in the world; zero without a hit.
    Direction,
    /// Origin of the ray, m.
    Origin,
    /// Hit point, m; zero without a hit.
    Point,
}

impl RayField {
    /// Number of values.
    pub const fn dim(self) -> usize {
        if matches!(self, Self::Distance) { 1 } else { 3 }
    }
}

/// One side of the contacts that a contact sensor selects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ContactSide {
    /// All geoms.
    Any,
    /// Index of a geom.
    Geom(usize),
    /// Geoms of a body.
    Body(usize),
    /// Geoms of a body and of its descendants.
    Subtree(usize),
    /// Geoms whose contacts are within a site's volume.
    Site(usize),
}

/// Quantities of each contact of a contact sensor, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum ContactField {
    /// Number of matching contacts; 0 in empty slots.
    Found,
    /// Force in the contact's frame (normal, first and second tangent), N.
    Force,
    /// Torque in the contact's frame, N m.
    Torque,
    /// Signed distance, m.
    Distance,
    /// Position, m.
    Pos,
    /// Unit normal from the first side to the second.
    Normal,
    /// First tangent.
    Tangent,
}

impl ContactField {
    /// Number of values.
    pub const fn dim(self) -> usize {
        if matches!(self, Self::Found | Self::Distance) { 1 } else { 3 }
    }
}

/// Selection of the contacts for the slots of a contact sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ContactReduction {
    /// First contacts, in their order.
    None,
    /// Deepest contacts.
    MinDistance,
    /// Contacts with the largest forces.
    MaxForce,
    /// Sum of all forces, in world axes, at the mean of the positions weighted by force, as one contact.
    NetForce,
}

/// Type of a sensor, with its element.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum SensorKind {
    /// Position of a hinge or slide.
    JointPos(usize),
    /// Velocity of a hinge or slide.
    JointVel(usize),
    /// Sum of the actuator forces on a hinge or slide, within the joint's bounds.
    JointActuatorForce(usize),
    /// Distance to the nearer limit of a hinge or slide if it is exceeded, else 0.
    JointLimitPos(usize),
    /// Rate of that distance if the limit is exceeded, else 0.
    JointLimitVel(usize),
    /// Force of the limit.
    JointLimitForce(usize),
    /// Orientation of a ball joint.
    BallQuat(usize),
    /// Angular velocity of a ball joint in the body's frame.
    BallAngVel(usize),
    /// Length of a tendon.
    TendonPos(usize),
    /// Rate of the length of a tendon.
    TendonVel(usize),
    /// Sum of the actuator forces on a tendon.
    TendonActuatorForce(usize),
    /// Distance to the nearer limit of a tendon if it is exceeded, else 0.
    TendonLimitPos(usize),
    /// Rate of that distance if the limit is exceeded, else 0.
    TendonLimitVel(usize),
    /// Force of the limit.
    TendonLimitForce(usize),
    /// Length of an actuator's transmission, including the gear.
    ActuatorPos(usize),
    /// Rate of that length.
    ActuatorVel(usize),
    /// Force of an actuator, before its gear.
    ActuatorForce(usize),
    /// Position, orientation, axes, velocity or acceleration of a frame. Accelerations have no reference.
    Frame {
        /// Measured quantity.
        what: FrameReading,
        /// Object with the frame.
        object: Object,
        /// Reference frame: readings are relative to it and in its axes. `None` is the world.
        reference: Option<Object>,
    },
    /// Magnetic field in a site's frame.
    Magnetometer(usize),
    /// Linear velocity of a site in its frame, m/s.
    Velocimeter(usize),
    /// Angular velocity of a site in its frame, rad/s.
    Gyro(usize),
    /// Linear acceleration of a site minus gravity, in its frame, m/s^2.
    Accelerometer(usize),
    /// Force from the parent on the site's body in the site's frame, N.
    Force(usize),
    /// Torque from the parent on the site's body about the site, in its frame, N m.
    Torque(usize),
    /// Sum of the normal forces of contacts on the site's body whose line of action meets the site's volume, N.
    Touch(usize),
    /// Distances along rays from a site.
    RangeFinder {
        /// Index of the site at the origin of the rays.
        site: usize,
        /// Unit directions in the site's frame.
        rays: Vec<[f64; 3]>,
        /// Reported quantities of each ray, ascending.
        fields: Vec<RayField>,
        /// The geoms that rays can hit.
        geoms: Vec<usize>,
    },
    /// Whether the object's origin is inside the site's volume, as 1 or 0.
    InsideSite {
        /// Object.
        object: Object,
        /// Index of the site.
        site: usize,
    },
    /// Closest points of two sets of geoms.
    Proximity {
        /// Reported quantity.
        what: ProximityReading,
        /// Indices of the geoms of the first set.
        from: Vec<usize>,
        /// Indices of the geoms of the second set.
        to: Vec<usize>,
        /// Largest distance of the search, m.
        cutoff: f64,
    },
    /// Contacts between two sides.
    Contact {
        /// First side.
        first: ContactSide,
        /// Second side.
        second: ContactSide,
        /// Reported quantities of each contact, ascending.
        fields: Vec<ContactField>,
        /// Selection of the reported contacts.
        reduction: ContactReduction,
        /// Number of reported contacts.
        slots: usize,
    },
    /// Centre of mass of a body and its descendants, m.
    SubtreeCom(usize),
    /// Velocity of that centre of mass, m/s.
    SubtreeLinVel(usize),
    /// Angular momentum about that centre of mass, kg m^2/s.
    SubtreeAngMom(usize),
    /// Potential energy of gravity and springs, J.
    PotentialEnergy,
    /// Kinetic energy, J.
    KineticEnergy,
    /// Simulated time, s.
    Clock,
    /// Linear combination of the readings of earlier sensors with equal dimensions: sensor and coefficient.
    Combination(Vec<(usize, f64)>),
}

/// Kind of a reading, which determines the effect of errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Any number.
    Real,
    /// Number that is only valid above 0. Errors do not change values of 0 and below.
    Positive,
    /// Unit vector, which errors rotate.
    Axis,
    /// Unit quaternion, which errors rotate.
    Quaternion,
}

/// Sensor of a model.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sensor {
    /// Name; may be empty.
    pub name: String,
    /// Type.
    pub kind: SensorKind,
    /// Standard deviation of the noise in the source.
    pub noise: f64,
    /// Largest magnitude of readings in the source; 0 is none.
    pub cutoff: f64,
    /// Delay in the source, s.
    pub delay: f64,
    /// Time between samples in the source, s; 0 is every step.
    pub interval: f64,
}

impl Sensor {
    /// Sensor without noise, cutoff, delay and interval.
    pub fn ideal(name: &str, kind: SensorKind) -> Self {
        Self { name: name.into(), kind, noise: 0.0, cutoff: 0.0, delay: 0.0, interval: 0.0 }
    }

    /// Dimension of the reading; `sensors` are those of the model.
    pub fn dim(&self, sensors: &[Self]) -> usize {
        use SensorKind as K;
        match &self.kind {
            K::BallQuat(_) | K::Frame { what: FrameReading::Quat, .. } => 4,
            K::BallAngVel(_)
            | K::Frame { .. }
            | K::Magnetometer(_)
            | K::Velocimeter(_)
            | K::Gyro(_)
            | K::Accelerometer(_)
            | K::Force(_)
            | K::Torque(_)
            | K::SubtreeCom(_)
            | K::SubtreeLinVel(_)
            | K::SubtreeAngMom(_)
            | K::Proximity { what: ProximityReading::Normal, .. } => 3,
            K::Proximity { what: ProximityReading::FromTo, .. } => 6,
            K::RangeFinder { rays, fields, .. } => rays.len() * fields.iter().map(|f| f.dim()).sum::<usize>(),
            K::Contact { fields, slots, .. } => slots * fields.iter().map(|f| f.dim()).sum::<usize>(),
            K::Combination(terms) => terms.first().map_or(1, |&(s, _)| sensors[s].dim(sensors)),
            _ => 1,
        }
    }

    /// Kind of the reading.
    pub fn quantity(&self) -> Quantity {
        use SensorKind as K;
        match &self.kind {
            K::BallQuat(_) | K::Frame { what: FrameReading::Quat, .. } => Quantity::Quaternion,
            K::Frame { what: FrameReading::XAxis | FrameReading::YAxis | FrameReading::ZAxis, .. }
            | K::Proximity { what: ProximityReading::Normal, .. } => Quantity::Axis,
            K::Touch(_) | K::InsideSite { .. } => Quantity::Positive,
            K::RangeFinder { fields, .. } if fields[..] == [RayField::Distance] => Quantity::Positive,
            _ => Quantity::Real,
        }
    }

    /// Whether the sensor needs the acceleration and impulses of the last step.
    pub fn needs_step(&self) -> bool {
        use SensorKind as K;
        matches!(
            self.kind,
            K::Accelerometer(_)
                | K::Force(_)
                | K::Torque(_)
                | K::Touch(_)
                | K::Contact { .. }
                | K::JointLimitForce(_)
                | K::TendonLimitForce(_)
                | K::Frame { what: FrameReading::LinAcc | FrameReading::AngAcc, .. }
        )
    }

    /// Name of the type in MJCF.
    pub fn word(&self) -> &'static str {
        use FrameReading as F;
        use SensorKind as K;
        match &self.kind {
            K::JointPos(_) => "jointpos",
            K::JointVel(_) => "jointvel",
            K::JointActuatorForce(_) => "jointactuatorfrc",
            K::JointLimitPos(_) => "jointlimitpos",
            K::JointLimitVel(_) => "jointlimitvel",
            K::JointLimitForce(_) => "jointlimitfrc",
            K::BallQuat(_) => "ballquat",
            K::BallAngVel(_) => "ballangvel",
            K::TendonPos(_) => "tendonpos",
            K::TendonVel(_) => "tendonvel",
            K::TendonActuatorForce(_) => "tendonactuatorfrc",
            K::TendonLimitPos(_) => "tendonlimitpos",
            K::TendonLimitVel(_) => "tendonlimitvel",
            K::TendonLimitForce(_) => "tendonlimitfrc",
            K::ActuatorPos(_) => "actuatorpos",
            K::ActuatorVel(_) => "actuatorvel",
            K::ActuatorForce(_) => "actuatorfrc",
            K::Frame { what, .. } => match what {
                F::Pos => "framepos",
                F::Quat => "framequat",
                F::XAxis => "framexaxis",
                F::YAxis => "frameyaxis",
                F::ZAxis => "framezaxis",
                F::LinVel => "framelinvel",
                F::AngVel => "frameangvel",
                F::LinAcc => "framelinacc",
                F::AngAcc => "frameangacc",
            },
            K::Magnetometer(_) => "magnetometer",
            K::Velocimeter(_) => "velocimeter",
            K::Gyro(_) => "gyro",
            K::Accelerometer(_) => "accelerometer",
            K::Force(_) => "force",
            K::Torque(_) => "torque",
            K::Touch(_) => "touch",
            K::RangeFinder { .. } => "rangefinder",
            K::InsideSite { .. } => "insidesite",
            K::Proximity { what: ProximityReading::Distance, .. } => "distance",
            K::Proximity { what: ProximityReading::Normal, .. } => "normal",
            K::Proximity { what: ProximityReading::FromTo, .. } => "fromto",
            K::Contact { .. } => "contact",
            K::SubtreeCom(_) => "subtreecom",
            K::SubtreeLinVel(_) => "subtreelinvel",
            K::SubtreeAngMom(_) => "subtreeangmom",
            K::PotentialEnergy => "e_potential",
            K::KineticEnergy => "e_kinetic",
            K::Clock => "clock",
            K::Combination(_) => "combination",
        }
    }
}
