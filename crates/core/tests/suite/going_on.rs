//! Test of batches of a single group of environments, whose state a worker keeps loaded between calls. Steps from the loaded state must
//! give the same bits as steps from the saved state.

use std::sync::Arc;

use crate::common::{action, errors, noise, start, trains, walker};
use proptest::prelude::*;
use stepper_core::model::{BodyBuilder, GeomBuilder, JointBuilder, Model, Parameter, WORLD};
use stepper_core::rollout::{Numbers, Quantity, Recording};
use stepper_core::{Field, Integrator, Options, Precision, Simulation, Stabilization, StepInputs};

/// Operation on a simulation: a step, a rollout, or an operation that a user may make between two of them.
#[derive(Clone, Copy, Debug)]
enum Deed {
    Step { nstep: usize, applied: bool },
    Rollout { nstep: usize },
    Set(Field),
    Time,
    Reset,
    Begin,
    Keep,
    Restore,
    Sense { truth: bool },
    Randomize { own: bool },
}

fn deed() -> impl Strategy<Value = Deed> {
    prop_oneof![
        6 => (0..3usize, any::<bool>()).prop_map(|(nstep, applied)| Deed::Step { nstep, applied }),
        1 => (0..3usize).prop_map(|nstep| Deed::Rollout { nstep }),
        1 => prop_oneof![Just(Field::Qpos), Just(Field::Qvel), Just(Field::Act)].prop_map(Deed::Set),
        1 => Just(Deed::Time),
        1 => Just(Deed::Reset),
        1 => Just(Deed::Begin),
        1 => Just(Deed::Keep),
        1 => Just(Deed::Restore),
        2 => any::<bool>().prop_map(|truth| Deed::Sense { truth }),
        1 => any::<bool>().prop_map(|own| Deed::Randomize { own }),
    ]
}

/// Model of a ball above a mocap body, the paddle.
fn paddle() -> Arc<Model> {
    let mut scene = Model::builder("paddle");
    let paddle = BodyBuilder::new("paddle").pos([0.0, 0.0, 0.5]).mocap();
    scene.body(WORLD, paddle.geom(GeomBuilder::cuboid("paddle", [0.3, 0.3, 0.05])));
    let ball = BodyBuilder::new("ball").pos([0.05, 0.0, 0.61]).joint(JointBuilder::free("ball"));
    scene.body(WORLD, ball.geom(GeomBuilder::sphere("ball", 0.06).density(300.0)));
    let model = scene.finish().expect("the paddle is a valid model");
    Arc::new(model)
}

struct Scene {
    model: Arc<Model>,
    options: Options,
    num_envs: usize,
    precision: Precision,
    /// Whether the simulation has actuator dynamics and sensors with errors.
    equipped: bool,
}

impl Scene {
    fn simulation(&self) -> Simulation {
        let mut sim = Simulation::new(self.model.clone(), self.options, Some(self.num_envs), self.precision, 2).unwrap();
        if self.equipped {
            sim.set_actuator_models(&trains(&self.model)).unwrap();
            sim.set_sensor_models(&errors(&self.model)).unwrap();
        }
        sim
    }

    fn randomize(&self, sim: &mut Simulation, masses: Option<&[f64]>) {
        sim.randomize(&[(Parameter::BodyMass, masses)], &(0..self.num_envs).collect::<Vec<_>>()).unwrap();
    }

    /// Applies all operations `deeds` to a simulation. Before each step or rollout, the function creates a second simulation with the saved
    /// state of the first. After it, both must have the same state.
    fn act(&self, deeds: &[Deed]) {
        let (model, n) = (&self.model, self.num_envs);
        let mut sim = self.simulation();
        let (mut kept, mut masses) = (sim.save_state(), None::<Vec<f64>>);
        for (turn, &deed) in deeds.iter().enumerate() {
            let random = |len: usize, size: f64| (0..len).map(|i| size * noise((turn * 10_000 + i) as u64)).collect::<Vec<f64>>();
            let env = turn % n;
            match deed {
                Deed::Step { .. } | Deed::Rollout { .. } => {
                    let mut other = self.simulation();
                    if let Some(masses) = &masses {
                        self.randomize(&mut other, Some(masses));
                    }
                    other.restore_state(&sim.save_state()).unwrap();
                    let ctrl: Vec<f64> = (0..n).flat_map(|env| action(model, env, turn)).collect();
                    let (qfrc, xfrc) = (random(n * model.nv(), 1.0), random(n * 6 * model.bodies.len(), 1.0));
                    let moved: Vec<_> = model.bodies.iter().filter(|b| b.mocap).map(|b| (b.pos, b.quat)).collect();
                    let mocap_pos: Vec<f64> = (0..n).flat_map(|_| moved.iter().flat_map(|m| m.0)).map(|x| x + random(1, 0.01)[0]).collect();
                    let mocap_quat: Vec<f64> = (0..n).flat_map(|_| moved.iter().flat_map(|m| m.1)).collect();
                    let mut inputs = StepInputs { ctrl: &ctrl, ..StepInputs::default() };
                    for sim in [&mut sim, &mut other] {
                        match deed {
                            Deed::Step { nstep, applied } => {
                                if applied {
                                    inputs = StepInputs {
                                        ctrl: &ctrl,
                                        qfrc: &qfrc,
                                        xfrc: &xfrc,
                                        mocap_pos: &mocap_pos,
                                        mocap_quat: &mocap_quat,
                                        ..StepInputs::default()
                                    };
                                }
                                sim.step(&inputs, nstep).unwrap();
                            }
                            Deed::Rollout { nstep } => {
                                let (mut status, mut residual) = (vec![0; n], vec![0.0; n]);
                                let (mut wide, mut narrow) = (vec![0.0f64; n * model.nq()], vec![0.0f32; n * model.nq()]);
                                let q = match self.precision {
                                    Precision::F64 => Numbers::F64(&mut wide),
                                    Precision::F32 => Numbers::F32(&mut narrow),
                                };
                                let quantities = vec![(Quantity::Qpos, q)];
                                let recording = Recording { quantities, status: &mut status, residual: &mut residual };
                                sim.rollout(&inputs, 1, nstep, recording, None).unwrap();
                            }
                            _ => unreachable!(),
                        }
                    }
                    assert_eq!(sim.save_state(), other.save_state(), "turn {turn} of {deeds:?}");
                }
                Deed::Set(field) => {
                    let (q, v) = start(model, turn);
                    let values = match field {
                        Field::Qpos => q,
                        Field::Qvel => v,
                        _ => random(model.na(), 1.0),
                    };
                    sim.set(field, env, &values).unwrap();
                }
                Deed::Time => sim.set_time(env, turn as f64).unwrap(),
                Deed::Reset => sim.reset(env),
                Deed::Begin => sim.begin_episode(env, Some(turn as u64)),
                Deed::Keep => kept = sim.save_state(),
                Deed::Restore => sim.restore_state(&kept).unwrap(),
                Deed::Sense { truth } => {
                    let mut out = vec![0.0; n * model.nsensordata()];
                    sim.sense(truth, &mut out).unwrap();
                }
                Deed::Randomize { own } => {
                    let all = model.field("body_mass").unwrap().1.repeat(n);
                    masses = own.then(|| all.iter().enumerate().map(|(i, m)| m * (1.1 + 0.1 * noise((turn * 1000 + i) as u64))).collect());
                    self.randomize(&mut sim, masses.as_deref());
                }
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..ProptestConfig::with_cases(256) })]

    #[test]
    fn a_step_is_a_function_of_the_state_whatever_was_done_before_it(
        deeds in prop::collection::vec(deed(), 1..24),
        many in any::<bool>(),
        single in any::<bool>(),
        walks in any::<bool>(),
        equipped in any::<bool>(),
        fast in any::<bool>(),
    ) {
        let precision = if single { Precision::F32 } else { Precision::F64 };
        let base = Options { timestep: Some(0.004), ..Options::default() };
        let options = if fast { Options { integrator: Some(Integrator::Euler), stabilization: Stabilization::Baumgarte, ..base } } else { base };
        let model = if walks { walker() } else { paddle() };
        Scene { model, options, num_envs: if many { 3 } else { 1 }, precision, equipped: equipped && walks }.act(&deeds);
    }
}
