//! Values of a step up to its constraint problem: state, inputs, evaluation point and free motion.

use stepper_real::{Mask, Real};

use crate::actuation::forces::{ActuatorForces, ForceState};
use crate::collision::contact_set::Contacts;
use crate::collision::detection::CollisionWorkspace;
use crate::compile::LaneModel;
use crate::constraints::solved_overlaps::SolvedOverlaps;
use crate::dynamics::kinematics::Kinematics;
use crate::integrators::impact_set::Impacts;
use crate::integrators::inputs::Inputs;
use crate::integrators::scheme;
use crate::integrators::scheme::Scheme;
use crate::math::spatial::*;
use crate::options::StepSettings;
use crate::stages::s02_smooth::Smooth;

/// State of a group of lanes, which a step hands over to the next. The impulses of scalar rows ([`VelocitySolution::scalar_impulse`]) and
/// the memories of sensors and actuator pipelines are stored elsewhere.
///
/// [`VelocitySolution::scalar_impulse`]: crate::constraints::VelocitySolution::scalar_impulse
#[derive(Clone, Debug)]
pub(crate) struct State<R: Real> {
    /// Configuration, nq.
    pub(crate) q: Vec<R>,
    /// Velocity, nv.
    pub(crate) v: Vec<R>,
    /// Activations, na.
    pub(crate) act: Vec<R>,
    /// Contacts of the last step with their impulses, the warm start of the next.
    pub(crate) contacts: Contacts<R>,
    /// Generalized impulse of all constraints in the last step, nv.
    pub(crate) impulse: Vec<R>,
    /// Simulated time of every lane, s, in 64 bits because it is a sum of many steps.
    pub(crate) time: Vec<f64>,
    /// Time since the beginning of the call, s. It determines the poses of mocap bodies.
    pub(crate) elapsed: f64,
}

/// Input of a step: model, settings, state and user inputs. After the step is accepted, `state` is the next state.
#[derive(Clone, Copy)]
pub(crate) struct StepInput<'a, R: Real> {
    pub(crate) compiled: &'a LaneModel<R>,
    pub(crate) options: &'a StepSettings,
    pub(crate) state: &'a State<R>,
    pub(crate) inputs: &'a Inputs<R>,
    /// Lanes that have an environment.
    pub(crate) alive: R::Mask,
}

/// Input of a step together with its evaluation point (the time at which forces and contacts are evaluated). Stages 4 to 8 do not move it.
#[derive(Clone, Copy)]
pub(crate) struct Place<'a, R: Real> {
    pub(crate) input: StepInput<'a, R>,
    pub(crate) evaluation: &'a Evaluation<R>,
}

impl<'a, R: Real> Place<'a, R> {
    /// Inputs of the force computation at the evaluation point. Explicit velocity-dependent forces use the velocity `v_at`.
    pub(crate) fn forces_at(&self, v_at: &'a [R]) -> ForceState<'a, R> {
        let Place { input: StepInput { state, inputs, .. }, evaluation: Evaluation { scheme, q, q_ahead, act, .. } } = *self;
        let Inputs { ctrl, actuator_dynamics, .. } = inputs;
        ForceState { q: scheme.springs_at(q, q_ahead), v: &state.v, v_at, act, ctrl, actuator_dynamics }
    }
}

/// Evaluation point of a step: the time at which forces, contacts and rows are evaluated, and the poses there.
#[derive(Clone, Debug)]
pub(crate) struct Evaluation<R: Real> {
    /// Scheme of the step, with the evaluation time of each lane.
    pub(crate) scheme: Scheme<R>,
    /// Lanes that are evaluated at the beginning of the step despite the midpoint rule, because their bodies are fast.
    pub(crate) at_start: R::Mask,
    /// Configuration at the evaluation point, nq.
    pub(crate) q: Vec<R>,
    /// Configuration at which springs and servos are evaluated, nq. The implicit scheme evaluates them later in the step than other forces.
    pub(crate) q_ahead: Vec<R>,
    /// Activations at the evaluation point, na.
    pub(crate) act: Vec<R>,
    /// Poses at `q`.
    pub(crate) kinematics: Kinematics<R>,
    /// Poses of the geoms, and the workspace of collision detection.
    pub(crate) collision: CollisionWorkspace<R>,
    /// Contacts at `q`.
    pub(crate) contacts: Contacts<R>,
    /// Impacts within the step.
    pub(crate) impacts: Impacts<R>,
    /// Overlaps of the step that is being differentiated; `None` in a normal step.
    pub(crate) solved_overlaps: Option<Box<SolvedOverlaps<R>>>,
}

impl<R: Real> Evaluation<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>, options: &StepSettings, contacts: Contacts<R>) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        Self {
            scheme: scheme(options),
            at_start: R::Mask::splat(false),
            q: zeros(compiled.nq),
            q_ahead: zeros(compiled.nq),
            act: zeros(compiled.na),
            kinematics: Kinematics::new(compiled),
            collision: CollisionWorkspace::new(compiled),
            contacts,
            impacts: Impacts::new(compiled),
            solved_overlaps: None,
        }
    }

    /// Fills the vectors that a step must compute before it reads them with NaN, for tests.
    pub(super) fn poison(&mut self) {
        let Self { q, q_ahead, act, .. } = self;
        [q, q_ahead, act].into_iter().for_each(|buffer| buffer.fill(R::of(f64::NAN)));
    }

    /// Prepares the contacts of a step.
    ///
    /// The function chooses their tangents, and copies the impulses of the same contacts from `last`, the contacts of the last step. In
    /// single precision, it sets gaps within rounding to zero. `last` is overwritten.
    #[inline(always)]
    pub(crate) fn match_contacts(&mut self, compiled: &LaneModel<R>, last: &mut Contacts<R>) {
        self.contacts.close_rounded_gaps(norm(compiled.params.gravity()) * self.scheme.h * self.scheme.h);
        self.contacts.prepare(last);
    }
}

/// Free motion of the step (without constraints), the forces that cause it, and the predicted effect of the constraints.
#[derive(Clone, Debug)]
pub(crate) struct FreeMotion<R: Real> {
    /// Mass matrix, bias forces and acceleration.
    pub(crate) smooth: Smooth<R>,
    /// Forces of actuators and joint springs.
    pub(crate) actuator_forces: ActuatorForces<R>,
    /// Generalized forces that the user applied, nv.
    pub(crate) applied: Vec<R>,
    /// Velocity after the step without constraints, nv.
    pub(crate) v: Vec<R>,
    /// Predicted velocity after the step, nv. Velocity-dependent forces are evaluated between this and the velocity before the step
    /// ([`Scheme::velocity_weight`]).
    pub(crate) v_expected: Vec<R>,
    /// Generalized impulse of the constraints in this step, nv.
    pub(crate) impulse: Vec<R>,
    /// Lanes whose motion is too fast for the time step.
    pub(crate) unresolved: R::Mask,
    /// Lanes whose motion is so fast that the error of the time step may add energy.
    pub(crate) may_gain: R::Mask,
    /// Buffers of the functions that compute the free motion.
    pub(crate) scratch: Scratch<R>,
}

/// Scratch buffers of the free motion, each named after its usual content, nv. A function fills a buffer before it reads it.
#[derive(Clone, Debug)]
pub(crate) struct Scratch<R: Real> {
    /// Change of the velocity by constraint impulses.
    pub(crate) velocity_by_impulses: Vec<R>,
    /// Change of the velocity by the whole step, nv.
    pub(crate) velocity_change: Vec<R>,
    /// Generalized impulses.
    pub(crate) impulse: Vec<R>,
    /// Velocity at which velocity-dependent forces are evaluated.
    pub(crate) v_mean: Vec<R>,
    /// Mean velocity of the step; in lanes without inertial forces the velocity before the step.
    pub(crate) v_forces: Vec<R>,
    /// Free velocity with recomputed forces.
    pub(crate) v_free_corrected: Vec<R>,
    /// Difference between the recomputed and the previous free velocity.
    pub(crate) free_change: Vec<R>,
    /// Free velocity after the first half of the step, or at an impact.
    pub(crate) v_half: Vec<R>,
    /// Velocity before impacts, or its change.
    pub(crate) before_impact: Vec<R>,
}

impl<R: Real> Scratch<R> {
    /// Fills all buffers with NaN, for tests.
    pub(crate) fn poison(&mut self) {
        let Self { velocity_by_impulses, velocity_change, impulse, v_mean, v_forces, v_free_corrected, free_change, v_half, before_impact } =
            self;
        [velocity_by_impulses, velocity_change, impulse, v_mean, v_forces, v_free_corrected, free_change, v_half, before_impact]
            .into_iter()
            .for_each(|buffer| buffer.fill(R::of(f64::NAN)));
    }
}

impl<R: Real> FreeMotion<R> {
    /// Workspace for a compiled model.
    pub(crate) fn new(compiled: &LaneModel<R>) -> Self {
        let (v, none) = (|| vec![R::zero(); compiled.nv], R::Mask::splat(false));
        Self {
            smooth: Smooth::new(compiled),
            actuator_forces: ActuatorForces::new(compiled),
            applied: v(),
            v: v(),
            v_expected: v(),
            impulse: v(),
            unresolved: none,
            may_gain: none,
            scratch: Scratch {
                velocity_by_impulses: v(),
                velocity_change: v(),
                impulse: v(),
                v_mean: v(),
                v_forces: v(),
                v_free_corrected: v(),
                free_change: v(),
                v_half: v(),
                before_impact: v(),
            },
        }
    }

    /// Fills the vectors that a step must compute before it reads them with NaN, for tests.
    pub(super) fn poison(&mut self) {
        let Self { applied, v, v_expected, impulse, scratch, .. } = self;
        [applied, v, v_expected, impulse].into_iter().for_each(|buffer| buffer.fill(R::of(f64::NAN)));
        scratch.poison();
    }

    /// Computes the acceleration by all forces (see [`Smooth::acceleration`]). `v` is the velocity before the step, `v_bias` the velocity
    /// at which inertial forces are evaluated.
    pub(crate) fn accelerate(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], v_bias: &[R]) {
        self.smooth.acceleration(compiled, kinematics, [&self.actuator_forces.tau, &self.applied], v, v_bias);
    }
}
