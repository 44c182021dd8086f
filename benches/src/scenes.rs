//! Robot models made in code, similar to those of reinforcement learning. All numbers were chosen for the benchmarks.

use std::sync::Arc;

use stepper_core::model::{ActuatorBuilder, BodyBuilder, GeomBuilder, JointBuilder, Model, ModelBuilder, WORLD};

/// Length of a chain's link, m.
pub const LINK_LENGTH: f64 = 0.1;
/// Mass of a chain's link, kg.
pub const LINK_MASS: f64 = 0.2;
/// Moments of inertia of a chain's link about its centre of mass, kg m^2: a rod along x.
pub const LINK_MOMENTS: [f64; 3] = [2e-5, 1.8e-4, 1.8e-4];

/// Scene of a benchmark: a robot, and the number of steps before the measurement, after which its state is typical.
#[derive(Clone, Debug)]
pub struct Scene {
    /// Short name of the scene.
    pub name: &'static str,
    /// Model of the robot.
    pub model: Arc<Model>,
    /// Number of steps before the measurement. After these steps, the humanoid and the ant lie on the floor.
    pub warm_up: usize,
}

impl Scene {
    /// All scenes.
    pub fn all() -> Vec<Self> {
        vec![Self::humanoid(), Self::ant(), Self::chain(5), Self::chain(20)]
    }

    /// Scene with the robot of [`humanoid`].
    pub fn humanoid() -> Self {
        Self { name: "humanoid", model: humanoid(), warm_up: 300 }
    }

    /// Scene with the robot of [`ant`].
    pub fn ant() -> Self {
        Self { name: "ant", model: ant(), warm_up: 100 }
    }

    /// Scene with the hanging chain of [`chain`], which has the given number of links.
    pub fn chain(links: usize) -> Self {
        let name = if links == 5 { "chain-5" } else { "chain-20" };
        Self { name, model: chain(links), warm_up: 0 }
    }

    /// Initial configuration and velocity (q, v) of environment `env`, different in each environment.
    pub fn start(&self, env: usize) -> (Vec<f64>, Vec<f64>) {
        let mut q = self.model.qpos0.clone();
        for (i, x) in q.iter_mut().enumerate() {
            *x += 0.05 * noise((env * 1000 + i) as u64);
        }
        let v = (0..self.model.nv()).map(|i| 0.3 * noise((env * 1000 + 500 + i) as u64)).collect();
        (q, v)
    }

    /// Pseudo-random controls of environment `env` in the call number `call` of `step`, within the control ranges of the actuators.
    pub fn action(&self, env: usize, call: usize) -> impl Iterator<Item = f64> {
        (0..self.model.nu()).map(move |i| noise((env * 7919 + call * 104_729 + i) as u64))
    }
}

/// Humanoid with 27 degrees of freedom: a free root and 21 hinges with limits, springs, damping, armature and geared motors. Its 16
/// capsules and 3 spheres touch the floor with friction, and each other without. The time step is 5 ms.
pub fn humanoid() -> Arc<Model> {
    let mut scene = Model::builder("humanoid");
    scene.timestep(0.005).geom(WORLD, GeomBuilder::plane("floor").friction([0.8, 0.0, 0.0]));
    let trunk = BodyBuilder::new("torso").pos([0.0, 0.0, 1.32]).joint(JointBuilder::free("root"));
    let trunk = trunk.geom(limb("chest", [0.0, -0.08, 0.0], [0.0, 0.08, 0.0], 0.075)).geom(limb(
        "upper waist",
        [0.0, -0.06, -0.12],
        [0.0, 0.06, -0.12],
        0.06,
    ));
    let torso = scene.body(WORLD, trunk);
    scene.body(torso, BodyBuilder::new("head").pos([0.0, 0.0, 0.21]).geom(skin(GeomBuilder::sphere("head", 0.1))));
    let waist = BodyBuilder::new("waist")
        .pos([0.0, 0.0, -0.25])
        .joint(stiff("abdomen z", [0.0, 0.0, 1.0], [-0.8, 0.8], 20.0).pos([0.0, 0.0, 0.06]))
        .joint(stiff("abdomen y", [0.0, 1.0, 0.0], [-1.3, 0.5], 10.0).pos([0.0, 0.0, 0.06]))
        .geom(limb("waist", [0.0, -0.06, 0.0], [0.0, 0.06, 0.0], 0.06));
    let waist = scene.body(torso, waist);
    let pelvis = BodyBuilder::new("pelvis")
        .pos([0.0, 0.0, -0.16])
        .joint(stiff("abdomen x", [1.0, 0.0, 0.0], [-0.6, 0.6], 10.0).pos([0.0, 0.0, 0.09]))
        .geom(limb("pelvis", [0.0, -0.07, 0.0], [0.0, 0.07, 0.0], 0.09));
    let pelvis = scene.body(waist, pelvis);
    for name in ["abdomen z", "abdomen y", "abdomen x"] {
        motor(&mut scene, name, 40.0);
    }
    for (side, y) in [("right", -1.0), ("left", 1.0)] {
        leg(&mut scene, pelvis, side, y);
        arm(&mut scene, torso, side, y);
    }
    Arc::new(scene.finish().expect("the humanoid is a valid model"))
}

/// Adds a leg of the humanoid to the scene, on the side `y` (-1 or 1). The leg has three hinges at the hip, one at the knee, two at the
/// ankle, and two capsules under the foot.
fn leg(scene: &mut ModelBuilder, pelvis: usize, side: &str, y: f64) {
    let name = |part: &str| format!("{side} {part}");
    let thigh = BodyBuilder::new(&name("thigh"))
        .pos([0.0, 0.1 * y, -0.05])
        .joint(stiff(&name("hip x"), [-y, 0.0, 0.0], [-0.4, 0.1], 10.0))
        .joint(stiff(&name("hip z"), [0.0, 0.0, -y], [-1.0, 0.6], 10.0))
        .joint(stiff(&name("hip y"), [0.0, 1.0, 0.0], [-2.0, 0.4], 20.0))
        .geom(limb(&name("thigh"), [0.0; 3], [0.0, 0.0, -0.36], 0.06));
    let thigh = scene.body(pelvis, thigh);
    let shin = BodyBuilder::new(&name("shin"))
        .pos([0.0, 0.0, -0.42])
        .joint(loose(&name("knee"), [0.0, -1.0, 0.0], [-2.8, 0.05], 1.0).pos([0.0, 0.0, 0.01]))
        .geom(limb(&name("shin"), [0.0; 3], [0.0, 0.0, -0.32], 0.045));
    let shin = scene.body(thigh, shin);
    let foot = BodyBuilder::new(&name("foot"))
        .pos([0.0, 0.0, -0.4])
        .joint(loose(&name("ankle y"), [0.0, 1.0, 0.0], [-0.9, 0.9], 6.0).pos([0.0, 0.0, 0.07]))
        .joint(loose(&name("ankle x"), [1.0, 0.0, 0.4], [-0.9, 0.9], 3.0).pos([0.0, 0.0, 0.04]))
        .geom(limb(&name("outer sole"), [-0.07, 0.03 * y, 0.0], [0.14, 0.04 * y, 0.0], 0.027))
        .geom(limb(&name("inner sole"), [-0.07, -0.01 * y, 0.0], [0.14, -0.02 * y, 0.0], 0.027));
    scene.body(shin, foot);
    for (joint, gear) in [("hip x", 40.0), ("hip z", 40.0), ("hip y", 120.0), ("knee", 80.0), ("ankle y", 20.0), ("ankle x", 20.0)] {
        motor(scene, &name(joint), gear);
    }
}

/// Adds an arm of the humanoid to the scene, on the side `y` (-1 or 1). The arm has two hinges at the shoulder, one at the elbow, and a
/// sphere as hand.
fn arm(scene: &mut ModelBuilder, torso: usize, side: &str, y: f64) {
    let name = |part: &str| format!("{side} {part}");
    let upper = BodyBuilder::new(&name("upper arm"))
        .pos([0.0, 0.18 * y, 0.05])
        .joint(loose(&name("shoulder 1"), [2.0, -y, 1.0], [-1.2, 1.2], 1.0))
        .joint(loose(&name("shoulder 2"), [0.0, y, 1.0], [-1.2, 1.2], 1.0))
        .geom(limb(&name("upper arm"), [0.0; 3], [0.14, 0.14 * y, -0.17], 0.04));
    let upper = scene.body(torso, upper);
    let lower = BodyBuilder::new(&name("lower arm"))
        .pos([0.16, 0.16 * y, -0.19])
        .joint(loose(&name("elbow"), [0.0, -1.0, -y], [-1.5, 0.9], 0.0))
        .geom(limb(&name("lower arm"), [0.01, -0.01 * y, 0.01], [0.16, -0.14 * y, 0.14], 0.03));
    let lower = scene.body(upper, lower);
    let hand = BodyBuilder::new(&name("hand")).pos([0.18, -0.16 * y, 0.16]);
    scene.body(lower, hand.geom(skin(GeomBuilder::sphere(&name("hand"), 0.04))));
    for (joint, gear) in [("shoulder 1", 20.0), ("shoulder 2", 20.0), ("elbow", 40.0)] {
        motor(scene, &name(joint), gear);
    }
}

/// Ant with 14 degrees of freedom: a free sphere with four legs of two hinges, 12 capsules and a floor. Links are light, rotors heavy, and
/// motors strong enough for jumps. Geoms only touch the floor. The time step is 10 ms.
pub fn ant() -> Arc<Model> {
    let mut scene = Model::builder("ant");
    scene.timestep(0.01).geom(WORLD, GeomBuilder::plane("floor").masks(1, 1));
    let shell = |geom: GeomBuilder| geom.density(5.0).masks(1, 0);
    let trunk = BodyBuilder::new("trunk").pos([0.0, 0.0, 0.75]).joint(JointBuilder::free("root"));
    let trunk = scene.body(WORLD, trunk.geom(shell(GeomBuilder::sphere("trunk", 0.25))));
    for (i, (x, y)) in [(1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, -1.0)].into_iter().enumerate() {
        let out = |way: f64| [way * x, way * y, 0.0];
        let (hip, ankle) = (format!("hip {i}"), format!("ankle {i}"));
        let hinge = |name: &str, axis: [f64; 3], range: [f64; 2]| {
            JointBuilder::hinge(name, axis).range(range[0], range[1]).damping(1.0).armature(1.0)
        };
        scene.geom(trunk, shell(segment(&format!("shoulder {i}"), [0.0; 3], out(0.2), 0.08)));
        let upper = BodyBuilder::new(&format!("upper leg {i}")).pos(out(0.2)).joint(hinge(&hip, [0.0, 0.0, 1.0], [-0.5, 0.5]));
        let upper = scene.body(trunk, upper.geom(shell(segment(&format!("upper leg {i}"), [0.0; 3], out(0.2), 0.08))));
        let lower = BodyBuilder::new(&format!("lower leg {i}")).pos(out(0.2)).joint(hinge(&ankle, [-y, x, 0.0], [0.5, 1.2]));
        scene.body(upper, lower.geom(shell(segment(&format!("lower leg {i}"), [0.0; 3], out(0.4), 0.08))));
        motor(&mut scene, &hip, 150.0);
        motor(&mut scene, &ankle, 150.0);
    }
    Arc::new(scene.finish().expect("the ant is a valid model"))
}

/// Chain of rods that hangs from the world, initially straight along x. The hinge axes are perpendicular to the rods and rotated relative
/// to each other, so that the motion is not planar. There is no damping and no contact. The time step is 2 ms.
pub fn chain(links: usize) -> Arc<Model> {
    let mut scene = Model::builder("chain");
    scene.timestep(0.002);
    let mut parent = WORLD;
    for i in 0..links {
        let body = BodyBuilder::new(&format!("link {i}"))
            .pos([if i == 0 { 0.0 } else { LINK_LENGTH }, 0.0, 0.0])
            .joint(JointBuilder::hinge(&format!("hinge {i}"), chain_axis(i)))
            .inertial(LINK_MASS, [0.5 * LINK_LENGTH, 0.0, 0.0], LINK_MOMENTS);
        parent = scene.body(parent, body);
    }
    Arc::new(scene.finish().expect("the chain is a valid model"))
}

/// Unit vector of the hinge axis of link `i` of [`chain`].
pub fn chain_axis(i: usize) -> [f64; 3] {
    if i.is_multiple_of(2) { [0.0, 1.0, 0.0] } else { [0.0, 0.8, 0.6] }
}

/// Pseudo-random number in [-1, 1], the same on every machine.
pub fn noise(seed: u64) -> f64 {
    let mut x = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03;
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Hinge of the humanoid's trunk or hip, with a damping of 5 N m s/rad. `stiffness` is that of a spring, N m/rad.
fn stiff(name: &str, axis: [f64; 3], range: [f64; 2], stiffness: f64) -> JointBuilder {
    JointBuilder::hinge(name, axis).range(range[0], range[1]).damping(5.0).armature(0.01).spring(stiffness, 0.0)
}

/// Hinge of an arm, knee or ankle of the humanoid, with a damping of 0.2 N m s/rad. `stiffness` is that of a spring, N m/rad.
fn loose(name: &str, axis: [f64; 3], range: [f64; 2], stiffness: f64) -> JointBuilder {
    JointBuilder::hinge(name, axis).range(range[0], range[1]).damping(0.2).armature(0.01).spring(stiffness, 0.0)
}

fn motor(scene: &mut ModelBuilder, joint: &str, gear: f64) {
    scene.actuator(ActuatorBuilder::motor(joint, joint).gear(gear).ctrl_range(-1.0, 1.0));
}

/// Capsule geom of the humanoid between two points.
fn limb(name: &str, from: [f64; 3], to: [f64; 3], radius: f64) -> GeomBuilder {
    skin(segment(name, from, to, radius))
}

/// Returns the geom with condim 1 and friction 0.7. Contacts between two such geoms are frictionless.
fn skin(geom: GeomBuilder) -> GeomBuilder {
    geom.condim(1).friction([0.7, 0.0, 0.0])
}

/// Capsule geom between two points.
fn segment(name: &str, from: [f64; 3], to: [f64; 3], radius: f64) -> GeomBuilder {
    let d: [f64; 3] = std::array::from_fn(|k| to[k] - from[k]);
    let length = d.iter().map(|x| x * x).sum::<f64>().sqrt();
    let middle = std::array::from_fn(|k| 0.5 * (from[k] + to[k]));
    // The shortest rotation from z to d; about x if they are opposite.
    let turn = if d[2] > -length { [length + d[2], -d[1], d[0], 0.0] } else { [0.0, 1.0, 0.0, 0.0] };
    let norm = turn.iter().map(|x| x * x).sum::<f64>().sqrt();
    GeomBuilder::capsule(name, radius, 0.5 * length).pos(middle).quat(turn.map(|x| x / norm))
}
