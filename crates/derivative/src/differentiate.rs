//! Derivatives of a step in all environments at once, with the contact modes (open, sticking, slipping) of its solution.

use std::sync::{Mutex, PoisonError};

use stepper_core::group_step::{GroupStep, GroupVisitor, StatePart, StepSettings, check_length};
use stepper_core::{ContactLaw, Error, Integrator, Options, Simulation};
use stepper_real::Real;

use crate::rows::{Derivative, DerivativeQuery};
use crate::step_derivative::StepDerivative;

/// Computes the derivatives of a step by the implicit function theorem, in all environments.
///
/// The step starts at the current state of `sim` and has the controls `ctrl`, (num_envs, nu). `query` selects the columns of the
/// derivatives. The result has one derivative for each environment. The state of `sim` does not change.
///
/// # Errors
/// [`Error::Option`] for settings without implicit derivatives, [`Error::Length`] for arrays of the wrong length, [`Error::Threads`]
/// when threads cannot be started.
pub fn differentiate(sim: &mut Simulation, ctrl: &[f64], query: &DerivativeQuery<'_>) -> Result<Vec<Derivative>, Error> {
    check_settings(sim)?;
    let (n, model) = (sim.num_envs(), sim.model());
    let [nq, nv, na, nu] = [model.nq(), model.nv(), model.na(), model.nu()];
    let width = |part: &StatePart| match part {
        StatePart::Qpos | StatePart::Qvel => nv,
        StatePart::Act => na,
        StatePart::Ctrl => nu,
    };
    let columns: usize = query.parts.iter().map(width).sum();
    check_length("points of a column", query.points.clamp(1, 2), query.points)?;
    check_length("ctrl", ctrl.len(), n * nu)?;
    check_length("offsets", query.offsets.len(), n * query.points * columns)?;
    let derivatives = (0..n).map(|_| Mutex::new(Derivative::new([nq, nv, na], columns))).collect();
    let visitor = Differentiation { query: *query, derivatives };
    sim.visit_groups(ctrl, query.tolerance, &visitor)?;
    Ok(visitor.derivatives.into_iter().map(|one| one.into_inner().unwrap_or_else(PoisonError::into_inner)).collect())
}

/// Visitor that computes the derivatives of the step of each SIMD group of environments.
struct Differentiation<'a> {
    query: DerivativeQuery<'a>,
    /// Derivatives of all environments. Each environment belongs to one group, so that no thread waits for a lock.
    derivatives: Vec<Mutex<Derivative>>,
}

impl GroupVisitor for Differentiation<'_> {
    fn visit<R: Real<Scalar = f64>>(&self, step: &mut GroupStep<R>, first: usize) {
        let lanes = self.derivatives.iter().skip(first).take(R::LANES);
        let mut lanes: Vec<_> = lanes.map(|derivative| derivative.lock().unwrap_or_else(PoisonError::into_inner)).collect();
        let offsets = &self.query.offsets[first * (self.query.offsets.len() / self.derivatives.len())..];
        let mut derivative = step.take_memory().unwrap_or_else(|| Box::new(StepDerivative::new(step)));
        derivative.differentiate(step, &DerivativeQuery { offsets, ..self.query }, &mut lanes);
        step.store_memory(derivative);
    }
}

/// Checks that the integrator of `sim` has implicit derivatives, and that MuJoCo's contact law makes no noslip iterations.
fn check_settings(sim: &Simulation) -> Result<(), Error> {
    let StepSettings { options: Options { contact, error, .. }, integrator, .. } = *sim.settings();
    let wrong = |name, found: &str, must| Err(Error::Option { name, found: found.to_owned(), must });
    let must = match (contact, integrator) {
        (ContactLaw::Hard, Integrator::Euler | Integrator::Implicit | Integrator::Midpoint)
        | (ContactLaw::Mujoco, Integrator::Euler | Integrator::ImplicitFast | Integrator::Implicit) => "",
        (ContactLaw::Hard, _) => "midpoint, euler or implicit for stepper_derivative::differentiate; finite differences take all",
        _ => "euler, implicitfast or implicit for stepper_derivative::differentiate; finite differences take all",
    };
    if !must.is_empty() {
        return wrong("integrator", integrator.name(), must);
    }
    if let Some(error) = error {
        return wrong("error", &error.to_string(), "None for derivatives, because the number of substeps jumps with the state");
    }
    let noslip = sim.model().soft.noslip.iterations;
    if contact == ContactLaw::Mujoco && noslip > 0 {
        let must = "0 for stepper_derivative::differentiate, since the sweeps after the solution have no derivative here; finite differences take all";
        return wrong("noslip_iterations", &noslip.to_string(), must);
    }
    Ok(())
}
