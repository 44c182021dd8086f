//! Compiled sensors: objects become positions in frames, and subtrees become lists of masses.

use std::cell::RefCell;
use std::sync::Arc;

use stepper_geometry::RaySurface;
use stepper_real::Scalar;

use crate::compile::equality::{self, Combination, CompiledTendon};
use crate::compile::merging::{Merged, Pose, matrix, wxyz};
use crate::compile::ray_surfaces::RaySurfaces;
use crate::compile::tree::{CompiledLimit, scalars};
use crate::model::{
    ContactField, ContactReduction, ContactSide, FrameReading, Model, Object, ProximityReading, Quantity, RayField, Sensor, SensorKind,
    Shape, Transmission,
};

/// Compiled sensors of a model, with the objects and the quantities of a step that they read.
#[derive(Clone, Debug)]
pub struct CompiledSensing<S> {
    /// Sensors in the model's order.
    pub sensors: Vec<CompiledSensor<S>>,
    /// Total number of readings (nsensordata).
    pub width: usize,
    /// Magnetic flux density in world axes, T.
    pub magnetic: [S; 3],
    /// Whether the reading of any sensor is a quaternion.
    pub quaternions: bool,
    /// Body of every geom of the model.
    pub geom_body: Vec<usize>,
    /// Quantities of a step that the sensors need, in addition to the state.
    pub needs: Needs,
    /// Subtrees whose mass or motion sensors read: a body with all its descendants.
    pub subtrees: Vec<Subtree>,
    /// Subtrees of the force and torque sensors, which measure between a subtree and its parent body. Each tuple has the frame of the
    /// sensor's site, and the index of the subtree in `subtrees`.
    pub force_sites: Vec<(SensorFrame<S>, usize)>,
    /// Frame and pose of each geom of the model.
    pub geoms: Vec<SensorFrame<S>>,
    /// Frame and pose of each site of the model.
    pub sites: Vec<SensorFrame<S>>,
    /// Objects whose positions sensors read. The list ends with all geoms and all sites of the model. The index in this list is the
    /// argument of [`Params::place`](crate::compile::Params::place).
    pub places: Vec<Object>,
    /// Simple shape of each geom, and its index in `shapes`; `None` for a mesh or height field.
    pub forms: Vec<Option<(Form, usize)>>,
    /// Geoms and sites whose sizes sensors read. The list ends with all geoms of the model. The index in this list is the argument of
    /// [`Params::size`](crate::compile::Params::size).
    pub shapes: Vec<Object>,
}

/// Quantities that the sensors of a model need in addition to q, v and activations.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Needs {
    /// Whether sensors need the poses of frames.
    pub poses: bool,
    /// Whether sensors need the velocities of links.
    pub velocities: bool,
    /// Whether sensors need the acceleration of the last step.
    pub acceleration: bool,
    /// Whether sensors need actuator forces, and with them the controls of the last step.
    pub actuators: bool,
    /// Whether sensors need the forces on bodies (`xfrc_applied`) that the user applied in the last step.
    pub wrenches: bool,
    /// Whether sensors need the contacts of the last step.
    pub contacts: bool,
    /// Whether sensors need results of the last step: its impulses or its acceleration.
    pub step: bool,
}

/// Sensor of the compiled model: addresses of its readings, and measured quantity.
#[derive(Clone, Debug)]
pub struct CompiledSensor<S> {
    /// Index of the sensor's first reading.
    pub at: usize,
    /// Number of the sensor's readings.
    pub dim: usize,
    /// Kind of quantity (scalar, positive number, quaternion ...). It determines how error models act on the readings.
    pub quantity: Quantity,
    /// Measured quantity and its inputs.
    pub read: Read<S>,
}

/// Frame of a sensor: a pose fixed to a link, the world or a mocap body.
#[derive(Clone, Copy, Debug)]
pub struct SensorFrame<S> {
    /// Index of the frame in the compiled model.
    pub frame: usize,
    /// Argument with which [`Params::place`](crate::compile::Params::place) returns the position of the sensor in the frame.
    pub index: usize,
    /// Rotation matrix from the sensor's axes to the frame's, row-major.
    pub mat: [S; 9],
    /// Unit quaternion (w, x, y, z) of the rotation `mat`.
    pub quat: [S; 4],
}

/// Simple shape (sphere, box ...) with its pose.
#[derive(Clone, Debug)]
pub struct Solid<S> {
    /// Pose of the shape.
    pub place: SensorFrame<S>,
    /// Kind of shape, such as sphere or box.
    pub form: Form,
    /// Argument with which [`Params::size`](crate::compile::Params::size) returns the size of the shape.
    pub index: usize,
}

/// Pair of shapes whose distance a sensor reads.
pub type Pair<S> = (Solid<S>, Solid<S>);

/// Kind of a simple shape: a geom that rays hit, or the volume of a site.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// Half space z <= 0.
    Plane,
    /// Sphere; its size is the radius.
    Sphere,
    /// Capsule; its size is radius and half length along z.
    Capsule,
    /// Ellipsoid; its size is the three semi-axes.
    Ellipsoid,
    /// Cylinder; its size is radius and half length along z.
    Cylinder,
    /// Box; its size is the three half sizes.
    Box,
}

/// Geom that rays can hit.
#[derive(Clone, Debug)]
pub struct Target<S> {
    /// Pose of the geom.
    pub place: SensorFrame<S>,
    /// Shape of the geom.
    pub form: TargetForm,
}

/// Shape of a geom that rays hit.
#[derive(Clone, Debug)]
pub enum TargetForm {
    /// Simple shape: its kind, and the argument with which [`Params::size`](crate::compile::Params::size) returns its size.
    Simple(Form, usize),
    /// Mesh or height field.
    Surface(Arc<RaySurface>),
}

/// Subtree: a body with all its descendants, as a list of masses in frames.
#[derive(Clone, Debug)]
pub struct Subtree {
    /// Argument with which [`Params::total`](crate::compile::Params::total) returns the mass of the subtree.
    pub index: usize,
    /// Parts of the subtree: one mass per frame.
    pub parts: Vec<Part>,
    /// For each body of the model, whether the subtree contains it.
    pub bodies: Vec<bool>,
}

/// Part of a subtree: the mass of its bodies that are fixed to one frame.
#[derive(Clone, Copy, Debug)]
pub struct Part {
    /// Index of the frame in the compiled model.
    pub frame: usize,
    /// Argument with which [`Params::inertial`](crate::compile::Params::inertial) returns mass, centre of mass and inertia of this part.
    pub index: usize,
}

/// Side of a contact sensor. A contact sensor has two sides, and each selects contacts by their geoms or positions.
#[derive(Clone, Debug)]
pub enum Side<S> {
    /// Set of geoms, as a list with an entry for each geom of the model.
    Geoms(Vec<bool>),
    /// Volume of a site. It selects the contacts inside the volume.
    Zone(Solid<S>),
}

/// Terms of a linear combination: address or index, and coefficient.
pub type Terms<S> = Vec<(usize, S)>;

/// Quantity that a sensor measures, with its inputs in the compiled model. An index of a subtree refers to [`CompiledSensing::subtrees`].
#[derive(Clone, Debug)]
pub enum Read<S> {
    /// Entries of the configuration q, from this address on.
    Position(usize),
    /// Entries of the velocity v, from this address on.
    Velocity(usize),
    /// Value of a combination of joint positions and the length of a path.
    Length(Combination<S>),
    /// Time derivative of a combination of joint positions and the length of a path.
    Rate(Combination<S>),
    /// Sum of the forces of the actuators with these indices.
    ActuatorForce(Vec<usize>),
    /// Generalized force of all actuators on the degree of freedom with this index.
    JointForce(usize),
    /// Length of the actuator with this index, which has a variable moment.
    ActuatorLength(usize),
    /// Time derivative of the length of the actuator with this index, which has a variable moment.
    ActuatorRate(usize),
    /// Violation of the range of a joint or tendon: distance from the violated end of the range, as a negative number. 0 within the range.
    LimitPos(Combination<S>, Bounds<S>),
    /// Time derivative of the reading of [`Read::LimitPos`].
    LimitVel(Combination<S>, Bounds<S>),
    /// Force of the limit of a joint or tendon. The index selects the limit's impulse in the list of impulses of scalar constraint rows.
    LimitForce(usize),
    /// Constant zero, because the limit that the sensor reads does not exist.
    Nothing,
    /// Pose, velocity or acceleration of a frame; relative to another frame, if there is one.
    Frame(FrameReading, SensorFrame<S>, Option<SensorFrame<S>>),
    /// Magnetic flux density in the sensor's axes.
    Magnetometer(SensorFrame<S>),
    /// Linear velocity in the sensor's axes.
    Velocimeter(SensorFrame<S>),
    /// Angular velocity in the sensor's axes.
    Gyro(SensorFrame<S>),
    /// Linear acceleration minus gravity, in the sensor's axes.
    Accelerometer(SensorFrame<S>),
    /// Force that the parent body exerts on a subtree, at the sensor's site. The index selects the subtree in
    /// [`CompiledSensing::force_sites`].
    Force(usize),
    /// Torque that the parent body exerts on a subtree, about the sensor's site. The index selects the subtree in
    /// [`CompiledSensing::force_sites`].
    Torque(usize),
    /// Touch sensor: sum of the normal forces on the body with this index. Only forces whose lines of action intersect the volume count.
    Touch(usize, Solid<S>),
    /// Rangefinder: distances along rays. The values are the sensor frame, the directions of the rays, the quantities in the reading, and
    /// the geoms that rays can hit.
    Range(SensorFrame<S>, Vec<[S; 3]>, Vec<RayField>, Vec<Target<S>>),
    /// Number 1 if the origin of the sensor frame is inside the volume, otherwise 0.
    Inside(SensorFrame<S>, Solid<S>),
    /// Distance, normal or nearest points of two sets of geoms. The values are the kind of reading, the pairs of geoms, and the cutoff
    /// distance, m.
    Proximity(ProximityReading, Vec<Pair<S>>, S),
    /// Contacts between two sides. The values are the sides, the quantities in the reading, and the selection among the contacts.
    Contact([Side<S>; 2], Vec<ContactField>, ContactReduction),
    /// Centre of mass of the subtree with this index.
    Com(usize),
    /// Velocity of the centre of mass of the subtree with this index.
    ComVelocity(usize),
    /// Angular momentum of the subtree with this index about its centre of mass.
    AngularMomentum(usize),
    /// Potential energy of gravity and springs. The index selects the subtree of the world.
    Potential(usize),
    /// Kinetic energy. The index selects the subtree of the world.
    Kinetic(usize),
    /// Simulated time.
    Clock,
    /// Linear combination of readings of other sensors: index of the first reading and coefficient of each term.
    Combination(Terms<S>),
}

/// Bounds of a limited joint or tendon.
#[derive(Clone, Copy, Debug)]
pub enum Bounds<S> {
    /// Bounds of a joint: index of the limit in the compiled model.
    Limit(usize),
    /// Bounds of a tendon: lowest and highest length, the same in all environments.
    Range([S; 2]),
}

impl Form {
    /// Kind of a shape; `None` for a mesh and a height field.
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
    /// Compiles the sensors of a model. `lossy` is set if actuator forces contain friction losses, which depend on the impulses of a step.
    pub(super) fn new(
        combinations: &equality::Compiler<'_>,
        limits: &[CompiledLimit],
        (tendons, lengths): (&[CompiledTendon<S>], &[Combination<S>]),
        lossy: bool,
    ) -> Self {
        let &equality::Compiler { model, merged } = combinations;
        let compiler = Compiler { model, merged, combinations, limits, tendons, lengths, found: RefCell::default() };
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
        let sites = compiler.found.borrow().force_sites.clone();
        let force_sites = sites.iter().map(|&s| (compiler.place(Object::Site(s)), compiler.subtree(model.sites[s].body))).collect();
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
            force_sites,
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
        let bodiless = |r: &Read<S>| match r {
            Read::Length(length) | Read::Rate(length) | Read::LimitPos(length, _) | Read::LimitVel(length, _) => length.path.is_none(),
            Read::Position(_) | Read::Velocity(_) | Read::Nothing | Read::LimitForce(_) | Read::Clock | Read::Combination(_) => true,
            _ => drives(r),
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

struct Compiler<'a, S> {
    model: &'a Model,
    merged: &'a Merged,
    combinations: &'a equality::Compiler<'a>,
    limits: &'a [CompiledLimit],
    tendons: &'a [CompiledTendon<S>],
    /// Lengths of all tendons.
    lengths: &'a [Combination<S>],
    found: RefCell<Found>,
}

/// Objects to which the sensors compiled so far refer. Each is stored once.
#[derive(Default)]
struct Found {
    subtrees: Vec<Subtree>,
    /// Indices of the sites of force and torque sensors.
    force_sites: Vec<usize>,
    places: Vec<Object>,
    shapes: Vec<Object>,
    surfaces: RaySurfaces,
    parts: usize,
}

impl<S: Scalar> Compiler<'_, S> {
    fn read(&self, kind: &SensorKind, at: &[usize]) -> Read<S> {
        use SensorKind as K;
        let site = |s: usize| self.place(Object::Site(s));
        let position = |j: usize| self.combinations.combination(&[(j, 1.0)]);
        match *kind {
            K::JointPos(j) | K::BallQuat(j) => Read::Position(self.merged.addresses[j].0),
            K::JointVel(j) | K::BallAngVel(j) => Read::Velocity(self.merged.addresses[j].1),
            K::JointActuatorForce(j) => Read::JointForce(self.merged.addresses[j].1),
            K::JointLimitPos(j) => self.overlap(position(j), self.limit_of(j).map(Bounds::Limit), false),
            K::JointLimitVel(j) => self.overlap(position(j), self.limit_of(j).map(Bounds::Limit), true),
            K::JointLimitForce(j) => self.limit_of(j).map_or(Read::Nothing, Read::LimitForce),
            K::TendonPos(t) => Read::Length(self.lengths[t].clone()),
            K::TendonVel(t) => Read::Rate(self.lengths[t].clone()),
            K::TendonLimitPos(t) => self.overlap(self.lengths[t].clone(), self.range_of(t), false),
            K::TendonLimitVel(t) => self.overlap(self.lengths[t].clone(), self.range_of(t), true),
            K::TendonLimitForce(t) => {
                let limited = self.tendons.iter().find(|tendon| tendon.index == t && tendon.range.is_some());
                limited.map_or(Read::Nothing, |tendon| Read::LimitForce(tendon.impulse_index))
            }
            K::TendonActuatorForce(t) => {
                let pulls = |a: &usize| self.model.actuators[*a].transmission == Transmission::Tendon(t);
                Read::ActuatorForce((0..self.model.actuators.len()).filter(pulls).collect())
            }
            K::ActuatorPos(a) => self.moment(a).map_or(Read::ActuatorLength(a), Read::Length),
            K::ActuatorVel(a) => self.moment(a).map_or(Read::ActuatorRate(a), Read::Rate),
            K::ActuatorForce(a) => Read::ActuatorForce(vec![a]),
            K::Frame { what, object, reference } => Read::Frame(what, self.place(object), reference.map(|r| self.place(r))),
            K::Magnetometer(s) => Read::Magnetometer(site(s)),
            K::Velocimeter(s) => Read::Velocimeter(site(s)),
            K::Gyro(s) => Read::Gyro(site(s)),
            K::Accelerometer(s) => Read::Accelerometer(site(s)),
            K::Force(s) => Read::Force(number(&mut self.found.borrow_mut().force_sites, s)),
            K::Torque(s) => Read::Torque(number(&mut self.found.borrow_mut().force_sites, s)),
            K::Touch(s) => Read::Touch(self.model.sites[s].body, self.zone(s)),
            K::RangeFinder { site: s, ref rays, ref fields, ref geoms } => {
                let seen = geoms.iter().filter_map(|&g| self.target(g)).collect();
                Read::Range(site(s), rays.iter().map(|&r| scalars(r)).collect(), fields.clone(), seen)
            }
            K::InsideSite { object, site: s } => Read::Inside(self.place(object), self.zone(s)),
            K::Proximity { what, ref from, ref to, cutoff } => Read::Proximity(what, self.near(from, to), S::from_f64(cutoff)),
            K::Contact { first, second, ref fields, reduction, .. } => {
                Read::Contact([self.side(first), self.side(second)], fields.clone(), reduction)
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

    /// Length of actuator `a` as a combination of joint positions. `None` for an actuator with a variable moment.
    fn moment(&self, a: usize) -> Option<Combination<S>> {
        let actuator = &self.model.actuators[a];
        match actuator.transmission {
            Transmission::Joint(j) => Some(self.combinations.combination(&[(j, actuator.gear)])),
            Transmission::Tendon(t) if self.lengths[t].path.is_none() => {
                let terms = self.model.tendons[t].joints.iter().map(|&(j, c)| (j, c * actuator.gear));
                Some(self.combinations.combination(&terms.collect::<Vec<_>>()))
            }
            _ => None,
        }
    }

    /// Index of the limit of joint `j` in the compiled model; `None` if the joint has no limit.
    fn limit_of(&self, j: usize) -> Option<usize> {
        self.limits.iter().position(|limit| limit.joint == j)
    }

    fn range_of(&self, t: usize) -> Option<Bounds<S>> {
        self.model.tendons[t].range.map(|range| Bounds::Range(scalars(range)))
    }

    /// Violation of the range of a joint or tendon ([`Read::LimitPos`]), or its time derivative ([`Read::LimitVel`]) if `rate` is true.
    /// `value` is the position or length.
    fn overlap(&self, value: Combination<S>, bounds: Option<Bounds<S>>, rate: bool) -> Read<S> {
        let Some(bounds) = bounds else { return Read::Nothing };
        if rate { Read::LimitVel(value, bounds) } else { Read::LimitPos(value, bounds) }
    }

    fn place(&self, object: Object) -> SensorFrame<S> {
        let index = number(&mut self.found.borrow_mut().places, object);
        self.frame_of(object, index)
    }

    /// Sensor frame of an object. The argument `index` selects the object's position in [`Params::place`](crate::compile::Params::place).
    fn frame_of(&self, object: Object, index: usize) -> SensorFrame<S> {
        let Pose { frame, quat, .. } = self.merged.pose(self.model, object);
        SensorFrame { frame, index, mat: matrix(&quat), quat: wxyz(&quat) }
    }

    fn solid(&self, object: Object, shape: &Shape) -> Option<Solid<S>> {
        let form = Form::of(shape)?;
        let index = number(&mut self.found.borrow_mut().shapes, object);
        Some(Solid { place: self.place(object), form, index })
    }

    /// Ray target of a geom; `None` if the model does not contain its mesh or height field.
    fn target(&self, geom: usize) -> Option<Target<S>> {
        let shape = &self.model.geoms[geom].shape;
        let form = match Form::of(shape) {
            Some(form) => TargetForm::Simple(form, number(&mut self.found.borrow_mut().shapes, Object::Geom(geom))),
            None => TargetForm::Surface(self.found.borrow_mut().surfaces.get_or_make(self.model, shape)?),
        };
        Some(Target { place: self.place(Object::Geom(geom)), form })
    }

    fn zone(&self, site: usize) -> Solid<S> {
        self.solid(Object::Site(site), &self.model.sites[site].shape).expect("the model was checked: sites have simple volumes")
    }

    /// All pairs of a geom in `from` and a geom in `to`. Meshes and height fields are left out.
    fn near(&self, from: &[usize], to: &[usize]) -> Vec<Pair<S>> {
        let solid = |g: usize| self.solid(Object::Geom(g), &self.model.geoms[g].shape);
        let pairs = from.iter().flat_map(|&a| to.iter().map(move |&b| (a, b)));
        pairs.filter_map(|(a, b)| Some((solid(a)?, solid(b)?))).collect()
    }

    fn side(&self, side: ContactSide) -> Side<S> {
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

    /// Index of the subtree of body `root`. The subtree is added if it is new.
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

/// Index of `thing` in `list`. The function appends `thing` if it is not in the list.
fn number<T: Copy + PartialEq>(list: &mut Vec<T>, thing: T) -> usize {
    list.iter().position(|&t| t == thing).unwrap_or_else(|| {
        list.push(thing);
        list.len() - 1
    })
}
