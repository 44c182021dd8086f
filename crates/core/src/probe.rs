//! Probe of the step: measures times, counts and operations, and costs nothing when it is off.
//!
//! The probe is a type parameter of the step. The engine steps with [`NoProbe`], which has no size and does nothing. Its step is compiled
//! as if there were no probe. The benchmarks use other probes.

stepper_model::named! {
    /// Part of a step, or of a worker's work around its steps, whose time a probe measures.
    ///
    /// Spans can be nested. The reported time of a span excludes the inner ones.
    pub enum Span {
        /// Loading of state, parameters and inputs of a group into the workspace.
        Load = "load",
        /// Dynamics of actuators between steps: delay, sampled servos and lag.
        ActuatorPipelines = "actuator pipelines",
        /// Computation of the configuration at the evaluation point of the step, such as its middle.
        Displace = "displace",
        /// Poses, joint axes and link inertias.
        Kinematics = "kinematics",
        /// Forces of actuators and springs, and forces that the user applies.
        Actuate = "actuate",
        /// Assembly of the mass matrix.
        MassMatrix = "mass matrix",
        /// Factorisation of the mass matrix.
        MassFactors = "mass factors",
        /// Bias force and acceleration without constraints.
        Acceleration = "bias force and acceleration",
        /// Broad phase: poses of geoms, and candidate pairs.
        BroadPhase = "broad phase",
        /// Narrow phase: contacts of the candidate pairs.
        NarrowPhase = "narrow phase",
        /// Search for the times of impacts within the step.
        ImpactTimes = "impact times",
        /// Lookup of the impulses that the same contacts had in the last step.
        WarmStart = "warm start",
        /// Assembly of the constraint rows.
        Assemble = "assemble",
        /// Prediction of the impulses.
        EstimateImpulses = "estimate impulses",
        /// Recomputation of forces at the predicted velocity, and the resulting change of the constraint problem.
        CorrectForces = "correct forces",
        /// Solve of the constraint problem.
        Solve = "solve",
        /// Repeated solves in lanes where impacts made the velocity jump.
        SolveImpacts = "solve again at impacts",
        /// Computation of velocities from impulses.
        IntegrateVelocity = "integrate velocity",
        /// Checks of the kinetic energy after steps that are too long for the motion, or whose impulses do not determine the kinetic
        /// energy.
        GuardEnergy = "guard energy",
        /// Check for geoms that may have passed through others.
        Tunnelling = "tunnelling",
        /// Computation of configurations from velocities.
        IntegratePosition = "integrate position",
        /// Position correction: the second solve of the constraint problem.
        Stabilise = "stabilise: second solve",
        /// Runge-Kutta steps of order 4.
        Rk4 = "rk4",
        /// Acceptance of the next state in lanes where it is finite.
        Accept = "accept",
        /// Sensor readings and their error models.
        Sense = "sense",
        /// Record of a step, with its status flags.
        Record = "record",
        /// Recording of a rollout's quantities.
        Rollout = "rollout",
        /// Storing of the state of a group.
        Store = "store",
    }
}

stepper_model::named! {
    /// Counter of events in a step of a group of environments. A counter has one count for all lanes together, or the sum of the counts of
    /// all environments in the group.
    pub enum Counter {
        /// Number of steps of groups.
        GroupSteps = "steps of a group",
        /// Number of evaluations of a step's forces, each in all lanes.
        Evaluations = "evaluations",
        /// Number of candidate pairs in the narrow phase, shared by all lanes.
        NearPairs = "near pairs",
        /// Number of contacts.
        Contacts = "contacts",
        /// Number of contact slots in use. A slot holds up to one contact of every lane, so that the lanes process these contacts together.
        ContactSlots = "contact slots",
        /// Number of constraint rows of limits, dry friction, equalities and tendons. All lanes have the same rows.
        ScalarRows = "scalar rows",
        /// Number of Gauss-Seidel iterations (sweeps) of the solver, as a sum over environments.
        Sweeps = "sweeps",
        /// Number of Gauss-Seidel iterations (sweeps) in the slowest lane of a group.
        SlowestSweeps = "sweeps of the slowest lane",
        /// Number of Newton iterations of the solver, as a sum over environments.
        NewtonSteps = "Newton steps",
    }
}

#[cfg(feature = "internals")]
impl Counter {
    /// Whether the counter has one count for all lanes together. Otherwise its value is the sum of the counts of all environments in the
    /// group.
    pub const fn is_shared(self) -> bool {
        !matches!(self, Self::Contacts | Self::Sweeps | Self::NewtonSteps)
    }
}

/// Probe of a step. It is passed by value: a probe without size takes no register.
pub trait Probe: Copy + Send + 'static {
    /// Runs `work`, a part of the step, and measures it. The function must be inlined, so that the work becomes a part of the kernel around
    /// it.
    fn span<T>(self, span: Span, work: impl FnOnce() -> T) -> T;
    /// Adds a number to a counter. A probe that does not count never computes the number.
    fn count(self, counter: Counter, number: impl FnOnce() -> f64);
}

/// Measures a part of the step: `span!(probe, Solve, || work)` calls [`Probe::span`] with [`Span`]`::Solve` and a closure that is always
/// inlined. Only then is the work compiled as a part of the kernel that contains it (`stepper_real::kernel!`).
macro_rules! span {
    ($probe:expr, $span:ident, || $work:expr) => {
        $probe.span(
            $crate::probe::Span::$span,
            #[inline(always)]
            || $work,
        )
    };
}
pub(crate) use span;

/// Probe that measures nothing.
#[derive(Clone, Copy, Debug, Default)]
pub struct NoProbe;

impl Probe for NoProbe {
    #[inline(always)]
    fn span<T>(self, _: Span, work: impl FnOnce() -> T) -> T {
        work()
    }

    #[inline(always)]
    fn count(self, _: Counter, _: impl FnOnce() -> f64) {}
}
