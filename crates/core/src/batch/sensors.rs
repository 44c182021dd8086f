//! Sensor readings of a worker: first observations of an episode, readings of a whole group, and results of the last step that sensors
//! need.

use stepper_real::{Mask, Real, Scalar, kernel};

use crate::batch::call::Call;
use crate::batch::exchange::{load_control, load_inputs, load_state};
use crate::batch::inputs::StepInputs;
use crate::batch::state::Group;
use crate::collision::contact_set::Contacts;
use crate::compile::LaneModel;
use crate::compile::sensing::Needs;
use crate::integrators::devices::Devices;
use crate::integrators::observation::{apply_errors, read_sensors};
use crate::integrators::step_input::StepInput;
use crate::integrators::workspace::Workspace;
use crate::math::spatial::*;
use crate::probe::Probe;
use crate::sensing::errors::Errors;
use crate::step::step;

/// Reader of the sensors of one group of environments.
#[derive(Clone, Copy)]
pub(super) struct Reader<'a, R: Real, P> {
    pub(super) call: &'a Call<'a, R::Scalar>,
    pub(super) compiled: &'a LaneModel<R>,
    /// Index of the first environment of the group.
    pub(super) first: usize,
    pub(super) probe: P,
}

impl<R: Real, P: Probe> Reader<'_, R, P> {
    /// Makes the first observation of the error models, in those lanes that have not made one since the user set their state.
    ///
    /// This reading ignores the forces that the user applies. It is therefore the same before a step and within a step.
    pub(super) fn begin_observations(&self, group: &mut Group<R::Scalar>, s: &mut Workspace<R>) {
        if let (Some(errors), true) = (self.call.sensor_errors, group.sensing.waiting & group.alive != 0) {
            self.observe_initial_state(errors, group, s);
        }
    }

    /// Makes the first observation of the error models in the lanes of `group.sensing.waiting`.
    #[cold]
    fn observe_initial_state(&self, errors: &Errors<R::Scalar>, group: &mut Group<R::Scalar>, s: &mut Workspace<R>) {
        let waiting = group.sensing.waiting & group.alive;
        let untouched = Call { inputs: StepInputs { qfrc: &[], xfrc: &[], ..self.call.inputs }, ..*self.call };
        Reader { call: &untouched, ..*self }.evaluate(group, s);
        apply_errors(
            errors,
            self.call.settings,
            &mut s.sensors,
            self.first / R::LANES,
            &mut group.sensing,
            R::Mask::from_bits(waiting),
            true,
        );
        group.sensing.waiting = 0;
    }

    /// Writes the readings of all environments of the group to `out`, environment-major. The readings are those of ideal sensors if `truth`
    /// is true, otherwise those after the error models.
    pub(super) fn read(&self, group: &mut Group<R::Scalar>, s: &mut Workspace<R>, truth: bool, out: &mut [f64]) {
        if truth || self.call.sensor_errors.is_none() {
            self.evaluate(group, s);
        } else {
            // The first step makes the first observation again, because the user may change parameters or poses before it. A reading
            // must not change later readings.
            let unread = (group.sensing.waiting != 0).then(|| group.sensing.clone());
            self.begin_observations(group, s);
            load_or_zero(&group.sensing.observation, &mut s.sensors.workspace.truth);
            if let Some(unread) = unread {
                group.sensing = unread;
            }
        }
        let readings = &s.sensors.workspace.truth;
        for (l, row) in out.chunks_exact_mut(readings.len()).enumerate() {
            row.iter_mut().zip(readings).for_each(|(out, x)| *out = x.lane(l).to_f64());
        }
    }

    /// Completes the readings after the steps with one control, in `s.sensors.workspace.truth`.
    ///
    /// These are the readings after the error models, if there are any, otherwise the true readings. Stage 9 has computed the true
    /// readings, unless `unread` is set because no step was made.
    pub(super) fn complete_readings(&self, group: &Group<R::Scalar>, s: &mut Workspace<R>, unread: bool) {
        if self.call.sensor_errors.is_some() {
            load_or_zero(&group.sensing.observation, &mut s.sensors.workspace.truth);
        } else if unread {
            self.read_truth(s);
        }
    }

    /// Computes the true readings of all sensors at the state in the workspace.
    fn read_truth(&self, s: &mut Workspace<R>) {
        let Workspace { state, inputs, evaluation, velocity, sensors, alive, .. } = s;
        let input = StepInput { compiled: self.compiled, options: self.call.settings, state, inputs, alive: *alive };
        read_sensors(input, &velocity.scalar_impulse, &mut evaluation.kinematics, sensors);
    }

    /// Computes the true readings of all sensors at the stored state of the group.
    ///
    /// If the state was set after the last step, sensors of accelerations and forces read the results of a trial step. A trial step starts
    /// from this state, and does not change it.
    fn evaluate(&self, group: &Group<R::Scalar>, s: &mut Workspace<R>) {
        let needs = self.call.compiled.sensing.needs;
        load_state(group, s, true);
        load_inputs(self.call, group, self.first, s);
        s.current = false;
        load_or_zero(&group.sensing.ctrl, &mut s.inputs.ctrl);
        self.load_last_step(group, s, needs);
        self.read_truth(s);
    }

    /// Loads the group into the workspace to compute derived quantities: state, applied inputs and controls in force.
    ///
    /// If `last_step` is true, results of the last step are loaded too. If the state was set since then, the results come from a trial
    /// step, which does not change the state. If `contacts` is true, the contacts of the last step are loaded too.
    pub(super) fn load_to_derive(&self, group: &Group<R::Scalar>, s: &mut Workspace<R>, last_step: bool, contacts: bool) {
        load_state(group, s, last_step);
        if contacts && !last_step {
            (0..R::LANES).for_each(|lane| load_contacts_of_lane(group, lane, &mut s.state.contacts));
        }
        load_inputs(self.call, group, self.first, s);
        s.current = false;
        match self.call.pipelines {
            Some(_) => load_or_zero(&group.actuation.applied, &mut s.inputs.ctrl),
            None => load_control(self.call, 0, self.first, s),
        }
        if last_step {
            self.load_last_step(group, s, Needs { step: true, contacts: true, ..Needs::default() });
        }
    }

    /// Loads the stored results of the last step that `needs` lists. Lanes whose state was set since the last step make a trial step, from
    /// which only the results are used.
    fn load_last_step(&self, group: &Group<R::Scalar>, s: &mut Workspace<R>, needs: Needs) {
        load_or_zero(&group.sensing.acceleration, &mut s.sensors.acceleration);
        let fresh = if needs.step { group.sensing.fresh & group.alive } else { 0 };
        if fresh != 0 {
            self.make_step_to_read(group, s, fresh);
        }
        for l in (0..R::LANES).filter(|l| fresh >> l & 1 == 0) {
            for (i, x) in s.velocity.scalar_impulse.iter_mut().enumerate() {
                x.set_lane(l, group.scalar_impulse[i * R::LANES + l]);
            }
            if needs.contacts {
                load_contacts_of_lane(group, l, &mut s.state.contacts);
            }
        }
        if needs.wrenches {
            s.inputs.xfrc.resize(6 * self.call.compiled.bodies.len(), R::zero());
            load_other_lanes(&group.sensing.xfrc, &mut s.inputs.xfrc, R::Mask::from_bits(fresh));
        }
    }

    /// Makes a trial step in the lanes `fresh` (bits) to get its results for the sensors, then restores state and time.
    fn make_step_to_read(&self, group: &Group<R::Scalar>, s: &mut Workspace<R>, fresh: u32) {
        let elapsed = s.state.elapsed;
        s.alive = R::Mask::from_bits(fresh);
        step(self.compiled, self.call.settings, s, &mut Devices::default(), self.probe);
        load_other_lanes(&group.sensing.acceleration, &mut s.sensors.acceleration, s.alive);
        load_other_lanes(&group.impulse, &mut s.state.impulse, s.alive);
        load_or_zero(&group.q, &mut s.state.q);
        load_or_zero(&group.v, &mut s.state.v);
        load_or_zero(&group.act, &mut s.state.act);
        s.state.time.copy_from_slice(&group.time);
        s.state.elapsed = elapsed;
    }
}

/// Stores the accelerations and inputs of the last step in the group, because sensors may be read after the call.
pub(super) fn store_sensor_inputs<R: Real>(group: &mut Group<R::Scalar>, s: &Workspace<R>) {
    let memory = &mut group.sensing;
    memory.fresh = 0;
    if memory.acceleration.is_empty() && memory.ctrl.is_empty() && memory.xfrc.is_empty() {
        return;
    }
    kernel!(R, || {
        for (x, out) in [(&s.sensors.acceleration, &mut memory.acceleration), (&s.inputs.ctrl, &mut memory.ctrl)] {
            R::store_all(x, out);
        }
        for (i, out) in memory.xfrc.chunks_exact_mut(R::LANES).enumerate() {
            s.inputs.xfrc.get(i).copied().unwrap_or(R::zero()).store(out);
        }
    });
}

/// Loads the values `from` into those lanes of `out` that are not in `kept`.
fn load_other_lanes<R: Real>(from: &[R::Scalar], out: &mut [R], kept: R::Mask) {
    for (x, from) in out.iter_mut().zip(from.chunks_exact(R::LANES)) {
        *x = R::select(kept, *x, R::load(from));
    }
}

/// Loads the values `from` into `out`, or zeros if `from` is empty.
fn load_or_zero<R: Real>(from: &[R::Scalar], out: &mut [R]) {
    kernel!(R, || {
        if from.is_empty() {
            out.fill(R::zero());
        }
        R::load_all(from, out);
    })
}

/// Loads the stored contacts of lane `lane` into `out`.
fn load_contacts_of_lane<R: Real>(group: &Group<R::Scalar>, lane: usize, out: &mut Contacts<R>) {
    out.count[lane] = group.contact_count[lane] as usize;
    for (k, contact) in group.contacts(lane).enumerate() {
        out.ids[k][lane] = contact.id;
        let slot = &mut out.data[k];
        if let Some(torque) = out.torque.get_mut(k) {
            (0..3).for_each(|i| torque[i].set_lane(lane, Scalar::from_f64(contact.torque[i])));
        }
        let set = |x: &mut V3<R>, from: [f64; 3]| (0..3).for_each(|i| x[i].set_lane(lane, Scalar::from_f64(from[i])));
        set(&mut slot.impulse, contact.impulse);
        set(&mut slot.point.pos, contact.pos);
        set(&mut slot.point.normal, contact.normal);
        slot.point.distance.set_lane(lane, Scalar::from_f64(contact.distance));
    }
}
