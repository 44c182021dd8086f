//! Derived quantities outside a step: of one environment, and of all environments in one call.

use crate::analysis::derived::DerivedQuantity;
use crate::analysis::quantities::Snapshot;
use crate::batch::engine::with_batch;
use crate::batch::inputs::{Field, StepInputs};
use crate::batch::rollout::Numbers;
use crate::batch::simulation::{Error, Simulation};
use crate::constraints::equality::active_equalities::ActiveEqualities;
use crate::integrators::inputs::Inputs;
use crate::math::precision::Precision;

impl Simulation {
    /// Snapshot of one environment at its present state, from which mass matrix, energy and similar quantities can be computed.
    ///
    /// `inputs` has arrays for this environment alone; they replace the inputs in force. With actuator pipelines, the controls are the
    /// outputs of the pipelines.
    ///
    /// # Errors
    /// [`Error::Environment`] when there is no such environment, [`Error::Length`] and [`Error::MocapPoses`] for the inputs.
    pub fn snapshot(&self, env: usize, inputs: &StepInputs<'_>) -> Result<Snapshot<'_>, Error> {
        self.check_env(env)?;
        self.check_each_input(inputs, 1, 1)?;
        let inputs = self.applied.complete_one(env, self.num_envs, inputs);
        let nu = self.model.nu();
        let in_force = || (self.ctrl[env * nu..(env + 1) * nu].to_vec(), vec![]);
        let (mut ctrl, actuator_dynamics) = with_batch!(&self.engine, batch => batch.actuator_outputs(env)).unwrap_or_else(in_force);
        if !inputs.ctrl.is_empty() {
            ctrl = inputs.ctrl.to_vec();
        }
        let compiled = self.lane_model_of(env);
        let mut active_equalities = ActiveEqualities::new(&compiled);
        active_equalities.load(&compiled, inputs.eq_active, 0, 1);
        let (qfrc, xfrc) = (inputs.qfrc.to_vec(), inputs.xfrc.to_vec());
        Ok(Snapshot {
            compiled,
            q: self.values(Field::Qpos, env),
            v: self.values(Field::Qvel, env),
            act: self.values(Field::Act, env),
            inputs: Inputs { ctrl, actuator_dynamics, qfrc, xfrc, active_equalities, mocap_trajectories: vec![] },
            timestep: self.timestep(),
            mocap: self.mocap_poses(inputs.mocap_pos, inputs.mocap_quat),
        })
    }

    /// Computes a derived quantity of all environments, (num_envs, ...), where `...` is its [shape](DerivedQuantity::shape) in one
    /// environment.
    ///
    /// The computation uses the applied inputs and the controls in force. The state does not change.
    ///
    /// # Errors
    /// [`Error::Element`] for a body or site that does not exist, [`Error::Length`] for `out`, [`Error::Threads`] when threads cannot be
    /// started.
    pub fn derive(&mut self, quantity: DerivedQuantity, out: &mut [f64]) -> Result<(), Error> {
        if self.precision == Precision::F64 {
            return self.derive_together(vec![(quantity, Numbers::F64(out))]);
        }
        let mut own = vec![0.0; out.len()];
        self.derive_together(vec![(quantity, Numbers::F32(&mut own))])?;
        out.iter_mut().zip(own).for_each(|(out, x)| *out = f64::from(x));
        Ok(())
    }

    /// Computes several derived quantities of all environments in one pass, which shares intermediate results.
    ///
    /// The arrays must be in the precision of the simulation; see [`Simulation::derive`].
    ///
    /// # Errors
    /// The errors of [`Simulation::derive`], and [`Error::ArrayPrecision`] for an array in another precision.
    pub fn derive_together(&mut self, quantities: Vec<(DerivedQuantity, Numbers<'_>)>) -> Result<(), Error> {
        for (quantity, out) in &quantities {
            self.check_derived(*quantity, out)?;
        }
        let inputs = StepInputs { ctrl: &self.ctrl, ..self.applied.complete(&StepInputs::default()) };
        with_batch!(&mut self.engine, batch => batch.derive(&inputs, quantities))
    }

    fn check_derived(&self, quantity: DerivedQuantity, out: &Numbers<'_>) -> Result<(), Error> {
        let element = match quantity {
            DerivedQuantity::BodyJacobian(body) => Some(("body", body, self.model.bodies.len())),
            DerivedQuantity::SiteJacobian(site) => Some(("site", site, self.model.sites.len())),
            _ => None,
        };
        if let Some((element, found, count)) = element.filter(|(_, found, count)| found >= count) {
            return Err(Error::Element { element, found, count });
        }
        self.check_array(quantity.name(), out, self.num_envs * quantity.shape(&self.model).iter().product::<usize>())
    }

    /// Poses of the mocap bodies of one environment: position, m, and quaternion. `pos` and `quat` are the inputs of this environment; if
    /// `pos` is empty, the result is the poses in the model.
    pub(super) fn mocap_poses(&self, pos: &[f64], quat: &[f64]) -> Vec<([f64; 3], [f64; 4])> {
        let (pos, quat) = (pos.as_chunks::<3>().0, quat.as_chunks::<4>().0);
        self.shared_model()
            .mocap
            .iter()
            .enumerate()
            .map(|(k, m)| if pos.is_empty() { (m.pos, m.quat) } else { (pos[k], quat[k]) })
            .collect()
    }
}
