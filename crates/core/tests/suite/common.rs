//! Models, inputs and helper functions that several tests share.
#![allow(dead_code, reason = "each test uses its own part")]

use std::sync::Arc;

use stepper_core::model::{
    ActuatorBuilder, BodyBuilder, ContactField, ContactReduction, ContactSide, EqualityBuilder, FrameReading, GeomBuilder, JointBuilder,
    Model, ModelBuilder, Object, Quantity, RayField, Sensor, SensorKind, Shape, Site, TendonBuilder, WORLD,
};
use stepper_core::{ActuatorSpec, Field, Level, Motor, Options, Outcome, Precision, Servo, Simulation, StepInputs, Transfer};

/// Model of a walking robot and loose objects. The robot has a free trunk, four legs of two limited hinges, a tail on a ball joint, dry
/// friction, and servos. The loose objects are a ball and a crate. The model also has the elements of [`tie`] and [`add_sensors`].
pub(crate) fn walker() -> Arc<Model> {
    let mut scene = Model::builder("walker");
    scene.timestep(0.004).geom(WORLD, GeomBuilder::plane("floor").friction([0.8, 0.0, 0.0]).restitution(0.3));
    let trunk = BodyBuilder::new("trunk").pos([0.0, 0.0, 0.6]).joint(JointBuilder::free("root"));
    let trunk = scene.body(WORLD, trunk.geom(GeomBuilder::cuboid("trunk", [0.25, 0.15, 0.08]).density(600.0)));
    for (i, (x, y)) in [(0.2, 0.15), (0.2, -0.15), (-0.2, 0.15), (-0.2, -0.15)].into_iter().enumerate() {
        let (hip, knee) = (format!("hip{i}"), format!("knee{i}"));
        let thigh = BodyBuilder::new(&format!("thigh{i}"))
            .pos([x, y, 0.0])
            .joint(JointBuilder::hinge(&hip, [0.0, 1.0, 0.0]).range(-1.0, 1.0).damping(0.4).armature(0.01))
            .geom(GeomBuilder::capsule(&format!("thigh{i}"), 0.04, 0.1).pos([0.0, 0.0, -0.12]).density(800.0));
        let thigh = scene.body(trunk, thigh);
        let axis = [0.6, 0.8, 0.0];
        let shin = BodyBuilder::new(&format!("shin{i}"))
            .pos([0.0, 0.0, -0.25])
            .joint(JointBuilder::hinge(&knee, axis).pos([0.0, 0.01, 0.0]).range(-1.2, 0.4).damping(0.2).frictionloss(0.1))
            .geom(GeomBuilder::capsule(&format!("shin{i}"), 0.03, 0.1).pos([0.0, 0.0, -0.1]).density(800.0));
        scene.body(thigh, shin);
        // Force bounds, which lanes reach in different steps.
        scene.actuator(ActuatorBuilder::position(&format!("hip servo {i}"), &hip, 30.0, 1.0).ctrl_range(-1.0, 1.0).force_range(-8.0, 8.0));
        scene.actuator(ActuatorBuilder::motor(&format!("knee motor {i}"), &knee).gear(15.0).ctrl_range(-1.0, 1.0));
    }
    let tail =
        BodyBuilder::new("tail").pos([-0.3, 0.0, 0.05]).joint(JointBuilder::ball("tail").damping(0.02).spring(0.5, 0.0).range(0.0, 0.4));
    scene.body(trunk, tail.geom(GeomBuilder::capsule("tail", 0.02, 0.1).pos([-0.1, 0.0, 0.0]).quat([0.6, 0.0, 0.8, 0.0]).density(500.0)));
    let ball = BodyBuilder::new("ball").pos([0.1, 0.0, 1.0]).joint(JointBuilder::free("ball"));
    scene.body(WORLD, ball.geom(GeomBuilder::sphere("ball", 0.08).density(300.0).restitution(0.6).condim(6).friction([0.8, 0.02, 0.01])));
    let crate_ = BodyBuilder::new("crate").pos([0.8, 0.0, 0.4]).quat([0.8, 0.48, 0.36, 0.0]).joint(JointBuilder::free("crate"));
    scene.body(WORLD, crate_.geom(GeomBuilder::cuboid("crate", [0.1, 0.12, 0.05]).density(200.0)));
    // The shins fold up beside the trunk without a collision.
    (0..4).for_each(|i| {
        scene.exclude("trunk", &format!("shin{i}"));
    });
    tie(&mut scene);
    add_sensors(&mut scene, trunk);
    Arc::new(scene.finish().expect("the walker is a valid model"))
}

/// Adds tendons and equalities of all kinds. Some couple the legs; others close a loop with a swing of two links.
fn tie(scene: &mut ModelBuilder) {
    let hips = TendonBuilder::new("hips", &[("hip0", 1.0), ("hip1", -1.0)]).range(-0.3, 0.3).frictionloss(0.01);
    scene.fixed_tendon(hips.stiffness(2.0).damping(0.1).armature(0.001));
    scene.tendon("knees", &[("knee2", 1.0), ("knee3", 0.5)]);
    scene.equality(EqualityBuilder::joint("hips", "hip2", Some("hip3"), [0.0, 0.8, 0.1, 0.0, 0.0]));
    scene.equality(EqualityBuilder::tendon("knees", "knees", None, [-0.3, 0.0, 0.0, 0.0, 0.0]));
    let rod = |name: &str, pos| {
        let rod = GeomBuilder::capsule(name, 0.02, 0.2).pos([0.0, 0.0, -0.2]).masks(0, 0);
        BodyBuilder::new(name).pos(pos).joint(JointBuilder::ball(name)).geom(rod)
    };
    let upper = scene.body(WORLD, rod("upper", [0.0, 2.0, 1.0]));
    scene.body(upper, rod("lower", [0.0, 0.0, -0.4]));
    let seat = GeomBuilder::cuboid("seat", [0.05; 3]).masks(0, 0);
    scene.body(WORLD, BodyBuilder::new("seat").pos([0.3, 2.0, 0.5]).joint(JointBuilder::free("seat")).geom(seat));
    scene.equality(EqualityBuilder::connect("loop", ["lower", "world"], [[0.0, 0.0, -0.4], [0.5, 2.0, 0.8]]));
    scene.equality(EqualityBuilder::weld("hold", ["lower", "seat"], [[0.0, 0.0, -0.2], [0.0; 3]], [1.0, 0.0, 0.0, 0.0]).torquescale(0.3));
    scene.equality(EqualityBuilder::connect("rope", ["seat", "trunk"], [[0.0; 3]; 2]).soft(20.0, 1.0));
}

/// Adds sensors of all kinds that read results of a step, on the body `trunk` and its first thigh. Also adds an actuator between two sites.
fn add_sensors(scene: &mut ModelBuilder, trunk: usize) {
    let shape = Shape::Box { half: [0.3, 0.3, 0.3] };
    let imu = scene.site(trunk, Site { name: "imu".into(), body: 0, pos: [0.1, 0.0, 0.05], quat: [0.8, 0.0, 0.6, 0.0], shape });
    // The force sensor is at the hip, because the bodies below a force sensor may not be part of a closed loop.
    let shape = Shape::Sphere { radius: 0.01 };
    let hip = scene.site(trunk + 1, Site { name: "hip".into(), body: 0, pos: [0.0; 3], quat: [1.0, 0.0, 0.0, 0.0], shape });
    let frame = |what| SensorKind::Frame { what, object: Object::Site(imu), reference: None };
    let contact = SensorKind::Contact {
        first: ContactSide::Subtree(trunk),
        second: ContactSide::Any,
        fields: vec![ContactField::Found, ContactField::Force, ContactField::Pos],
        reduction: ContactReduction::MaxForce,
        slots: 3,
    };
    let (rays, fields) = (vec![[0.0, 0.0, -1.0], [0.6, 0.0, -0.8]], vec![RayField::Distance]);
    scene.actuator(ActuatorBuilder::position("thrust", "hip", 3.0, 0.1).on_site([1.0, 0.0, 0.5, 0.1, 0.0, 0.2], Some("imu")));
    for (name, kind) in [
        ("gyro", SensorKind::Gyro(imu)),
        ("accelerometer", SensorKind::Accelerometer(imu)),
        ("force", SensorKind::Force(hip)),
        ("torque", SensorKind::Torque(hip)),
        ("touch", SensorKind::Touch(imu)),
        ("attitude", frame(FrameReading::Quat)),
        ("up", frame(FrameReading::ZAxis)),
        ("range", SensorKind::RangeFinder { site: imu, rays, fields, geoms: (0..6).collect() }),
        ("contact", contact),
        ("momentum", SensorKind::SubtreeAngMom(trunk)),
        ("energy", SensorKind::KineticEnergy),
        ("servo", SensorKind::ActuatorForce(0)),
        ("knee", SensorKind::ActuatorForce(3)),
        ("thrust", SensorKind::ActuatorPos(8)),
        ("hip", SensorKind::JointLimitForce(1)),
        ("clock", SensorKind::Clock),
    ] {
        scene.sensor(name, kind);
    }
}

/// Transfer functions with errors of all kinds, one for every sensor.
pub(crate) fn errors(model: &Model) -> Vec<Option<Transfer>> {
    let turned = |s: &Sensor| matches!(s.quantity(), Quantity::Axis | Quantity::Quaternion);
    let transfer = |s: &Sensor| Transfer {
        scale: vec![if turned(s) { 1.0 } else { 1.5 }],
        matrix: vec![],
        scale_std: vec![if turned(s) { 0.0 } else { 0.1 }],
        misalignment_std: vec![if turned(s) { 0.0 } else { 0.1 }],
        bias: vec![-0.05],
        bias_std: vec![0.1],
        drift_std: vec![0.5],
        drift_time: vec![0.2],
        noise_std: vec![0.1],
        uniform: false,
        noise_density: vec![0.01],
        quantum: vec![1e-3],
        low: vec![-500.0],
        high: vec![500.0],
        period: vec![0.0],
        delay: vec![0.01],
        jitter: vec![0.005],
        dropout: vec![0.1],
    };
    model.sensors.iter().map(|s| Some(transfer(s))).collect()
}

/// Actuator models of all kinds, one entry for every actuator.
///
/// On the first leg, the hip has a motor with a continuous servo, and the knee a motor whose control is a voltage. The second leg has
/// sampled servos, and the third has neither servo nor motor. All actuators of these legs have delay and force limits, and all except the
/// knee of the first leg have lag. Other actuators have no actuator model.
pub(crate) fn trains(model: &Model) -> Vec<Option<ActuatorSpec>> {
    let servo = |period: Vec<f64>| Servo { kp: vec![20.0], ki: vec![5.0], kd: vec![0.5], integral_limit: vec![2.0], period };
    let motor = |voltage| Motor {
        stall_torque: vec![2.0],
        no_load_speed: vec![40.0],
        rotor_inertia: 1e-4,
        gear: 5.0,
        efficiency: vec![0.7],
        voltage,
    };
    let train = |servo, motor, lag| ActuatorSpec {
        delay: vec![0.0093],
        delay_steps: vec![0.0],
        lag: vec![lag],
        low: vec![-6.0],
        high: vec![7.0],
        friction: vec![if lag > 0.05 { 0.0 } else { 0.02 }],
        stribeck_friction: vec![if lag > 0.05 { 0.0 } else { 0.01 }],
        stribeck_velocity: vec![0.3],
        servo,
        motor,
    };
    let of = |i: usize| match i {
        0 => Some(train(Some(servo(vec![])), Some(motor(false)), 0.01)),
        1 => Some(train(None, Some(motor(true)), 0.0)),
        2 | 3 => Some(train(Some(servo(vec![0.02])), None, 0.02)),
        4 | 5 => Some(train(None, None, 0.1)),
        _ => None,
    };
    (0..model.nu()).map(of).collect()
}

/// Pseudo-random number in [-1, 1] for the seed `seed`, the same on every machine.
pub(crate) fn noise(seed: u64) -> f64 {
    let mut x = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03;
    x = (x ^ (x >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x = (x ^ (x >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    ((x ^ (x >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
}

/// Initial configuration and velocity of environment `env`, different for each environment.
pub(crate) fn start(model: &Model, env: usize) -> (Vec<f64>, Vec<f64>) {
    let mut q = model.qpos0.clone();
    for (i, x) in q.iter_mut().enumerate() {
        *x += 0.1 * noise((env * 1000 + i) as u64);
    }
    let v = (0..model.nv()).map(|i| noise((env * 1000 + 500 + i) as u64)).collect();
    (q, v)
}

/// Controls of environment `env` in the call of `step` with index `call`.
pub(crate) fn action(model: &Model, env: usize, call: usize) -> Vec<f64> {
    (0..model.nu()).map(|i| noise((env * 7919 + call * 104_729 + i) as u64)).collect()
}

/// Makes `calls` calls of `step`, of two steps each, with the environments `envs` as one batch. Returns for each environment the bits of
/// state, certificate and sensor readings.
pub(crate) fn run(
    model: &Arc<Model>,
    options: Options,
    envs: &[usize],
    precision: Precision,
    threads: usize,
    level: Level,
    calls: usize,
) -> Vec<Vec<u64>> {
    let mut sim = Simulation::at_level(model.clone(), options, Some(envs.len()), precision, threads, level);
    sim.set_actuator_models(&trains(model)).unwrap();
    sim.set_sensor_models(&errors(model)).unwrap();
    for (e, &env) in envs.iter().enumerate() {
        sim.set_random_stream(e, env as u32);
        sim.begin_episode(e, Some(7));
        let (q, v) = start(model, env);
        sim.set(Field::Qpos, e, &q).unwrap();
        sim.set(Field::Qvel, e, &v).unwrap();
    }
    for call in 0..calls {
        let ctrl: Vec<f64> = envs.iter().flat_map(|&env| action(model, env, call)).collect();
        sim.step(&StepInputs { ctrl: &ctrl, ..StepInputs::default() }, 2).unwrap();
    }
    let width = model.nsensordata();
    let mut readings = [vec![0.0; envs.len() * width], vec![0.0; envs.len() * width]];
    for (truth, out) in [true, false].into_iter().zip(&mut readings) {
        sim.sense(truth, out).unwrap();
    }
    let read = |e: usize| readings.iter().flat_map(move |r| r[e * width..(e + 1) * width].iter().map(|x| x.to_bits()));
    (0..envs.len()).map(|e| bits(&sim, e).into_iter().chain(read(e)).collect()).collect()
}

/// Bits of all values of environment `env` that a user can read: state, certificate, time, status and contacts.
pub(crate) fn bits(sim: &Simulation, env: usize) -> Vec<u64> {
    let model = sim.model();
    let mut all = Vec::new();
    for (field, n) in [(Field::Qpos, model.nq()), (Field::Qvel, model.nv()), (Field::Act, model.na())] {
        let mut x = vec![0.0; n];
        sim.get(field, env, &mut x).unwrap();
        all.extend(x);
    }
    let Outcome { residual, sweeps, newton_steps, .. } = sim.outcome(env);
    all.extend([residual, f64::from(sweeps), f64::from(newton_steps), sim.time(env), f64::from(sim.status(env).bits())]);
    for c in sim.contacts(env) {
        all.extend(c.geoms.map(|g| g as f64));
        all.extend(c.force.into_iter().chain(c.pos).chain(c.normal).chain([c.distance]));
    }
    all.into_iter().map(f64::to_bits).collect()
}
