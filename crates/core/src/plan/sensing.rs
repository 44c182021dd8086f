//! What sensors read: objects become places in frames, bodies with all that hangs from them become parts.

use nalgebra::{UnitQuaternion, Vector3};
use stepper_real::Scalar;

use super::merge::{Merged, combined, matrix, quaternion, vector};
use super::scalars;
use crate::model::{
    ContactField, ContactReduction, ContactSide, FrameReading, Model, Object, ProximityReading, Quantity, RayField, Sensor, SensorKind,
    Shape, Transmission,
};

/// All sensors of a model, and what they need of a step.
#[derive(Clone, Debug)]
pub struct SensingPlan<S> {
    /// Sensors in the model's order.
    pub sensors: Vec<SensorPlan<S>>,
    /// Numbers of all readings.
    pub width: usize,
    /// Magnetic field in the world, T.
    pub magnetic: [S; 3],
    /// Orientation of every link in its parent's frame before its joints; empty when no sensor reads a quaternion.
    pub link_quat: Vec<[S; 4]>,
    /// Body of every geom of the model.
    pub geom_body: Vec<usize>,
    /// What the sensors need.
    pub needs: Needs,
}

/// What sensors need beyond q, v and the activations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// Poses.
    pub poses: bool,
    /// Velocities of links.
    pub velocities: bool,
    /// The acceleration of the last step.
    pub acceleration: bool,
    /// Forces of actuators, and so the controls of the last step.
    pub actuators: bool,
    /// Wrenches that the user applied in the last step.
    pub wrenches: bool,
    /// Contacts of the last step.
    pub contacts: bool,
    /// Whether anything is read of the last step itself: its impulses or its acceleration.
    pub step: bool,
}

/// One sensor.
#[derive(Clone, Debug)]
pub struct SensorPlan<S> {
    /// Address of its first reading.
    pub at: usize,
    /// Numbers of its reading.
    pub dim: usize,
    /// How errors act on it.
    pub quantity: Quantity,
    /// What it reads.
    pub read: Read<S>,
}

/// A frame fixed to a link, the world or a mocap body.
#[derive(Clone, Copy, Debug)]
pub struct Place<S> {
    /// The plan's frame.
    pub frame: usize,
    /// Position in it, m.
    pub pos: [S; 3],
    /// Orientation in it.
    pub mat: [S; 9],
    /// The same as a quaternion.
    pub quat: [S; 4],
}

/// A shape somewhere.
#[derive(Clone, Debug)]
pub struct Solid<S> {
    /// Where.
    pub place: Place<S>,
    /// What.
    pub form: Form,
    /// radius, half length; or semi-axes; or half sizes; m.
    pub size: [S; 3],
}

/// Two shapes whose distance is read.
pub type Pair<S> = (Solid<S>, Solid<S>);

/// Shapes that rays meet and that zones have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// The half space z <= 0.
    Plane,
    /// radius
    Sphere,
    /// radius, half length along z
    Capsule,
    /// semi-axes
    Ellipsoid,
    /// radius, half length along z
    Cylinder,
    /// half sizes
    Box,
}

/// What belongs to a body and all that hangs from it, by frame.
#[derive(Clone, Debug)]
pub struct Subtree<S> {
    /// kg
    pub mass: S,
    /// Its masses.
    pub parts: Vec<Part<S>>,
    /// Which bodies of the model it has.
    pub bodies: Vec<bool>,
}

/// A mass fixed to a frame.
#[derive(Clone, Copy, Debug)]
pub struct Part<S> {
    /// The plan's frame.
    pub frame: usize,
    /// kg
    pub mass: S,
    /// Centre of mass, m.
    pub com: [S; 3],
    /// Inertia about it: xx, yy, zz, xy, xz, yz, kg m^2.
    pub inertia: [S; 6],
}

/// One side of the contacts of a contact sensor.
#[derive(Clone, Debug)]
pub enum Side<S> {
    /// Which geoms of the model.
    Geoms(Vec<bool>),
    /// Whatever touches in this volume.
    Zone(Solid<S>),
}

/// What a sensor reads, in terms of the plan.
#[derive(Clone, Debug)]
pub enum Read<S> {
    /// So many entries of q.
    Position(usize),
    /// So many entries of v.
    Velocity(usize),
    /// sum of coefficient q
    Length(Vec<(usize, S)>),
    /// sum of coefficient v
    Rate(Vec<(usize, S)>),
    /// Sum of the forces of actuators.
    ActuatorForce(Vec<usize>),
    /// Force of all actuators on a dof.
    JointForce(usize),
    /// Length of an actuator on a site.
    ActuatorLength(usize),
    /// Its rate.
    ActuatorRate(usize),
    /// Overlap with the nearer limit: address in q, low, high.
    LimitPos(usize, [S; 2]),
    /// Its rate: address in q, dof, low, high.
    LimitVel(usize, usize, [S; 2]),
    /// Impulse of a limit, by its index in the plan.
    LimitForce(usize),
    /// A limit that is not there.
    Nothing,
    /// A frame, perhaps in another.
    Frame(FrameReading, Place<S>, Option<Place<S>>),
    /// The magnetic field.
    Magnetometer(Place<S>),
    /// Linear velocity in its own frame.
    Velocimeter(Place<S>),
    /// Angular velocity in its own frame.
    Gyro(Place<S>),
    /// Linear acceleration less gravity in its own frame.
    Accelerometer(Place<S>),
    /// Force of the parent on a subtree.
    Force(Place<S>, Subtree<S>),
    /// Torque of the parent on a subtree.
    Torque(Place<S>, Subtree<S>),
    /// Normal forces on a body of the model whose line meets a volume.
    Touch(usize, Solid<S>),
    /// Rays.
    Range(Place<S>, Vec<[S; 3]>, Vec<RayField>, Vec<Solid<S>>),
    /// Whether a place is inside a volume.
    Inside(Place<S>, Solid<S>),
    /// Closest points up to a cutoff.
    Proximity(ProximityReading, Vec<Pair<S>>, S),
    /// Contacts.
    Contact([Side<S>; 2], Vec<ContactField>, ContactReduction, usize),
    /// Centre of mass.
    Com(Subtree<S>),
    /// Its velocity.
    ComVelocity(Subtree<S>),
    /// Angular momentum about it.
    AngularMomentum(Subtree<S>),
    /// Energy of gravity and springs.
    Potential(Subtree<S>),
    /// Energy of motion.
    Kinetic(Subtree<S>),
    /// Time.
    Clock,
    /// Coefficients times readings that begin at these addresses.
    Combination(Vec<(usize, S)>),
}

impl<S: Scalar> SensingPlan<S> {
    /// `lossy` says whether part of what actuators do is known from the impulses of a step alone.
    pub(super) fn new(model: &Model, merged: &Merged, lossy: bool) -> Self {
        let at = model.sensor_addresses();
        let compile = |(i, s): (usize, &Sensor)| SensorPlan {
            at: at[i],
            dim: s.dim(&model.sensors),
            quantity: s.quantity(),
            read: Compiler { model, merged, addresses: model.joint_addresses() }.read(&s.kind, &at),
        };
        let sensors: Vec<_> = model.sensors.iter().enumerate().map(compile).collect();
        let mut needs = Needs::of(&sensors, model);
        needs.step |= lossy && needs.actuators;
        let quaternions = sensors.iter().any(|s| matches!(s.read, Read::Frame(FrameReading::Quat, ..)));
        let link_quat = |&leader: &usize| {
            let body = &model.bodies[leader];
            wxyz(&(merged.quat[body.parent] * quaternion(body.quat)))
        };
        Self {
            sensors,
            width: model.nsensordata(),
            magnetic: scalars(model.magnetic),
            link_quat: if quaternions { merged.leaders.iter().map(link_quat).collect() } else { vec![] },
            geom_body: model.geoms.iter().map(|g| g.body).collect(),
            needs,
        }
    }
}

impl Needs {
    fn of<S>(sensors: &[SensorPlan<S>], model: &Model) -> Self {
        let any = |test: &dyn Fn(&Read<S>) -> bool| sensors.iter().any(|s| test(&s.read));
        let wrenches = any(&|r| matches!(r, Read::Force(..) | Read::Torque(..)));
        let accelerated = |r: &Read<S>| matches!(r, Read::Accelerometer(_) | Read::Frame(FrameReading::LinAcc | FrameReading::AngAcc, ..));
        let acceleration = wrenches || any(&accelerated);
        let moving = |r: &Read<S>| {
            matches!(r, Read::Velocimeter(_) | Read::Gyro(_) | Read::ComVelocity(_) | Read::AngularMomentum(_) | Read::Kinetic(_))
                || matches!(r, Read::Frame(FrameReading::LinVel | FrameReading::AngVel, ..))
        };
        let drives =
            |r: &Read<S>| matches!(r, Read::ActuatorForce(_) | Read::JointForce(_) | Read::ActuatorLength(_) | Read::ActuatorRate(_));
        let bodiless = |r: &Read<S>| {
            matches!(r, Read::Position(_) | Read::Velocity(_) | Read::Length(_) | Read::Rate(_) | Read::Nothing)
                || drives(r)
                || matches!(r, Read::LimitPos(..) | Read::LimitVel(..) | Read::LimitForce(_) | Read::Clock | Read::Combination(_))
        };
        Self {
            poses: any(&|r| !bodiless(r)),
            velocities: acceleration || any(&moving),
            acceleration,
            actuators: any(&drives),
            wrenches,
            contacts: wrenches || any(&|r| matches!(r, Read::Touch(..) | Read::Contact(..))),
            step: model.sensors.iter().any(Sensor::needs_step),
        }
    }
}

fn wxyz<S: Scalar>(q: &UnitQuaternion<f64>) -> [S; 4] {
    scalars([q.w, q.i, q.j, q.k])
}

/// Where an object of the model is.
pub(super) fn place<S: Scalar>(model: &Model, merged: &Merged, object: Object) -> Place<S> {
    let (body, pos, quat) = match object {
        Object::XBody(b) => (b, [0.0; 3], [1.0, 0.0, 0.0, 0.0]),
        Object::Body(b) => (b, model.bodies[b].ipos, model.bodies[b].iquat),
        Object::Geom(g) => (model.geoms[g].body, model.geoms[g].pos, model.geoms[g].quat),
        Object::Site(s) => (model.sites[s].body, model.sites[s].pos, model.sites[s].quat),
    };
    let at: Vector3<f64> = merged.pos[body] + merged.quat[body] * vector(pos);
    let quat = merged.quat[body] * quaternion(quat);
    Place { frame: merged.frame[body], pos: scalars(at.into()), mat: matrix(&quat), quat: wxyz(&quat) }
}

struct Compiler<'a> {
    model: &'a Model,
    merged: &'a Merged,
    addresses: Vec<(usize, usize)>,
}

impl Compiler<'_> {
    fn read<S: Scalar>(&self, kind: &SensorKind, at: &[usize]) -> Read<S> {
        use SensorKind as K;
        let site = |s: usize| self.place::<S>(Object::Site(s));
        match *kind {
            K::JointPos(j) | K::BallQuat(j) => Read::Position(self.addresses[j].0),
            K::JointVel(j) | K::BallAngVel(j) => Read::Velocity(self.addresses[j].1),
            K::JointActuatorForce(j) => Read::JointForce(self.addresses[j].1),
            K::JointLimitPos(j) => self.limit(j, |q, _, range| Read::LimitPos(q, range)),
            K::JointLimitVel(j) => self.limit(j, Read::LimitVel),
            K::JointLimitForce(j) => self.limit_force(j),
            K::TendonPos(t) => Read::Length(self.arms(&self.model.tendons[t].joints, 1.0).map(|(q, _, c)| (q, c)).collect()),
            K::TendonVel(t) => Read::Rate(self.arms(&self.model.tendons[t].joints, 1.0).map(|(_, v, c)| (v, c)).collect()),
            K::TendonActuatorForce(t) => {
                let pulls = |a: &usize| self.model.actuators[*a].transmission == Transmission::Tendon(t);
                Read::ActuatorForce((0..self.model.actuators.len()).filter(pulls).collect())
            }
            K::ActuatorPos(a) => self.moment(a).map_or(Read::ActuatorLength(a), |m| Read::Length(m.map(|(q, _, c)| (q, c)).collect())),
            K::ActuatorVel(a) => self.moment(a).map_or(Read::ActuatorRate(a), |m| Read::Rate(m.map(|(_, v, c)| (v, c)).collect())),
            K::ActuatorForce(a) => Read::ActuatorForce(vec![a]),
            K::Frame { what, object, reference } => Read::Frame(what, self.place(object), reference.map(|r| self.place(r))),
            K::Magnetometer(s) => Read::Magnetometer(site(s)),
            K::Velocimeter(s) => Read::Velocimeter(site(s)),
            K::Gyro(s) => Read::Gyro(site(s)),
            K::Accelerometer(s) => Read::Accelerometer(site(s)),
            K::Force(s) => Read::Force(site(s), self.subtree(self.model.sites[s].body)),
            K::Torque(s) => Read::Torque(site(s), self.subtree(self.model.sites[s].body)),
            K::Touch(s) => Read::Touch(self.model.sites[s].body, self.zone(s)),
            K::RangeFinder { site: s, ref rays, ref fields, ref geoms } => {
                let seen = geoms.iter().filter_map(|&g| self.solid(Object::Geom(g), &self.model.geoms[g].shape)).collect();
                Read::Range(site(s), rays.iter().map(|&r| scalars(r)).collect(), fields.clone(), seen)
            }
            K::InsideSite { object, site: s } => Read::Inside(self.place(object), self.zone(s)),
            K::Proximity { what, ref from, ref to, cutoff } => Read::Proximity(what, self.near(from, to), S::from_f64(cutoff)),
            K::Contact { first, second, ref fields, reduction, slots } => {
                Read::Contact([self.side(first), self.side(second)], fields.clone(), reduction, slots)
            }
            K::SubtreeCom(b) => Read::Com(self.subtree(b)),
            K::SubtreeLinVel(b) => Read::ComVelocity(self.subtree(b)),
            K::SubtreeAngMom(b) => Read::AngularMomentum(self.subtree(b)),
            K::PotentialEnergy => Read::Potential(self.subtree(0)),
            K::KineticEnergy => Read::Kinetic(self.subtree(0)),
            K::Clock => Read::Clock,
            K::Combination(ref terms) => Read::Combination(terms.iter().map(|&(s, c)| (at[s], S::from_f64(c))).collect()),
        }
    }

    /// Addresses in q and v, and coefficients.
    fn arms<'a, S: Scalar>(&'a self, arms: &'a [(usize, f64)], gear: f64) -> impl Iterator<Item = (usize, usize, S)> + 'a {
        arms.iter().map(move |&(j, c)| (self.addresses[j].0, self.addresses[j].1, S::from_f64(c * gear)))
    }

    /// The moment of an actuator, if it is the same in every configuration.
    fn moment<S: Scalar>(&self, a: usize) -> Option<impl Iterator<Item = (usize, usize, S)>> {
        let actuator = &self.model.actuators[a];
        let arms = match actuator.transmission {
            Transmission::Joint(j) => vec![(j, 1.0)],
            Transmission::Tendon(t) => self.model.tendons[t].joints.clone(),
            Transmission::Site { .. } => return None,
        };
        Some(self.arms(&arms, actuator.gear).collect::<Vec<_>>().into_iter())
    }

    fn limit<S: Scalar>(&self, j: usize, read: impl Fn(usize, usize, [S; 2]) -> Read<S>) -> Read<S> {
        let (q, v) = self.addresses[j];
        self.model.joints[j].range.map_or(Read::Nothing, |range| read(q, v, scalars(range)))
    }

    fn limit_force<S: Scalar>(&self, j: usize) -> Read<S> {
        let dof = self.addresses[j].1;
        let index = super::limits::<S>(self.model, &self.addresses).iter().position(|l| l.dof == dof);
        index.map_or(Read::Nothing, Read::LimitForce)
    }

    fn place<S: Scalar>(&self, object: Object) -> Place<S> {
        place(self.model, self.merged, object)
    }

    fn solid<S: Scalar>(&self, object: Object, shape: &Shape) -> Option<Solid<S>> {
        let (form, size) = match *shape {
            Shape::Plane => (Form::Plane, [0.0; 3]),
            Shape::Sphere { radius } => (Form::Sphere, [radius, 0.0, 0.0]),
            Shape::Capsule { radius, half_length } => (Form::Capsule, [radius, half_length, 0.0]),
            Shape::Cylinder { radius, half_length } => (Form::Cylinder, [radius, half_length, 0.0]),
            Shape::Ellipsoid { radii } => (Form::Ellipsoid, radii),
            Shape::Box { half } => (Form::Box, half),
            Shape::Mesh { .. } | Shape::HeightField { .. } => return None,
        };
        Some(Solid { place: self.place(object), form, size: scalars(size) })
    }

    fn zone<S: Scalar>(&self, site: usize) -> Solid<S> {
        self.solid(Object::Site(site), &self.model.sites[site].shape).expect("the model was checked: sites have simple volumes")
    }

    /// All pairs of two sets of geoms.
    fn near<S: Scalar>(&self, from: &[usize], to: &[usize]) -> Vec<Pair<S>> {
        let solid = |g: usize| self.solid(Object::Geom(g), &self.model.geoms[g].shape);
        let pairs = from.iter().flat_map(|&a| to.iter().map(move |&b| (a, b)));
        pairs.filter_map(|(a, b)| Some((solid(a)?, solid(b)?))).collect()
    }

    fn side<S: Scalar>(&self, side: ContactSide) -> Side<S> {
        let below = |b: usize| self.descendants(b);
        let geoms = &self.model.geoms;
        match side {
            ContactSide::Any => Side::Geoms(vec![true; geoms.len()]),
            ContactSide::Geom(g) => Side::Geoms((0..geoms.len()).map(|k| k == g).collect()),
            ContactSide::Body(b) => Side::Geoms(geoms.iter().map(|g| g.body == b).collect()),
            ContactSide::Subtree(b) => {
                let bodies = below(b);
                Side::Geoms(geoms.iter().map(|g| bodies[g.body]).collect())
            }
            ContactSide::Site(s) => Side::Zone(self.zone(s)),
        }
    }

    fn descendants(&self, root: usize) -> Vec<bool> {
        let mut below = vec![false; self.model.bodies.len()];
        below[root] = true;
        for b in root + 1..below.len() {
            below[b] = below[self.model.bodies[b].parent];
        }
        below
    }

    fn subtree<S: Scalar>(&self, root: usize) -> Subtree<S> {
        let bodies = self.descendants(root);
        let mut frames: Vec<usize> = (0..bodies.len()).filter(|&b| bodies[b]).map(|b| self.merged.frame[b]).collect();
        frames.sort_unstable();
        frames.dedup();
        let part = |&frame: &usize| {
            let (mass, com, inertia) = combined(self.model, self.merged, |b| bodies[b] && self.merged.frame[b] == frame);
            Part { frame, mass: S::from_f64(mass), com: scalars(com.into()), inertia: scalars(inertia) }
        };
        let parts: Vec<Part<S>> = frames.iter().map(part).filter(|p| p.mass > S::ZERO).collect();
        let mass = (0..bodies.len()).filter(|&b| bodies[b]).map(|b| self.model.bodies[b].mass).sum();
        Subtree { mass: S::from_f64(mass), parts, bodies }
    }
}
