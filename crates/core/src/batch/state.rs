//! State of a group of environments: everything that a step hands over to the next step.

use serde::{Deserialize, Serialize};
use stepper_real::{Real, Scalar};

use crate::actuation;
use crate::collision::contact_set::{ContactId, Contacts};
use crate::collision::separation_cache::SeparationCache;
use crate::compile::{ModelStructure, obstacle_count};
use crate::math::lane_arrays::{clear_column, lane_arrays};
use crate::math::lanes::{DestinationLanes, MAX_LANES, columns, set_columns};
use crate::sensing::memory::Memory;
use crate::stages::s10_record::Status;

/// Number of stored values per contact: impulse (3), position (3), normal (3) and distance (1).
const CONTACT_NUMBERS: usize = 10;
/// Offset of the normal in the stored values of a contact.
const NORMAL: usize = 6;

/// State of the environments of one group of lanes, lane-interleaved: entry i of lane l is at `i * lanes + l`.
///
/// The solver of the next step starts from the contact impulses, so they are part of the state. Positions of contacts and results of the
/// last call are stored only for the user to read.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Group<S> {
    /// Number of lanes of the group.
    pub lanes: usize,
    /// Lanes (bits) that have an environment. The other lanes are unused.
    pub alive: u32,
    /// Configuration, nq per lane.
    pub q: Vec<S>,
    /// Velocity, nv per lane.
    pub v: Vec<S>,
    /// Activations, na per lane.
    pub act: Vec<S>,
    /// Impulses of joint limits, dry friction, equalities and tendons in the last step, one number per constraint row.
    pub scalar_impulse: Vec<S>,
    /// Generalized impulse of all constraints in the last step, nv per lane, N s and N m s.
    pub impulse: Vec<S>,
    /// Last pose of every mocap body (position, quaternion), 7 per lane; zeros before the first call of `step`.
    pub mocap: Vec<S>,
    /// Number of contacts per lane.
    pub contact_count: Vec<u32>,
    /// Identities of the contacts: contact k of lane l is at `k * lanes + l`.
    pub contact_ids: Vec<u64>,
    /// Stored values of the contacts, ten per contact: impulse, position, normal, distance.
    pub contact_data: Vec<S>,
    /// Angular impulses of the contacts, three per contact; empty when the scene has no torsional or rolling friction.
    pub contact_torque: Vec<S>,
    /// Separating planes of the pairs of a hull or box and a hull that were close to each other in the last step. They speed up the next
    /// step.
    pub separation_cache: SeparationCache,
    /// Simulated time, s, per lane.
    pub time: Vec<f64>,
    /// Status flags of the last call, per lane.
    pub status: Vec<u32>,
    /// For each actuator and lane, number of steps of the last call that clamped the actuator's force, or a sum of forces that contains it.
    /// Empty if no actuator force has bounds.
    pub saturated: Vec<u32>,
    /// Residual of the last step, m/s, per lane.
    pub residual: Vec<S>,
    /// Number of Gauss-Seidel iterations (sweeps) in the last step, per lane.
    pub sweeps: Vec<S>,
    /// Number of Newton iterations in the last step, per lane.
    pub newton_steps: Vec<S>,
    /// Cause of the last unsolved step of the last call, per lane, as a
    /// [`ConstraintCode`](crate::constraints::worst_row::ConstraintCode).
    pub worst: Vec<u64>,
    /// Largest overlap of the contacts during the last call, beyond their margins, m, per lane.
    pub depth: Vec<S>,
    /// Largest distance of a joint or tendon beyond its range, over the steps of the last call, rad or m, per lane.
    pub overshoot: Vec<S>,
    /// Largest position error of an equality, over the steps of the last call, m or rad, per lane.
    pub equality_violation: Vec<S>,
    /// Largest estimated error of the positions in a step of the last call, m or rad, per lane; 0 without divided steps.
    pub error: Vec<S>,
    /// Number of substeps of the last call, per lane; 0 without divided steps.
    pub substeps: Vec<S>,
    /// Numbers that change where tendons and adhesion have kinks, in the last step, see
    /// [`Simulation::switches`](crate::Simulation::switches). No step reads them, and they are not saved.
    #[serde(skip)]
    pub switches: Vec<u32>,
    /// Memory of the sensors: delays, noise and results of the last step.
    pub sensing: Memory<S>,
    /// Memory of the actuator pipelines: delay lines, lags and servo integrals.
    pub actuation: actuation::memory::Memory<S>,
}

// All arrays but `switches` and those of the contacts, whose capacity may differ between groups.
lane_arrays!(Group {
    arrays: [q v act scalar_impulse impulse mocap contact_count time status saturated residual sweeps newton_steps worst depth overshoot
        equality_violation error substeps],
    sets: [alive],
    shared: [],
    parts: [separation_cache sensing actuation]
});

impl<S: Scalar> Group<S> {
    /// Creates a group at the reset state `qpos0`, for the environments from `first` on. `alive` are the lanes (bits) that have an
    /// environment.
    pub fn new(compiled: &ModelStructure<S>, qpos0: &[S], lanes: usize, alive: u32, first: usize, max_contacts: usize) -> Self {
        let zeros = |n: usize| vec![S::default(); n * lanes];
        Self {
            lanes,
            alive,
            q: qpos0.iter().flat_map(|&x| std::iter::repeat_n(x, lanes)).collect(),
            v: zeros(compiled.nv),
            act: zeros(compiled.na),
            scalar_impulse: zeros(compiled.scalar_impulses),
            impulse: zeros(compiled.nv),
            mocap: zeros(7 * compiled.mocap.len()),
            contact_count: vec![0; lanes],
            contact_ids: vec![0; max_contacts * lanes],
            contact_data: zeros(max_contacts * CONTACT_NUMBERS),
            contact_torque: zeros(if compiled.has_rolling_friction { 3 * max_contacts } else { 0 }),
            separation_cache: SeparationCache::new(compiled, lanes),
            time: vec![0.0; lanes],
            status: vec![0; lanes],
            saturated: vec![0; if compiled.actuator_forces_are_bounded() { compiled.actuators.len() * lanes } else { 0 }],
            residual: zeros(1),
            sweeps: zeros(1),
            newton_steps: zeros(1),
            worst: vec![0; lanes],
            depth: zeros(1),
            overshoot: zeros(1),
            equality_violation: zeros(1),
            error: zeros(1),
            substeps: zeros(1),
            switches: vec![0; lanes * (obstacle_count(&compiled.paths) + compiled.adhesive_actuators().count())],
            sensing: Memory::new(compiled, lanes, first),
            actuation: actuation::memory::Memory::default(),
        }
    }

    /// Clears the results of earlier steps in a lane: impulses, contacts, separating planes, last poses of mocap bodies, and the record of
    /// the last call (status, residual, iterations, largest errors). Also clears the memories of sensors and actuator pipelines.
    pub fn clear_memory(&mut self, lane: usize) {
        let lanes = self.lanes;
        [&mut self.scalar_impulse, &mut self.impulse, &mut self.mocap].into_iter().for_each(|numbers| clear_column(numbers, lanes, lane));
        // Entries beyond a lane's number of contacts are loaded together with those of other lanes, but have no effect.
        self.contact_count[lane] = 0;
        self.separation_cache.forget(lane);
        self.status[lane] = Status::OK.bits();
        self.worst[lane] = 0;
        clear_column(&mut self.saturated, lanes, lane);
        let Self { residual, sweeps, newton_steps, depth, overshoot, equality_violation, error, substeps, .. } = self;
        for number in [residual, sweeps, newton_steps, depth, overshoot, equality_violation, error, substeps] {
            number[lane] = S::default();
        }
        self.sensing.forget(lane);
        self.actuation.forget(lane, lanes);
    }

    /// Memory of the group's state, bytes.
    pub fn bytes(&self) -> usize {
        size_of::<Self>()
            + self.bytes_of_arrays()
            + size_of_val(&self.contact_ids[..])
            + size_of_val(&self.contact_data[..])
            + size_of_val(&self.contact_torque[..])
    }

    /// Whether the contact arrays are consistent: enough entries for all contacts, at most `max_contacts`, and angular impulses only if
    /// `rolling` is true.
    pub fn has_whole_contacts(&self, max_contacts: usize, rolling: bool) -> bool {
        let entries = self.contact_ids.len();
        entries.is_multiple_of(self.lanes)
            && entries <= max_contacts * self.lanes
            && self.contact_count.iter().all(|&held| held as usize * self.lanes <= entries)
            && self.contact_data.len() == CONTACT_NUMBERS * entries
            && self.contact_torque.len() == if rolling { 3 * entries } else { 0 }
    }

    /// Canonical form of the state: unused entries are zero, so that equal states have equal bytes.
    pub fn canonical(mut self) -> Self {
        let lanes = self.lanes;
        for lane in 0..lanes {
            if self.alive >> lane & 1 == 0 {
                self.clear_memory(lane);
                self.time[lane] = 0.0;
                self.sensing.clear(lane);
                self.actuation.clear(lane, lanes);
            }
            let held = self.contact_count[lane] as usize;
            clear_column(&mut self.contact_ids, lanes, held * lanes + lane);
            clear_column(&mut self.contact_data, lanes, held * CONTACT_NUMBERS * lanes + lane);
            clear_column(&mut self.contact_torque, lanes, held * 3 * lanes + lane);
        }
        self.separation_cache.tidy();
        self
    }

    /// Copy of the lanes from `first` to `first + n`, exclusive, with a contact capacity for the present contacts only.
    pub fn part(&self, first: usize, n: usize) -> Self {
        let lanes = self.lanes;
        let held = (first..first + n).filter(|lane| self.alive >> lane & 1 == 1).map(|lane| self.contact_count[lane] as usize);
        let entries = lanes * held.max().unwrap_or(0);
        let torques = (3 * entries).min(self.contact_torque.len());
        Self {
            lanes: n,
            contact_ids: columns(&self.contact_ids[..entries], lanes, first, n),
            contact_data: columns(&self.contact_data[..CONTACT_NUMBERS * entries], lanes, first, n),
            contact_torque: columns(&self.contact_torque[..torques], lanes, first, n),
            ..self.copy_lanes(lanes, first, n)
        }
    }

    /// Copies the lanes of `part` to the lanes `target`. Entries beyond a lane's number of contacts do not change, because no step reads
    /// them.
    pub(crate) fn set_part(&mut self, target: DestinationLanes, part: &Self) {
        let (lanes, n) = (self.lanes, part.lanes);
        self.set_lanes(lanes, target, n, part);
        set_columns(&mut self.contact_ids, lanes, target, n, &part.contact_ids);
        set_columns(&mut self.contact_data, lanes, target, n, &part.contact_data);
        set_columns(&mut self.contact_torque, lanes, target, n, &part.contact_torque);
    }

    /// Stored contacts of lane `lane` in the last step.
    pub fn contacts(&self, lane: usize) -> impl Iterator<Item = StoredContact> + '_ {
        (0..self.contact_count[lane] as usize).map(move |k| {
            let x = |i: usize| self.contact_data[(k * CONTACT_NUMBERS + i) * self.lanes + lane].to_f64();
            let torque = |i: usize| self.contact_torque.get((k * 3 + i) * self.lanes + lane).map_or(0.0, |x| x.to_f64());
            StoredContact {
                torque: [torque(0), torque(1), torque(2)],
                id: ContactId(self.contact_ids[k * self.lanes + lane]),
                impulse: [x(0), x(1), x(2)],
                pos: [x(3), x(4), x(5)],
                normal: [x(6), x(7), x(8)],
                distance: x(9),
            }
        })
    }

    /// Loads the stored contacts of all lanes into `out`.
    #[inline(always)]
    pub fn load_contacts<R: Real<Scalar = S>>(&self, out: &mut Contacts<R>) {
        out.clear();
        for (to, &count) in out.count.iter_mut().zip(&self.contact_count) {
            *to = count as usize;
        }
        for k in 0..out.slots() {
            for (to, &id) in out.ids[k].iter_mut().zip(&self.contact_ids[k * R::LANES..(k + 1) * R::LANES]) {
                *to = ContactId(id);
            }
            let numbers = &self.contact_data[k * CONTACT_NUMBERS * R::LANES..(k + 1) * CONTACT_NUMBERS * R::LANES];
            for i in 0..3 {
                out.data[k].impulse[i] = R::load(&numbers[i * R::LANES..]);
                out.data[k].point.normal[i] = R::load(&numbers[(NORMAL + i) * R::LANES..]);
                if let Some(torque) = out.torque.get_mut(k) {
                    torque[i] = R::load(&self.contact_torque[(k * 3 + i) * R::LANES..]);
                }
            }
        }
    }

    /// Stores the contacts of all lanes in the group.
    #[inline(always)]
    pub fn store_contacts<R: Real<Scalar = S>>(&mut self, contacts: &Contacts<R>) {
        for (to, &count) in self.contact_count[..R::LANES].iter_mut().zip(contacts.count.iter()) {
            *to = count as u32;
        }
        for k in 0..contacts.slots() {
            for (to, id) in self.contact_ids[k * R::LANES..(k + 1) * R::LANES].iter_mut().zip(&contacts.ids[k]) {
                *to = id.0;
            }
            let slot = &contacts.data[k];
            let numbers = [slot.impulse, slot.point.pos, slot.point.normal];
            let out = &mut self.contact_data[k * CONTACT_NUMBERS * R::LANES..][..CONTACT_NUMBERS * R::LANES];
            R::store_all(numbers.as_flattened(), out);
            slot.point.distance.store(&mut out[(CONTACT_NUMBERS - 1) * R::LANES..]);
            for (i, x) in contacts.torque.get(k).into_iter().flatten().enumerate() {
                x.store(&mut self.contact_torque[(k * 3 + i) * R::LANES..]);
            }
        }
    }
}

/// Stored contact with its two geoms, as indices in the model.
pub(super) type ContactOfGeoms = ([usize; 2], StoredContact);

/// Contact of one environment, as the state stores it.
#[derive(Clone, Copy, Debug)]
pub struct StoredContact {
    /// Identity of the contact: its pair and feature.
    pub id: ContactId,
    /// Impulse on the second geom along the normal and the two tangents, N s.
    pub impulse: [f64; 3],
    /// Angular impulse of torsional and rolling friction about the normal and the two tangents, N m s.
    pub torque: [f64; 3],
    /// Position in the world frame, m.
    pub pos: [f64; 3],
    /// Unit normal in world axes, from the first geom to the second.
    pub normal: [f64; 3],
    /// Distance between the geoms minus the margin, m; negative for an overlap.
    pub distance: f64,
}

const _: () = assert!(MAX_LANES <= 32, "lanes are kept as bits of a u32");
