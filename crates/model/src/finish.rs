//! Checks that turn a description into a finished model.

mod check;
mod element;
mod inertia;
mod scope;
mod sensors;

pub(crate) use check::parameters as check_parameters;
pub(crate) use element::{Checked, Element};
pub(crate) use inertia::check as check_inertia;

use crate::hulls::Hulls;
use crate::{Description, EqualityKind, JointKind, Model, ModelError, label};

/// Largest deviation of the norm of a quaternion or axis from 1 that counts as rounding in the source file. Vectors with such a deviation
/// are normalised.
const SLOPPY: f64 = 1e-3;

/// Largest deviation of a norm from 1 at which a vector counts as normalised, a few rounding errors. Such vectors do not change, so that
/// finishing a finished model changes no bit.
const EXACT: f64 = 1e-14;

impl Description {
    /// Checks the description and returns the model. Vectors whose norm is 1 within rounding are normalised.
    ///
    /// Elements that are not simulated yet are an error if `strict` is true. Otherwise they are left out and added to
    /// [`Description::omitted`].
    ///
    /// # Errors
    /// [`ModelError::Invalid`] for the first invalid value, with the element and the remedy; [`ModelError::Unsupported`] with all elements
    /// that change the motion and are not simulated.
    pub fn finish(self, strict: bool) -> Result<Model, ModelError> {
        self.finish_with(strict, &Hulls::default())
    }

    /// Checks the description like [`Description::finish`], which takes the convex hulls of meshes that are in `hulls` from there.
    pub(super) fn finish_with(self, strict: bool, hulls: &Hulls) -> Result<Model, ModelError> {
        let Model { description: mut model, hulls } = self.check(hulls)?;
        model.omitted.retain(|o| !scope::is_own(o));
        model.omitted.extend(scope::not_simulated(&model));
        let missing: Vec<_> = model.omitted.iter().filter(|o| o.changes_motion).cloned().collect();
        if strict && !missing.is_empty() { Err(ModelError::Unsupported(missing)) } else { Ok(Model { description: model, hulls }) }
    }

    /// Checks the description like [`Description::finish`], but does not search for elements that are not simulated. The search was done
    /// when the model was first finished.
    pub(super) fn check(mut self, hulls: &Hulls) -> Result<Model, ModelError> {
        check::structure(&self)?;
        self.normalise()?;
        let hulls = check::values(&self, hulls)?;
        inertia::check(&self)?;
        Ok(Model { description: self, hulls })
    }

    fn normalise(&mut self) -> Result<(), ModelError> {
        for (i, body) in self.bodies.iter_mut().enumerate() {
            let place = format!("body {:?}", label(&body.name, i));
            unit(&mut body.quat, &place, "quaternion")?;
            unit(&mut body.iquat, &place, "quaternion of the principal axes")?;
        }
        for (i, geom) in self.geoms.iter_mut().enumerate() {
            unit(&mut geom.quat, &format!("geom {:?}", label(&geom.name, i)), "quaternion")?;
        }
        for (i, site) in self.sites.iter_mut().enumerate() {
            unit(&mut site.quat, &format!("site {:?}", label(&site.name, i)), "quaternion")?;
        }
        normalise_welds(self)?;
        let addresses = self.joint_addresses();
        for (i, joint) in self.joints.iter_mut().enumerate() {
            let place = format!("joint {:?}", label(&joint.name, i));
            let q = addresses[i].0;
            let rotation = match joint.kind {
                JointKind::Free => q + 3..q + 7,
                JointKind::Ball => q..q + 4,
                JointKind::Slide | JointKind::Hinge => {
                    unit(&mut joint.axis, &place, "axis")?;
                    continue;
                }
            };
            unit(&mut self.qpos0[rotation.clone()], &place, "quaternion in qpos0")?;
            unit(&mut self.qpos_spring[rotation.clone()], &place, "quaternion in qpos_spring")?;
            for (k, key) in self.keyframes.iter_mut().enumerate() {
                let what = format!("quaternion in qpos of keyframe {:?}", label(&key.name, k));
                unit(&mut key.qpos[rotation.clone()], &place, &what)?;
            }
        }
        Ok(())
    }
}

/// Normalises the relative orientations of all welds.
pub(crate) fn normalise_welds(model: &mut Description) -> Result<(), ModelError> {
    for (i, equality) in model.equalities.iter_mut().enumerate() {
        if let EqualityKind::Weld { relpose, .. } = &mut equality.kind {
            unit(relpose, &format!("equality {:?}", label(&equality.name, i)), "quaternion relpose")?;
        }
    }
    Ok(())
}

/// Normalises a vector whose norm is 1 within rounding. Any other vector is an error. The error contains `place`, the label of the element,
/// and `what`, the name of the vector.
fn unit(x: &mut [f64], place: &str, what: &str) -> Result<(), ModelError> {
    let length = x.iter().map(|v| v * v).sum::<f64>().sqrt();
    let off = (length - 1.0).abs();
    if off <= SLOPPY {
        if off > EXACT {
            x.iter_mut().for_each(|v| *v /= length);
        }
        return Ok(());
    }
    let remedy = "give one of length 1";
    Err(ModelError::invalid(place, format!("{what} {x:?} has length {length}"), remedy))
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::*;
    use proptest::prelude::*;

    /// Scene with one element of every supported kind.
    pub(crate) fn rich() -> Description {
        rich_model().into_description()
    }

    /// Finished model with one element of every supported kind.
    pub(crate) fn rich_model() -> Model {
        let mut scene = Model::builder("rich");
        scene.timestep(0.001).geom(WORLD, GeomBuilder::plane("floor").restitution(0.5));
        let ball = BodyBuilder::new("ball").pos([1.0, 0.0, 1.0]).joint(JointBuilder::free("root").damping(0.01));
        scene.body(WORLD, ball.geom(GeomBuilder::sphere("ball", 0.1).mass(0.5)));
        let hinge = JointBuilder::hinge("shoulder", [0.0, 1.0, 0.0]).range(-1.0, 1.0).spring(2.0, 0.1).damping(0.2).frictionloss(0.1);
        let arm =
            scene.body(WORLD, BodyBuilder::new("arm").pos([0.0, 0.0, 2.0]).joint(hinge).geom(GeomBuilder::capsule("upper", 0.05, 0.3)));
        let slide = JointBuilder::slide("reach", [0.0, 0.0, 1.0]).armature(0.1).actuator_force_range(-5.0, 5.0);
        scene.body(arm, BodyBuilder::new("tool").joint(slide).geom(GeomBuilder::sphere("tip", 0.05).pos([0.0, 0.0, -0.4])));
        scene.body(
            arm,
            BodyBuilder::new("lamp").joint(JointBuilder::ball("socket")).geom(GeomBuilder::cuboid("shade", [0.1; 3]).masks(0, 0)),
        );
        scene.body(arm, BodyBuilder::new("plate").geom(GeomBuilder::sphere("rivet", 0.01)));
        scene.body(WORLD, BodyBuilder::new("hand").mocap().geom(GeomBuilder::sphere("palm", 0.05)));
        let belt = TendonBuilder::new("belt", &[("shoulder", 1.0), ("reach", -0.5)]).range(-3.0, 3.0).stiffness(0.5).damping(0.1);
        scene.fixed_tendon(belt.armature(0.01).frictionloss(0.02));
        scene.equality(EqualityBuilder::connect("pin", ["lamp", "world"], [[0.1, 0.0, 0.0], [0.1, 0.0, 2.0]]).inactive());
        scene.equality(EqualityBuilder::weld("grip", ["ball", "hand"], [[0.0; 3]; 2], [1.0, 0.0, 0.0, 0.0]).soft(100.0, 1.0));
        scene.equality(EqualityBuilder::joint("couple", "reach", Some("shoulder"), [0.0, 0.5, 0.0, 0.0, 0.0]).inactive());
        scene
            .actuator(ActuatorBuilder::position("servo", "shoulder", 20.0, 1.0).ctrl_range(-1.0, 1.0).activation(Activation::Filter(0.05)));
        scene.actuator(ActuatorBuilder::motor("pull", "belt").on_tendon().gear(3.0).force_range(-2.0, 2.0));
        scene.position_sensor("angle", "shoulder");
        scene.velocity_sensor("rate", "reach");
        scene.pair("ball", "palm", [0.3, 0.0, 0.0]);
        scene.exclude("ball", "tool");
        let (qpos, qvel) = ([1.0, 0.0, 0.1, 1.0, 0.0, 0.0, 0.0, 0.5, 0.1, 1.0, 0.0, 0.0, 0.0].to_vec(), vec![0.0; 11]);
        scene.keyframe(Keyframe { name: "home".into(), time: 0.0, qpos, qvel, act: vec![0.1], ctrl: vec![0.1, 0.0] });
        scene.finish().unwrap()
    }

    /// Mesh with the four vertices of a tetrahedron and one of its faces.
    fn rock() -> Mesh {
        let vertices = vec![[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1], [-0.1; 3]];
        Mesh { name: "rock".into(), vertices, faces: vec![[0, 1, 2]] }
    }

    /// Scene of [`rich`] in which the geoms "ball" and "rivet" are hollow meshes. They could touch, which is not supported.
    pub(crate) fn hollow() -> Description {
        let mut model = rich();
        let shape = Shape::Mesh { asset: "rock".into(), concave: true };
        model.meshes.push(rock());
        (model.geoms[1].shape, model.geoms[5].shape) = (shape.clone(), shape);
        model
    }

    /// Checks that the rich model is rejected after `change`, with an error that contains all of `parts`.
    fn refused(change: impl FnOnce(&mut Description), parts: &[&str]) {
        let mut model = rich();
        change(&mut model);
        let error = model.finish(true).expect_err(&format!("{parts:?} was accepted"));
        let text = error.to_string();
        assert!(matches!(error, ModelError::Invalid { .. }), "{text}");
        assert!(parts.iter().all(|p| text.contains(p)), "{parts:?} in {text:?}");
        assert!(text.matches("; ").count() >= 1, "no remedy in {text:?}");
    }

    #[test]
    fn the_scene() {
        refused(|m| m.timestep = 0.0, &["timestep", "0 s"]);
        refused(|m| m.timestep = f64::NAN, &["timestep", "NaN"]);
        refused(|m| m.gravity[1] = f64::INFINITY, &["gravity", "inf"]);
        refused(|m| m.bodies.clear(), &["world"]);
        refused(|m| m.qpos0.truncate(3), &["qpos0", "length 3", "13"]);
        refused(|m| m.qpos_spring.push(0.0), &["qpos_spring", "length 14", "13"]);
        refused(|m| m.qpos0[7] = f64::NAN, &["qpos0", "NaN"]);
        refused(|m| m.excludes.push([1, 77]), &["exclude", "77"]);
        refused(|m| m.bodies[3].name = "arm".into(), &["body \"arm\"", "name"]);
    }

    #[test]
    fn bodies() {
        refused(|m| m.bodies[2].parent = 5, &["body \"arm\"", "parent", "5"]);
        refused(|m| m.bodies[2].pos[0] = f64::NAN, &["body \"arm\"", "pos", "NaN"]);
        refused(|m| m.bodies[2].mass = -1.0, &["body \"arm\"", "mass", "-1"]);
        refused(|m| m.bodies[2].inertia[2] = -0.5, &["body \"arm\"", "inertia", "-0.5"]);
        refused(|m| m.bodies[2].inertia = [1.0, 1.0, 2.1], &["body \"arm\"", "triangle", "2.1"]);
        refused(|m| m.bodies[2].quat = [0.0; 4], &["body \"arm\"", "quaternion", "length 0"]);
        refused(|m| m.bodies[2].quat = [2.0, 0.0, 0.0, 0.0], &["body \"arm\"", "length 2"]);
        refused(|m| m.bodies[2].iquat[0] = f64::NAN, &["body \"arm\"", "principal", "NaN"]);
        refused(|m| m.bodies[6].parent = 1, &["body \"hand\"", "mocap", "world"]);
        refused(|m| m.bodies[2].mocap = true, &["body \"arm\"", "mocap", "joint"]);
        refused(|m| m.bodies[0].mocap = true, &["body \"world\"", "mocap"]);
    }

    #[test]
    fn joints() {
        refused(|m| m.joints[1].body = 77, &["joint \"shoulder\"", "77"]);
        refused(|m| m.joints[0].body = 0, &["joint \"root\"", "world"]);
        refused(|m| m.joints[1].body = 4, &["joint \"reach\"", "order"]);
        refused(|m| m.bodies[1].parent = 1, &["body \"ball\"", "parent"]);
        refused(|m| m.joints[1].axis = [0.0; 3], &["joint \"shoulder\"", "axis", "length 0"]);
        refused(|m| m.joints[1].range = Some([1.0, -1.0]), &["joint \"shoulder\"", "range", "the lower bound above the upper bound"]);
        refused(|m| m.joints[1].range = Some([0.0, f64::INFINITY]), &["joint \"shoulder\"", "range", "inf"]);
        refused(|m| m.joints[0].range = Some([0.0, 1.0]), &["joint \"root\"", "range", "free"]);
        refused(|m| m.joints[1].damping = -0.1, &["joint \"shoulder\"", "damping", "-0.1"]);
        refused(|m| m.joints[1].armature = -0.1, &["joint \"shoulder\"", "armature", "-0.1"]);
        refused(|m| m.joints[1].frictionloss = f64::NAN, &["joint \"shoulder\"", "frictionloss", "NaN"]);
        refused(|m| m.joints[1].stiffness = f64::NAN, &["joint \"shoulder\"", "stiffness", "NaN"]);
        refused(|m| m.joints[2].actuator_force_range = Some([1.0, 0.0]), &["joint \"reach\"", "the lower bound above the upper bound"]);
        refused(|m| m.qpos0[3] = 0.5, &["joint \"root\"", "quaternion in qpos0", "0.5"]);
        refused(|m| m.keyframes[0].qpos[9] = 0.0, &["joint \"socket\"", "keyframe \"home\"", "length 0"]);
    }

    #[test]
    fn free_joints_stand_alone_under_the_world() {
        let mut scene = Model::builder("free");
        let base = scene.body(WORLD, BodyBuilder::new("base").joint(JointBuilder::free("a")).geom(GeomBuilder::sphere("s", 0.1)));
        let mut nested = scene.clone();
        nested.body(base, BodyBuilder::new("pod").joint(JointBuilder::free("b")).geom(GeomBuilder::sphere("t", 0.1)));
        let text = nested.finish().unwrap_err().to_string();
        assert!(text.contains("joint \"b\"") && text.contains("\"pod\"") && text.contains("world"), "{text}");
        let both = BodyBuilder::new("pod").joint(JointBuilder::free("b")).joint(JointBuilder::hinge("c", [1.0, 0.0, 0.0]));
        scene.body(WORLD, both.geom(GeomBuilder::sphere("t", 0.1)));
        let text = scene.finish().unwrap_err().to_string();
        assert!(text.contains("joint \"b\"") && text.contains("remove the other joints"), "{text}");
    }

    #[test]
    fn geoms_and_pairs() {
        refused(|m| m.geoms[1].body = 77, &["geom \"ball\"", "77"]);
        refused(|m| m.geoms.swap(1, 2), &["geom \"ball\"", "order"]);
        refused(|m| m.geoms[1].shape = Shape::Sphere { radius: 0.0 }, &["geom \"ball\"", "radius", "0 m"]);
        refused(|m| m.geoms[1].shape = Shape::Box { half: [1.0, -1.0, 1.0] }, &["geom \"ball\"", "half size", "-1"]);
        refused(|m| m.geoms[1].quat = [0.5; 4].map(|x| x * 3.0), &["geom \"ball\"", "length 3"]);
        refused(|m| m.geoms[1].pos[2] = f64::NAN, &["geom \"ball\"", "pos", "NaN"]);
        refused(|m| m.geoms[1].condim = 2, &["geom \"ball\"", "condim", "2"]);
        refused(|m| m.geoms[1].friction[0] = -1.0, &["geom \"ball\"", "friction", "-1"]);
        refused(|m| m.geoms[1].restitution = 1.5, &["geom \"ball\"", "restitution", "1.5"]);
        refused(|m| m.geoms[1].margin = f64::NAN, &["geom \"ball\"", "margin", "NaN"]);
        refused(|m| m.geoms[1].gap = -0.1, &["geom \"ball\"", "gap", "-0.1"]);
        refused(|m| m.pairs[0].geoms[1] = 77, &["pair", "77"]);
        refused(|m| m.pairs[0].geoms = [1, 1], &["pair", "both elements are geom"]);
        refused(|m| m.pairs[0].condim = 0, &["pair", "condim"]);
        refused(|m| m.pairs[0].restitution = -0.1, &["pair", "restitution", "-0.1"]);
    }

    #[test]
    fn meshes_and_height_fields() {
        let mesh = |vertices: &[[f64; 3]]| Mesh { name: "rock".into(), vertices: vertices.into(), faces: vec![] };
        let corners = [[0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.1], [-0.1; 3]];
        let shape = |concave: bool| Shape::Mesh { asset: "rock".into(), concave };
        let with = |m: &mut Description, given: Mesh, concave: bool| {
            m.meshes = vec![given];
            m.geoms[1].shape = shape(concave);
        };
        refused(|m| m.geoms[1].shape = shape(false), &["geom \"ball\"", "mesh \"rock\"", "does not exist"]);
        refused(|m| with(m, mesh(&corners[..3]), false), &["geom \"ball\"", "mesh \"rock\"", "fewer than four points"]);
        refused(|m| with(m, mesh(&[[0.0; 3]; 9]), false), &["mesh \"rock\"", "one plane"]);
        refused(|m| with(m, mesh(&corners), true), &["mesh \"rock\"", "no faces", "concave"]);
        refused(|m| m.meshes = vec![mesh(&[[f64::NAN; 3]])], &["mesh \"rock\"", "vertex 0", "NaN"]);
        refused(|m| m.meshes = vec![Mesh { faces: vec![[0, 1, 4]], ..mesh(&corners) }], &["mesh \"rock\"", "face 0", "4 vertices"]);
        let field = |shape, n: usize| HeightField { name: "hill".into(), shape, half: [1.0; 2], elevation: vec![0.0; n], base: 0.1 };
        refused(|m| m.height_fields = vec![field([2, 1], 2)], &["height field \"hill\"", "1 columns"]);
        refused(|m| m.height_fields = vec![field([2, 2], 5)], &["height field \"hill\"", "length 5", "4 numbers"]);
        let mut model = rich();
        with(&mut model, mesh(&corners), false);
        assert!(model.finish(true).is_ok());
    }

    #[test]
    fn tendons_actuators_sensors_keyframes() {
        refused(|m| m.tendons[0].joints[0].0 = 77, &["tendon \"belt\"", "77"]);
        refused(|m| m.tendons[0].joints[0].0 = 0, &["tendon \"belt\"", "joint \"root\"", "free"]);
        refused(|m| m.tendons[0].joints[0].1 = f64::NAN, &["tendon \"belt\"", "NaN"]);
        refused(|m| m.actuators[0].transmission = Transmission::Joint(77), &["actuator \"servo\"", "77"]);
        refused(|m| m.actuators[0].transmission = Transmission::Joint(3), &["actuator \"servo\"", "joint \"socket\"", "ball"]);
        refused(|m| m.actuators[0].transmission = Transmission::Tendon(9), &["actuator \"servo\"", "tendon", "9"]);
        refused(|m| m.actuators[0].activation = Activation::Filter(0.0), &["actuator \"servo\"", "time constant", "0 s"]);
        refused(|m| m.actuators[0].gear = f64::NAN, &["actuator \"servo\"", "gear"]);
        refused(|m| m.actuators[0].gain[1] = f64::NAN, &["actuator \"servo\"", "gain"]);
        refused(
            |m| m.actuators[0].ctrl_range = Some([1.0, 0.0]),
            &["actuator \"servo\"", "ctrl_range", "the lower bound above the upper bound"],
        );
        refused(|m| m.actuators[0].force_range = Some([f64::NAN, 0.0]), &["actuator \"servo\"", "force_range", "NaN"]);
        refused(|m| m.sensors[0].kind = SensorKind::JointPos(77), &["sensor \"angle\"", "77"]);
        refused(|m| m.sensors[0].kind = SensorKind::JointVel(0), &["sensor \"angle\"", "joint \"root\"", "free"]);
        refused(|m| m.keyframes[0].qvel.truncate(1), &["keyframe \"home\"", "qvel", "length 1", "11"]);
        refused(|m| m.keyframes[0].ctrl[0] = f64::NAN, &["keyframe \"home\"", "ctrl", "NaN"]);
    }

    #[test]
    fn what_moves_needs_inertia() {
        let weightless = |m: &mut Description, b: usize| (m.bodies[b].mass, m.bodies[b].inertia) = (0.0, [0.0; 3]);
        refused(|m| weightless(m, 1), &["body \"ball\"", "joint \"root\"", "mass", "armature"]);
        refused(|m| weightless(m, 4), &["body \"lamp\"", "joint \"socket\""]);
        // A child with mass or rotor inertia suffices.
        let mut model = rich();
        weightless(&mut model, 3);
        assert!(model.clone().finish(true).is_ok(), "the slide has armature");
        weightless(&mut model, 2);
        assert!(model.finish(true).is_ok(), "the rivet is welded to the arm");
    }

    #[test]
    fn two_joints_with_one_motion_need_inertia_between_them() {
        let chain = |middle: f64| {
            let mut scene = Model::builder("coaxial");
            let hinge = |name: &str| JointBuilder::hinge(name, [0.0, 1.0, 0.0]);
            let a = scene.body(WORLD, BodyBuilder::new("a").joint(hinge("first")).geom(GeomBuilder::sphere("s", 0.1).mass(middle)));
            scene.body(a, BodyBuilder::new("b").joint(hinge("second")).geom(GeomBuilder::sphere("t", 0.1)));
            scene.finish()
        };
        assert!(chain(1e-6).is_ok());
        let text = chain(0.0).unwrap_err().to_string();
        assert!(
            text.contains("body \"a\"") && text.contains("joint \"first\" and \"second\" can move without moving any inertia"),
            "{text}"
        );
        assert!(!text.contains("moves nothing"), "{text}");
        // Two hinges on one body: no body is between them, and the armature of one determines the motion.
        let twins = |armature: f64| {
            let mut scene = Model::builder("twins");
            let hinge = |name: &str| JointBuilder::hinge(name, [0.0, 1.0, 0.0]);
            let body = BodyBuilder::new("a").joint(hinge("first").armature(armature)).joint(hinge("second"));
            scene.body(WORLD, body.geom(GeomBuilder::sphere("s", 0.1).mass(4.0)));
            scene.finish()
        };
        assert!(twins(0.01).is_ok());
        assert!(twins(0.0).unwrap_err().to_string().contains("armature"));
        // The cross of a universal joint may have no mass, because its axes differ.
        let mut scene = Model::builder("universal");
        let cross = scene.body(WORLD, BodyBuilder::new("cross").joint(JointBuilder::hinge("x", [1.0, 0.0, 0.0])));
        scene.body(cross, BodyBuilder::new("bob").joint(JointBuilder::hinge("y", [0.0, 1.0, 0.0])).geom(GeomBuilder::sphere("t", 0.1)));
        assert!(scene.finish().is_ok());
    }

    fn kinds(model: &Description) -> Vec<(&str, &str)> {
        model.omitted.iter().map(|o| (o.kind.as_str(), o.name.as_str())).collect()
    }

    #[test]
    fn equalities() {
        let connect = |bodies, anchors| EqualityKind::Connect { bodies, anchors };
        refused(|m| m.equalities[0].kind = connect([1, 77], [[0.0; 3]; 2]), &["equality \"pin\"", "body 77"]);
        refused(|m| m.equalities[0].kind = connect([2, 2], [[0.0; 3]; 2]), &["equality \"pin\"", "both elements are body \"arm\""]);
        refused(|m| m.equalities[0].kind = connect([1, 2], [[f64::NAN; 3], [0.0; 3]]), &["equality \"pin\"", "NaN"]);
        refused(|m| m.equalities[1].stiffness = -1.0, &["equality \"grip\"", "stiffness", "-1"]);
        refused(|m| m.equalities[1].damping = f64::NAN, &["equality \"grip\"", "damping", "NaN"]);
        let coupling = |joint, other| EqualityKind::Joint { joint, other, polycoef: [0.0; 5] };
        refused(|m| m.equalities[2].kind = coupling(0, None), &["equality \"couple\"", "joint \"root\"", "free"]);
        refused(|m| m.equalities[2].kind = coupling(1, Some(1)), &["equality \"couple\"", "both elements are joint \"shoulder\""]);
        let tendons = EqualityKind::Tendon { tendon: 0, other: Some(3), polycoef: [0.0; 5] };
        refused(|m| m.equalities[2].kind = tendons, &["equality \"couple\"", "tendon 3"]);
        refused(|m| m.equalities[1].name = "pin".into(), &["equality \"pin\"", "same name"]);
        refused(|m| m.tendons[0].range = Some([1.0, 0.0]), &["tendon \"belt\"", "range", "the lower bound above the upper bound"]);
        refused(|m| m.tendons[0].stiffness = -1.0, &["tendon \"belt\"", "stiffness", "-1"]);
    }

    #[test]
    fn what_is_not_simulated_is_listed_by_kind_and_name() {
        let mut model = hollow();
        model.omitted.push(Omission { kind: "flex".into(), name: "cloth".into(), reason: "r".into(), changes_motion: true });
        model.omitted.push(Omission { kind: "sensor gyro".into(), name: "imu".into(), reason: "r".into(), changes_motion: false });
        let Err(ModelError::Unsupported(all)) = model.clone().finish(true) else { panic!("accepted") };
        let found: Vec<(&str, &str)> = all.iter().map(|o| (o.kind.as_str(), o.name.as_str())).collect();
        assert_eq!(found, [("flex", "cloth"), ("collision", "rivet")]);
        assert!(all[1].reason.contains("this mesh would pass through mesh \"ball\""), "{}", all[1].reason);
        let loose = model.finish(false).unwrap();
        assert_eq!(loose.omitted.len(), 3);
        assert_eq!(loose.clone().into_description().finish(false).unwrap(), loose, "finishing twice changes nothing");
    }

    #[test]
    fn a_repaired_model_forgets_what_was_omitted() {
        let mut model = hollow().finish(false).unwrap().into_description();
        assert_eq!(kinds(&model), [("collision", "rivet")]);
        model.geoms[5].shape = rich().geoms[5].shape.clone();
        assert!(model.finish(true).unwrap().omitted.is_empty());
    }

    proptest! {
        #[test]
        fn quaternions_near_unit_are_normalised_once(q in any::<[i16; 4]>(), off in -9e-4..9e-4) {
            let q = q.map(|x| f64::from(x) + 0.5);
            let length = q.iter().map(|x| x * x).sum::<f64>().sqrt();
            let mut model = rich();
            model.bodies[2].quat = q.map(|x| x / length * (1.0 + off));
            let once = model.finish(true).unwrap();
            let length = once.bodies[2].quat.iter().map(|x| x * x).sum::<f64>().sqrt();
            prop_assert!((length - 1.0).abs() <= super::EXACT);
            prop_assert_eq!(once.clone().into_description().finish(true).unwrap().to_bytes(), once.to_bytes());
        }
    }
}
