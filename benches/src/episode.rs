//! Benchmark run of a batch of environments, which repeats the same steps.

use stepper_core::internals::batch::worker::{LaneScalar, Worker, WorkerSpec, lane_worker};
use stepper_core::{AppliedInput, Error, Field, Level, Options, Precision, SavedState, Simulation};
use stepper_real::{F32Lanes, Real};

use crate::clock::Run;
use crate::counted::Counted;
use crate::recorder::{Meter, Recorder, Recording, record};
use crate::replay::{Call, Replay};
use crate::scenes::Scene;

/// Number of steps with the same control.
const HOLD: usize = 5;
/// Number of calls of `step` in a run, each with a new control.
const CALLS: usize = 20;

/// Benchmark run with a batch of environments: repeats the same steps from the same state.
///
/// The steps are a hundred steps of a scene after its warm-up, under pseudo-random controls, or the steps of a recording.
pub struct Episode {
    simulation: Simulation,
    start: SavedState,
    calls: Vec<Call>,
}

impl Episode {
    /// Benchmark run with the environments `first..first + count` of a scene, which the calling thread steps.
    pub fn new(scene: &Scene, first: usize, count: usize, precision: Precision, level: Level) -> Self {
        let mut simulation = Simulation::at_level(scene.model.clone(), Options::default(), Some(count), precision, 1, level);
        for env in 0..count {
            let (q, v) = scene.start(first + env);
            simulation.set(Field::Qpos, env, &q).expect("a valid configuration");
            simulation.set(Field::Qvel, env, &v).expect("a valid velocity");
        }
        let begin = scene.warm_up.div_ceil(HOLD);
        let call = |call: usize| {
            let ctrl = (0..count).flat_map(|env| scene.action(first + env, call)).collect();
            Call::Step { ctrl, nstep: HOLD }
        };
        (0..begin).for_each(|k| run(&call(k), &mut simulation));
        let start = simulation.save_state();
        Self { simulation, start, calls: (begin..begin + CALLS).map(call).collect() }
    }

    /// Benchmark run with all environments of a recording, which the calling thread steps.
    ///
    /// # Errors
    /// Returns the errors of [`Replay::simulation`].
    pub fn recorded(replay: &Replay) -> Result<Self, Error> {
        Ok(Self { simulation: replay.simulation()?, start: replay.start.clone(), calls: replay.calls.clone() })
    }

    /// Copy of the benchmark run with only the environment `env`, at the lowest CPU level. Its states equal those of this environment in
    /// the batch bit for bit.
    ///
    /// # Errors
    /// Returns the errors of [`Simulation::restore_state`].
    pub fn of_one(&mut self, env: usize) -> Result<Self, Error> {
        self.rewind();
        let whole = &self.simulation;
        let start = whole.save_state_of(env);
        let calls = self.calls.iter().map(|call| call.of_one(env, whole.num_envs())).collect();
        // The lowest level of this build. Operations in f32 are counted in eight lanes, which f32 has with every level but AVX-512.
        let level = Level::available()[0];
        assert!(level != Level::Avx512 || whole.precision() == Precision::F64, "a build for AVX-512 alone cannot count operations in f32");
        let mut simulation = Simulation::at_level(whole.model().clone(), *whole.options(), None, whole.precision(), 1, level);
        simulation.restore_state(&start)?;
        Ok(Self { simulation, start, calls })
    }

    /// Whether the configurations of all environments equal the given ones, (num_envs, nq), bit for bit.
    pub fn is_at(&self, configurations: &[f64]) -> bool {
        let mut q = vec![0.0; self.simulation.model().nq()];
        let mut now = Vec::with_capacity(configurations.len());
        for env in 0..self.simulation.num_envs() {
            self.simulation.get(Field::Qpos, env, &mut q).expect("nq numbers");
            now.extend(q.iter().map(|x| x.to_bits()));
        }
        now.into_iter().eq(configurations.iter().map(|x| x.to_bits()))
    }

    /// Batch of environments of the benchmark run, in its current state.
    pub fn simulation(&self) -> &Simulation {
        &self.simulation
    }

    /// Mutable batch of environments, for steps that are not part of the benchmark run.
    pub fn simulation_mut(&mut self) -> &mut Simulation {
        &mut self.simulation
    }

    /// Converts the benchmark run to its batch of environments, in the current state.
    pub fn into_simulation(self) -> Simulation {
        self.simulation
    }

    /// Returns the benchmark run, changed so that a [`Recorder`] measures the parts of all later steps.
    pub fn probe(mut self) -> Self {
        self.simulation.set_workers(recorded::<f64>, recorded::<f32>);
        self
    }

    /// Returns the benchmark run of a single environment, changed so that later steps count their arithmetic operations.
    ///
    /// The steps compute with [`Counted`] numbers, and a [`Recorder`] assigns the counts to the parts of the step.
    ///
    /// # Panics
    /// With several environments, because an operation on all lanes counts once.
    pub fn probe_operations(mut self) -> Self {
        assert_eq!(self.simulation.num_envs(), 1, "operations are counted in one environment");
        self.simulation.set_workers(counted::<f64>, counted::<F32Lanes>);
        self
    }

    /// Records all calls of `step` in the benchmark run with a meter, and returns the sum of their recordings.
    ///
    /// The function repeats the run `rounds` times, with the same steps bit for bit. Of the recordings of a call it uses the one with the
    /// smallest [`Recording::sum`], which is the fastest repetition if the meter measures time.
    pub fn record(&mut self, meter: Meter, rounds: usize) -> Recording {
        let mut least: Vec<Option<Recording>> = vec![None; self.calls.len()];
        for _ in 0..rounds {
            self.rewind();
            for (call, least) in self.calls.iter().zip(&mut least) {
                if call.steps() == 0 {
                    run(call, &mut self.simulation);
                    continue;
                }
                let found = record(meter, || run(call, &mut self.simulation));
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

fn counted<R: Real<Scalar: LaneScalar>>(spec: &WorkerSpec<'_, R::Scalar>, _: usize, _: Level) -> Box<dyn Worker<R::Scalar>> {
    lane_worker::<Counted<R>>(spec, Recorder)
}

impl Run for Episode {
    fn rewind(&mut self) {
        self.simulation.restore_state(&self.start).expect("its own state");
        AppliedInput::ALL.into_iter().for_each(|input| self.simulation.apply(input, &[]).expect("nothing is of any length"));
    }

    fn run(&mut self) {
        self.calls.iter().for_each(|call| run(call, &mut self.simulation));
    }

    fn environment_steps(&self) -> u64 {
        (self.simulation.num_envs() * self.calls.iter().map(Call::steps).sum::<usize>()) as u64
    }
}

fn run(call: &Call, simulation: &mut Simulation) {
    call.run(simulation).expect("the call is of this batch");
}

/// Several benchmark runs as a single one, which executes them one after the other.
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

/// Runs of the first eight environments of a scene, each in a simulation of one environment in `f64`. The CPU level is the best one of this
/// build and machine.
pub fn single(scene: &Scene) -> InTurn<Episode> {
    let level = *Level::available().last().expect("some level is always available");
    InTurn((0..8).map(|env| Episode::new(scene, env, 1, Precision::F64, level)).collect())
}

impl InTurn<Episode> {
    /// Returns the benchmark runs, changed so that a [`Recorder`] measures the parts of all later steps.
    pub fn probe(self) -> Self {
        Self(self.0.into_iter().map(Episode::probe).collect())
    }

    /// Returns the benchmark runs, changed so that later steps count their arithmetic operations.
    ///
    /// The steps compute with [`Counted`] numbers, and a [`Recorder`] assigns the counts to the parts of the step.
    pub fn probe_operations(self) -> Self {
        Self(self.0.into_iter().map(Episode::probe_operations).collect())
    }

    /// Records each run by [`Episode::record`] with `rounds` repetitions. Returns the sum of the recordings, divided by the total number of
    /// environment steps.
    pub fn record(&mut self, meter: Meter, rounds: usize) -> Recording {
        let mut mean = Recording::default();
        let weight = 1.0 / self.environment_steps() as f64;
        self.0.iter_mut().for_each(|episode| mean.add(&episode.record(meter, rounds), weight));
        mean
    }
}

/// Benchmark run of the first 64 environments of a scene as one batch, in SIMD lanes.
pub fn lanes(scene: &Scene, precision: Precision, level: Level) -> Episode {
    Episode::new(scene, 0, 64, precision, level)
}
