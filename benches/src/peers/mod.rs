//! Comparison of stepper and rapier on the same scenes with the same time step: speed and error of each engine.
//!
//! A speed is meaningful only together with the error at the same setting. Rapier's accuracy setting is `num_solver_iterations`, the number
//! of substeps per step. The default is 4; the documentation of `IntegrationParameters` recommends "8-12: demanding scenarios (complex
//! machinery)". A substep evaluates the whole multibody dynamics, like a step with a smaller time step.

mod bodies;
mod ours;
mod rapier;

pub use bodies::{Bodies, Pose, Shape, Solid};
pub use ours::Ours;
pub use rapier::{Rapier, Setting};

use stepper_core::{Integrator, Level, Precision};

use self::bodies::{BOX_FRICTION, BOX_HALF, BOX_SPEED};
use crate::clock::Run;
use crate::scenes::{LINK_LENGTH, LINK_MASS};

/// Gravity in the scenes, m/s^2.
pub const GRAVITY: f64 = 9.81;
/// Scene of the comparison, for both engines.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Course {
    /// Chain of [`crate::scenes::chain`] with this number of links, released at rest in a horizontal line.
    Chain(usize),
    /// Box that slides along a floor, stops and then rests.
    Box,
    /// Ten boxes that lie in a bin.
    Heap,
    /// Standing wall of fifteen bricks.
    Wall,
    /// SimBenchmark's balls on a plate that is pulled along the ground.
    Balls,
}

impl Course {
    /// All scenes of the comparison.
    pub const ALL: [Course; 6] = [Course::Chain(5), Course::Chain(20), Course::Box, Course::Heap, Course::Wall, Course::Balls];

    /// Short name of the scene.
    pub fn name(self) -> String {
        match self {
            Course::Chain(n) => format!("chain-{n}"),
            Course::Box => "sliding box".into(),
            Course::Heap => "heap of ten boxes".into(),
            Course::Wall => "wall of 15 bricks".into(),
            Course::Balls => "25 balls on a plate".into(),
        }
    }

    /// Time step of the comparison, s.
    pub const fn timestep(self) -> f64 {
        0.002
    }

    /// Simulated time over which the errors are measured, s.
    pub const fn duration(self) -> f64 {
        match self {
            Course::Chain(_) => 0.5,
            Course::Heap => 0.4,
            Course::Box | Course::Wall | Course::Balls => 1.0,
        }
    }

    /// Simulated time over which the speed is measured, s. In scenes with many bodies it is only the first part of [`Course::duration`].
    pub const fn timed(self) -> f64 {
        match self {
            Course::Chain(_) | Course::Box => self.duration(),
            Course::Heap | Course::Wall | Course::Balls => 0.1,
        }
    }

    /// Number of environments with which stepper is timed in SIMD lanes.
    pub const fn lanes(self) -> usize {
        match self {
            Course::Chain(_) | Course::Box => 64,
            Course::Heap | Course::Wall | Course::Balls => 16,
        }
    }

    /// Names of the two errors that are measured in the scene.
    pub const fn measures(self) -> [&'static str; 2] {
        match self {
            Course::Chain(_) => ["worst link, m", "energy drift"],
            Course::Box => ["stopping, m", "worst overlap, m"],
            Course::Heap => ["creep, m/s", "overlap at end, m"],
            Course::Wall => ["worst drift, m", "overlap at end, m"],
            Course::Balls => ["acceleration", "overlap at end, m"],
        }
    }

    /// Description of the reference solution from which errors are measured.
    pub const fn reference(self) -> &'static str {
        match self {
            Course::Chain(_) => "stepper's rk4 at dt 1e-4; rapier with dt -> 0 tends to it",
            Course::Box => "closed form v^2 / (2 mu g)",
            Course::Heap => "what lies in a bin does not move: the fastest box, over the second half",
            Course::Wall => "a wall stands: the brick that moved farthest",
            Course::Balls => "closed form of plate and balls that roll: the worst of them, over that of the plate",
        }
    }

    /// Free bodies of the scene. The result is `None` for the chain.
    fn bodies(self) -> Option<Bodies> {
        match self {
            Course::Chain(_) => None,
            Course::Box => Some(Bodies::sliding_box()),
            Course::Heap => Some(Bodies::heap()),
            Course::Wall => Some(Bodies::wall()),
            Course::Balls => Some(Bodies::balls()),
        }
    }
}

/// Engine with a setting in a scene, which can be stepped and timed.
pub trait Engine: Run {
    /// Makes `steps` time steps.
    fn advance(&mut self, steps: usize);
    /// Centres of mass of all moving bodies, m.
    fn centres(&self) -> Vec<[f64; 3]>;
    /// Poses of all moving bodies.
    fn poses(&self) -> Vec<Pose>;
    /// Kinetic plus potential energy of an environment, J.
    fn energy(&self) -> f64;
    /// Number of time steps in the simulated time over which errors are measured.
    fn steps(&self) -> usize;
}

/// Result of the comparison: an engine with a setting in a scene, and its errors.
pub struct Entry {
    /// Scene of the comparison.
    pub course: Course,
    /// Names of engine and setting.
    pub name: String,
    /// Engine, whose runs are timed.
    pub engine: Box<dyn Engine>,
    /// Two errors of the engine in the scene, whose names [`Course::measures`] returns.
    pub errors: [f64; 2],
}

/// Entries of the comparison for a scene, one for each engine and setting. The first one is rapier with its default settings.
pub fn entries(course: Course) -> Vec<Entry> {
    let answer = answer(course);
    let dt = course.timestep();
    let best = best_level();
    let rapier = |name: &str, substeps: usize, coulomb: bool| {
        let mut engine = Rapier::new(course, Setting { dt, substeps, coulomb });
        let errors = errors(course, &mut engine, &answer);
        Entry { course, name: name.into(), engine: Box::new(engine), errors }
    };
    let ours = |name: &str, integrator: Integrator, precision: Precision, count: usize| {
        // Environments in SIMD lanes equal a single environment bit for bit.
        let errors = errors(course, &mut Ours::new(course, dt, integrator, precision, 1, best), &answer);
        Entry { course, name: name.into(), engine: Box::new(Ours::new(course, dt, integrator, precision, count, best)), errors }
    };
    let mut all = vec![rapier("rapier, 4 substeps (default)", 4, false)];
    if let Course::Chain(_) = course {
        all.push(rapier("rapier, 1 substep", 1, false));
    }
    all.push(rapier("rapier, 12 substeps (documented best)", 12, false));
    if course.bodies().is_some() {
        all.push(rapier("rapier, 4 substeps, Coulomb", 4, true));
    }
    all.push(ours("stepper f64, euler", Integrator::Euler, Precision::F64, 1));
    all.push(ours("stepper f64, midpoint (default)", Integrator::Midpoint, Precision::F64, 1));
    if let Course::Chain(_) | Course::Box = course {
        all.push(ours("stepper f64, rk4", Integrator::Rk4, Precision::F64, 1));
    }
    all.push(ours("stepper f64 lanes, midpoint", Integrator::Midpoint, Precision::F64, course.lanes()));
    all.push(ours("stepper f32 lanes, midpoint", Integrator::Midpoint, Precision::F32, course.lanes()));
    all
}

/// Best CPU level of this build and machine. Results do not depend on it.
fn best_level() -> Level {
    *Level::available().last().expect("some level is always available")
}

/// Reference solution of a scene, from which errors are measured: final positions of the bodies, m, exact or from small time steps.
///
/// For [`Course::Balls`] it has the exact accelerations of plate and balls instead, m/s^2. [`Course::Heap`] has no reference solution:
/// the result is empty.
pub fn answer(course: Course) -> Vec<[f64; 3]> {
    match course {
        Course::Chain(_) => {
            let mut fine = Ours::new(course, 1e-4, Integrator::Rk4, Precision::F64, 1, best_level());
            fine.advance(fine.steps());
            fine.centres()
        }
        Course::Box => vec![[BOX_SPEED * BOX_SPEED / (2.0 * BOX_FRICTION * GRAVITY), 0.0, BOX_HALF[2]]],
        Course::Heap => vec![],
        Course::Wall => Bodies::wall().solids.iter().map(|solid| solid.pose.0).collect(),
        Course::Balls => Bodies::rolling_accelerations(),
    }
}

/// Runs the engine once in a scene, and returns its two errors. [`Course::measures`] has the names of these errors.
///
/// The argument `answer` is the reference solution, as the function [`answer`] returns it.
pub fn errors(course: Course, engine: &mut dyn Engine, answer: &[[f64; 3]]) -> [f64; 2] {
    engine.rewind();
    let steps = engine.steps();
    let overlap = |engine: &dyn Engine| course.bodies().expect("no chain").at(&engine.poses()).deepest_overlap();
    match course {
        Course::Chain(n) => {
            let (start, mut drift) = (engine.energy(), 0.0_f64);
            for _ in 0..steps {
                engine.advance(1);
                drift = drift.max((engine.energy() - start).abs());
            }
            // Energy that the chain would gain by falling half its length.
            let n = n as f64;
            [farthest(&engine.centres(), answer), drift / (n * LINK_MASS * GRAVITY * 0.5 * n * LINK_LENGTH)]
        }
        Course::Box => {
            let mut deepest = 0.0_f64;
            for _ in 0..steps {
                engine.advance(1);
                deepest = deepest.max(BOX_HALF[2] - engine.centres()[0][2]);
            }
            [(engine.centres()[0][0] - answer[0][0]).abs(), deepest]
        }
        Course::Heap => {
            // In the first half each engine settles into its rest state.
            engine.advance(steps / 2);
            let rest = engine.centres();
            engine.advance(steps - steps / 2);
            [farthest(&engine.centres(), &rest) / (0.5 * course.duration()), overlap(engine)]
        }
        Course::Wall => {
            engine.advance(steps);
            [farthest(&engine.centres(), answer), overlap(engine)]
        }
        Course::Balls => {
            let mut places = vec![engine.centres()];
            for _ in 0..2 {
                engine.advance(steps / 2);
                places.push(engine.centres());
            }
            // The second difference of positions cancels offsets of position and velocity, such as those of half a step.
            let time = 0.5 * course.duration();
            let acceleration =
                |k: usize| std::array::from_fn(|i| (places[2][k][i] - 2.0 * places[1][k][i] + places[0][k][i]) / (time * time));
            let found: Vec<[f64; 3]> = (0..answer.len()).map(acceleration).collect();
            [farthest(&found, answer) / farthest(&answer[..1], &[[0.0; 3]]), overlap(engine)]
        }
    }
}

/// Largest distance between the points of two lists with equal indices.
fn farthest(a: &[[f64; 3]], b: &[[f64; 3]]) -> f64 {
    let apart = |(a, b): (&[f64; 3], &[f64; 3])| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f64>().sqrt();
    a.iter().zip(b).map(apart).fold(0.0, f64::max)
}
