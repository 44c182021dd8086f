//! A worker's sensors: what they need of every step, and readings of a whole group at once.

use stepper_real::{Mask, Real, Scalar};

use crate::actuation::forces::{ActuatorForces, ForceState};
use crate::batch::call::Call;
use crate::batch::exchange::{load_inputs, load_state};
use crate::batch::inputs::StepInputs;
use crate::batch::state::Group;
use crate::collision::contact_set::Contacts;
use crate::compile::{LaneModel, ModelStructure};
use crate::dynamics::mocap;
use crate::integrators::workspace::Workspace;
use crate::math::spatial::*;
use crate::probe::Probe;
use crate::sensing::errors::{Errors, Slots, Work};
use crate::sensing::{Room, SensorInput};
use crate::stages::s01_actuate::actuate;
use crate::stages::s09_sense::sense;
use crate::step::step;

/// Room of a worker's sensors.
pub(super) struct Senses<R: Real, P: Probe> {
    /// Who measures the step that is made to be read.
    probe: P,
    room: Room<R>,
    actuator_forces: ActuatorForces<R>,
    work: Option<Work<R>>,
    v_before: Vec<R>,
    acceleration: Vec<R>,
}

impl<R: Real, P: Probe> Senses<R, P> {
    pub(super) fn new(compiled: &ModelStructure<R::Scalar>, max_contacts: usize, probe: P) -> Self {
        let n = if compiled.sensing.needs.acceleration { compiled.nv } else { 0 };
        Self {
            probe,
            room: Room::new(compiled, max_contacts),
            actuator_forces: ActuatorForces::new(compiled),
            work: None,
            v_before: vec![R::zero(); n],
            acceleration: vec![R::zero(); n],
        }
    }

    /// Keeps what a step will change.
    pub(super) fn before_step(&mut self, s: &Workspace<R>) {
        if !self.v_before.is_empty() {
            self.v_before.copy_from_slice(&s.state.v);
        }
    }

    /// (v+ - v) / h in the lanes `lanes`.
    fn accelerate(&mut self, s: &Workspace<R>, h: f64, lanes: R::Mask) {
        if self.acceleration.is_empty() {
            return;
        }
        R::vectorize(
            #[inline(always)]
            || {
                let rate = R::one() / R::of(h);
                for ((a, &before), &v) in self.acceleration.iter_mut().zip(&self.v_before).zip(&s.state.v) {
                    *a = R::select(lanes, (v - before) * rate, *a);
                }
            },
        )
    }

    /// Takes up a step, and lets sensors that are not ideal read it.
    pub(super) fn after_step(
        &mut self,
        call: &Call<'_, R::Scalar>,
        compiled: &LaneModel<R>,
        group: &mut Group<R::Scalar>,
        first: usize,
        s: &mut Workspace<R>,
    ) {
        self.accelerate(s, call.settings.timestep, R::Mask::splat(true));
        for l in 0..R::LANES {
            group.sensing.step[l] = group.sensing.step[l].wrapping_add(1);
        }
        if let Some(errors) = call.sensor_errors {
            self.sense(call, compiled, group, s);
            self.observe(errors, call, group, first, s.alive, false);
        }
    }

    /// True readings of the state in `s`, left in the room.
    fn sense(&mut self, call: &Call<'_, R::Scalar>, compiled: &LaneModel<R>, group: &Group<R::Scalar>, s: &mut Workspace<R>) {
        let elapsed = R::of(s.elapsed);
        mocap::pose_bodies(compiled, &s.mocap_trajectories, elapsed, &mut s.evaluation.kinematics);
        if compiled.sensing.needs.actuators {
            if compiled.wrench_arms[1] > 0 {
                s.evaluation.kinematics.update(compiled, &s.state.q);
                self.actuator_forces.transmit(compiled, &s.evaluation.kinematics, &s.state.v, R::zero());
            }
            actuate(
                compiled,
                &ForceState::state(&s.state.q, &s.state.v, &s.state.act, &s.inputs.ctrl, &s.inputs.actuator_dynamics),
                None,
                &mut self.actuator_forces,
            );
            if compiled.lossy {
                self.actuator_forces.lose(compiled, &s.inputs.actuator_dynamics, false);
                self.actuator_forces.subtract_losses(
                    compiled,
                    &s.inputs.actuator_dynamics,
                    &s.constraints.scalar_impulse,
                    R::of(call.settings.timestep),
                );
            }
        }
        if !self.room.orientation.is_empty() {
            for (m, way) in compiled.mocap.iter().zip(&s.mocap_trajectories) {
                self.room.orientation[m.frame] = R::vectorize(
                    #[inline(always)]
                    || way.quat_at(elapsed),
                );
            }
        }
        let mut time = R::zero();
        (0..R::LANES).for_each(|l| time.set_lane(l, Scalar::from_f64(group.time[l])));
        let input = SensorInput {
            q: &s.state.q,
            v: &s.state.v,
            time,
            h: R::of(call.settings.timestep),
            acceleration: &self.acceleration,
            actuator_forces: &self.actuator_forces,
            xfrc: if compiled.sensing.needs.wrenches { &s.inputs.xfrc } else { &[] },
            scalar_impulse: &s.constraints.scalar_impulse,
            contacts: &s.state.contacts,
        };
        sense(compiled, &mut s.evaluation.kinematics, &mut self.room, &input);
    }

    fn observe(
        &mut self,
        errors: &Errors<R::Scalar>,
        call: &Call<'_, R::Scalar>,
        group: &mut Group<R::Scalar>,
        first: usize,
        lanes: R::Mask,
        start: bool,
    ) {
        let keys = group.sensing.keys();
        let memory = &mut group.sensing;
        let mut slots = Slots {
            numbers: &mut memory.numbers,
            cursors: &mut memory.cursors,
            faults: &mut memory.faults,
            observation: &mut memory.observation,
        };
        let work = self.work.get_or_insert_with(|| errors.work());
        errors.observe(first / R::LANES, &self.room.truth, &keys, lanes, start, call.settings.timestep, work, &mut slots);
    }

    /// Readings of the state in `s`, after a step.
    pub(super) fn readings(
        &mut self,
        call: &Call<'_, R::Scalar>,
        compiled: &LaneModel<R>,
        group: &Group<R::Scalar>,
        s: &mut Workspace<R>,
    ) -> &[R] {
        if call.sensor_errors.is_none() {
            self.sense(call, compiled, group, s);
        } else {
            load_or_zero(&group.sensing.observation, &mut self.room.truth);
        }
        &self.room.truth
    }

    /// Remembers what sensors read of the last step.
    pub(super) fn remember(&self, group: &mut Group<R::Scalar>, s: &Workspace<R>) {
        let memory = &mut group.sensing;
        memory.fresh = 0;
        if memory.acceleration.is_empty() && memory.ctrl.is_empty() && memory.xfrc.is_empty() {
            return;
        }
        R::vectorize(
            #[inline(always)]
            || {
                for (x, out) in [(&self.acceleration, &mut memory.acceleration), (&s.inputs.ctrl, &mut memory.ctrl)] {
                    R::store_all(x, out);
                }
                for (i, out) in memory.xfrc.chunks_exact_mut(R::LANES).enumerate() {
                    s.inputs.xfrc.get(i).copied().unwrap_or(R::zero()).store(out);
                }
            },
        );
    }

    /// Lets the transfer functions begin in the lanes that wait for it. What the user applies is left out of that reading, so that it is
    /// the same whenever it is made, before a step or by the step itself.
    pub(super) fn begin_observations(
        &mut self,
        call: &Call<'_, R::Scalar>,
        compiled: &LaneModel<R>,
        group: &mut Group<R::Scalar>,
        first: usize,
        s: &mut Workspace<R>,
    ) {
        if let (Some(errors), true) = (call.sensor_errors, group.sensing.waiting & group.alive != 0) {
            self.observe_initial_state(errors, call, compiled, group, first, s);
        }
    }

    #[cold]
    fn observe_initial_state(
        &mut self,
        errors: &Errors<R::Scalar>,
        call: &Call<'_, R::Scalar>,
        compiled: &LaneModel<R>,
        group: &mut Group<R::Scalar>,
        first: usize,
        s: &mut Workspace<R>,
    ) {
        let waiting = group.sensing.waiting & group.alive;
        self.evaluate(&Call { inputs: StepInputs { qfrc: &[], xfrc: &[], ..call.inputs }, ..*call }, compiled, group, first, s);
        self.observe(errors, call, group, first, R::Mask::from_bits(waiting), true);
        group.sensing.waiting = 0;
    }

    /// Readings of all environments of a group, environment-major: true ones, or after the transfer functions.
    #[expect(clippy::too_many_arguments, reason = "whose sensors, and where the readings go")]
    pub(super) fn read(
        &mut self,
        call: &Call<'_, R::Scalar>,
        compiled: &LaneModel<R>,
        group: &mut Group<R::Scalar>,
        first: usize,
        s: &mut Workspace<R>,
        truth: bool,
        out: &mut [f64],
    ) {
        let width = call.compiled.sensing.width;
        let rows = out.chunks_exact_mut(width).enumerate();
        if truth || call.sensor_errors.is_none() {
            self.evaluate(call, compiled, group, first, s);
            rows.for_each(|(l, row)| row.iter_mut().zip(&self.room.truth).for_each(|(out, x)| *out = x.lane(l).to_f64()));
        } else {
            self.begin_observations(call, compiled, group, first, s);
            let readings = &group.sensing.observation;
            rows.for_each(|(l, row)| row.iter_mut().enumerate().for_each(|(i, out)| *out = readings[i * R::LANES + l].to_f64()));
        }
    }

    /// Reads the state of a group. Where no step was made since the state was set, sensors of accelerations and forces read the step that
    /// would be made from it, which is not kept.
    fn evaluate(
        &mut self,
        call: &Call<'_, R::Scalar>,
        compiled: &LaneModel<R>,
        group: &Group<R::Scalar>,
        first: usize,
        s: &mut Workspace<R>,
    ) {
        let needs = call.compiled.sensing.needs;
        load_state(group, s);
        load_inputs(call, group, first, s);
        s.current = false;
        load_or_zero(&group.sensing.ctrl, &mut s.inputs.ctrl);
        load_or_zero(&group.sensing.acceleration, &mut self.acceleration);
        let fresh = if needs.step { group.sensing.fresh & group.alive } else { 0 };
        if fresh != 0 {
            s.alive = R::Mask::from_bits(fresh);
            self.before_step(s);
            step(compiled, call.settings, s, self.probe);
            self.accelerate(s, call.settings.timestep, R::Mask::from_bits(fresh));
            load_or_zero(&group.q, &mut s.state.q);
            load_or_zero(&group.v, &mut s.state.v);
            load_or_zero(&group.act, &mut s.state.act);
        }
        for l in (0..R::LANES).filter(|l| fresh >> l & 1 == 0) {
            for (i, x) in s.constraints.scalar_impulse.iter_mut().enumerate() {
                x.set_lane(l, group.scalar_impulse[i * R::LANES + l]);
            }
            if needs.contacts {
                place_contacts(group, l, &mut s.state.contacts);
            }
        }
        if needs.wrenches {
            s.inputs.xfrc.resize(6 * call.compiled.bodies.len(), R::zero());
            for (i, x) in s.inputs.xfrc.iter_mut().enumerate() {
                let last = R::load(&group.sensing.xfrc[i * R::LANES..]);
                *x = R::select(R::Mask::from_bits(fresh), *x, last);
            }
        }
        self.sense(call, compiled, group, s);
    }
}

fn load_or_zero<R: Real>(from: &[R::Scalar], out: &mut [R]) {
    R::vectorize(
        #[inline(always)]
        || {
            if from.is_empty() {
                out.fill(R::zero());
            }
            R::load_all(from, out);
        },
    )
}

/// The contacts of one lane as they are in the state.
fn place_contacts<R: Real>(group: &Group<R::Scalar>, lane: usize, out: &mut Contacts<R>) {
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
