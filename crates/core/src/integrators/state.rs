//! State of a group of lanes.

use stepper_real::Real;

use crate::collision::contact_set::Contacts;

/// State of a group of lanes, which one step hands over to the next. The state also includes the impulses of scalar rows, in
/// [`VelocitySolution::scalar_impulse`], and the memories of sensors and actuator pipelines, which the batch stores.
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
    /// Contacts of the last step with their impulses, from which the next step starts.
    pub(crate) contacts: Contacts<R>,
    /// Generalized impulse of all constraints in the last step, nv.
    pub(crate) impulse: Vec<R>,
    /// Simulated time of every lane, s. It has 64 bits in every precision, because it is a sum of many steps.
    pub(crate) time: Vec<f64>,
    /// Time since the beginning of the call of `step`, which may make several steps, s. It determines the poses of mocap bodies.
    pub(crate) elapsed: f64,
}
