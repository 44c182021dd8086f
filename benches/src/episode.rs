//! A batch of environments that goes the same way every time.

use stepper_core::{Field, Level, Options, Precision, SavedState, Simulation, StepInputs};

use crate::clock::Run;
use crate::scenes::Scene;

/// Steps that a control is held.
const HOLD: usize = 5;
/// Controls of a run.
const CALLS: usize = 20;

/// A hundred steps of some environments of a scene under pseudo-random controls, from the state that they had after the warm-up.
pub struct Episode {
    simulation: Simulation,
    start: SavedState,
    controls: Vec<Vec<f64>>,
}

impl Episode {
    /// Environments `first..first + count` of the scene, stepped on this thread.
    pub fn new(scene: &Scene, first: usize, count: usize, precision: Precision, level: Level) -> Self {
        // One tolerance in both precisions, so that rows compare.
        let options = Options { tolerance: Some(Precision::F64.tolerance()), ..Options::default() };
        let mut simulation = Simulation::at_level(scene.model.clone(), options, Some(count), precision, 1, level);
        for env in 0..count {
            let (q, v) = scene.start(first + env);
            simulation.set(Field::Qpos, env, &q).expect("a valid configuration");
            simulation.set(Field::Qvel, env, &v).expect("a valid velocity");
        }
        let calls = scene.warm_up.div_ceil(HOLD);
        let control = |call: usize| (0..count).flat_map(move |env| scene.action(first + env, call)).collect::<Vec<f64>>();
        for call in 0..calls {
            step(&mut simulation, &control(call));
        }
        let controls = (calls..calls + CALLS).map(control).collect();
        let start = simulation.save_state();
        Self { simulation, start, controls }
    }

    /// The environments as they are now.
    pub fn simulation(&self) -> &Simulation {
        &self.simulation
    }

    /// The environments, to be stepped otherwise.
    pub fn simulation_mut(&mut self) -> &mut Simulation {
        &mut self.simulation
    }

    /// The controls of the run, call by call, environment-major; each is held for [`Episode::hold`] steps.
    pub fn controls(&self) -> &[Vec<f64>] {
        &self.controls
    }

    /// Steps that a control is held.
    pub const fn hold() -> usize {
        HOLD
    }
}

impl Run for Episode {
    fn rewind(&mut self) {
        self.simulation.restore_state(&self.start).expect("its own state");
    }

    fn run(&mut self) {
        for control in &self.controls {
            step(&mut self.simulation, control);
        }
    }

    fn environment_steps(&self) -> u64 {
        (self.simulation.num_envs() * CALLS * HOLD) as u64
    }
}

fn step(simulation: &mut Simulation, control: &[f64]) {
    simulation.step(&StepInputs { ctrl: control, ..StepInputs::default() }, HOLD).expect("controls fit");
}

/// Several runs as one, one after the other.
pub struct InTurn<T>(pub Vec<T>);

impl<T: Run> Run for InTurn<T> {
    fn rewind(&mut self) {
        self.0.iter_mut().for_each(Run::rewind);
    }

    fn run(&mut self) {
        self.0.iter_mut().for_each(Run::run);
    }

    fn environment_steps(&self) -> u64 {
        self.0.iter().map(Run::environment_steps).sum()
    }
}

/// The first eight environments of a scene, each alone in `f64`, at the best level of this build and machine.
pub fn single(scene: &Scene) -> InTurn<Episode> {
    let level = *Level::available().last().expect("some level is always available");
    InTurn((0..8).map(|env| Episode::new(scene, env, 1, Precision::F64, level)).collect())
}

/// The first 64 environments of a scene in lanes.
pub fn lanes(scene: &Scene, precision: Precision, level: Level) -> Episode {
    Episode::new(scene, 0, 64, precision, level)
}
