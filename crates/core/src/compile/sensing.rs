//! Compiled sensors: objects become places in frames, and bodies with their descendants become parts.

use std::cell::RefCell;
use std::sync::Arc;

use stepper_geometry::RaySurface;
use stepper_real::Scalar;

use crate::compile::equality::CompiledTendon;
use crate::compile::merging::{Merged, matrix, quaternion, wxyz};
use crate::compile::ray_surfaces::RaySurfaces;
use crate::compile::tree::scalars;
use crate::model::{
    ContactField, ContactReduction, ContactSide, FrameReading, Model, Object, ProximityReading, Quantity, RayField, Sensor, SensorKind,
    Shape, Transmission,
};

/// Sensors of a model, and the parts of a step that they need.
#[derive(Clone, Debug)]
pub struct CompiledSensing<S> {
    /// Sensors in the model's order.
    pub sensors: Vec<CompiledSensor<S>>,
    /// Total length of all readings.
    pub width: usize,
    /// Magnetic field in the world, T.
    pub magnetic: [S; 3],
    /// Whether any sensor reads a quaternion.
    pub quaternions: bool,
    /// Body of every geom of the model.
    pub geom_body: Vec<usize>,
    /// Quantities that the sensors need.
    pub needs: Needs,
    /// Bodies with their descendants whose masses are read.
    pub subtrees: Vec<Subtree>,
    /// Frames at which sensors read the force and torque of the parent on a subtree, and the subtree.
    pub carried: Vec<(SensorFrame<S>, usize)>,
    /// Frames of the model's geoms.
    pub geoms: Vec<SensorFrame<S>>,
    /// Frames of the model's sites.
    pub sites: Vec<SensorFrame<S>>,
    /// Places that sensors read, those of all geoms and sites last: rows of [`Params::place`](crate::compile::Params::place).
    pub places: Vec<Object>,
    /// Simple shapes of the geoms, with their index among all shapes; `None` for a mesh or height field.
    pub forms: Vec<Option<(Form, usize)>>,
    /// Geoms and sites whose shape sensors read, all geoms last: rows of [`Params::size`](crate::compile::Params::size).
    pub shapes: Vec<Object>,
}

/// Quantities that sensors need besides q, v and the activations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// Whether sensors need poses.
    pub poses: bool,
    /// Whether sensors need the velocities of links.
    pub velocities: bool,
    /// Whether sensors need the acceleration of the last step.
    pub acceleration: bool,
    /// Whether sensors need actuator forces, and with them the controls of the last step.
    pub actuators: bool,
    /// Whether sensors need the wrenches that the user applied in the last step.
    pub wrenches: bool,
    /// Whether sensors need the contacts of the last step.
    pub contacts: bool,
    /// Whether sensors need results of the last step: its impulses or its acceleration.
    pub step: bool,
}

/// Compiled sensor.
#[derive(Clone, Debug)]
pub struct CompiledSensor<S> {
    /// Address of the first reading.
    pub at: usize,
    /// Length of the reading.
    pub dim: usize,
    /// Kind of quantity, which determines how errors act on it.
    pub quantity: Quantity,
    /// Reading of the sensor.
    pub read: Read<S>,
}

/// Frame fixed to a link, the world or a mocap body.
#[derive(Clone, Copy, Debug)]
pub struct SensorFrame<S> {
    /// Frame of the compiled model.
    pub frame: usize,
    /// Index among all places, for its position in the frame.
    pub index: usize,
    /// Orientation in the frame.
    pub mat: [S; 9],
    /// Orientation as a quaternion.
    pub quat: [S; 4],
}

/// Shape at a place.
#[derive(Clone, Debug)]
pub struct Solid<S> {
    /// Place of the shape.
    pub place: SensorFrame<S>,
    /// Kind of shape.
    pub form: Form,
    /// Index among all shapes, for its size.
    pub index: usize,
}

/// Pair of shapes whose distance is read.
pub type Pair<S> = (Solid<S>, Solid<S>);

/// Shape that rays hit or that zones have.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// Half space z <= 0.
    Plane,
    /// Sphere, by its radius.
    Sphere,
    /// Capsule, by radius and half length along z.
    Capsule,
    /// Ellipsoid, by its semi-axes.
    Ellipsoid,
    /// Cylinder, by radius and half length along z.
    Cylinder,
    /// Box, by its half sizes.
    Box,
}

/// Geom that rays can hit.
#[derive(Clone, Debug)]
pub struct Target<S> {
    /// Place of the target.
    pub place: SensorFrame<S>,
    /// Shape of the target.
    pub form: TargetForm,
}

/// Shape of a geom that rays hit.
#[derive(Clone, Debug)]
pub enum TargetForm {
    /// Simple shape, with its index among all shapes, for its size.
    Simple(Form, usize),
    /// Mesh or height field.
    Surface(Arc<RaySurface>),
}

/// Body with its descendants, by frame.
#[derive(Clone, Debug)]
pub struct Subtree {
    /// Index among all subtrees, for its mass.
    pub index: usize,
    /// Masses of the subtree.
    pub parts: Vec<Part>,
    /// Whether the subtree contains each body of the model.
    pub bodies: Vec<bool>,
}

/// Mass fixed to a frame.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// Frame of the compiled model.
    pub frame: usize,
    /// Row of [`Params::inertial`](crate::compile::Params::inertial).
    pub index: usize,
}

/// One side of the contacts of a contact sensor.
#[derive(Clone, Debug)]
pub enum Side<S> {
    /// Whether each geom of the model is in the set.
    Geoms(Vec<bool>),
    /// Volume: all geoms that touch in it.
    Zone(Solid<S>),
}

/// Reading of a sensor, in terms of the compiled model; subtrees by their number.
#[derive(Clone, Debug)]
pub enum Read<S> {
    /// Entries of q.
    Position(usize),
    /// Entries of v.
    Velocity(usize),
    /// Sum of coefficients times q.
    Length(Vec<(usize, S)>),
    /// Sum of coefficients times v.
    Rate(Vec<(usize, S)>),
    /// Sum of the forces of actuators.
    ActuatorForce(Vec<usize>),
    /// Force of all actuators on a dof.
    JointForce(usize),
    /// Length of an actuator on a site.
    ActuatorLength(usize),
    /// Rate of the length of an actuator.
    ActuatorRate(usize),
    /// Violation of the nearer end of the range of a sum of coefficients times q.
    LimitPos(Vec<(usize, S)>, Bounds<S>),
    /// Rate of the violation of a limit.
    LimitVel([Vec<(usize, S)>; 2], Bounds<S>),
    /// Impulse of a limit, by its index in the compiled model.
    LimitForce(usize),
    /// Zero, for a limit that does not exist.
    Nothing,
    /// Motion or pose of a frame, possibly relative to another.
    Frame(FrameReading, SensorFrame<S>, Option<SensorFrame<S>>),
    /// Magnetic field.
    Magnetometer(SensorFrame<S>),
    /// Linear velocity in the sensor's frame.
    Velocimeter(SensorFrame<S>),
    /// Angular velocity in the sensor's frame.
    Gyro(SensorFrame<S>),
    /// Linear acceleration less gravity in the sensor's frame.
    Accelerometer(SensorFrame<S>),
    /// Force of the parent on a subtree, by its index among the subtree forces that sensors read.
    Force(usize),
    /// Torque of the parent on a subtree.
    Torque(usize),
    /// Sum of the normal forces on a body of the model whose lines meet a volume.
    Touch(usize, Solid<S>),
    /// Distances along rays.
    Range(SensorFrame<S>, Vec<[S; 3]>, Vec<RayField>, Vec<Target<S>>),
    /// Whether a place is inside a volume.
    Inside(SensorFrame<S>, Solid<S>),
    /// Distance between closest points, up to a cutoff.
    Proximity(ProximityReading, Vec<Pair<S>>, S),
    /// Contacts between two sides.
    Contact([Side<S>; 2], Vec<ContactField>, ContactReduction, usize),
    /// Centre of mass.
    Com(usize),
    /// Velocity of a centre of mass.
    ComVelocity(usize),
    /// Angular momentum about a centre of mass.
    AngularMomentum(usize),
    /// Potential energy of gravity and springs.
    Potential(usize),
    /// Kinetic energy.
    Kinetic(usize),
    /// Simulated time.
    Clock,
    /// Sum of coefficients times readings, which begin at these addresses.
    Combination(Vec<(usize, S)>),
}

/// Bounds of a range.
#[derive(Clone, Copy, Debug)]
pub enum Bounds<S> {
    /// Range of a joint's limit, by its index in the compiled model.
    Limit(usize),
    /// Constant range.
    Range([S; 2]),
}

impl Form {
    /// Form of a shape; `None` for a mesh and a height field.
    pub(crate) fn of(shape: &Shape) -> Option<Self> {
        match *shape {
            Shape::Plane => Some(Self::Plane),
            Shape::Sphere { .. } => Some(Self::Sphere),
            Shape::Capsule { .. } => Some(Self::Capsule),
            Shape::Cylinder { .. } => Some(Self::Cylinder),
            Shape::Ellipsoid { .. } => Some(Self::Ellipsoid),
            Shape::Box { .. } => Some(Self::Box),
            Shape::Mesh { .. } | Shape::HeightField { .. } => None,
        }
    }
}

impl<S: Scalar> CompiledSensing<S> {
    /// Compiles the sensors of a model. `lossy` marks models in which the impulses of a step determine part of the actuator forces.
    pub(super) fn new(model: &Model, merged: &Merged, tendons: &[CompiledTendon<S>], lossy: bool) -> Self {
        let owners = tendons.iter().map(|t| (t.index, t.owner)).collect();
        let compiler = Compiler { model, merged, addresses: model.joint_addresses(), owners, found: RefCell::default() };
        let at = model.sensor_addresses();
        let compile = |(i, s): (usize, &Sensor)| CompiledSensor {
            at: at[i],
            dim: s.dim(&model.sensors),
            quantity: s.quantity(),
            read: compiler.read(&s.kind, &at),
        };
        let sensors: Vec<_> = model.sensors.iter().enumerate().map(compile).collect();
        let mut needs = Needs::of(&sensors, model);
        needs.step |= lossy && needs.actuators;
        let quaternions = sensors.iter().any(|s| matches!(s.read, Read::Frame(FrameReading::Quat, ..)));
        let sites = compiler.found.borrow().carried.clone();
        let carried = sites.iter().map(|&s| (compiler.place(Object::Site(s)), compiler.subtree(model.sites[s].body))).collect();
        let first = compiler.found.borrow().places.len();
        let objects: Vec<Object> = (0..model.geoms.len()).map(Object::Geom).chain((0..model.sites.len()).map(Object::Site)).collect();
        let mut geoms: Vec<_> = objects.iter().enumerate().map(|(k, &object)| compiler.frame_of(object, first + k)).collect();
        let sites = geoms.split_off(model.geoms.len());
        let Found { subtrees, mut places, mut shapes, .. } = compiler.found.into_inner();
        places.extend(objects);
        let first = shapes.len();
        let forms = model.geoms.iter().enumerate().map(|(g, geom)| Some((Form::of(&geom.shape)?, first + g))).collect();
        shapes.extend((0..model.geoms.len()).map(Object::Geom));
        Self {
            sensors,
            subtrees,
            carried,
            geoms,
            sites,
            places,
            forms,
            shapes,
            width: model.nsensordata(),
            magnetic: scalars(model.magnetic),
            quaternions,
            geom_body: model.geoms.iter().map(|g| g.body).collect(),
            needs,
        }
    }
}

impl Needs {
    fn of<S>(sensors: &[CompiledSensor<S>], model: &Model) -> Self {
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

struct Compiler<'a> {
    model: &'a Model,
    merged: &'a Merged,
    addresses: Vec<(usize, usize)>,
    /// Tendons of the model with rows, and the indices of their impulses.
    owners: Vec<(usize, usize)>,
    found: RefCell<Found>,
}

/// Objects found so far that need separate numbers in the compiled model.
#[derive(Default)]
struct Found {
    subtrees: Vec<Subtree>,
    /// Sites at which forces and torques are read.
    carried: Vec<usize>,
    places: Vec<Object>,
    shapes: Vec<Object>,
    surfaces: RaySurfaces,
    parts: usize,
}

impl Compiler<'_> {
    fn read<S: Scalar>(&self, kind: &SensorKind, at: &[usize]) -> Read<S> {
        use SensorKind as K;
        let site = |s: usize| self.place::<S>(Object::Site(s));
        match *kind {
            K::JointPos(j) | K::BallQuat(j) => Read::Position(self.addresses[j].0),
            K::JointVel(j) | K::BallAngVel(j) => Read::Velocity(self.addresses[j].1),
            K::JointActuatorForce(j) => Read::JointForce(self.addresses[j].1),
            K::JointLimitPos(j) => self.overlap(&[(j, 1.0)], self.limit_of(j).map(Bounds::Limit), false),
            K::JointLimitVel(j) => self.overlap(&[(j, 1.0)], self.limit_of(j).map(Bounds::Limit), true),
            K::JointLimitForce(j) => self.limit_of(j).map_or(Read::Nothing, Read::LimitForce),
            K::TendonPos(t) => Read::Length(self.sums(&self.model.tendons[t].joints, 1.0)[0].clone()),
            K::TendonVel(t) => Read::Rate(self.sums(&self.model.tendons[t].joints, 1.0)[1].clone()),
            K::TendonLimitPos(t) => self.overlap(&self.model.tendons[t].joints, self.range_of(t), false),
            K::TendonLimitVel(t) => self.overlap(&self.model.tendons[t].joints, self.range_of(t), true),
            K::TendonLimitForce(t) => {
                let owner = self.owners.iter().find(|owner| owner.0 == t && self.model.tendons[t].range.is_some());
                owner.map_or(Read::Nothing, |owner| Read::LimitForce(owner.1))
            }
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
            K::Force(s) => Read::Force(number(&mut self.found.borrow_mut().carried, s)),
            K::Torque(s) => Read::Torque(number(&mut self.found.borrow_mut().carried, s)),
            K::Touch(s) => Read::Touch(self.model.sites[s].body, self.zone(s)),
            K::RangeFinder { site: s, ref rays, ref fields, ref geoms } => {
                let seen = geoms.iter().filter_map(|&g| self.target(g)).collect();
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

    /// Terms of a sum in q and in v.
    fn sums<S: Scalar>(&self, arms: &[(usize, f64)], gear: f64) -> [Vec<(usize, S)>; 2] {
        let arms = || self.arms(arms, gear);
        [arms().map(|(q, _, c)| (q, c)).collect(), arms().map(|(_, v, c)| (v, c)).collect()]
    }

    /// Moment of an actuator, if it is the same in every configuration.
    fn moment<S: Scalar>(&self, a: usize) -> Option<impl Iterator<Item = (usize, usize, S)>> {
        let actuator = &self.model.actuators[a];
        let arms = match actuator.transmission {
            Transmission::Joint(j) => vec![(j, 1.0)],
            Transmission::Tendon(t) => self.model.tendons[t].joints.clone(),
            Transmission::Site { .. } => return None,
        };
        Some(self.arms(&arms, actuator.gear).collect::<Vec<_>>().into_iter())
    }

    /// Index in the compiled model of a joint's limit.
    fn limit_of(&self, j: usize) -> Option<usize> {
        crate::compile::limits::limits(self.model, &self.addresses).iter().position(|l| l.dof == self.addresses[j].1)
    }

    fn range_of<S: Scalar>(&self, t: usize) -> Option<Bounds<S>> {
        self.model.tendons[t].range.map(|range| Bounds::Range(scalars(range)))
    }

    /// Overlap of a joint or tendon with its limits, or the rate of the overlap.
    fn overlap<S: Scalar>(&self, arms: &[(usize, f64)], bounds: Option<Bounds<S>>, rate: bool) -> Read<S> {
        let Some(bounds) = bounds else { return Read::Nothing };
        let sums = self.sums(arms, 1.0);
        if rate { Read::LimitVel(sums, bounds) } else { Read::LimitPos(sums[0].clone(), bounds) }
    }

    fn place<S: Scalar>(&self, object: Object) -> SensorFrame<S> {
        let index = number(&mut self.found.borrow_mut().places, object);
        self.frame_of(object, index)
    }

    /// Frame of an object whose place has this index.
    fn frame_of<S: Scalar>(&self, object: Object, index: usize) -> SensorFrame<S> {
        let (body, quat) = match object {
            Object::XBody(b) => (b, [1.0, 0.0, 0.0, 0.0]),
            Object::Body(b) => (b, self.model.bodies[b].iquat),
            Object::Geom(g) => (self.model.geoms[g].body, self.model.geoms[g].quat),
            Object::Site(s) => (self.model.sites[s].body, self.model.sites[s].quat),
        };
        let quat = self.merged.quat[body] * quaternion(quat);
        SensorFrame { frame: self.merged.frame[body], index, mat: matrix(&quat), quat: wxyz(&quat) }
    }

    fn solid<S: Scalar>(&self, object: Object, shape: &Shape) -> Option<Solid<S>> {
        let form = Form::of(shape)?;
        let index = number(&mut self.found.borrow_mut().shapes, object);
        Some(Solid { place: self.place(object), form, index })
    }

    /// Ray target of a geom; `None` if the model does not have its form.
    fn target<S: Scalar>(&self, geom: usize) -> Option<Target<S>> {
        let shape = &self.model.geoms[geom].shape;
        let form = match Form::of(shape) {
            Some(form) => TargetForm::Simple(form, number(&mut self.found.borrow_mut().shapes, Object::Geom(geom))),
            None => TargetForm::Surface(self.found.borrow_mut().surfaces.get_or_make(self.model, shape)?),
        };
        Some(Target { place: self.place(Object::Geom(geom)), form })
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
        let mut among = vec![false; self.model.bodies.len()];
        among[root] = true;
        for b in root + 1..among.len() {
            among[b] = among[self.model.bodies[b].parent];
        }
        among
    }

    /// Index of a body's subtree.
    fn subtree(&self, root: usize) -> usize {
        let bodies = self.descendants(root);
        let mut found = self.found.borrow_mut();
        if let Some(tree) = found.subtrees.iter().find(|tree| tree.bodies == bodies) {
            return tree.index;
        }
        let heavy = |b: &usize| bodies[*b] && self.model.bodies[*b].mass > 0.0;
        let mut frames: Vec<usize> = (0..bodies.len()).filter(heavy).map(|b| self.merged.frame[b]).collect();
        frames.sort_unstable();
        frames.dedup();
        let first = self.merged.leaders.len() + found.parts;
        let parts: Vec<_> = frames.into_iter().enumerate().map(|(k, frame)| Part { frame, index: first + k }).collect();
        found.parts += parts.len();
        let index = found.subtrees.len();
        found.subtrees.push(Subtree { index, parts, bodies });
        index
    }
}

/// Index of a thing in a list, to which it is appended if it is new.
fn number<T: Copy + PartialEq>(list: &mut Vec<T>, thing: T) -> usize {
    list.iter().position(|&t| t == thing).unwrap_or_else(|| {
        list.push(thing);
        list.len() - 1
    })
}
