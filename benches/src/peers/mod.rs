//! stepper beside rapier on the same scenes at the same time step, with the error of each.
//!
//! A speed says nothing without the error at that setting. Rapier's accuracy setting is `num_solver_iterations`, the substeps of a step: 4
//! by default, "8-12: demanding scenarios (complex machinery)" by the documentation of `IntegrationParameters`. A substep evaluates the
//! whole multibody dynamics, so it is the same trade as a smaller time step.

mod ours;
mod rapier;

pub use ours::Ours;
pub use rapier::{Rapier, Setting};

use stepper_core::{Integrator, Level, Precision};

use crate::clock::Run;
use crate::scenes::{LINK_LENGTH, LINK_MASS};

/// Standard gravity as the scenes have it, m/s^2.
pub const GRAVITY: f64 = 9.81;
/// Half size of the sliding box, m.
pub const BOX_HALF: [f64; 3] = [0.2, 0.15, 0.1];
/// Speed of the sliding box at the start, m/s.
pub const BOX_SPEED: f64 = 2.0;
/// Its friction with the floor.
pub const BOX_FRICTION: f64 = 0.5;

/// A scene that both engines step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Course {
    /// [`crate::scenes::chain`] of so many links, let go at rest, stretched level.
    Chain(usize),
    /// A box pushed over a floor, which stops and then rests.
    Box,
}

impl Course {
    /// All of them.
    pub const ALL: [Course; 3] = [Course::Chain(5), Course::Chain(20), Course::Box];

    /// Short name.
    pub fn name(self) -> String {
        match self {
            Course::Chain(n) => format!("chain-{n}"),
            Course::Box => "sliding box".into(),
        }
    }

    /// Time step of the comparison, s.
    pub const fn timestep(self) -> f64 {
        0.002
    }

    /// Simulated time, s.
    pub const fn duration(self) -> f64 {
        match self {
            Course::Chain(_) => 0.5,
            Course::Box => 1.0,
        }
    }

    /// Names of the two errors.
    pub const fn measures(self) -> [&'static str; 2] {
        match self {
            Course::Chain(_) => ["worst link, m", "energy drift"],
            Course::Box => ["stopping, m", "worst overlap, m"],
        }
    }

    /// Where the right answer comes from.
    pub const fn reference(self) -> &'static str {
        match self {
            Course::Chain(_) => "stepper's rk4 at dt 1e-4; rapier with dt -> 0 tends to it",
            Course::Box => "closed form v^2 / (2 mu g)",
        }
    }
}

/// An engine with a setting on a course.
pub trait Engine: Run {
    /// Makes steps.
    fn advance(&mut self, steps: usize);
    /// Centres of mass of all that moves, m.
    fn centres(&self) -> Vec<[f64; 3]>;
    /// Kinetic and potential energy of an environment, J.
    fn energy(&self) -> f64;
    /// Steps of a run.
    fn steps(&self) -> usize;
}

/// An engine with a setting on a course, and what it gets wrong there.
pub struct Entry {
    /// The course.
    pub course: Course,
    /// Engine and setting.
    pub name: String,
    /// Its runs.
    pub engine: Box<dyn Engine>,
    /// See [`Course::measures`].
    pub errors: [f64; 2],
}

impl Entry {
    fn new(course: Course, name: &str, mut engine: Box<dyn Engine>, answer: &[[f64; 3]]) -> Self {
        let errors = errors(course, &mut *engine, answer);
        Self { course, name: name.into(), engine, errors }
    }
}

/// All engines and settings of a course; rapier's default is the first.
pub fn entries(course: Course) -> Vec<Entry> {
    let answer = answer(course);
    let dt = course.timestep();
    let best = *Level::available().last().expect("the baseline is always there");
    let rapier = |substeps: usize, coulomb: bool| Box::new(Rapier::new(course, Setting { dt, substeps, coulomb }));
    let alone = |integrator| Box::new(Ours::new(course, dt, integrator, Precision::F64, 1, best));
    let lanes = |precision| Box::new(Ours::new(course, dt, Integrator::Midpoint, precision, 64, best));
    let mut all: Vec<(&str, Box<dyn Engine>)> = vec![("rapier, 4 substeps (default)", rapier(4, false))];
    match course {
        Course::Chain(_) => {
            all.push(("rapier, 1 substep", rapier(1, false)));
            all.push(("rapier, 12 substeps (documented best)", rapier(12, false)));
        }
        Course::Box => {
            all.push(("rapier, 12 substeps (documented best)", rapier(12, false)));
            all.push(("rapier, 4 substeps, Coulomb", rapier(4, true)));
        }
    }
    all.push(("stepper f64, euler", alone(Integrator::Euler)));
    all.push(("stepper f64, midpoint (default)", alone(Integrator::Midpoint)));
    all.push(("stepper f64, rk4", alone(Integrator::Rk4)));
    all.push(("stepper f64 lanes, midpoint", lanes(Precision::F64)));
    all.push(("stepper f32 lanes, midpoint", lanes(Precision::F32)));
    all.into_iter().map(|(name, engine)| Entry::new(course, name, engine, &answer)).collect()
}

/// Where everything should be at the end.
pub fn answer(course: Course) -> Vec<[f64; 3]> {
    match course {
        Course::Chain(_) => {
            let mut fine = Ours::new(course, 1e-4, Integrator::Rk4, Precision::F64, 1, Level::Baseline);
            fine.advance(fine.steps());
            fine.centres()
        }
        Course::Box => vec![[BOX_SPEED * BOX_SPEED / (2.0 * BOX_FRICTION * GRAVITY), 0.0, BOX_HALF[2]]],
    }
}

/// Runs the engine once and compares.
pub fn errors(course: Course, engine: &mut dyn Engine, answer: &[[f64; 3]]) -> [f64; 2] {
    engine.rewind();
    let start = engine.energy();
    let (mut drift, mut overlap) = (0.0_f64, 0.0_f64);
    for _ in 0..engine.steps() {
        engine.advance(1);
        drift = drift.max((engine.energy() - start).abs());
        overlap = overlap.max(BOX_HALF[2] - engine.centres()[0][2]);
    }
    let apart = |a: &[f64; 3], b: &[f64; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
    let centres = engine.centres();
    match course {
        Course::Chain(n) => {
            let worst = centres.iter().zip(answer).map(|(a, b)| apart(a, b)).fold(0.0, f64::max);
            // What the chain would gain by falling its own half length.
            let n = n as f64;
            [worst, drift / (n * LINK_MASS * GRAVITY * 0.5 * n * LINK_LENGTH)]
        }
        Course::Box => [(centres[0][0] - answer[0][0]).abs(), overlap],
    }
}
