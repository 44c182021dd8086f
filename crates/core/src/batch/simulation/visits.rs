//! Access to the step of every group of environments, for derivatives.

use stepper_real::{Real, at_level};

use crate::batch::engine::{Engine, with_batch};
use crate::batch::inputs::StepInputs;
use crate::batch::simulation::{Error, Simulation};
use crate::batch::stepping::LentStep;
use crate::error::check_length;
use crate::group_step::{GroupStep, GroupVisitor, StepSettings};

impl Simulation {
    /// Calls `visitor` for every group of environments, with the group's step from the present state.
    ///
    /// The step uses the controls `ctrl`, (num_envs, nu), and its solver converges to a residual of `tolerance`, m/s. The state of the
    /// environments does not change.
    ///
    /// The worker threads call the visitor. The step leaves out error models of sensors.
    ///
    /// # Errors
    /// [`Error::Option`] in 32 bits and with actuator models, [`Error::Length`] for controls of the wrong length, [`Error::Threads`] when
    /// threads cannot be started.
    pub fn visit_groups<V: GroupVisitor>(&mut self, ctrl: &[f64], tolerance: f64, visitor: &V) -> Result<(), Error> {
        let wrong = |name, found: &str, must| Err(Error::Option { name, found: found.to_owned(), must });
        let Engine::F64(batch) = &mut self.engine else {
            return wrong("precision", "f32", "f64 for Simulation::visit_groups");
        };
        if self.actuator_models.is_some() {
            return wrong("actuators", "drives with a memory", "none for Simulation::visit_groups; finite differences take all");
        }
        check_length("ctrl", ctrl.len(), self.num_envs * self.model.nu())?;
        let inputs = StepInputs { ctrl, ..self.applied.complete(&StepInputs::default()) };
        batch.lend_steps(&inputs, tolerance, &|lent| match lent.lanes {
            1 => at_level!(lent.level, F64x1, visit(lent, visitor)),
            _ => at_level!(lent.level, F64Lanes, visit(lent, visitor)),
        })
    }

    /// Step settings in force.
    pub fn settings(&self) -> &StepSettings {
        with_batch!(&self.engine, batch => &batch.settings)
    }
}

fn visit<R: Real<Scalar = f64>>(lent: LentStep<'_>, visitor: &impl GroupVisitor) {
    let LentStep { first, step, .. } = lent;
    let step = step.downcast_mut::<GroupStep<R>>().expect("a group has the lanes of its level");
    visitor.visit(step, first);
}
