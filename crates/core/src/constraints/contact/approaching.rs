//! Approaching contacts. Their rows are deferred: the solver leaves them out until the geoms collide in the predicted or solved motion.
//!
//! A contact row keeps a gap open along one fixed normal. That is right for surfaces that collide, and wrong for surfaces that pass each
//! other: their nearest points approach, but never touch. Stage 4 therefore assembles the rows of an approaching contact and marks them as
//! deferred, so that the solver leaves them out. The solution without these rows gives the motion of the step. After the solve,
//! [`crate::integrators::velocity::contact_activation`] activates the rows of the pairs that collide in this motion, and the solver solves
//! the lanes of these pairs again. Before the solve, it does the same with the predicted motion.
//!
//! Contacts that rest, slide or roll are never deferred. Nor are contacts that bore load in the step before, and contacts with soft
//! surfaces. Contacts of two round geoms that certainly collide are not deferred, nor are those at a flat face. A contact is at a flat
//! face if its geom is a plane, or if a ball stays over one flat face of the other geom during two steps. A large sweeping rotation moves
//! the surface at a flat face along a curve; such contacts are deferred too. On a surface of triangles, a face is a triangle together with
//! its neighbours across flat or concave edges, because a ball cannot hit such an edge.

use stepper_real::{Mask, Real, Scalar, kernel};
use stepper_solve::MAX_CONTACT_ROWS;

use crate::collision::contact_set::Contacts;
use crate::collision::joint_path::{JointPath, MAX_STRAIGHT_ROTATION};
use crate::constraints::assembler::{Assembler, RowInput, RowState};
use crate::constraints::constraint_problem::ConstraintProblem;
use crate::constraints::velocity_solution::VelocitySolution;
use crate::math::lanes::each_of;
use crate::math::spatial::*;
use crate::options::StepSettings;
use crate::tuning::{COPLANAR_COSINE, RESTING_SPEED_RATIO};

/// Normal speed below which a touching contact counts as resting, m/s.
pub(crate) fn resting_speed(options: &StepSettings) -> f64 {
    RESTING_SPEED_RATIO * options.tolerance
}

impl<R: Real> Assembler<'_, R> {
    /// Lanes of `lanes` in which the rows of the contact in slot `k` are deferred (left out of the solve). There the surfaces approach each
    /// other, and may pass without touching.
    ///
    /// `before` is the normal velocity before the step, m/s. `free` is the contact velocity after the step along normal and tangents, m/s,
    /// if only hard equalities exert constraint forces.
    #[inline(always)]
    pub(crate) fn approaching_lanes(
        &self,
        input: &RowInput<'_, R>,
        contacts: &Contacts<R>,
        k: usize,
        lanes: R::Mask,
        before: R,
        free: V3<R>,
    ) -> R::Mask {
        let at_face = lanes.and(R::Mask::from_bits(self.builder.flat | contacts.data[k].over_face));
        // Lanes in which the normal velocity of the contact can change. Contacts of an impact touch.
        let curved = lanes.and_not(at_face.and_not(self.problem.turning)).and_not(input.is_impact);
        if curved.none() {
            return curved;
        }
        let options = input.options;
        let resting_speed = R::of(resting_speed(options));
        let gap = contacts.data[k].point.distance;
        let closes =
            gap.gt(R::of(options.slop)).and((input.closing_part_of_slot(contacts, k, lanes.bits()) + input.h * free[0]).lt(R::zero()));
        let loaded = contacts.data[k].impulse[0].gt(R::zero());
        let mut deferred = curved.and_not(loaded).and(before.lt(-resting_speed).or(closes));
        let faces = deferred.and(at_face);
        if faces.any() {
            deferred = deferred.and_not(faces.and_not(self.sweeping_lanes(input, contacts, k, faces)));
        }
        if deferred.none() { deferred } else { self.without_certain_hits(input, contacts, k, deferred, free) }
    }

    /// Lanes of `lanes` in which a geom of the contact has a large sweeping rotation until the next evaluation of contacts, see
    /// [`JointPath::sweeping_rotation`].
    #[cold]
    #[inline(never)]
    fn sweeping_lanes(&self, input: &RowInput<'_, R>, contacts: &Contacts<R>, k: usize, lanes: R::Mask) -> R::Mask {
        kernel!(R, || {
            let RowState { compiled, kinematics, v_free, .. } = input.state;
            let joints = JointPath { compiled, kinematics, v: v_free };
            let mut sweeping = R::Mask::splat(false);
            for (pair, same) in contacts.pairs(k, lanes.bits()) {
                let same = R::Mask::from_bits(same);
                let geoms = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
                let closing_time = input.times.of_pair(compiled, geoms).closing;
                for geom in geoms {
                    let frame = compiled.geoms[geom].frame;
                    if (1..=compiled.links.len()).contains(&frame) {
                        let pos = kinematics.point(frame, compiled.params.geom(geom).pos);
                        let mat = mat_mul(&kinematics.mat[frame], &splat(compiled.geoms[geom].mat));
                        let angle = joints.sweeping_rotation(geom, frame - 1, pos, &mat, closing_time);
                        sweeping = sweeping.or(same.and(angle.gt(R::of(MAX_STRAIGHT_ROTATION))));
                    }
                }
            }
            sweeping
        })
    }

    /// Lanes of `lanes` without those in which two round geoms (spheres, capsules) certainly collide in the free motion.
    ///
    /// A round geom contains the ball about the contact's centre of curvature. The geoms collide if these two balls do. A rotation about
    /// this centre and the velocity of a conveyor move the contact point, but not the ball. Where a link rotates far, the balls may move
    /// along curves, so that no hit is certain.
    #[inline(never)]
    fn without_certain_hits(&self, input: &RowInput<'_, R>, contacts: &Contacts<R>, k: usize, lanes: R::Mask, free: V3<R>) -> R::Mask {
        kernel!(R, || {
            let (compiled, slot) = (input.compiled, &contacts.data[k]);
            let (gap, normal, mut out) = (slot.point.distance, slot.point.normal, lanes);
            for (pair, same) in contacts.pairs(k, lanes.bits()) {
                let [a, b] = compiled.pair_geoms(pair).expect("a pair index of this compiled model");
                let is_conveyor = |geom| compiled.surfaces.iter().any(|surface| surface.geom == geom && surface.own.is_some());
                let closing_time = input.times.of_pair(compiled, [a, b]).closing;
                let approach = free[0] * closing_time;
                if compiled.geoms[a].is_round
                    && compiled.geoms[b].is_round
                    && R::Mask::from_bits(same).and((gap + approach).lt(R::zero())).any()
                    && ![a, b].into_iter().any(is_conveyor)
                {
                    let (half, radius_a, radius_b) = (gap * R::of(0.5), compiled.params.geom(a).size[0], compiled.params.geom(b).size[0]);
                    let spin_a = angular_velocity(input, compiled.geoms[a].frame);
                    let spin_b = angular_velocity(input, compiled.geoms[b].frame);
                    let spins = add(scale(spin_a, radius_a + half), scale(spin_b, radius_b + half));
                    let centre_velocity = cross(spins, normal);
                    let tangents = [slot.tangent, cross(normal, slot.tangent)];
                    let (across, over) = (dot(tangents[0], centre_velocity), dot(tangents[1], centre_velocity));
                    let reach = radius_a + radius_b;
                    let displacement = scale([free[0], free[1] + across, free[2] + over], closing_time);
                    let distance = norm([reach + gap + displacement[0], displacement[1], displacement[2]]);
                    let meets = distance.lt(reach).and((reach + gap + displacement[0]).gt(R::zero()));
                    out = out.and_not(meets.and(R::Mask::from_bits(same)).and_not(self.problem.turning));
                }
            }
            out
        })
    }
}

/// Angular velocity of a frame after the step without constraints, world axes, rad/s.
#[inline(always)]
fn angular_velocity<R: Real>(input: &RowInput<'_, R>, frame: usize) -> V3<R> {
    let RowState { compiled, kinematics, v_free, .. } = input.state;
    match frame.checked_sub(compiled.links.len() + 1) {
        _ if frame == 0 => zero(),
        Some(mocap) => angular(&kinematics.mocap_velocities[mocap]),
        None => {
            let mut sum = zero();
            for &dof in compiled.chain_of(compiled.links[frame - 1].dofs.end - 1) {
                sum = add_scaled(sum, angular(&kinematics.axes[dof as usize]), v_free[dof as usize]);
            }
            sum
        }
    }
}

/// Lanes in which a link rotates by more than [`MAX_STRAIGHT_ROTATION`] in `time` seconds at the velocities `links`.
#[inline(always)]
pub(crate) fn turning_lanes<R: Real>(links: &[V6<R>], time: R) -> R::Mask {
    let mut square = R::zero();
    for velocity in links {
        square = square.max(dot(angular(velocity), angular(velocity)));
    }
    (square * time.square()).gt(R::of(MAX_STRAIGHT_ROTATION * MAX_STRAIGHT_ROTATION))
}

impl<R: Real> ConstraintProblem<R> {
    /// Lanes of `lanes` with at least one deferred contact, whose rows the solver leaves out.
    #[inline(always)]
    pub(crate) fn deferred_lanes(&self, lanes: R::Mask) -> R::Mask {
        let mut deferred = R::Mask::splat(false);
        for contact in &self.deferred {
            deferred = deferred.or(contact.lanes);
        }
        deferred.and(lanes)
    }

    /// Whether the contact in slot `k` is deferred in lane `lane`.
    pub(crate) fn is_deferred(&self, k: usize, lane: usize) -> bool {
        self.deferred.iter().any(|contact| contact.slot == k && contact.lanes.bits() >> lane & 1 == 1)
    }

    /// Largest overlap in lane `lane` among the contacts of either of two bodies that are not deferred, m. `frames` are the frames of the
    /// two bodies. `frames_of` returns the two frames of the pair of geoms with a given index.
    pub(crate) fn resting_overlap(
        &self,
        contacts: &Contacts<R>,
        frames_of: impl Fn(usize) -> [usize; 2],
        frames: [usize; 2],
        lane: usize,
    ) -> f64 {
        let mut deepest = 0.0_f64;
        for k in 0..contacts.count[lane] {
            let shares = |f: usize| f > 0 && frames.contains(&f);
            if !self.is_deferred(k, lane) && frames_of(contacts.ids[k][lane].pair()).into_iter().any(shares) {
                deepest = deepest.max(-contacts.data[k].point.distance.lane(lane).to_f64());
            }
        }
        deepest
    }

    /// Activates the deferred contacts of colliding pairs in the lanes `lanes`, so that the solver includes their rows.
    ///
    /// `lanes_of` returns, for the index of a pair of geoms, the lanes in which the pair collides, and the lanes in which this collision is
    /// doubtful. [`Self::defer_doubtful`] later defers doubtful contacts again.
    pub(crate) fn activate(
        &mut self,
        velocity: &mut VelocitySolution<R>,
        contacts: &Contacts<R>,
        lanes: R::Mask,
        lanes_of: impl Fn(usize) -> [R::Mask; 2],
    ) {
        kernel!(R, || {
            for i in 0..self.deferred.len() {
                let deferred = &self.deferred[i];
                let [mut colliding, mut doubtful] = [R::Mask::splat(false); 2];
                for (pair, same) in contacts.pairs(deferred.slot, deferred.lanes.and(lanes).bits()) {
                    let [hits, in_doubt] = lanes_of(pair).map(|lanes| lanes.and(R::Mask::from_bits(same)));
                    (colliding, doubtful) = (colliding.or(hits), doubtful.or(hits.and(in_doubt)));
                }
                self.deferred[i].doubtful = deferred.doubtful.or(doubtful);
                self.activate_contact(velocity, i, colliding, self.deferred[i].impulse);
            }
        });
        let newly_loaded = velocity.contact_groups.newly_loaded_lanes(contacts, self, &velocity.impulses);
        self.rows.newly_loaded = self.rows.newly_loaded.and_not(lanes).or(newly_loaded.and(lanes));
    }

    /// Whether a doubtful collision, found in the predicted motion, activated a contact.
    #[inline(always)]
    pub(crate) fn has_doubtful_contacts(&self) -> bool {
        self.deferred.iter().any(|contact| contact.doubtful.any())
    }

    /// Defers the contacts again that a doubtful collision of the predicted motion activated. The solved motion decides whether they act.
    ///
    /// Their present impulses, predicted or from the last step, become their initial impulses if the solve activates them.
    #[inline(never)]
    pub(crate) fn defer_doubtful(&mut self, velocity: &mut VelocitySolution<R>) {
        kernel!(R, || {
            let Self { deferred, rows, .. } = self;
            for contact in deferred.iter_mut().filter(|contact| contact.doubtful.any()) {
                let lanes = std::mem::replace(&mut contact.doubtful, R::Mask::splat(false));
                let impulse = velocity.impulses.take_impulse(rows, contact.contact, lanes);
                contact.impulse = select(lanes, impulse, contact.impulse);
                rows.contacts.defer(contact.contact, lanes);
                contact.lanes = contact.lanes.or(lanes);
            }
        });
    }

    /// Activates the deferred contacts whose gap does not close in the solution, with zero impulse. Stage 8 then includes their rows, and
    /// the state keeps these contacts for the next step.
    ///
    /// Deferred contacts whose gap closes without a collision remain deferred: their surfaces pass each other.
    #[inline(always)]
    pub(crate) fn activate_not_closing(&mut self, velocity: &mut VelocitySolution<R>) {
        kernel!(R, || {
            for i in 0..self.deferred.len() {
                let deferred = &self.deferred[i];
                let open = self.rows.contacts.normal_velocity_above_target(deferred.contact, &velocity.impulses.w).ge(R::zero());
                self.activate_contact(velocity, i, deferred.lanes.and(open), [R::zero(); 6]);
            }
        })
    }

    /// Activates those deferred contacts that are also in `reference`, the contacts of the completed step whose derivative is computed.
    pub(crate) fn activate_matching(&mut self, velocity: &mut VelocitySolution<R>, contacts: &Contacts<R>, reference: &Contacts<R>) {
        for i in 0..self.deferred.len() {
            let deferred = self.deferred[i];
            let mut matching = 0;
            for lane in each_of(deferred.lanes.bits()) {
                let id = contacts.ids[deferred.slot][lane];
                matching |= u32::from(reference.ids[..reference.count[lane]].iter().any(|ids| ids[lane] == id)) << lane;
            }
            self.activate_contact(velocity, i, R::Mask::from_bits(matching), deferred.impulse);
        }
    }

    /// Activates the deferred contacts of those pairs that also have an active contact with the same normal.
    ///
    /// Such contacts belong to two faces that lie on each other, and share their load.
    #[inline(never)]
    pub(crate) fn activate_coplanar(&mut self, velocity: &mut VelocitySolution<R>, contacts: &Contacts<R>) {
        kernel!(R, || {
            for i in 0..self.deferred.len() {
                let deferred = self.deferred[i];
                let mut coplanar = 0;
                for lane in each_of(deferred.lanes.bits()) {
                    let normal = of_lane(&contacts.data[deferred.slot].point.normal, lane);
                    let pair = contacts.ids[deferred.slot][lane].pair();
                    let rests = (0..contacts.count[lane]).any(|k| {
                        contacts.ids[k][lane].pair() == pair
                            && dot(of_lane(&contacts.data[k].point.normal, lane), normal) > COPLANAR_COSINE
                            && !self.is_deferred(k, lane)
                    });
                    coplanar |= u32::from(rests) << lane;
                }
                self.activate_contact(velocity, i, R::Mask::from_bits(coplanar), deferred.impulse);
            }
        })
    }

    /// Activates deferred contact number `i` in the lanes `lanes`, with the initial impulse `impulse`, N s and N m s.
    ///
    /// The function also stores the impulse in [`VelocitySolution::saved_impulses`]: the predictor may restore the saved impulses, and the
    /// saved impulses must include this one.
    #[inline(always)]
    fn activate_contact(&mut self, velocity: &mut VelocitySolution<R>, i: usize, lanes: R::Mask, impulse: [R; MAX_CONTACT_ROWS]) {
        if lanes.any() {
            let Self { deferred, rows, .. } = self;
            let deferred = &mut deferred[i];
            let lanes = rows.contacts.activate(deferred.contact, lanes);
            velocity.impulses.set_first_impulse(rows, deferred.contact, lanes, impulse);
            velocity.saved_impulses.set_first_impulse(rows, deferred.contact, lanes, impulse);
            deferred.lanes = deferred.lanes.and_not(lanes);
            // Doubtful contacts are deferred again before the solve, so that they do not count as constraints yet.
            self.constrained = self.constrained.or(lanes.and_not(deferred.doubtful));
        }
    }

    /// Removes the contacts of the lanes `lanes` that are still deferred from `contacts`, because their surfaces have passed each other.
    #[inline(always)]
    pub(crate) fn remove_deferred(&self, contacts: &mut Contacts<R>, lanes: R::Mask) {
        let lanes = self.deferred_lanes(lanes);
        for lane in each_of(lanes.bits()) {
            contacts.retain(lane, |_, slot, _| !self.is_deferred(slot, lane));
        }
    }
}
