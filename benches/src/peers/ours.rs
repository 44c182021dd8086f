//! stepper as an engine of the comparison with rapier.

use std::sync::Arc;

use stepper_core::internals::dynamics::kinematics::Kinematics;
use stepper_core::{AppliedInput, Field, Integrator, Level, Options, Precision, SavedState, Simulation, StepInputs};

use super::bodies::{Bodies, Pose, poses};
use super::{Course, Engine};
use crate::clock::Run;
use crate::scenes::chain;

/// Batch of equal environments of a scene, stepped by stepper.
pub struct Ours {
    simulation: Simulation,
    start: SavedState,
    steps: usize,
    timed: usize,
}

impl Ours {
    /// Batch of `count` environments at the start of a scene, with time step `dt`, s. It is stepped on the calling thread.
    pub fn new(course: Course, dt: f64, integrator: Integrator, precision: Precision, count: usize, level: Level) -> Self {
        let bodies = course.bodies();
        let model = match course {
            Course::Chain(links) => chain(links),
            _ => Arc::new(bodies.as_ref().expect("all but chains are free bodies").model()),
        };
        let options = Options { timestep: Some(dt), integrator: Some(integrator), ..Options::default() };
        let mut simulation = Simulation::at_level(model, options, Some(count), precision, 1, level);
        if let Some(Bodies { solids, push, .. }) = bodies {
            let velocity: Vec<f64> = solids.iter().flat_map(|solid| solid.velocity.into_iter().chain([0.0; 3])).collect();
            (0..count).for_each(|env| simulation.set(Field::Qvel, env, &velocity).expect("a valid velocity"));
            // The world comes first among the bodies.
            let mut force = vec![0.0; 6 * (1 + solids.len())];
            force[6..9].copy_from_slice(&push);
            simulation.apply(AppliedInput::XfrcApplied, &force.repeat(count)).expect("a force on every body");
        }
        let start = simulation.save_state();
        let [steps, timed] = [course.duration(), course.timed()].map(|time| (time / dt).round() as usize);
        Self { simulation, start, steps, timed }
    }
}

impl Run for Ours {
    fn rewind(&mut self) {
        self.simulation.restore_state(&self.start).expect("its own state");
    }

    fn run(&mut self) {
        self.advance(self.timed);
    }

    fn environment_steps(&self) -> u64 {
        (self.timed * self.simulation.num_envs()) as u64
    }
}

impl Engine for Ours {
    fn advance(&mut self, steps: usize) {
        self.simulation.step(&StepInputs::default(), steps).expect("no inputs");
    }

    fn centres(&self) -> Vec<[f64; 3]> {
        let compiled = self.simulation.compiled();
        let mut q = vec![0.0; compiled.nq];
        self.simulation.get(Field::Qpos, 0, &mut q).expect("nq numbers");
        let mut kinematics = Kinematics::new(compiled);
        kinematics.update(compiled, &q);
        (0..compiled.links.len()).map(|l| kinematics.point(l + 1, compiled.params.inertial(l).com)).collect()
    }

    fn poses(&self) -> Vec<Pose> {
        poses(&self.simulation)
    }

    fn energy(&self) -> f64 {
        let (potential, kinetic) = self.simulation.snapshot(0, &StepInputs::default()).expect("no inputs").energy();
        potential + kinetic
    }

    fn steps(&self) -> usize {
        self.steps
    }
}
