//! Options of a step: [`Options`] as a user gives them, [`StepSettings`] with all values resolved.

use std::fmt::Display;
use std::ops::Deref;

use serde::{Deserialize, Serialize};

use crate::error::Error;
use crate::math::precision::Precision;
use crate::model::{Description, JointKind};

/// Contact law: how the forces of contacts, limits, dry friction and equalities are determined.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum ContactLaw {
    /// Rigid contact: Signorini's condition and Coulomb's cone, each step solved to the tolerance.
    Hard,
    /// MuJoCo's contact law: a convex problem in which each constraint yields according to its solref and solimp. Forces follow from the
    /// accelerations.
    Mujoco,
}

stepper_model::named! {
    /// Time integrator of velocities and positions.
    #[derive(Serialize, Deserialize)]
    #[non_exhaustive]
    pub enum Integrator {
        /// Semi-implicit Euler rule: forces and constraint rows at q, then q+ = q (+) h v+. First order.
        ///
        /// Springs and dampers of tendons are implicit. Joint damping is implicit as in MuJoCo, unless the model makes it explicit.
        Euler = "euler",
        /// Moreau's midpoint rule: forces and constraint rows at q_mid = q (+) h/2 v, then q+ = q_mid (+) h/2 v+. Second order in free
        /// flight.
        ///
        /// Springs, dampers and servos follow the implicit midpoint rule (A-stable). If the step does not resolve them, more of the damping
        /// is evaluated at the end of the step.
        Midpoint = "midpoint",
        /// Implicit Euler rule: springs, dampers and servos at the end of the step (L-stable). Other velocity-dependent forces are
        /// evaluated at the velocity that is predicted for the end.
        ///
        /// First order; it dissipates the energy of motions that it cannot resolve. With MuJoCo's contact law it is MuJoCo's `implicit`.
        Implicit = "implicit",
        /// Runge-Kutta-Munthe-Kaas method of order 4 for environments without an active constraint in this step; the others make a midpoint
        /// step.
        ///
        /// With MuJoCo's contact law it is the classical method of order 4, including constraints.
        Rk4 = "rk4",
        /// MuJoCo's `implicitfast`, only with MuJoCo's contact law: Euler's rule with the symmetric part of the forces' derivatives with
        /// respect to velocity.
        ImplicitFast = "implicitfast",
    }
}

impl Integrator {
    /// Integrator whose name in model files is `name`.
    ///
    /// # Errors
    /// [`Error::SourceIntegrator`] if no integrator has this name.
    fn of_source(name: &str) -> Result<Self, Error> {
        match name {
            "Euler" => Ok(Self::Euler),
            "RK4" => Ok(Self::Rk4),
            "implicitfast" => Ok(Self::ImplicitFast),
            "implicit" => Ok(Self::Implicit),
            _ => Err(Error::SourceIntegrator { found: name.to_owned() }),
        }
    }
}

/// Stabilisation method: how a step removes remaining overlap and other position errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Stabilization {
    /// Correction through the velocity (Baumgarte 1972). In a time step h, the normal row gets the bias beta (overlap - slop) / h, with an
    /// upper bound; beta is [`Options::baumgarte`].
    Baumgarte,
    /// Correction of positions only (split stabilisation). The step solves the same constraint rows a second time, for a velocity that it
    /// uses only to change positions.
    Split,
    /// No correction of position errors.
    None,
}

/// Solver of the constraint problem.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[non_exhaustive]
pub enum Solver {
    /// Gauss-Seidel iterations (sweeps), followed by Newton's method for environments whose residual is still above the tolerance.
    Auto,
    /// Projected Gauss-Seidel iterations only, with Anderson's acceleration.
    Pgs,
    /// Proximal Newton method for all environments that the first Gauss-Seidel iterations do not solve.
    Newton,
}

/// Settings of a step, as a user gives them. Times in s, lengths in m (rad for hinge limits), velocities in m/s.
///
/// `None` selects the value of the model or of the precision, so that `Options::default()` steps every model with its time step.
/// [`Simulation::timestep`](crate::Simulation::timestep) and [`Simulation::tolerance`](crate::Simulation::tolerance) return the selected
/// values.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Options {
    /// Time step, s; `None` selects the model's.
    pub timestep: Option<f64>,
    /// Contact law.
    pub contact: ContactLaw,
    /// Integrator. `None` selects midpoint with hard contact. With MuJoCo's contact law it selects the integrator of the model file, and
    /// Euler's rule if the file has none.
    pub integrator: Option<Integrator>,
    /// Error of the positions that a step may make, m and rad; `None` makes every step once.
    ///
    /// Otherwise a step is divided into substeps, until the estimated error of each is within its share of this bound.
    pub error: Option<f64>,
    /// Solver of the constraint problem.
    pub solver: Solver,
    /// Limit of Gauss-Seidel iterations (sweeps) in each pass of the solver. Of Newton iterations, a pass makes up to six times this number
    /// for each island of an environment.
    ///
    /// [`Solver::Auto`] makes at most 50 sweeps a pass, and at most 25 before the first Newton iteration.
    pub iterations: u32,
    /// Largest residual at which the solver stops, m/s. `None` selects the smallest of three speeds, but at least 1e-6 m/s. They are 1e-4
    /// m/s, 0.6 % of the velocity that gravity adds in a step, and 0.006 rad/s times the radius of gyration of the smallest free body.
    ///
    /// There are two exceptions. Hard contact in 32 bits ignores gravity, and MuJoCo's contact law in 64 bits has 1e-6 m/s.
    pub tolerance: Option<f64>,
    /// Residual at which the solver stops, as a fraction of the speed of the fastest degree of freedom, rad/s or m/s. The solver stops at
    /// the smaller of this residual and `tolerance`, so that an environment at rest does not creep. MuJoCo's contact law ignores it.
    ///
    /// Evidence: a residual r causes joint speeds up to 60 r (ants at rest). With 1e-3 the speed at which a robot at rest creeps decreases
    /// in every step.
    pub rtol: f64,
    /// Stabilisation method.
    pub stabilization: Stabilization,
    /// Fraction of the overlap beyond the slop that a step removes.
    pub baumgarte: f64,
    /// Overlap or position error that stabilisation leaves, m or rad.
    pub slop: f64,
    /// Largest speed of an overlap correction, m/s.
    pub max_correction_speed: f64,
    /// Approach speed below which a contact with restitution does not bounce, m/s.
    pub restitution_threshold: f64,
    /// Contact capacity of an environment; `None` selects an estimate from the model.
    pub max_contacts: Option<u32>,
}

/// Largest number of Gauss-Seidel iterations (sweeps) of [`Solver::Auto`] in a pass.
///
/// A sweep processes eight lanes at once. A Newton iteration processes one lane and costs as much as ten sweeps. Evidence: time of a step
/// of an environment on one core, for 128 humanoids, in microseconds. With 50 sweeps the fewest environments are unsolved.
///
/// | sweeps | random control | at rest |
/// |---|---|---|
/// | 12 | 6.8 | 22.1 |
/// | 20 | 6.4 | 15.9 |
/// | 30 | 5.9 | 13.1 |
/// | 50 | 5.8 | 14.8 |
/// | sweeps alone | 5.2 | 9.9 |
const AUTO_SWEEPS: u32 = 50;
/// Number of Gauss-Seidel iterations before [`Solver::Newton`] begins. They find which contacts are active, and cost less than a Newton
/// iteration.
const NEWTON_SWEEPS: u32 = 2;

/// Acceleration error that the default tolerance permits in short steps, as a fraction of gravity. It bounds the error of contact forces at
/// rest, independent of the time step.
///
/// Evidence, with MuJoCo's contact law in 32 bits at a time step of 0.1 ms: the contact force under a cube of weight 98.1 N is 97.7 to
/// 98.6 N. With 1e-4 m/s, the default tolerance of long steps, it is 88.9 to 106.7 N.
const SHARE_OF_GRAVITY: f64 = 6e-3;

/// Gravity assumed for a model without gravity, and upper bound of the gravity that [`default_tolerance`] uses, m/s^2.
const USUAL_GRAVITY: f64 = 10.0;

/// Smallest default tolerance of the solver, m/s. Below it, predictions and corrections become more accurate too
/// ([`StepSettings::accuracy_factor`]).
const FINE_TOLERANCE: f64 = 1e-6;

/// Largest default tolerance of the solver, m/s.
///
/// Evidence: errors of twelve robots under random control are those of 1e-6 m/s (docs/development/decisions/tolerance.md).
const MAX_TOLERANCE: f64 = 1e-4;

/// Angular velocity of a small free body across its length that the default tolerance permits, rad/s.
///
/// Evidence: two fingers press a cube of 2 mm with 1 N and shake it for 4 s. In 32 bits it slips by 0.28 mm with 1e-4 m/s, by 20 nm with
/// the 5e-6 m/s of this rate.
const MAX_TURN_RATE: f64 = 6e-3;

/// Quantities of a model from which options follow that the user has not set.
#[derive(Clone, Debug)]
pub(crate) struct ModelScales {
    /// Time step of the model, s.
    pub(crate) timestep: f64,
    /// Magnitude of gravity, m/s^2.
    pub(crate) gravity: f64,
    /// Radius of gyration of the smallest body with a free joint, m; infinite if there is none. The radius is that about the axis of the
    /// largest moment of inertia, so that a thin rod counts as long.
    pub(crate) smallest_gyration_radius: f64,
    /// Name of the integrator that the model file selects; `None` if it selects none.
    pub(crate) integrator: Option<String>,
}

impl ModelScales {
    /// Scales of a model.
    pub(crate) fn of(model: &Description) -> Self {
        let free = model.joints.iter().filter(|joint| joint.kind == JointKind::Free).map(|joint| &model.bodies[joint.body]);
        let gyration = free.map(|body| (body.inertia.into_iter().fold(0.0, f64::max) / body.mass).sqrt()).filter(|radius| *radius > 0.0);
        Self {
            timestep: model.timestep,
            gravity: model.gravity.iter().map(|g| g * g).sum::<f64>().sqrt(),
            smallest_gyration_radius: gyration.fold(f64::INFINITY, f64::min),
            integrator: model.requested.as_ref().map(|requested| requested.integrator.clone()),
        }
    }
}

/// Default tolerance of the solver, m/s, at the time step `timestep`, s.
///
/// A velocity error e in every step of h seconds is a force error proportional to e / h. Short steps therefore have a smaller tolerance. In
/// 32 bits, the rounding of hard contacts prevents this. An error e at the surface of a body of radius r turns it with e / r, so that small
/// bodies have a smaller tolerance too. MuJoCo's contact law is solved more exactly in 64 bits, by Newton's method, which converges
/// quadratically.
fn default_tolerance(contact: ContactLaw, precision: Precision, timestep: f64, scales: &ModelScales) -> f64 {
    let by_gravity = match (contact, precision) {
        (ContactLaw::Mujoco, Precision::F64) => return FINE_TOLERANCE,
        (ContactLaw::Hard, Precision::F32) => MAX_TOLERANCE,
        _ if scales.gravity > 0.0 => SHARE_OF_GRAVITY * scales.gravity.min(USUAL_GRAVITY) * timestep,
        _ => SHARE_OF_GRAVITY * USUAL_GRAVITY * timestep,
    };
    by_gravity.min(MAX_TURN_RATE * scales.smallest_gyration_radius).clamp(FINE_TOLERANCE, MAX_TOLERANCE)
}

impl Default for Options {
    fn default() -> Self {
        Self {
            timestep: None,
            contact: ContactLaw::Hard,
            integrator: None,
            error: None,
            solver: Solver::Auto,
            iterations: 50,
            tolerance: None,
            rtol: 1e-3,
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
    /// Options that a model's source file requests: MuJoCo's contact law with the model's parameters, and the integrator of the file.
    ///
    /// Iterations are at least those of the file. Solver and tolerance of the file are ignored: the constraint problem is the same, and is
    /// solved to stepper's tolerance in m/s. A model that was made in code has no such settings and gets `Options::default()`.
    ///
    /// # Errors
    /// [`Error::SourceIntegrator`] when the source selects an integrator that does not exist here.
    pub fn from_model(model: &Description) -> Result<Self, Error> {
        let Some(requested) = &model.requested else { return Ok(Self::default()) };
        let integrator = Integrator::of_source(&requested.integrator)?;
        let usual = Self::default();
        let iterations = usual.iterations.max(requested.iterations);
        Ok(Self { contact: ContactLaw::Mujoco, integrator: Some(integrator), iterations, ..usual })
    }

    /// Resolves these options to settings, for a model with the scales `scales`.
    ///
    /// # Errors
    /// [`Error::Option`] for an integrator that the contact law does not have. [`Error::SourceIntegrator`] if the options select none, and
    /// the file one that does not exist here.
    pub(crate) fn resolve(&self, scales: &ModelScales, precision: Precision) -> Result<StepSettings, Error> {
        let integrator = self.integrator_of(scales.integrator.as_deref())?;
        let timestep = self.timestep.unwrap_or(scales.timestep);
        Ok(StepSettings {
            options: *self,
            timestep,
            integrator,
            tolerance: self.tolerance.unwrap_or_else(|| default_tolerance(self.contact, precision, timestep, scales)),
            poison: cfg!(debug_assertions),
        })
    }

    /// Integrator of the step. `asked` is the name of the integrator that the model file selects; `None` if it selects none.
    ///
    /// # Errors
    /// The errors of [`Options::resolve`].
    fn integrator_of(&self, asked: Option<&str>) -> Result<Integrator, Error> {
        let integrator = match (self.integrator, self.contact) {
            (Some(integrator), _) => integrator,
            (None, ContactLaw::Hard) => Integrator::Midpoint,
            (None, ContactLaw::Mujoco) => asked.map_or(Ok(Integrator::Euler), Integrator::of_source)?,
        };
        let must = match (self.contact, integrator) {
            (ContactLaw::Mujoco, Integrator::Midpoint) => "euler, implicitfast, implicit or rk4 with ContactLaw::Mujoco",
            (ContactLaw::Hard, Integrator::ImplicitFast) => "euler, midpoint, implicit or rk4 with ContactLaw::Hard",
            _ => "",
        };
        if !must.is_empty() {
            return Err(Error::Option { name: "integrator", found: integrator.name().to_owned(), must });
        }
        if let Some(error) = self.error
            && (self.contact == ContactLaw::Mujoco || integrator == Integrator::Rk4)
        {
            let must = "None with ContactLaw::Mujoco or rk4, which have no step that keeps an error; midpoint, implicit and euler have one";
            return Err(Error::Option { name: "error", found: error.to_string(), must });
        }
        Ok(integrator)
    }

    /// Checks the range of every setting, and that the contact law has the integrator.
    ///
    /// # Errors
    /// [`Error::Option`] for the first that is wrong.
    pub fn check(&self) -> Result<(), Error> {
        let positive = |x: Option<f64>| x.is_none_or(|x| x > 0.0 && x.is_finite());
        // Name, whether the value is in its range, value, range.
        let checks: [(_, _, &dyn Display, _); 10] = [
            ("timestep", positive(self.timestep), &self.timestep.unwrap_or_default(), "a finite number above 0"),
            ("error", positive(self.error), &self.error.unwrap_or_default(), "a finite number above 0"),
            ("tolerance", positive(self.tolerance), &self.tolerance.unwrap_or_default(), "a finite number above 0"),
            ("rtol", positive(Some(self.rtol)), &self.rtol, "a finite number above 0"),
            ("slop", self.slop >= 0.0, &self.slop, "0 or more"),
            ("max_correction_speed", self.max_correction_speed >= 0.0, &self.max_correction_speed, "0 or more"),
            ("restitution_threshold", self.restitution_threshold >= 0.0, &self.restitution_threshold, "0 or more"),
            ("baumgarte", (0.0..=1.0).contains(&self.baumgarte), &self.baumgarte, "from 0 to 1"),
            ("iterations", self.iterations > 0, &0, "1 or more"),
            ("max_contacts", self.max_contacts != Some(0), &0, "1 or more; drop contacts with contype=0 instead"),
        ];
        match checks.into_iter().find(|(_, is_in_range, ..)| !is_in_range) {
            Some((name, _, found, must)) => Err(Error::Option { name, found: found.to_string(), must }),
            None => self.integrator_of(None).map(|_| ()),
        }
    }
}

/// Settings of a step: [`Options`], and the values in place of those that they leave to the model and the precision.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StepSettings {
    /// Options as they were given. Their fields are read as fields of the settings, except those below.
    pub options: Options,
    /// Time step, s, see [`Options::timestep`].
    pub timestep: f64,
    /// Integrator, see [`Options::integrator`].
    pub integrator: Integrator,
    /// Largest residual at which the solver stops, m/s.
    pub tolerance: f64,
    /// Whether a step first fills its buffers with NaN, to detect reads of old values. True in debug builds, and in tests that enable it.
    pub poison: bool,
}

impl Deref for StepSettings {
    type Target = Options;

    #[inline(always)]
    fn deref(&self) -> &Options {
        &self.options
    }
}

impl StepSettings {
    /// Factor by which the tolerance is smaller than [`FINE_TOLERANCE`], at least 1.
    ///
    /// The module `tuning` has tolerances and iteration limits of predictions and corrections. A step divides these tolerances by the
    /// factor, and multiplies these iteration limits by it.
    pub(crate) fn accuracy_factor(&self) -> f64 {
        (FINE_TOLERANCE / self.tolerance).max(1.0)
    }

    /// Limits of Gauss-Seidel iterations and of Newton iterations in a pass of a solve.
    pub fn iteration_limits(&self) -> [u32; 2] {
        match self.solver {
            Solver::Auto => [self.iterations.min(AUTO_SWEEPS), self.iterations],
            Solver::Pgs => [self.iterations, 0],
            Solver::Newton => [self.iterations.min(NEWTON_SWEEPS), self.iterations],
        }
    }
}
