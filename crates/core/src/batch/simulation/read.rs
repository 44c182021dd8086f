//! Getters of a simulation for one environment: state, flags, contacts and poses.

use std::path::Path;

use crate::analysis::quantities::body_poses;
use crate::batch::engine::with_batch;
use crate::batch::environments::Outcome;
use crate::batch::inputs::{Field, StepInputs};
use crate::batch::simulation::{Error, Simulation};
use crate::batch::state::ContactOfGeoms;
use crate::batch::worst_row::WorstRow;
use crate::error::check_length;
use crate::math::spatial::contact_frame;
use crate::model::write_whole;
use crate::stages::s10_record::Status;

/// Contact of the last step, in the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub struct Contact {
    /// Indices of the two geoms in the model.
    pub geoms: [usize; 2],
    /// Indices of the bodies of the two geoms.
    pub bodies: [usize; 2],
    /// Position of the contact in the world frame, m.
    pub pos: [f64; 3],
    /// Unit normal in world axes, from the first geom to the second.
    pub normal: [f64; 3],
    /// Distance between the geoms minus the margin, m; negative for an overlap.
    pub distance: f64,
    /// Force on the second geom along the rows of [`Contact::frame`], normal first, N.
    pub force: [f64; 3],
    /// Torque of torsional and rolling friction on the second geom about the rows of [`Contact::frame`], N m.
    pub torque: [f64; 3],
}

impl Contact {
    /// Axes of the contact as rows, along which `force` and `torque` are given. They are unit vectors in world axes: the normal and the two
    /// tangents, right-handed.
    pub fn frame(&self) -> [[f64; 3]; 3] {
        contact_frame(self.normal)
    }
}

/// Position and orientation of a body's frame in the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BodyPose {
    /// Position of the frame's origin, m.
    pub pos: [f64; 3],
    /// Orientation: unit quaternion (w, x, y, z).
    pub quat: [f64; 4],
}

impl Simulation {
    /// Copies a state field of one environment to `out`: nq, nv or na numbers.
    ///
    /// # Errors
    /// [`Error::Environment`] when there is no such environment, [`Error::Length`] when `out` has fewer or more numbers; nothing is written
    /// then.
    pub fn get(&self, field: Field, env: usize, out: &mut [f64]) -> Result<(), Error> {
        self.check_env(env)?;
        check_length(field.name(), out.len(), field.width(&self.model))?;
        with_batch!(&self.engine, batch => batch.read(field, env, out));
        Ok(())
    }

    pub(super) fn values(&self, field: Field, env: usize) -> Vec<f64> {
        let mut out = vec![0.0; field.width(&self.model)];
        with_batch!(&self.engine, batch => batch.read(field, env, &mut out));
        out
    }

    /// Configuration of one environment, (nq,): m, rad and unit quaternions.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn qpos(&self, env: usize) -> Vec<f64> {
        self.assert_env(env);
        self.values(Field::Qpos, env)
    }

    /// Velocity of one environment, (nv,): m/s and rad/s.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn qvel(&self, env: usize) -> Vec<f64> {
        self.assert_env(env);
        self.values(Field::Qvel, env)
    }

    /// Simulated time of one environment, s.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn time(&self, env: usize) -> f64 {
        self.assert_env(env);
        with_batch!(&self.engine, batch => batch.time(env))
    }

    /// Outcome of the last call in one environment: status, certificate of the last step, and largest errors.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn outcome(&self, env: usize) -> Outcome {
        self.assert_env(env);
        with_batch!(&self.engine, batch => batch.outcome(env))
    }

    /// Status flags of all steps of the last call, combined.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn status(&self, env: usize) -> Status {
        self.outcome(env).status
    }

    /// Number of clipped readings and number of lost samples in the last call, for every sensor of the model.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn sensor_faults(&self, env: usize) -> Vec<[u32; 2]> {
        self.assert_env(env);
        with_batch!(&self.engine, batch => batch.sensor_faults(env))
    }

    /// Number of steps of the last call in which the effort of each actuator reached its bounds, (nu,).
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn actuator_saturation(&self, env: usize) -> Vec<u32> {
        self.assert_env(env);
        with_batch!(&self.engine, batch => batch.actuator_saturation(env))
    }

    /// Numbers that change where tendons and adhesion have kinks, in the last step. The first list has an entry for each geom in the path
    /// of a tendon: 1 if the tendon touches it, otherwise 0. The second has the number of contacts that each actuator on the contacts of a
    /// body pulls.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn switches(&self, env: usize) -> [Vec<u32>; 2] {
        self.assert_env(env);
        with_batch!(&self.engine, batch => batch.switches(env))
    }

    /// Cause of the last unsolved step of the last call: a constraint row, or an element whose number is not finite.
    ///
    /// With [`Status::NOT_CONVERGED`](crate::Status) it is the row with the largest residual. With [`Status::INFEASIBLE`](crate::Status) it
    /// is the row that misses its position target by most. With [`Status::NON_FINITE`](crate::Status) it is the element.
    ///
    /// `None` if all steps were solved, or if no row exceeds the tolerance.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn worst_row(&self, env: usize) -> Option<WorstRow> {
        self.assert_env(env);
        with_batch!(&self.engine, batch => batch.worst_row(&self.model, env))
    }

    /// Constraint problem of the next step of environment `env`, as bytes for `stepper_solve::Problem::from_bytes`. The state does not
    /// change.
    ///
    /// The function uses the controls in `inputs`. If `inputs` has none, it uses the controls in force. To get the problem of a step that
    /// was not solved, first restore the state before that step, which [`Simulation::save_state`](crate::Simulation::save_state) saved.
    ///
    /// # Errors
    /// The errors of [`Simulation::step`](crate::Simulation::step) for the inputs, and [`Error::Environment`].
    pub fn problem(&self, env: usize, inputs: &StepInputs<'_>) -> Result<Vec<u8>, Error> {
        self.check_env(env)?;
        self.check_inputs(inputs, 1)?;
        let mut ctrl = self.ctrl.clone();
        if !inputs.ctrl.is_empty() {
            // A single row of controls is for all environments.
            ctrl.chunks_exact_mut(inputs.ctrl.len()).for_each(|rows| rows.copy_from_slice(inputs.ctrl));
        }
        Ok(with_batch!(&self.engine, batch => batch.problem(&StepInputs { ctrl: &ctrl, ..self.applied.complete(inputs) }, env)))
    }

    /// Writes [`Simulation::problem`] to a file atomically. A test of the solver loads it with `stepper_solve::Problem::load`.
    ///
    /// # Errors
    /// The errors of [`Simulation::problem`], and [`Error::File`] when the file cannot be written.
    pub fn save_problem(&self, env: usize, inputs: &StepInputs<'_>, path: impl AsRef<Path>) -> Result<(), Error> {
        let (bytes, path) = (self.problem(env, inputs)?, path.as_ref());
        write_whole(path, &bytes).map_err(|e| Error::File { path: path.display().to_string(), reason: e.to_string() })
    }

    /// Contacts of the last step: all contacts whose gap the motion of the step could close, even if the geoms do not touch.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn contacts(&self, env: usize) -> Vec<Contact> {
        self.assert_env(env);
        with_batch!(&self.engine, batch => batch.contacts_of(batch.lane(env))).into_iter().map(|stored| self.contact(stored)).collect()
    }

    /// Contacts of each of the environments `envs`, as [`Simulation::contacts`]. If a state was set since the last step, its contacts are
    /// those of a trial step with the applied inputs and the controls in force. The trial step does not change the state.
    ///
    /// # Errors
    /// [`Error::Threads`] when threads cannot be started.
    ///
    /// # Panics
    /// When there is no such environment.
    #[track_caller]
    pub fn contacts_at_state(&mut self, envs: &[usize]) -> Result<Vec<Vec<Contact>>, Error> {
        envs.iter().for_each(|&env| self.assert_env(env));
        let inputs = StepInputs { ctrl: &self.ctrl, ..self.applied.complete(&StepInputs::default()) };
        let stored = with_batch!(&mut self.engine, batch => batch.contacts_at_state(&inputs, envs))?;
        Ok(stored.into_iter().map(|contacts| contacts.into_iter().map(|stored| self.contact(stored)).collect()).collect())
    }

    /// Contact of two geoms, given by their indices in the model, from a stored contact.
    fn contact(&self, (geoms, c): ContactOfGeoms) -> Contact {
        // The stored impulses are integrals over a step. Division by `h` gives mean forces.
        let h = self.timestep();
        let force = |impulse: [f64; 3]| impulse.map(|x| x / h);
        Contact {
            geoms,
            bodies: geoms.map(|g| self.model.geoms[g].body),
            pos: c.pos,
            normal: c.normal,
            distance: c.distance,
            force: force(c.impulse),
            torque: force(c.torque),
        }
    }

    /// Poses of all bodies of one environment at its present configuration, (nbody,); body 0 is the world.
    ///
    /// `inputs` has arrays for all environments, as for [`Simulation::step`]. Only the poses of mocap bodies are read.
    ///
    /// # Errors
    /// [`Error::Environment`] when there is no such environment, and those of [`Simulation::step`] for the inputs.
    pub fn body_poses_of(&self, env: usize, inputs: &StepInputs<'_>) -> Result<Vec<BodyPose>, Error> {
        self.check_env(env)?;
        self.check_inputs(inputs, 1)?;
        let inputs = &self.applied.complete(inputs);
        let compiled = self.shared_model();
        let mocap = compiled.mocap.len();
        let (pos, quat) = match inputs.mocap_pos.is_empty() {
            true => (&[][..], &[][..]),
            false => (&inputs.mocap_pos[3 * env * mocap..][..3 * mocap], &inputs.mocap_quat[4 * env * mocap..][..4 * mocap]),
        };
        let poses = body_poses(compiled, &self.values(Field::Qpos, env), &self.mocap_poses(pos, quat));
        Ok(poses.into_iter().map(|(pos, quat)| BodyPose { pos, quat }).collect())
    }
}
