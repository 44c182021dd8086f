//! Probe of the step, which measures times, counts and operations, and costs nothing when it is off.
//!
//! The probe is a type parameter of the step. The engine steps with [`NoProbe`], which has no size and does nothing. Its step is compiled
//! as if there were no probe. The benches use other probes.

/// Declares an enumeration whose variants have names in reports.
macro_rules! reported {
    ($(#[$about:meta])* $name:ident { $($(#[$doc:meta])* $variant:ident = $text:literal,)+ }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name {
            $($(#[$doc])* $variant,)+
        }

        // Only the benches make reports.
        #[cfg(feature = "internals")]
        impl $name {
            /// All variants, in the order of a step.
            pub const ALL: &[Self] = &[$(Self::$variant,)+];

            /// Name in reports.
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$variant => $text,)+
                }
            }
        }
    };
}

reported! {
    /// Part of a step, or of a worker's work around its steps.
    ///
    /// Spans can be nested. The report of a span excludes the inner ones.
    Span {
        /// Loading of state, parameters and inputs of a group into the workspace.
        Load = "load",
        /// Dynamics of actuators between the steps: delay, lag, limits.
        ActuatorPipelines = "actuator pipelines",
        /// Configuration at which a scheme evaluates the step.
        Displace = "displace",
        /// Poses, axes and inertias.
        Kinematics = "kinematics",
        /// Forces of actuators and springs, and applied forces.
        Actuate = "actuate",
        /// Mass matrix.
        MassMatrix = "mass matrix",
        /// Factors of the mass matrix.
        MassFactors = "mass factors",
        /// Bias force and free acceleration.
        Acceleration = "bias force and acceleration",
        /// Poses of geoms, and candidate pairs.
        BroadPhase = "broad phase",
        /// Contacts of the candidate pairs.
        NarrowPhase = "narrow phase",
        /// Times of impacts within the step.
        ImpactTimes = "impact times",
        /// Impulses of the same contacts in the last step.
        WarmStart = "warm start",
        /// Rows of the constraint problem.
        Assemble = "assemble",
        /// Estimate of the impulses.
        EstimateImpulses = "estimate impulses",
        /// Forces at the expected velocity, and the change of the problem by them.
        CorrectForces = "correct forces",
        /// Solution of the constraint problem.
        Solve = "solve",
        /// Repeated solution of the problem where impacts made the velocity jump.
        SolveImpacts = "solve again at impacts",
        /// Velocities from impulses.
        IntegrateVelocity = "integrate velocity",
        /// Guard of steps that are too long for the motion, or whose impulses leave the energy ambiguous.
        GuardEnergy = "guard energy",
        /// Check for geoms that may have passed through thin ones.
        Tunnelling = "tunnelling",
        /// Configurations from velocities.
        IntegratePosition = "integrate position",
        /// Position targets: the second solution of the problem.
        Stabilise = "stabilise: second solve",
        /// Runge-Kutta method of order 4.
        Rk4 = "rk4",
        /// Acceptance of the next state where it is finite.
        Accept = "accept",
        /// Sensors and their errors.
        Sense = "sense",
        /// Record of a step, with its status flags.
        Record = "record",
        /// Recording of a rollout.
        Rollout = "rollout",
        /// Storing of a group's state.
        Store = "store",
    }
}

reported! {
    /// Counter of a step of a group. The counts of its environments are summed, unless the lanes share what is counted.
    Counter {
        /// Number of steps of a group.
        GroupSteps = "steps of a group",
        /// Number of evaluations of a step's forces, in all of its lanes.
        Evaluations = "evaluations",
        /// Number of candidate pairs in the narrow phase, shared by all lanes.
        NearPairs = "near pairs",
        /// Number of contacts.
        Contacts = "contacts",
        /// Number of slots into which the contacts of all lanes are packed, shared by the lanes.
        ContactSlots = "contact slots",
        /// Number of rows of limits, dry friction, equalities and tendons, shared by all lanes.
        ScalarRows = "scalar rows",
        /// Number of sweeps of the solver.
        Sweeps = "sweeps",
        /// Number of sweeps of the slowest lane of a group.
        SlowestSweeps = "sweeps of the slowest lane",
        /// Number of Newton steps of the solver.
        NewtonSteps = "Newton steps",
    }
}

#[cfg(feature = "internals")]
impl Counter {
    /// Whether the lanes of a group share the count. Otherwise the counts of its environments are summed.
    pub const fn is_shared(self) -> bool {
        !matches!(self, Self::Contacts | Self::Sweeps | Self::NewtonSteps)
    }
}

/// Probe of a step. It is passed by value: one without size costs no register.
pub trait Probe: Copy + Send + 'static {
    /// Runs a part of the step.
    fn span<T>(self, span: Span, work: impl FnOnce() -> T) -> T;
    /// Adds a number to a counter. A probe that does not count never computes it.
    fn count(self, counter: Counter, number: impl FnOnce() -> f64);
}

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
