//! Parts of the steps of an episode: what each takes in lanes, and the least that its operations could take.

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

/// Repeats at the most.
const ROUNDS: usize = 15;
/// Time after which no further repeat begins.
const PATIENCE: Duration = Duration::from_secs(5);
/// Environments whose operations are counted, spread over the batch.
const COUNTED: usize = 8;

/// What the steps of an episode take, per step of an environment.
#[derive(Clone, Debug, Serialize)]
pub struct Anatomy {
    /// Name of the episode.
    pub name: String,
    /// "f64" or "f32".
    pub precision: &'static str,
    /// Environments that were stepped in lanes.
    pub num_envs: usize,
    /// Time of the whole step without a probe, median of the rounds, us.
    pub micros: f64,
    /// Time that its operations take at the rates of the core, us.
    pub floor: f64,
    /// Whether the configurations at the end are those of the recording, bit for bit.
    pub reproduced: bool,
    /// Its parts.
    pub parts: Vec<Part>,
    /// What it counts: of an environment, or of the group whose lanes share it.
    pub counts: Vec<Count>,
}

/// A part of the step.
#[derive(Clone, Debug, Serialize)]
pub struct Part {
    /// Its name.
    pub name: &'static str,
    /// How often a group enters it in a step.
    pub times: f64,
    /// Its time, us: its share of what a clock saw in the least of the rounds of each call, of the processor time of the whole step.
    pub micros: f64,
    /// The least time of its operations, us. What is done lane by lane in plain numbers, hulls and Newton's method, is not counted.
    pub floor: f64,
}

/// A number that a step counts.
#[derive(Clone, Debug, Serialize)]
pub struct Count {
    /// Its name.
    pub name: &'static str,
    /// Whether all lanes of a group share it.
    pub shared: bool,
    /// The mean.
    pub mean: f64,
}

impl Anatomy {
    /// Steps a recording again and again.
    ///
    /// # Errors
    /// As [`Episode::recorded`].
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
        // The clock goes on while others have the core, but for all parts alike.
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
