//! Sensors and sites, with MuJoCo's types.

use serde::{Deserialize, Serialize};

use crate::Shape;

/// Site: a frame on a body, with a volume for sensors that need one.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Site {
    /// Name of the site; may be empty.
    pub name: String,
    /// Index of the body to which the site is fixed.
    pub body: usize,
    /// Position of the site in the body's frame, m.
    pub pos: [f64; 3],
    /// Orientation of the site in the body's frame, a unit quaternion (w, x, y, z).
    pub quat: [f64; 4],
    /// Volume of the site: a sphere, capsule, ellipsoid, cylinder or box.
    pub shape: Shape,
}

/// Object whose frame a sensor reads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Object {
    /// Inertial frame of a body: centre of mass and principal axes.
    Body(usize),
    /// Body frame of a body.
    XBody(usize),
    /// Frame of a geom.
    Geom(usize),
    /// Frame of a site.
    Site(usize),
}

named! {
    /// Quantity that a frame sensor reads.
    #[derive(Serialize, Deserialize)]
    pub enum FrameReading {
        /// Position of the frame's origin, m.
        Pos = "framepos",
        /// Orientation, a unit quaternion (w, x, y, z).
        Quat = "framequat",
        /// Unit vector of the frame's x axis.
        XAxis = "framexaxis",
        /// Unit vector of the frame's y axis.
        YAxis = "frameyaxis",
        /// Unit vector of the frame's z axis.
        ZAxis = "framezaxis",
        /// Linear velocity of the frame's origin, m/s.
        LinVel = "framelinvel",
        /// Angular velocity, rad/s.
        AngVel = "frameangvel",
        /// Linear acceleration of the frame's origin minus gravity, m/s^2. A frame at rest reads 9.81 upwards.
        LinAcc = "framelinacc",
        /// Angular acceleration, rad/s^2.
        AngAcc = "frameangacc",
    }
}

named! {
    /// Quantity that a proximity sensor reads from the closest points of two sets of geoms.
    #[derive(Serialize, Deserialize)]
    pub enum ProximityReading {
        /// Signed distance, m.
        Distance = "distance",
        /// Unit vector from the closest point of the first geom to the closest point of the second geom. It is reversed if the geoms
        /// overlap, and zero beyond the cutoff.
        Normal = "normal",
        /// Positions of the two closest points, m: first the point on a geom of the first set, then the point on a geom of the second set.
        /// They are zero beyond the cutoff.
        FromTo = "fromto",
    }
}

/// Quantity that a rangefinder reads for each ray. The reading contains these quantities in the order of the variants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum RayField {
    /// Distance to the nearest surface, m; -1 without a hit.
    Distance,
    /// Unit direction of the ray in world axes; zero without a hit.
    Direction,
    /// Origin of the ray in the world frame, m.
    Origin,
    /// Hit point in the world frame, m; zero without a hit.
    Point,
}

impl RayField {
    /// Number of values of the quantity.
    pub const fn dim(self) -> usize {
        if matches!(self, Self::Distance) { 1 } else { 3 }
    }
}

/// Side of a contact sensor, which selects contacts by their geoms or positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ContactSide {
    /// All geoms.
    Any,
    /// Single geom, by its index.
    Geom(usize),
    /// Geoms of a body, by the body's index.
    Body(usize),
    /// Geoms of a body and of all its descendants, by the body's index.
    Subtree(usize),
    /// Geoms whose contacts are inside the volume of a site, by the site's index.
    Site(usize),
}

/// Quantity that a contact sensor reads for each contact. The reading contains these quantities in the order of the variants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum ContactField {
    /// Number of contacts that match both sides of the sensor; 0 in slots without a contact.
    Found,
    /// Force in the contact's frame (normal, first and second tangent), N.
    Force,
    /// Torque in the contact's frame, N m.
    Torque,
    /// Signed distance, m.
    Distance,
    /// Position in the world frame, m.
    Pos,
    /// Unit normal in world axes, from the first side to the second.
    Normal,
    /// First tangent, a unit vector in world axes.
    Tangent,
}

impl ContactField {
    /// Number of values of the quantity.
    pub const fn dim(self) -> usize {
        if matches!(self, Self::Found | Self::Distance) { 1 } else { 3 }
    }
}

/// Rule that selects the reported contacts of a contact sensor, if more contacts match than the sensor can report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum ContactReduction {
    /// First contacts in the order in which stepper finds contacts.
    None,
    /// Deepest contacts first.
    MinDistance,
    /// Contacts with the largest forces first.
    MaxForce,
    /// One net contact: sum of all forces in world axes, at the mean of the positions weighted by force.
    NetForce,
}

named! {
    /// Type of a sensor, with the indices of its elements.
    #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
    pub enum SensorKind {
        /// Position of a hinge or slide, m or rad.
        JointPos(usize) = "jointpos",
        /// Velocity of a hinge or slide, m/s or rad/s.
        JointVel(usize) = "jointvel",
        /// Sum of the actuator forces on a hinge or slide, clamped to the joint's force range, N or N m.
        JointActuatorForce(usize) = "jointactuatorfrc",
        /// Minus the distance of a hinge or slide beyond the nearer end of its range, m or rad; 0 within the range.
        JointLimitPos(usize) = "jointlimitpos",
        /// Time derivative of the reading of [`SensorKind::JointLimitPos`], m/s or rad/s; 0 within the range.
        JointLimitVel(usize) = "jointlimitvel",
        /// Force of the limit of a hinge or slide, N or N m.
        JointLimitForce(usize) = "jointlimitfrc",
        /// Orientation of a ball joint, a unit quaternion (w, x, y, z).
        BallQuat(usize) = "ballquat",
        /// Angular velocity of a ball joint in the body's frame, rad/s.
        BallAngVel(usize) = "ballangvel",
        /// Length of a tendon, m or rad.
        TendonPos(usize) = "tendonpos",
        /// Time derivative of the length of a tendon, m/s or rad/s.
        TendonVel(usize) = "tendonvel",
        /// Sum of the actuator forces on a tendon, N or N m.
        TendonActuatorForce(usize) = "tendonactuatorfrc",
        /// Minus the distance of the length of a tendon beyond the nearer end of its range, m or rad; 0 within the range.
        TendonLimitPos(usize) = "tendonlimitpos",
        /// Time derivative of the reading of [`SensorKind::TendonLimitPos`], m/s or rad/s; 0 within the range.
        TendonLimitVel(usize) = "tendonlimitvel",
        /// Force of the limit of a tendon, N or N m.
        TendonLimitForce(usize) = "tendonlimitfrc",
        /// Length of an actuator, including the gear.
        ActuatorPos(usize) = "actuatorpos",
        /// Time derivative of the length of an actuator, including the gear.
        ActuatorVel(usize) = "actuatorvel",
        /// Force of an actuator, before its gear.
        ActuatorForce(usize) = "actuatorfrc",
        /// Position, orientation, axis, velocity or acceleration of a frame.
        Frame {
            /// Measured quantity.
            what: FrameReading,
            /// Object whose frame is measured.
            object: Object,
            /// Object whose frame is the reference: the reading is relative to this frame and in its axes. `None` selects the world frame.
            /// Accelerations have no reference.
            reference: Option<Object>,
        } = "frame",
        /// Magnetic flux density in a site's frame, T.
        Magnetometer(usize) = "magnetometer",
        /// Linear velocity of a site in its frame, m/s.
        Velocimeter(usize) = "velocimeter",
        /// Angular velocity of a site in its frame, rad/s.
        Gyro(usize) = "gyro",
        /// Linear acceleration of a site minus gravity, in its frame, m/s^2.
        Accelerometer(usize) = "accelerometer",
        /// Force of the parent body on the site's body, in the site's frame, N.
        Force(usize) = "force",
        /// Torque of the parent body on the site's body about the site, in the site's frame, N m.
        Torque(usize) = "torque",
        /// Touch sensor: sum of the normal forces of contacts on the site's body whose line of action intersects the site's volume, N.
        Touch(usize) = "touch",
        /// Rangefinder: distances and other quantities along rays from a site.
        RangeFinder {
            /// Index of the site at the origin of the rays.
            site: usize,
            /// Unit directions in the site's frame.
            rays: Vec<[f64; 3]>,
            /// Reported quantities of each ray, in the order of the variants of [`RayField`].
            fields: Vec<RayField>,
            /// Indices of the geoms that rays can hit.
            geoms: Vec<usize>,
        } = "rangefinder",
        /// Whether the object's origin is inside the site's volume, as 1 or 0.
        InsideSite {
            /// Object whose origin is inside or outside the volume.
            object: Object,
            /// Index of the site with the volume.
            site: usize,
        } = "insidesite",
        /// Distance, normal or closest points of two sets of geoms.
        Proximity {
            /// Quantity of the closest points that the sensor reads.
            what: ProximityReading,
            /// Indices of the geoms in the first of the two sets.
            from: Vec<usize>,
            /// Indices of the geoms in the second of the two sets.
            to: Vec<usize>,
            /// Largest distance of the search, m.
            cutoff: f64,
        } = "proximity",
        /// Contacts between two sides, for example two bodies.
        Contact {
            /// First side, which selects one geom of a contact.
            first: ContactSide,
            /// Second side, which selects the other geom.
            second: ContactSide,
            /// Reported quantities of each contact, in the order of the variants of [`ContactField`].
            fields: Vec<ContactField>,
            /// Rule that selects the reported contacts, if more than `slots` contacts match.
            reduction: ContactReduction,
            /// Largest number of reported contacts.
            slots: usize,
        } = "contact",
        /// Centre of mass of a body with its descendants in the world frame, m.
        SubtreeCom(usize) = "subtreecom",
        /// Velocity of the centre of mass of a body with its descendants, m/s.
        SubtreeLinVel(usize) = "subtreelinvel",
        /// Angular momentum of a body with its descendants about their centre of mass, kg m^2/s.
        SubtreeAngMom(usize) = "subtreeangmom",
        /// Potential energy of gravity and springs, J.
        PotentialEnergy = "e_potential",
        /// Kinetic energy, J.
        KineticEnergy = "e_kinetic",
        /// Simulated time, s.
        Clock = "clock",
        /// Linear combination of the readings of earlier sensors with equal dimensions: pairs of sensor index and coefficient.
        Combination(Vec<(usize, f64)>) = "combination",
    }
}

named! {
    /// Kind of a reading, which determines how sensor errors act on it.
    pub enum Quantity {
        /// Any number.
        Real = "real",
        /// Number that is only valid above 0, such as a distance. Errors do not change values of 0 and below.
        Positive = "positive",
        /// Unit vector. Sensor errors rotate it.
        Axis = "axis",
        /// Unit quaternion. Sensor errors rotate it.
        Quaternion = "quaternion",
    }
}

/// Sensor of a model: its type, and the errors that the source file specifies.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sensor {
    /// Name of the sensor; may be empty.
    pub name: String,
    /// Type of the sensor, with the indices of its elements.
    pub kind: SensorKind,
    /// Standard deviation of the noise according to the source file, in the unit of the reading.
    pub noise: f64,
    /// Largest magnitude of readings according to the source file, in the unit of the reading; 0 means no limit.
    pub cutoff: f64,
    /// Delay according to the source file, s.
    pub delay: f64,
    /// Sampling period according to the source file, s; 0 means a sample in every step.
    pub interval: f64,
}

impl Sensor {
    /// Sensor without noise, cutoff, delay and sampling period.
    pub fn ideal(name: &str, kind: SensorKind) -> Self {
        Self { name: name.into(), kind, noise: 0.0, cutoff: 0.0, delay: 0.0, interval: 0.0 }
    }

    /// Number of values in the reading. `sensors` are all sensors of the model.
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

    /// Kind of values in the sensor's reading, such as unit quaternions, which determines how sensor errors act on them.
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

    /// Name of the sensor type in MJCF.
    pub const fn word(&self) -> &'static str {
        match self.kind {
            SensorKind::Frame { what, .. } => what.name(),
            SensorKind::Proximity { what, .. } => what.name(),
            ref kind => kind.name(),
        }
    }
}
