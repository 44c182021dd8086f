//! theta: every choice of method that a step makes.

use serde::{Deserialize, Serialize};

/// How velocities and positions advance.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Integrator {
    /// Semi-implicit Euler: everything at q, then q+ = q (+) h v+. First order. Implicit in
    /// joint damping alone, as MuJoCo's, unless the model wants that explicit too; and in springs and dampers of tendons.
    Euler,
    /// Moreau's midpoint: everything at q (+) h/2 v, then q+ = q_mid (+) h/2 v+. Second order in free flight; springs, dampers and servos by
    /// the implicit midpoint rule (A-stable), with more of the damping at the end of the step where that does not resolve it.
    Midpoint,
    /// Euler's rule with springs, dampers and servos at the end of the step (L-stable) and velocity-dependent forces at the velocity to be
    /// expected there. First order; it takes energy out of what it cannot resolve.
    Implicit,
    /// Runge-Kutta-Munthe-Kaas of order 4 for environments without an active constraint in this step; the others take a midpoint step.
    Rk4,
}

impl Integrator {
    /// Whether the step is taken in its middle.
    pub fn in_the_middle(self) -> bool {
        matches!(self, Self::Midpoint | Self::Rk4)
    }
}

/// What removes the overlap that remains.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Stabilization {
    /// A velocity bias beta (overlap - slop) / h in the normal row (Baumgarte 1972), capped.
    Baumgarte,
    /// A second solve of the same rows whose velocity moves positions only.
    Split,
    /// Nothing.
    None,
}

/// Who solves the constraint problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Solver {
    /// Sweeps, then Newton's method for the environments whose residual they leave above the tolerance.
    Auto,
    /// Projected Gauss-Seidel alone, with Anderson's acceleration.
    Pgs,
    /// Augmented-Lagrangian Newton for all but what the first sweeps solve.
    Newton,
}

/// Settings of a step. Times in s, lengths in m (rad for hinge limits), velocities in m/s.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// Time step.
    pub timestep: f64,
    /// Integrator.
    pub integrator: Integrator,
    /// Solver.
    pub solver: Solver,
    /// Sweeps of the solver at the most, and Newton steps at the most for each island of an environment; [`Solver::Auto`] makes no more than
    /// [`AUTO_SWEEPS`] of the former.
    pub iterations: u32,
    /// Residual at which the solver stops, m/s.
    pub tolerance: f64,
    /// Stabilisation.
    pub stabilization: Stabilization,
    /// Fraction of the overlap beyond the slop removed per step.
    pub baumgarte: f64,
    /// Overlap that is left alone.
    pub slop: f64,
    /// Fastest correction of overlap.
    pub max_correction_speed: f64,
    /// Approach slower than this does not bounce from a resting contact.
    pub restitution_threshold: f64,
    /// Contacts an environment can hold; `None` lets the model decide.
    pub max_contacts: Option<u32>,
}

/// Sweeps after which [`Solver::Auto`] hands over to Newton's method.
///
/// Measured on 128 humanoids under random control, then left to rest (microseconds of an environment's step on one core; sweeps alone: 5.2,
/// 9.9): 12 sweeps 6.8, 22.1; 20 sweeps 6.4, 15.9; 30 sweeps 5.9, 13.1; 50 sweeps 5.8, 14.8, and the fewest unsolved. A sweep serves eight lanes
/// at once, a Newton step one, and costs as much as ten of them.
pub const AUTO_SWEEPS: u32 = 50;
/// Sweeps before [`Solver::Newton`] begins: they find out which contacts hold, for less than a Newton step.
const NEWTON_SWEEPS: u32 = 2;

impl Default for Options {
    fn default() -> Self {
        Self {
            timestep: 0.002,
            integrator: Integrator::Midpoint,
            solver: Solver::Auto,
            iterations: 50,
            tolerance: 1e-6,
            stabilization: Stabilization::Split,
            baumgarte: 0.2,
            slop: 1e-5,
            max_correction_speed: 1.0,
            restitution_threshold: 0.01,
            max_contacts: None,
        }
    }
}

impl Options {
    /// (Sweeps, Newton steps) at the most.
    pub fn effort(&self) -> [u32; 2] {
        match self.solver {
            Solver::Auto => [self.iterations.min(AUTO_SWEEPS), self.iterations],
            Solver::Pgs => [self.iterations, 0],
            Solver::Newton => [self.iterations.min(NEWTON_SWEEPS), self.iterations],
        }
    }

    /// The first setting out of its range, in words.
    pub fn check(&self) -> Result<(), String> {
        let positive = |name: &str, x: f64| match x > 0.0 && x.is_finite() {
            true => Ok(()),
            false => Err(format!("option {name} is {x}, must be a finite number above 0")),
        };
        let not_negative = |name: &str, x: f64| match x >= 0.0 {
            true => Ok(()),
            false => Err(format!("option {name} is {x}, must be 0 or more")),
        };
        positive("timestep", self.timestep)?;
        positive("tolerance", self.tolerance)?;
        not_negative("slop", self.slop)?;
        not_negative("max_correction_speed", self.max_correction_speed)?;
        not_negative("restitution_threshold", self.restitution_threshold)?;
        if !(0.0..=1.0).contains(&self.baumgarte) {
            return Err(format!("option baumgarte is {}, must be from 0 to 1", self.baumgarte));
        }
        if self.iterations == 0 {
            return Err("option iterations is 0, must be 1 or more".into());
        }
        if self.max_contacts == Some(0) {
            return Err("option max_contacts is 0, must be 1 or more; drop contacts with contype=0 instead".into());
        }
        Ok(())
    }
}
