//! Sensors: what they read, in MuJoCo's vocabulary.

use serde::{Deserialize, Serialize};

use crate::Shape;

/// A place on a body for sensors, with a volume for those that have a zone.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Site {
    /// Name; may be empty.
    pub name: String,
    /// The body that it is fixed to.
    pub body: usize,
    /// Position in the body's frame, m.
    pub pos: [f64; 3],
    /// Orientation in the body's frame.
    pub quat: [f64; 4],
    /// Its volume: a sphere, capsule, ellipsoid, cylinder or box.
    pub shape: Shape,
}

/// Something with a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Object {
    /// A body's centre of mass and principal axes.
    Body(usize),
    /// A body's own frame.
    XBody(usize),
    /// A geom.
    Geom(usize),
    /// A site.
    Site(usize),
}

/// What a frame sensor reads of its object.
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
    /// Linear acceleration less gravity, m/s^2: a frame at rest reads 9.81 upwards.
    LinAcc,
    /// Angular acceleration, rad/s^2.
    AngAcc,
}

/// What is reported of the closest points of two geoms.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ProximityReading {
    /// Signed distance, m.
    Distance,
    /// Unit vector from the first's closest point to the second's, which turns round where they overlap; zero beyond the cutoff.
    Normal,
    /// The closest points, first and second; zero beyond the cutoff, m.
    FromTo,
}

/// What a range finder reports of each ray, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum RayField {
    /// Distance to the nearest surface, m; -1 where there is none.
    Distance,
    /// The ray's unit direction in the world; zero where it hits nothing.
    Direction,
    /// Where it begins, m.
    Origin,
    /// Where it hits, m; zero where there is nothing.
    Point,
}

impl RayField {
    /// Numbers that it takes.
    pub const fn dim(self) -> usize {
        if matches!(self, Self::Distance) { 1 } else { 3 }
    }
}

/// One side of the contacts that a contact sensor selects.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ContactSide {
    /// Everything.
    Any,
    /// A geom.
    Geom(usize),
    /// The geoms of a body.
    Body(usize),
    /// The geoms of a body and all that hangs from it.
    Subtree(usize),
    /// Whatever touches within a site's volume.
    Site(usize),
}

/// What a contact sensor reports of each contact, in this order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum ContactField {
    /// The number of contacts that match; 0 in slots without one.
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
    /// Numbers that it takes.
    pub const fn dim(self) -> usize {
        if matches!(self, Self::Found | Self::Distance) { 1 } else { 3 }
    }
}

/// Which of the matching contacts fill the slots of a contact sensor.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ContactReduction {
    /// The first ones, in the order of the contacts.
    None,
    /// The deepest ones.
    MinDistance,
    /// Those with the largest force.
    MaxForce,
    /// One: the sum of all forces, in world axes, at the mean of the positions weighted by force.
    NetForce,
}

/// What a sensor reads.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum SensorKind {
    /// Position of a hinge or slide.
    JointPos(usize),
    /// Velocity of a hinge or slide.
    JointVel(usize),
    /// Sum of the actuators' forces on a hinge or slide, within the joint's bounds.
    JointActuatorForce(usize),
    /// Distance to the nearer limit of a hinge or slide where it is exceeded, else 0.
    JointLimitPos(usize),
    /// Rate of that distance where the limit is exceeded, else 0.
    JointLimitVel(usize),
    /// Force of the limit.
    JointLimitForce(usize),
    /// Orientation of a ball joint.
    BallQuat(usize),
    /// Angular velocity of a ball joint in the body's frame.
    BallAngVel(usize),
    /// Length of a tendon.
    TendonPos(usize),
    /// Rate of that length.
    TendonVel(usize),
    /// Sum of the actuators' forces on a tendon.
    TendonActuatorForce(usize),
    /// Distance to the nearer limit of a tendon where it is exceeded, else 0.
    TendonLimitPos(usize),
    /// Rate of that distance where the limit is exceeded, else 0.
    TendonLimitVel(usize),
    /// Force of the limit.
    TendonLimitForce(usize),
    /// Length of an actuator's transmission, gear included.
    ActuatorPos(usize),
    /// Rate of that length.
    ActuatorVel(usize),
    /// Force of an actuator, before its gear.
    ActuatorForce(usize),
    /// Position, orientation, axes, velocity or acceleration of a frame. Accelerations have no reference.
    Frame {
        /// What is read.
        what: FrameReading,
        /// The frame.
        object: Object,
        /// The frame in which it is expressed and against which it moves; `None` is the world.
        reference: Option<Object>,
    },
    /// The magnetic field in a site's frame.
    Magnetometer(usize),
    /// Linear velocity of a site in its own frame, m/s.
    Velocimeter(usize),
    /// Angular velocity of a site in its own frame, rad/s.
    Gyro(usize),
    /// Linear acceleration less gravity of a site in its own frame, m/s^2.
    Accelerometer(usize),
    /// Force from the parent on the site's body in the site's frame, N.
    Force(usize),
    /// Torque from the parent on the site's body about the site, in its frame, N m.
    Torque(usize),
    /// Sum of the normal forces of the contacts on the site's body whose line of force meets the site's volume, N.
    Touch(usize),
    /// Distances along rays from a site.
    RangeFinder {
        /// Where the rays begin.
        site: usize,
        /// Unit directions in the site's frame.
        rays: Vec<[f64; 3]>,
        /// What is reported of each ray, ascending.
        fields: Vec<RayField>,
        /// The geoms that rays can hit.
        geoms: Vec<usize>,
    },
    /// 1 where the object's origin is inside the site's volume, else 0.
    InsideSite {
        /// What is looked for.
        object: Object,
        /// Where.
        site: usize,
    },
    /// Closest points of two sets of geoms.
    Proximity {
        /// What is reported.
        what: ProximityReading,
        /// The first set.
        from: Vec<usize>,
        /// The second set.
        to: Vec<usize>,
        /// Distances are looked for up to this one, m.
        cutoff: f64,
    },
    /// Contacts between two sides.
    Contact {
        /// First side.
        first: ContactSide,
        /// Second side.
        second: ContactSide,
        /// What is reported of each, ascending.
        fields: Vec<ContactField>,
        /// Which are reported.
        reduction: ContactReduction,
        /// How many are reported.
        slots: usize,
    },
    /// Centre of mass of a body and all that hangs from it, m.
    SubtreeCom(usize),
    /// Velocity of that centre of mass, m/s.
    SubtreeLinVel(usize),
    /// Angular momentum about that centre of mass, kg m^2/s.
    SubtreeAngMom(usize),
    /// Energy of gravity and springs, J.
    PotentialEnergy,
    /// J
    KineticEnergy,
    /// Simulated time, s.
    Clock,
    /// A linear combination of readings of earlier sensors, all of one dimension: sensor and coefficient.
    Combination(Vec<(usize, f64)>),
}

/// What kind of quantity a reading is: it decides how errors act on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Quantity {
    /// Any number.
    Real,
    /// A number that is positive where it says something: errors leave 0 and below alone.
    Positive,
    /// A unit vector: errors turn it.
    Axis,
    /// A unit quaternion: errors turn it.
    Quaternion,
}

/// A sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sensor {
    /// Name; may be empty.
    pub name: String,
    /// What it reads.
    pub kind: SensorKind,
    /// Standard deviation of the noise that its source declares.
    pub noise: f64,
    /// Largest magnitude of its readings that its source declares; 0 is none.
    pub cutoff: f64,
    /// Delay that its source declares, s.
    pub delay: f64,
    /// Time between samples that its source declares, s; 0 is every step.
    pub interval: f64,
}

impl Sensor {
    /// A sensor of which nothing but its truth is declared.
    pub fn ideal(name: &str, kind: SensorKind) -> Self {
        Self { name: name.into(), kind, noise: 0.0, cutoff: 0.0, delay: 0.0, interval: 0.0 }
    }

    /// Numbers of a reading; `sensors` are those of the model.
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

    /// What kind of quantity it reads.
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

    /// Whether it needs what the last step did: its acceleration and impulses.
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

    /// The field's word for it.
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
