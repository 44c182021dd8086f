//! Derivatives of a step at the modes of its solution, of all environments at once.

use crate::batch::inputs::StepInputs;
use crate::batch::simulation::{Error, Simulation};
use crate::error::check_length;
use crate::math::precision::Precision;
use crate::options::{ContactLaw, Integrator, StepSettings};
use crate::step_derivative::{DerivativeQuery, DerivativeRows, StatePart};

impl Simulation {
    /// Differentiates the step from the present state with the controls `ctrl`, (num_envs, nu), by the implicit function theorem. The state
    /// stays the same.
    ///
    /// # Errors
    /// [`Error::Option`] for settings without implicit derivatives, [`Error::Length`] for arrays of the wrong length, [`Error::Threads`]
    /// when threads cannot be started.
    pub fn differentiate(&mut self, ctrl: &[f64], query: &DerivativeQuery<'_>, rows: DerivativeRows<'_>) -> Result<(), Error> {
        self.check_implicit()?;
        let (n, model) = (self.num_envs, &self.model);
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
        check_length("slopes", rows.slopes.len(), n * (2 * nv + na) * columns)?;
        check_length("causes", rows.causes.len(), n * columns)?;
        for (name, found) in [("distance", rows.distance.len()), ("sound", rows.sound.len()), ("residual", rows.residual.len())] {
            check_length(name, found, n)?;
        }
        check_length("status", rows.status.len(), n)?;
        for (state, width) in rows.state.iter().zip([nq, nv, na]) {
            check_length("state", state.len(), n * width)?;
        }
        let inputs = StepInputs { ctrl, ..self.applied.complete(&StepInputs::default()) };
        self.engine.differentiate(&inputs, query, rows)
    }

    /// Checks that the settings have implicit derivatives: the step must have one solution that determines all else.
    fn check_implicit(&self) -> Result<(), Error> {
        let StepSettings { contact, integrator, .. } = *self.engine.settings();
        let wrong = |name, found: &str, must| Err(Error::Option { name, found: found.to_owned(), must });
        match (contact, integrator) {
            (ContactLaw::Hard, Integrator::Euler | Integrator::Implicit | Integrator::Midpoint)
            | (ContactLaw::Mujoco, Integrator::Euler | Integrator::ImplicitFast | Integrator::Implicit) => {}
            (ContactLaw::Hard, other) => {
                return wrong(
                    "integrator",
                    other.name(),
                    "midpoint, euler or implicit for Simulation::differentiate; finite differences take all",
                );
            }
            (ContactLaw::Mujoco, other) => {
                return wrong(
                    "integrator",
                    other.name(),
                    "euler, implicitfast or implicit for Simulation::differentiate; finite differences take all",
                );
            }
        }
        let noslip = self.model().soft.noslip.iterations;
        if contact == ContactLaw::Mujoco && noslip > 0 {
            let must =
                "0 for Simulation::differentiate, since the sweeps after the solution have no derivative here; finite differences take all";
            return wrong("noslip_iterations", &noslip.to_string(), must);
        }
        if self.precision == Precision::F32 {
            return wrong("precision", "f32", "f64 for derivatives");
        }
        if self.actuator_models.is_some() {
            return wrong("actuators", "drives with a memory", "none for Simulation::differentiate; finite differences take all");
        }
        Ok(())
    }
}
