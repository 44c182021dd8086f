//! A batch of environments that goes the same way every time.

use stepper_core::internals::batch::worker::{LaneScalar, Worker, WorkerMakers, WorkerSpec, lane_worker};
use stepper_core::{Field, Level, Options, Precision, SavedState, Simulation, StepInputs};

use crate::clock::Run;
use crate::counted::Counted;
use crate::recorder::{Meter, Recorder, Recording, record};
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

    /// Puts a [`Recorder`] into the steps from now on.
    pub fn probe(mut self) -> Self {
        self.simulation.set_workers(&WorkerMakers { f64: recorded::<f64>, f32: recorded::<f32> });
        self
    }

    /// Puts a [`Recorder`] into the steps of a single environment in 64 bits, and makes them with numbers that count what is done with
    /// them.
    ///
    /// # Panics
    /// When the environment is in 32 bits.
    pub fn probe_operations(mut self) -> Self {
        assert_eq!(self.simulation.num_envs(), 1, "operations are counted in one environment");
        assert_eq!(self.simulation.precision(), Precision::F64, "operations are counted in 64 bits");
        self.simulation.set_workers(&WorkerMakers { f64: counted, f32: recorded::<f32> });
        self
    }

    /// Records one call after the other, `rounds` times; of each call the round with the least of the first reading counts. All rounds make
    /// the same steps to the bit.
    pub fn record(&mut self, meter: Meter, rounds: usize) -> Recording {
        let mut least: Vec<Option<Recording>> = vec![None; CALLS];
        for _ in 0..rounds {
            self.rewind();
            for (control, least) in self.controls.iter().zip(&mut least) {
                let found = record(meter, || step(&mut self.simulation, control));
                if least.as_ref().is_none_or(|least| found.sum() < least.sum()) {
                    *least = Some(found);
                }
            }
        }
        let mut sum = Recording::default();
        least.iter().flatten().for_each(|found| sum.add(found, 1.0));
        sum
    }
}

fn recorded<S: LaneScalar>(spec: &WorkerSpec<'_, S>, lanes: usize, level: Level) -> Box<dyn Worker<S>> {
    S::probed_worker(spec, lanes, level, Recorder)
}

fn counted(spec: &WorkerSpec<'_, f64>, _: usize, _: Level) -> Box<dyn Worker<f64>> {
    lane_worker::<Counted>(spec, Recorder)
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

impl InTurn<Episode> {
    /// Each with a [`Recorder`].
    pub fn probe(self) -> Self {
        Self(self.0.into_iter().map(Episode::probe).collect())
    }

    /// Each with a [`Recorder`] and numbers that count.
    pub fn probe_operations(self) -> Self {
        Self(self.0.into_iter().map(Episode::probe_operations).collect())
    }

    /// All recordings together, per step of an environment.
    pub fn record(&mut self, meter: Meter, rounds: usize) -> Recording {
        let mut mean = Recording::default();
        let weight = 1.0 / self.environment_steps() as f64;
        self.0.iter_mut().for_each(|episode| mean.add(&episode.record(meter, rounds), weight));
        mean
    }
}

/// The first 64 environments of a scene in lanes.
pub fn lanes(scene: &Scene, precision: Precision, level: Level) -> Episode {
    Episode::new(scene, 0, 64, precision, level)
}
