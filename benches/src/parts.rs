//! Times of the parts of a step in SIMD lanes, compared with the times that their arithmetic would take at the peak rates of the core.

use std::time::Duration;

use serde::Serialize;
use stepper_core::internals::probe::Counter;
use stepper_core::{Error, Level, Precision};

use crate::clock::{Run, medians};
use crate::counted::operations;
use crate::episode::{Episode, InTurn};
use crate::floor::Rates;
use crate::recorder::{Recording, Row, nanoseconds, own_cost};
use crate::replay::Replay;

/// Largest number of times that the steps of an episode are repeated.
const ROUNDS: usize = 15;
/// Time that all repetitions of an episode may take together, which limits the number of repetitions.
const PATIENCE: Duration = Duration::from_secs(5);
/// Largest number of environments whose operations are counted. These environments are spread evenly over the batch.
const COUNTED: usize = 8;

/// Mean times of the parts of a step, and mean numbers of events (such as contacts) in a step, over a recorded episode.
#[derive(Clone, Debug, Serialize)]
pub struct Anatomy {
    /// Name of the recorded episode.
    pub name: String,
    /// Floating-point precision, "f64" or "f32".
    pub precision: &'static str,
    /// Number of environments of the batch, stepped in SIMD lanes.
    pub num_envs: usize,
    /// Median time per environment step over all rounds, us, measured without instrumentation of the parts.
    pub micros: f64,
    /// Floor of the step: time that its arithmetic operations would take at the measured peak rates of the core, us.
    pub floor: f64,
    /// Whether the final configurations equal those of the recording bit for bit.
    pub reproduced: bool,
    /// Times of the parts of a step.
    pub parts: Vec<Part>,
    /// Mean numbers of events in a step, such as contacts and solver iterations.
    pub counts: Vec<Count>,
}

/// Time of a part of the step, such as collision or the solver.
#[derive(Clone, Debug, Serialize)]
pub struct Part {
    /// Name of the part.
    pub name: &'static str,
    /// Mean number of times that a SIMD group of environments runs the part in one step.
    pub times: f64,
    /// Time of the part per environment step, us: the processor time of the whole step, times the fraction of the recorded time that the
    /// part takes.
    ///
    /// The steps are repeated in several rounds. The recorded times of each call of `step` are those of its fastest round.
    pub micros: f64,
    /// Floor of the part: time that its arithmetic operations would take at the measured peak rates of the core, us. Scalar operations,
    /// such as those of convex hulls and Newton's method, are not included.
    pub floor: f64,
}

/// Mean number of events of one kind in a step, such as contacts or solver iterations.
#[derive(Clone, Debug, Serialize)]
pub struct Count {
    /// Name of the kind of events.
    pub name: &'static str,
    /// Whether the mean is per step of a SIMD group of environments. Otherwise it is per step of one environment.
    pub shared: bool,
    /// Mean number of events of the kind `name` in a step.
    pub mean: f64,
}

impl Anatomy {
    /// Measures the times of a step's parts and counts events such as contacts, by repeating the steps of a recording.
    ///
    /// # Errors
    /// Returns the errors of [`Episode::recorded`].
    pub fn of(replay: &Replay, level: Level) -> Result<Self, Error> {
        let mut episode = Episode::recorded(replay)?;
        let first = episode.time(1);
        let reproduced = episode.is_at(&replay.end);
        let steps = episode.environment_steps() as f64;
        let rounds = (PATIENCE.as_secs_f64() / first.as_secs_f64().max(1e-9)).clamp(1.0, ROUNDS as f64) as usize;
        let micros = if rounds > 1 { medians(&mut [&mut episode], rounds)[0] } else { 1e6 * first.as_secs_f64() / steps };
        let apart = replay.num_envs.div_ceil(COUNTED);
        let alone = (0..replay.num_envs).step_by(apart).map(|env| Ok(episode.of_one(env)?.probe_operations()));
        let work = InTurn(alone.collect::<Result<Vec<_>, Error>>()?).record(operations, 1);
        let mut time = Recording::default();
        time.add(&episode.probe().record(nanoseconds, rounds), 1.0 / steps);
        time.subtract_probe(own_cost());
        let rates = Rates::measure(replay.precision, level);
        let groups = time.counters[Counter::GroupSteps as usize];
        // The recorded wall-clock time includes interruptions, which affect all parts alike.
        let whole = time.sum();
        let part = |((name, time), (_, work)): ((_, Row), (_, Row))| Part {
            name,
            times: time.times / groups,
            micros: micros * time.readings[0] / whole,
            floor: rates.micros(work.readings),
        };
        let parts: Vec<Part> = time.rows().zip(work.rows()).map(part).filter(|part| part.micros > 0.0).collect();
        Ok(Self {
            name: replay.name.clone(),
            precision: if replay.precision == Precision::F32 { "f32" } else { "f64" },
            num_envs: replay.num_envs,
            micros,
            floor: parts.iter().map(|part| part.floor).sum(),
            reproduced,
            parts,
            counts: Counter::ALL
                .iter()
                .filter(|&&counter| counter != Counter::GroupSteps)
                .map(|&counter| Count::of(counter, &time))
                .collect(),
        })
    }
}

impl Count {
    fn of(counter: Counter, found: &Recording) -> Self {
        Self { name: counter.name(), shared: counter.is_shared(), mean: found.mean(counter) }
    }
}
