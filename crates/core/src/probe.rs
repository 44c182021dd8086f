//! Probe of the step, which measures times, counts and operations, and costs nothing when it is off.
//!
//! The probe is a type parameter of the step. The engine steps with [`NoProbe`], which has no size and does nothing. Its step is compiled
//! as if there were no probe. The benches use other probes.

/// An enumeration whose variants have names in reports.
macro_rules! reported {
    ($(#[$about:meta])* $name:ident { $($(#[$doc:meta])* $variant:ident = $text:literal,)+ }) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $name {
            $($(#[$doc])* $variant,)+
        }

        // Reports are of the benches.
        #[cfg(feature = "internals")]
        impl $name {
            /// All of them, in the order of a step.
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
        /// State, parameters and inputs of a group brought into the workspace.
        Load = "load",
        /// Dynamics of actuators between the steps: delay, lag, limits.
        ActuatorPipelines = "actuator pipelines",
        /// Configuration at which a scheme takes the step.
        Displace = "displace",
        /// Poses, axes and inertias.
        Kinematics = "kinematics",
        /// Forces of actuators and springs, and what the user applies.
        Actuate = "actuate",
        /// Servos at the bounds of their force.
        SaturateServos = "saturate servos",
        /// Mass matrix.
        MassMatrix = "mass matrix",
        /// Factors of the mass matrix.
        MassFactors = "mass factors",
        /// Bias force and free acceleration.
        Acceleration = "bias force and acceleration",
        /// Poses of geoms, and the pairs of them that are near one another.
        BroadPhase = "broad phase",
        /// Contacts of those pairs.
        NarrowPhase = "narrow phase",
        /// Times of impacts within the step.
        ImpactTimes = "impact times",
        /// Impulses of the same contacts in the last step.
        WarmStart = "warm start",
        /// Rows of the constraint problem.
        Assemble = "assemble",
        /// An estimate of the impulses.
        EstimateImpulses = "estimate impulses",
        /// Forces at the velocity to be expected, and the change of the problem by them.
        CorrectForces = "correct forces",
        /// The constraint problem.
        Solve = "solve",
        /// The problem again where impacts made the velocity jump.
        SolveImpacts = "solve again at impacts",
        /// Impulses to velocities.
        IntegrateVelocity = "integrate velocity",
        /// Motion that the step is too long for, or that impulses do not decide.
        GuardEnergy = "guard energy",
        /// Whether something may have passed through something thin.
        Tunnelling = "tunnelling",
        /// Velocities to configurations.
        IntegratePosition = "integrate position",
        /// Position targets: the second solution of the problem.
        Stabilise = "stabilise: second solve",
        /// Runge and Kutta's method.
        Rk4 = "rk4",
        /// The next state taken over where it is finite.
        Accept = "accept",
        /// Sensors and their errors.
        Sense = "sense",
        /// Record of a step, with its status flags.
        Record = "record",
        /// Recording of a rollout.
        Rollout = "rollout",
        /// State of a group brought back from the workspace.
        Store = "store",
    }
}

reported! {
    /// A number that a step of a group of environments counts. Those of its environments are added up, unless they share what is counted.
    Counter {
        /// Steps of a group.
        GroupSteps = "steps of a group",
        /// Times that the forces of a step were taken, in all of its lanes.
        Evaluations = "evaluations",
        /// Pairs of geoms that the narrow phase looked at, shared by all lanes.
        NearPairs = "near pairs",
        /// Contacts.
        Contacts = "contacts",
        /// Slots that contacts of all lanes are packed into, shared by them.
        ContactSlots = "contact slots",
        /// Rows of limits, dry friction, equalities and tendons, shared by all lanes.
        ScalarRows = "scalar rows",
        /// Sweeps of the solver.
        Sweeps = "sweeps",
        /// Sweeps of the lane of a group that has the most.
        SlowestSweeps = "sweeps of the slowest lane",
        /// Newton steps of the solver.
        NewtonSteps = "Newton steps",
    }
}

#[cfg(feature = "internals")]
impl Counter {
    /// Whether the lanes of a group share what is counted; else its environments are added up.
    pub const fn is_shared(self) -> bool {
        !matches!(self, Self::Contacts | Self::Sweeps | Self::NewtonSteps)
    }
}

/// Probe of a step. It is passed by value: one without size costs no register.
pub trait Probe: Copy + Send + 'static {
    /// Does the work of a part of the step.
    fn span<T>(self, span: Span, work: impl FnOnce() -> T) -> T;
    /// Adds a number to a counter. A probe that does not count never computes it.
    fn count(self, counter: Counter, number: impl FnOnce() -> f64);
}

/// Nobody measures.
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
