//! Builder of models in code.

/// Declares methods of a builder that set fields and return the builder, such as `gear(gear: f64) { actuator.gear = gear }`. Semicolons
/// separate several fields.
macro_rules! setters {
    ($builder:ident $($(#[$doc:meta])* $name:ident($($argument:ident: $type:ty),*) { $($($field:ident).+ = $value:expr);+ })*) => {
        impl $builder {
            $(
                $(#[$doc])*
                pub fn $name(mut self, $($argument: $type),*) -> Self {
                    $(self.$($field).+ = $value;)+
                    self
                }
            )*
        }
    };
}

/// Declares functions that create a builder of the element `name` by the builder's function `new`, such as
/// `sphere(radius: f64) { Shape::Sphere { radius } }`. The braces have the arguments of `new` after the name.
macro_rules! constructors {
    ($builder:ident $($(#[$doc:meta])* $name:ident($($argument:ident: $type:ty),*) { $($given:expr),+ })*) => {
        impl $builder {
            $(
                $(#[$doc])*
                pub fn $name(name: &str, $($argument: $type),*) -> Self {
                    Self::new(name, $($given),+)
                }
            )*
        }
    };
}

mod actuator;
mod body;
mod equality;
mod geom;
mod joint;
mod tendon;

use crate::Softness;
use crate::softness::{ContactSpring, mixing_share};
use crate::{Description, ElementKind, HeightField, Keyframe, Medium, Mesh, Model, ModelError, Pair, Sensor, SensorKind, Site};

pub use crate::builder::actuator::ActuatorBuilder;
pub use crate::builder::body::BodyBuilder;
pub use crate::builder::equality::EqualityBuilder;
pub use crate::builder::geom::GeomBuilder;
pub use crate::builder::joint::JointBuilder;
pub use crate::builder::tendon::TendonBuilder;

/// Index of the world body.
pub const WORLD: usize = 0;

/// Builder of a [`Model`] in code. Bodies are attached to bodies, geoms give them mass, and joints let them move.
///
/// ```
/// use stepper_model::{ActuatorBuilder, BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};
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
/// let push = scene.actuator(ActuatorBuilder::motor("push", "rail").gear(10.0).ctrl_range(-1.0, 1.0));
/// scene.position_sensor("angle", "pivot");
/// let model = scene.finish()?;
///
/// assert_eq!((model.nq(), model.nv(), model.nu()), (2, 2, 1));
/// assert_eq!((model.actuator("push")?, model.body("cart")?), (push, cart));
/// assert_eq!(model.joint("pivot")?.qpos, 1..2); // its range in the configuration
/// assert_eq!(model.collision_pairs().len(), 1); // rod and floor
/// # Ok::<(), stepper_model::ModelError>(())
/// ```
///
/// Actuators, sensors, pairs and excludes refer to other elements by name. A name that does not exist is an error of
/// [`ModelBuilder::finish`]. Most methods that add an element return its index in the finished model. The other methods return the builder,
/// so that calls can be chained.
#[derive(Clone, Debug, Default)]
pub struct ModelBuilder {
    model: Description,
    bodies: Vec<BodyBuilder>,
    /// Geoms, each with the index of its body.
    geoms: Vec<(usize, GeomBuilder)>,
    actuators: Vec<ActuatorBuilder>,
    /// Sensors, each with the name of the joint that sets the index in its kind; `None` for a kind whose indices are known.
    sensors: Vec<(Sensor, Option<String>)>,
    tendons: Vec<TendonBuilder>,
    equalities: Vec<EqualityBuilder>,
    pairs: Vec<([String; 2], [f64; 3])>,
    excludes: Vec<[String; 2]>,
}

impl Model {
    /// Creates a builder of a model that has only the world body, with gravity 9.81 m/s^2 along -z and a time step of 2 ms.
    pub fn builder(name: &str) -> ModelBuilder {
        let model = Description {
            name: name.into(),
            timestep: 0.002,
            gravity: [0.0, 0.0, -9.81],
            magnetic: [0.0, -0.5, 0.0],
            ..Description::default()
        };
        ModelBuilder { model, bodies: vec![BodyBuilder::new("world")], ..ModelBuilder::default() }
    }
}

impl ModelBuilder {
    /// Sets the default time step, s.
    pub fn timestep(&mut self, seconds: f64) -> &mut Self {
        self.model.timestep = seconds;
        self
    }

    /// Sets the gravitational acceleration in the world frame, m/s^2.
    pub fn gravity(&mut self, acceleration: impl Into<[f64; 3]>) -> &mut Self {
        self.model.gravity = acceleration.into();
        self
    }

    /// Sets the fluid that surrounds the bodies: density (kg/m^3), viscosity (Pa s) and velocity in the world frame (m/s).
    pub fn medium(&mut self, density: f64, viscosity: f64, wind: [f64; 3]) -> &mut Self {
        self.model.medium = Medium { density, viscosity, wind };
        self
    }

    /// Adds a body as child of [`WORLD`] or of a body from an earlier call. Returns the index of the body.
    pub fn body(&mut self, parent: usize, mut body: BodyBuilder) -> usize {
        body.body.parent = parent;
        push(&mut self.bodies, body)
    }

    /// Adds a geom to a body or to the [`WORLD`]. A body that does not exist is an error of [`ModelBuilder::finish`].
    ///
    /// Geoms of a finished model are in the order of their bodies; [`Description::geom`] returns their index.
    pub fn geom(&mut self, body: usize, geom: GeomBuilder) -> &mut Self {
        self.geoms.push((body, geom));
        self
    }

    /// Adds a fixed tendon from pairs of joint name and coefficient: the tendon's length is a linear combination of hinge and slide
    /// positions. Returns the index of the tendon.
    pub fn tendon(&mut self, name: &str, joints: &[(&str, f64)]) -> usize {
        self.fixed_tendon(TendonBuilder::new(name, joints))
    }

    /// Adds a fixed tendon with limits, springs and other attributes. Returns its index.
    pub fn fixed_tendon(&mut self, tendon: TendonBuilder) -> usize {
        push(&mut self.tendons, tendon)
    }

    /// Adds an equality. Returns its index.
    pub fn equality(&mut self, equality: EqualityBuilder) -> usize {
        push(&mut self.equalities, equality)
    }

    /// Adds an actuator. Returns its index, which is also its index in the controls.
    pub fn actuator(&mut self, actuator: ActuatorBuilder) -> usize {
        push(&mut self.actuators, actuator)
    }

    /// Adds a sensor of the position of joint `joint`. Returns the sensor's index.
    pub fn position_sensor(&mut self, name: &str, joint: &str) -> usize {
        push(&mut self.sensors, (Sensor::ideal(name, SensorKind::JointPos(0)), Some(joint.into())))
    }

    /// Adds a sensor of the velocity of joint `joint`. Returns the sensor's index.
    pub fn velocity_sensor(&mut self, name: &str, joint: &str) -> usize {
        push(&mut self.sensors, (Sensor::ideal(name, SensorKind::JointVel(0)), Some(joint.into())))
    }

    /// Adds a site to a body or to the [`WORLD`]. Returns its index, for use in [`SensorKind`]. A body that does not exist is an error of
    /// [`ModelBuilder::finish`].
    pub fn site(&mut self, body: usize, mut site: Site) -> usize {
        site.body = body;
        push(&mut self.model.sites, site)
    }

    /// Adds a sensor of any kind. The indices in `kind` must be indices of elements in the finished model. Returns the sensor's index.
    pub fn sensor(&mut self, name: &str, kind: SensorKind) -> usize {
        push(&mut self.sensors, (Sensor::ideal(name, kind), None))
    }

    /// Adds an explicit pair: two geoms that collide regardless of filters. `friction` has the sliding, torsional (m) and rolling (m)
    /// friction coefficients. Returns the index of the pair.
    pub fn pair(&mut self, geom_a: &str, geom_b: &str, friction: [f64; 3]) -> usize {
        push(&mut self.pairs, ([geom_a.into(), geom_b.into()], friction))
    }

    /// Disables collisions between the geoms of body `body_a` and the geoms of body `body_b`.
    pub fn exclude(&mut self, body_a: &str, body_b: &str) -> &mut Self {
        self.excludes.push([body_a.into(), body_b.into()]);
        self
    }

    /// Adds a mesh for [`GeomBuilder::mesh`]: vertices in m, and faces counter-clockwise seen from outside. Only concave geoms need the
    /// faces.
    pub fn mesh(&mut self, name: &str, vertices: &[[f64; 3]], faces: &[[u32; 3]]) -> &mut Self {
        self.model.meshes.push(Mesh { name: name.into(), vertices: vertices.to_vec(), faces: faces.to_vec() });
        self
    }

    /// Adds a height field for [`GeomBuilder::height_field`].
    pub fn height_field(&mut self, field: HeightField) -> &mut Self {
        self.model.height_fields.push(field);
        self
    }

    /// Adds a keyframe: a named state for resets. Returns its index.
    pub fn keyframe(&mut self, keyframe: Keyframe) -> usize {
        push(&mut self.model.keyframes, keyframe)
    }

    /// Checks the scene and returns the model.
    ///
    /// # Errors
    /// [`ModelError`] if a name does not exist, if [`Description::finish`] rejects the scene, or if an element is not simulated yet.
    pub fn finish(&self) -> Result<Model, ModelError> {
        self.describe()?.finish(true)
    }

    /// Converts the builder to a description, before the checks.
    pub(super) fn describe(&self) -> Result<Description, ModelError> {
        let mut model = self.model.clone();
        let mut bodies = self.bodies.clone();
        for (body, geom) in &self.geoms {
            let count = bodies.len();
            let owner = bodies.get_mut(*body).ok_or_else(|| {
                let what = format!("is fixed to body {body}, and the builder has {count} bodies");
                ModelError::invalid(format!("geom {:?}", geom.geom.name), what, "give WORLD, or an index that the builder's body() gave")
            })?;
            owner.geoms.push(geom.clone());
        }
        for (index, builder) in bodies.iter().enumerate() {
            builder.add_to(&mut model, index);
        }
        model.tendons = self.tendons.iter().map(|tendon| tendon.resolve(&model)).collect::<Result<_, _>>()?;
        model.equalities = self.equalities.iter().map(|equality| equality.resolve(&model)).collect::<Result<_, _>>()?;
        model.actuators = self.actuators.iter().map(|actuator| actuator.resolve(&model)).collect::<Result<_, _>>()?;
        for (mut sensor, joint) in self.sensors.iter().cloned() {
            if let (Some(joint), SensorKind::JointPos(index) | SensorKind::JointVel(index)) = (joint, &mut sensor.kind) {
                *index = find(&model, ElementKind::Joint, &joint, &format!("sensor {:?}", sensor.name))?;
            }
            model.sensors.push(sensor);
        }
        self.add_pairs(&mut model)?;
        Ok(model)
    }

    fn add_pairs(&self, model: &mut Description) -> Result<(), ModelError> {
        for (names, friction) in &self.pairs {
            let [a, b] = names.each_ref().map(|n| find(model, ElementKind::Geom, n, "pair"));
            let geoms = [a?, b?];
            let [g, h] = geoms.map(|k| &model.geoms[k]);
            let (margin, gap, restitution) = (g.margin + h.margin, g.gap + h.gap, g.restitution.max(h.restitution));
            let condim = g.condim.max(h.condim);
            let softness = Softness::mix(g.softness, h.softness, mixing_share([g.solmix, h.solmix]));
            let (friction, anisotropy, spring) = (*friction, [1.0; 2], ContactSpring::in_series([g.spring, h.spring]));
            let pair = Pair { geoms, condim, friction, restitution, margin, gap, softness, anisotropy, spring, ..Pair::default() };
            model.pairs.push(pair);
        }
        for names in &self.excludes {
            let [a, b] = names.each_ref().map(|n| find(model, ElementKind::Body, n, "exclude"));
            model.excludes.push([a?, b?]);
        }
        Ok(())
    }
}

/// Appends an element to a list. Returns the index of the element.
fn push<T>(list: &mut Vec<T>, element: T) -> usize {
    list.push(element);
    list.len() - 1
}

/// Index of the element of the kind `kind` with the name `name`. An error has the label `place` of the element that refers to it.
fn find(model: &Description, kind: ElementKind, name: &str, place: &str) -> Result<usize, ModelError> {
    kind.names(model).iter().position(|known| *known == name).ok_or_else(|| {
        let kind = kind.name();
        let remedy = format!("name a {kind} that was added to the builder");
        ModelError::invalid(place, format!("refers to {kind} {name:?}, which does not exist"), remedy)
    })
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
        let names: Vec<String> = scene.finish().unwrap().geoms.iter().map(|g| g.name.clone()).collect();
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
        let text = |add: &dyn Fn(&mut ModelBuilder)| {
            let mut scene = Model::builder("empty");
            add(&mut scene);
            scene.finish().unwrap_err().to_string()
        };
        let motor = |target: &str| ActuatorBuilder::motor("push", target);
        assert!(text(&|s| _ = s.actuator(motor("rail"))).contains("actuator \"push\": refers to joint \"rail\""));
        assert!(text(&|s| _ = s.position_sensor("angle", "pivot")).contains("sensor \"angle\": refers to joint \"pivot\""));
        assert!(text(&|s| _ = s.tendon("pull", &[("elbow", 1.0)])).contains("tendon \"pull\": refers to joint \"elbow\""));
        assert!(text(&|s| _ = s.actuator(motor("t").on_tendon())).contains("tendon \"t\""));
        assert!(text(&|s| _ = s.pair("a", "b", [1.0, 0.0, 0.0])).contains("geom \"a\""));
        assert!(text(&|s| _ = s.exclude("world", "b")).contains("body \"b\""));
        let error = text(&|s| _ = s.geom(3, GeomBuilder::plane("floor")));
        assert!(error.contains("geom \"floor\": is fixed to body 3, and the builder has 1"), "{error}");
    }
}
