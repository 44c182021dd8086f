//! Models made in code.

use nalgebra::{Quaternion, UnitQuaternion, Vector3};

use super::{
    Activation, Actuator, Body, Geom, Joint, JointKind, Keyframe, MassProperties, Model, ModelError, Pair, Sensor, SensorKind, Shape,
    Tendon, Transmission,
};

/// Index of the world body.
pub const WORLD: usize = 0;

/// Density of a geom that gives neither mass nor density: that of water, kg/m^3.
const DENSITY: f64 = 1000.0;

/// Makes a [`Model`] in code: bodies hang from bodies, geoms give them mass, joints let them move.
///
/// ```
/// use stepper_core::model::{ActuatorBuilder, BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
///
/// // A cart on a rail with a pole on top, above a floor.
/// let mut scene = Model::builder("cart-pole");
/// scene.timestep(0.002).geom(WORLD, GeomBuilder::plane("floor"));
/// let cart = scene.body(
///     WORLD,
///     BodyBuilder::new("cart")
///         .pos([0.0, 0.0, 1.0])
///         .joint(JointBuilder::slide("rail", [1.0, 0.0, 0.0]).range(-2.0, 2.0).damping(0.1))
///         .geom(GeomBuilder::cuboid("chassis", [0.2, 0.1, 0.05]).mass(1.0).masks(0, 0)),
/// );
/// scene.body(
///     cart,
///     BodyBuilder::new("pole")
///         .joint(JointBuilder::hinge("pivot", [0.0, 1.0, 0.0]))
///         .geom(GeomBuilder::capsule("rod", 0.02, 0.3).pos([0.0, 0.0, 0.3]).density(700.0)),
/// );
/// scene.actuator(ActuatorBuilder::motor("push", "rail").gear(10.0).ctrl_range(-1.0, 1.0)).position_sensor("angle", "pivot");
/// let model = scene.finish()?;
///
/// assert_eq!((model.nq(), model.nv(), model.nu()), (2, 2, 1));
/// assert_eq!(model.collision_pairs().len(), 1); // rod and floor
/// # Ok::<(), stepper_core::model::ModelError>(())
/// ```
///
/// Names refer to elements in actuators, sensors, pairs and excludes; a name that is missing is an error of [`ModelBuilder::finish`].
#[derive(Clone, Debug)]
pub struct ModelBuilder {
    model: Model,
    bodies: Vec<BodyBuilder>,
    actuators: Vec<ActuatorBuilder>,
    sensors: Vec<(String, String, bool)>,
    tendons: Vec<(String, Vec<(String, f64)>)>,
    pairs: Vec<([String; 2], [f64; 3])>,
    excludes: Vec<[String; 2]>,
}

/// A body with its joints and geoms.
#[derive(Clone, Debug)]
pub struct BodyBuilder {
    body: Body,
    inertial: bool,
    joints: Vec<JointBuilder>,
    geoms: Vec<GeomBuilder>,
}

/// A joint.
#[derive(Clone, Debug)]
pub struct JointBuilder {
    joint: Joint,
    rest: Option<f64>,
}

/// A geom; solid of density 1000 kg/m^3 unless told otherwise.
#[derive(Clone, Debug)]
pub struct GeomBuilder {
    geom: Geom,
    mass: Option<f64>,
    density: f64,
}

/// An actuator on a joint or tendon, by name.
#[derive(Clone, Debug)]
pub struct ActuatorBuilder {
    actuator: Actuator,
    target: String,
    on_tendon: bool,
}

impl Model {
    /// Starts a model: only the world, gravity 9.81 m/s^2 along -z, time step 2 ms.
    pub fn builder(name: &str) -> ModelBuilder {
        ModelBuilder {
            model: Self {
                name: name.into(),
                timestep: 0.002,
                gravity: [0.0, 0.0, -9.81],
                bodies: vec![],
                joints: vec![],
                geoms: vec![],
                pairs: vec![],
                excludes: vec![],
                tendons: vec![],
                actuators: vec![],
                sensors: vec![],
                keyframes: vec![],
                qpos0: vec![],
                qpos_spring: vec![],
                omitted: vec![],
            },
            bodies: vec![BodyBuilder::new("world")],
            actuators: vec![],
            sensors: vec![],
            tendons: vec![],
            pairs: vec![],
            excludes: vec![],
        }
    }
}

impl ModelBuilder {
    /// Sets the default time step, s.
    pub fn timestep(&mut self, seconds: f64) -> &mut Self {
        self.model.timestep = seconds;
        self
    }

    /// Sets the gravitational acceleration in the world frame, m/s^2.
    pub fn gravity(&mut self, acceleration: [f64; 3]) -> &mut Self {
        self.model.gravity = acceleration;
        self
    }

    /// Hangs a body from another ([`WORLD`] or what an earlier call gave) and gives its index.
    pub fn body(&mut self, parent: usize, mut body: BodyBuilder) -> usize {
        body.body.parent = parent;
        self.bodies.push(body);
        self.bodies.len() - 1
    }

    /// Fixes a geom to a body that was made before, or to the [`WORLD`].
    ///
    /// # Panics
    /// When there is no such body.
    pub fn geom(&mut self, body: usize, geom: GeomBuilder) -> &mut Self {
        self.bodies[body].geoms.push(geom);
        self
    }

    /// Adds a fixed tendon: a linear combination of the positions of hinges and slides, by name.
    pub fn tendon(&mut self, name: &str, joints: &[(&str, f64)]) -> &mut Self {
        self.tendons.push((name.into(), joints.iter().map(|&(j, c)| (j.into(), c)).collect()));
        self
    }

    /// Adds an actuator.
    pub fn actuator(&mut self, actuator: ActuatorBuilder) -> &mut Self {
        self.actuators.push(actuator);
        self
    }

    /// Adds a sensor of a joint's position.
    pub fn position_sensor(&mut self, name: &str, joint: &str) -> &mut Self {
        self.sensors.push((name.into(), joint.into(), true));
        self
    }

    /// Adds a sensor of a joint's velocity.
    pub fn velocity_sensor(&mut self, name: &str, joint: &str) -> &mut Self {
        self.sensors.push((name.into(), joint.into(), false));
        self
    }

    /// Lets two geoms collide whatever the filters say, with this friction: sliding (1), torsional (m), rolling (m).
    pub fn pair(&mut self, geom_a: &str, geom_b: &str, friction: [f64; 3]) -> &mut Self {
        self.pairs.push(([geom_a.into(), geom_b.into()], friction));
        self
    }

    /// Keeps the geoms of two bodies from colliding.
    pub fn exclude(&mut self, body_a: &str, body_b: &str) -> &mut Self {
        self.excludes.push([body_a.into(), body_b.into()]);
        self
    }

    /// Adds a named state to reset to.
    pub fn keyframe(&mut self, keyframe: Keyframe) -> &mut Self {
        self.model.keyframes.push(keyframe);
        self
    }

    /// The model, validated.
    ///
    /// # Errors
    /// [`ModelError`] when a name is missing, as [`Model::finish`], and for what stepper does not simulate yet.
    pub fn finish(&self) -> Result<Model, ModelError> {
        self.describe()?.finish(true)
    }

    /// The model before validation.
    pub(super) fn describe(&self) -> Result<Model, ModelError> {
        let mut model = self.model.clone();
        for (index, builder) in self.bodies.iter().enumerate() {
            builder.add_to(&mut model, index);
        }
        for (name, joints) in &self.tendons {
            let place = format!("tendon {name:?}");
            let joints = joints.iter().map(|(j, c)| Ok((find_joint(&model, j, &place)?, *c))).collect::<Result<_, ModelError>>()?;
            model.tendons.push(Tendon { name: name.clone(), joints });
        }
        for builder in &self.actuators {
            let actuator = builder.resolve(&model)?;
            model.actuators.push(actuator);
        }
        for (name, joint, position) in &self.sensors {
            let joint = find_joint(&model, joint, &format!("sensor {name:?}"))?;
            let kind = if *position { SensorKind::JointPos(joint) } else { SensorKind::JointVel(joint) };
            model.sensors.push(Sensor { name: name.clone(), kind });
        }
        self.add_pairs(&mut model)?;
        Ok(model)
    }

    fn add_pairs(&self, model: &mut Model) -> Result<(), ModelError> {
        for (names, friction) in &self.pairs {
            let [a, b] = names.each_ref().map(|n| find(model.geoms.iter().map(|g| &g.name), n, "geom", "pair"));
            let geoms = [a?, b?];
            let [g, h] = geoms.map(|k| &model.geoms[k]);
            let (margin, gap, restitution) = (g.margin + h.margin, g.gap + h.gap, g.restitution.max(h.restitution));
            model.pairs.push(Pair { name: String::new(), geoms, condim: 3, friction: *friction, restitution, margin, gap });
        }
        for names in &self.excludes {
            let [a, b] = names.each_ref().map(|n| find(model.bodies.iter().map(|b| &b.name), n, "body", "exclude"));
            model.excludes.push([a?, b?]);
        }
        Ok(())
    }
}

fn find<'a>(mut names: impl Iterator<Item = &'a String>, name: &str, kind: &str, place: &str) -> Result<usize, ModelError> {
    names.position(|n| n == name).ok_or_else(|| {
        let remedy = format!("name a {kind} that was added to the builder");
        ModelError::invalid(place, format!("refers to {kind} {name:?}, which does not exist"), remedy)
    })
}

fn find_joint(model: &Model, name: &str, place: &str) -> Result<usize, ModelError> {
    find(model.joints.iter().map(|j| &j.name), name, "joint", place)
}

impl BodyBuilder {
    /// A body at its parent's origin, without joints: fixed to its parent.
    pub fn new(name: &str) -> Self {
        let body = Body {
            name: name.into(),
            parent: WORLD,
            pos: [0.0; 3],
            quat: [1.0, 0.0, 0.0, 0.0],
            mass: 0.0,
            ipos: [0.0; 3],
            iquat: [1.0, 0.0, 0.0, 0.0],
            inertia: [0.0; 3],
            mocap: false,
        };
        Self { body, inertial: false, joints: vec![], geoms: vec![] }
    }

    /// Places it in its parent's frame, m.
    pub fn pos(mut self, pos: [f64; 3]) -> Self {
        self.body.pos = pos;
        self
    }

    /// Turns it in its parent's frame: quaternion (w, x, y, z).
    pub fn quat(mut self, quat: [f64; 4]) -> Self {
        self.body.quat = quat;
        self
    }

    /// Adds a joint; several act in this order.
    pub fn joint(mut self, joint: JointBuilder) -> Self {
        self.joints.push(joint);
        self
    }

    /// Adds a geom.
    pub fn geom(mut self, geom: GeomBuilder) -> Self {
        self.geoms.push(geom);
        self
    }

    /// Gives mass (kg), centre of mass (m) and principal moments (kg m^2, along the body's axes) instead of the geoms'.
    pub fn inertial(mut self, mass: f64, com: [f64; 3], moments: [f64; 3]) -> Self {
        (self.body.mass, self.body.ipos, self.body.inertia, self.inertial) = (mass, com, moments, true);
        self
    }

    /// Turns the principal axes of [`BodyBuilder::inertial`]: quaternion (w, x, y, z).
    pub fn inertial_quat(mut self, quat: [f64; 4]) -> Self {
        self.body.iquat = quat;
        self
    }

    /// Lets the user pose it; only children of the world without joints.
    pub fn mocap(mut self) -> Self {
        self.body.mocap = true;
        self
    }

    fn add_to(&self, model: &mut Model, index: usize) {
        let mut body = self.body.clone();
        if !self.inertial && index != WORLD {
            let total = self.geoms.iter().map(GeomBuilder::mass_properties).fold(MassProperties::zero(), |sum, g| sum.plus(&g));
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

impl JointBuilder {
    fn new(name: &str, kind: JointKind, axis: [f64; 3]) -> Self {
        let joint = Joint {
            name: name.into(),
            body: WORLD,
            kind,
            pos: [0.0; 3],
            axis,
            stiffness: 0.0,
            damping: 0.0,
            armature: 0.0,
            frictionloss: 0.0,
            range: None,
            actuator_force_range: None,
        };
        Self { joint, rest: None }
    }

    /// Six degrees of freedom; only for a child of the world, and alone.
    pub fn free(name: &str) -> Self {
        Self::new(name, JointKind::Free, [0.0, 0.0, 1.0])
    }

    /// Three rotations.
    pub fn ball(name: &str) -> Self {
        Self::new(name, JointKind::Ball, [0.0, 0.0, 1.0])
    }

    /// Translation along an axis of any length but 0.
    pub fn slide(name: &str, axis: [f64; 3]) -> Self {
        Self::new(name, JointKind::Slide, unit(axis))
    }

    /// Rotation about an axis of any length but 0.
    pub fn hinge(name: &str, axis: [f64; 3]) -> Self {
        Self::new(name, JointKind::Hinge, unit(axis))
    }

    /// Places its anchor in the body's frame, m.
    pub fn pos(mut self, pos: [f64; 3]) -> Self {
        self.joint.pos = pos;
        self
    }

    /// Limits it, m or rad.
    pub fn range(mut self, low: f64, high: f64) -> Self {
        self.joint.range = Some([low, high]);
        self
    }

    /// Adds viscous damping, N s/m or N m s/rad.
    pub fn damping(mut self, damping: f64) -> Self {
        self.joint.damping = damping;
        self
    }

    /// Adds a spring, N/m or N m/rad, at rest at `rest` (hinges and slides) or at the initial pose.
    pub fn spring(mut self, stiffness: f64, rest: f64) -> Self {
        self.joint.stiffness = stiffness;
        self.rest = Some(rest);
        self
    }

    /// Adds rotor inertia, kg or kg m^2.
    pub fn armature(mut self, armature: f64) -> Self {
        self.joint.armature = armature;
        self
    }

    /// Adds dry friction, N or N m.
    pub fn frictionloss(mut self, loss: f64) -> Self {
        self.joint.frictionloss = loss;
        self
    }

    /// Bounds the sum of actuator forces on it, N or N m.
    pub fn actuator_force_range(mut self, low: f64, high: f64) -> Self {
        self.joint.actuator_force_range = Some([low, high]);
        self
    }

    /// Coordinates at reset, and where the spring rests.
    fn reference(&self, body: &Body) -> (Vec<f64>, Vec<f64>) {
        match self.joint.kind {
            JointKind::Free => {
                let pose = [&body.pos[..], &body.quat[..]].concat();
                (pose.clone(), pose)
            }
            JointKind::Ball => (vec![1.0, 0.0, 0.0, 0.0], vec![1.0, 0.0, 0.0, 0.0]),
            JointKind::Slide | JointKind::Hinge => (vec![0.0], vec![self.rest.unwrap_or(0.0)]),
        }
    }
}

/// The axis with length 1, or as it is when that cannot be: [`Model::finish`] then says so.
fn unit(axis: [f64; 3]) -> [f64; 3] {
    Vector3::from(axis).try_normalize(0.0).map_or(axis, Into::into)
}

impl GeomBuilder {
    fn new(name: &str, shape: Shape) -> Self {
        let geom = Geom {
            name: name.into(),
            body: WORLD,
            shape,
            pos: [0.0; 3],
            quat: [1.0, 0.0, 0.0, 0.0],
            contype: 1,
            conaffinity: 1,
            condim: 3,
            priority: 0,
            friction: [1.0, 0.005, 0.0001],
            restitution: 0.0,
            margin: 0.0,
            gap: 0.0,
        };
        Self { geom, mass: None, density: DENSITY }
    }

    /// The half space below the frame's xy plane.
    pub fn plane(name: &str) -> Self {
        Self::new(name, Shape::Plane)
    }

    /// A ball; radius in m.
    pub fn sphere(name: &str, radius: f64) -> Self {
        Self::new(name, Shape::Sphere { radius })
    }

    /// A segment along z of twice this half length, thickened; m.
    pub fn capsule(name: &str, radius: f64, half_length: f64) -> Self {
        Self::new(name, Shape::Capsule { radius, half_length })
    }

    /// A solid cylinder along z; m.
    pub fn cylinder(name: &str, radius: f64, half_length: f64) -> Self {
        Self::new(name, Shape::Cylinder { radius, half_length })
    }

    /// An ellipsoid; semi-axes in m.
    pub fn ellipsoid(name: &str, radii: [f64; 3]) -> Self {
        Self::new(name, Shape::Ellipsoid { radii })
    }

    /// A box; half sizes in m.
    pub fn cuboid(name: &str, half: [f64; 3]) -> Self {
        Self::new(name, Shape::Box { half })
    }

    /// Places it in the body's frame, m.
    pub fn pos(mut self, pos: [f64; 3]) -> Self {
        self.geom.pos = pos;
        self
    }

    /// Turns it in the body's frame: quaternion (w, x, y, z).
    pub fn quat(mut self, quat: [f64; 4]) -> Self {
        self.geom.quat = quat;
        self
    }

    /// Gives it a mass, kg; 0 makes it a shape without mass.
    pub fn mass(mut self, mass: f64) -> Self {
        self.mass = Some(mass);
        self
    }

    /// Gives it a density, kg/m^3.
    pub fn density(mut self, density: f64) -> Self {
        (self.mass, self.density) = (None, density);
        self
    }

    /// Sets `contype` and `conaffinity`; (0, 0) collides with nothing.
    pub fn masks(mut self, contype: u32, conaffinity: u32) -> Self {
        (self.geom.contype, self.geom.conaffinity) = (contype, conaffinity);
        self
    }

    /// Sets the rows of a contact: 1 frictionless, 3 sliding friction.
    pub fn condim(mut self, condim: u8) -> Self {
        self.geom.condim = condim;
        self
    }

    /// Sets the priority of its friction and condim.
    pub fn priority(mut self, priority: i32) -> Self {
        self.geom.priority = priority;
        self
    }

    /// Sets friction: sliding (1), torsional (m), rolling (m).
    pub fn friction(mut self, friction: [f64; 3]) -> Self {
        self.geom.friction = friction;
        self
    }

    /// Sets Newton's coefficient of restitution, 0 to 1.
    pub fn restitution(mut self, restitution: f64) -> Self {
        self.geom.restitution = restitution;
        self
    }

    /// Sets the distance at which a contact begins to push, m.
    pub fn margin(mut self, margin: f64) -> Self {
        self.geom.margin = margin;
        self
    }

    /// Sets the distance beyond the margin within which a contact is reported, m.
    pub fn gap(mut self, gap: f64) -> Self {
        self.geom.gap = gap;
        self
    }

    fn mass_properties(&self) -> MassProperties {
        let g = &self.geom;
        let mass = self.mass.or_else(|| MassProperties::volume(&g.shape).map(|v| v * self.density));
        let solid = mass.and_then(|m| MassProperties::solid(&g.shape, m)).unwrap_or_else(MassProperties::zero);
        let quat = Quaternion::new(g.quat[0], g.quat[1], g.quat[2], g.quat[3]);
        solid.placed(g.pos.into(), UnitQuaternion::new_normalize(quat))
    }
}

impl ActuatorBuilder {
    fn new(name: &str, target: &str, gain: [f64; 3], bias: [f64; 3]) -> Self {
        let actuator = Actuator {
            name: name.into(),
            transmission: Transmission::Joint(0),
            gear: 1.0,
            ctrl_range: None,
            force_range: None,
            act_range: None,
            activation: Activation::None,
            gain,
            bias,
        };
        Self { actuator, target: target.into(), on_tendon: false }
    }

    /// The control is the force (N, N m) on a joint, by name.
    pub fn motor(name: &str, joint: &str) -> Self {
        Self::new(name, joint, [1.0, 0.0, 0.0], [0.0; 3])
    }

    /// The control is a position that a spring (N/m, N m/rad) and a damper (N s/m, N m s/rad) pull a joint to.
    pub fn position(name: &str, joint: &str, kp: f64, kv: f64) -> Self {
        Self::new(name, joint, [kp, 0.0, 0.0], [0.0, -kp, -kv])
    }

    /// The control is a velocity that a damper (N s/m, N m s/rad) pulls a joint to.
    pub fn velocity(name: &str, joint: &str, kv: f64) -> Self {
        Self::new(name, joint, [kv, 0.0, 0.0], [0.0, 0.0, -kv])
    }

    /// The name that was given is a tendon's, not a joint's.
    pub fn on_tendon(mut self) -> Self {
        self.on_tendon = true;
        self
    }

    /// Scales length, velocity and force.
    pub fn gear(mut self, gear: f64) -> Self {
        self.actuator.gear = gear;
        self
    }

    /// Clamps the control.
    pub fn ctrl_range(mut self, low: f64, high: f64) -> Self {
        self.actuator.ctrl_range = Some([low, high]);
        self
    }

    /// Clamps the force, N or N m.
    pub fn force_range(mut self, low: f64, high: f64) -> Self {
        self.actuator.force_range = Some([low, high]);
        self
    }

    /// Puts dynamics between control and force.
    pub fn activation(mut self, activation: Activation) -> Self {
        self.actuator.activation = activation;
        self
    }

    fn resolve(&self, model: &Model) -> Result<Actuator, ModelError> {
        let place = format!("actuator {:?}", self.actuator.name);
        let transmission = if self.on_tendon {
            Transmission::Tendon(find(model.tendons.iter().map(|t| &t.name), &self.target, "tendon", &place)?)
        } else {
            Transmission::Joint(find_joint(model, &self.target, &place)?)
        };
        Ok(Actuator { transmission, ..self.actuator.clone() })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn free_with(geom: GeomBuilder) -> Model {
        let mut scene = Model::builder("one");
        scene.body(WORLD, BodyBuilder::new("body").pos([0.0, 0.0, 1.0]).joint(JointBuilder::free("root")).geom(geom));
        scene.finish().unwrap()
    }

    #[test]
    fn geoms_give_mass_and_inertia() {
        let ball = &free_with(GeomBuilder::sphere("ball", 0.1).mass(2.0)).bodies[1];
        assert_eq!((ball.mass, ball.inertia), (2.0, [2.0 * 0.4 * 0.1 * 0.1; 3]));
        let boxed = &free_with(GeomBuilder::cuboid("box", [0.5, 0.25, 0.125]).pos([1.0, 0.0, 0.0])).bodies[1];
        assert_eq!((boxed.mass, boxed.ipos), (1000.0 * 8.0 * 0.5 * 0.25 * 0.125, [1.0, 0.0, 0.0]));
    }

    #[test]
    fn inertial_overrides_geoms() {
        let mut scene = Model::builder("one");
        let body = BodyBuilder::new("body").inertial(3.0, [0.0, 0.1, 0.0], [1.0, 2.0, 2.5]).geom(GeomBuilder::sphere("ball", 0.1));
        scene.body(WORLD, body.joint(JointBuilder::ball("socket")));
        let model = scene.finish().unwrap();
        assert_eq!((model.bodies[1].mass, model.bodies[1].inertia), (3.0, [1.0, 2.0, 2.5]));
        assert_eq!(model.qpos0, [1.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn free_bodies_start_where_they_are_placed() {
        assert_eq!(free_with(GeomBuilder::sphere("ball", 0.1)).qpos0, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn geoms_of_the_world_come_first_whenever_added() {
        let mut scene = Model::builder("order");
        scene.body(WORLD, BodyBuilder::new("a").joint(JointBuilder::free("")).geom(GeomBuilder::sphere("ball", 0.1)));
        scene.geom(WORLD, GeomBuilder::plane("floor"));
        let names: Vec<String> = scene.finish().unwrap().geoms.into_iter().map(|g| g.name).collect();
        assert_eq!(names, ["floor", "ball"]);
    }

    #[test]
    fn servos_are_affine() {
        let servo = ActuatorBuilder::position("servo", "joint", 10.0, 2.0).actuator;
        assert_eq!((servo.gain, servo.bias), ([10.0, 0.0, 0.0], [0.0, -10.0, -2.0]));
        let servo = ActuatorBuilder::velocity("servo", "joint", 2.0).actuator;
        assert_eq!((servo.gain, servo.bias), ([2.0, 0.0, 0.0], [0.0, 0.0, -2.0]));
    }

    #[test]
    fn missing_names_are_errors_that_name_both_ends() {
        let text = |scene: &ModelBuilder| scene.finish().unwrap_err().to_string();
        let base = Model::builder("empty");
        let mut scene = base.clone();
        assert!(text(scene.actuator(ActuatorBuilder::motor("push", "rail"))).contains("actuator \"push\": refers to joint \"rail\""));
        let mut scene = base.clone();
        assert!(text(scene.position_sensor("angle", "pivot")).contains("sensor \"angle\": refers to joint \"pivot\""));
        let mut scene = base.clone();
        assert!(text(scene.tendon("pull", &[("elbow", 1.0)])).contains("tendon \"pull\": refers to joint \"elbow\""));
        let mut scene = base.clone();
        assert!(text(scene.actuator(ActuatorBuilder::motor("m", "t").on_tendon())).contains("tendon \"t\""));
        let mut scene = base.clone();
        assert!(text(scene.pair("a", "b", [1.0, 0.0, 0.0])).contains("geom \"a\""));
        let mut scene = base.clone();
        assert!(text(scene.exclude("world", "b")).contains("body \"b\""));
    }
}
