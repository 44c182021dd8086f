//! State of a group of lanes.

use stepper_real::Real;

use crate::collision::contact_set::Contacts;

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
