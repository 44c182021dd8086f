//! Contacts as sensors feel them. They are few and differ from lane to lane, so each lane is read by itself.

use stepper_real::{Real, Scalar};

use super::frames::{orientation, position};
use super::rays::{holds, ray};
use super::{Moment, Room};
use crate::contacts::{Contacts, frame};
use crate::kinematics::Kinematics;
use crate::model::{ContactField, ContactReduction};
use crate::plan::LanePlan;
use crate::plan::sensing::{Side, Solid};
use crate::spatial::*;

/// One contact of one lane.
struct Contact {
    /// Geoms of the model, and their bodies.
    geoms: [usize; 2],
    bodies: [usize; 2],
    distance: f64,
    pos: [f64; 3],
    /// Normal and tangents.
    axes: [[f64; 3]; 3],
    /// Along them, on the second body, N.
    force: [f64; 3],
    /// About them, N m.
    torque: [f64; 3],
}

/// Geoms of the model that a contact is between, and their bodies.
fn parties<R: Real>(plan: &LanePlan<R>, contacts: &Contacts<R>, slot: usize, lane: usize) -> [[usize; 2]; 2] {
    let pair = plan.pair_geoms(contacts.ids[slot][lane].pair()).expect("a contact belongs to a pair");
    let geoms = pair.map(|g| plan.geoms[g].index);
    [geoms, geoms.map(|g| plan.sensing.geom_body[g])]
}

impl Contact {
    fn of<R: Real>(plan: &LanePlan<R>, contacts: &Contacts<R>, h: R, slot: usize, lane: usize) -> Self {
        let [geoms, bodies] = parties(plan, contacts, slot, lane);
        let data = &contacts.data[slot];
        let at = |x: V3<R>| x.map(|x| x.lane(lane).to_f64());
        let h = h.lane(lane).to_f64();
        Self {
            geoms,
            bodies,
            distance: data.point.distance.lane(lane).to_f64(),
            pos: at(data.point.pos),
            axes: frame(at(data.point.normal)),
            force: at(data.impulse).map(|x| x / h),
            torque: contacts.torque.get(slot).map_or([0.0; 3], |&x| at(x).map(|x| x / h)),
        }
    }

    /// A vector along the axes in the world.
    fn world(&self, x: [f64; 3]) -> [f64; 3] {
        let [n, a, b] = self.axes;
        add_scaled(add_scaled(scale(n, x[0]), a, x[1]), b, x[2])
    }

    fn world_force(&self) -> [f64; 3] {
        self.world(self.force)
    }
}

/// A volume as one lane sees it.
struct Zone {
    origin: [f64; 3],
    axes: [f64; 9],
    size: [f64; 3],
}

impl Zone {
    fn of<R: Real>(plan: &LanePlan<R>, kinematics: &Kinematics<R>, solid: &Solid<R::Scalar>, lane: usize) -> Self {
        Self {
            origin: position(plan, kinematics, &solid.place).map(|x| x.lane(lane).to_f64()),
            axes: orientation(kinematics, &solid.place).map(|x| x.lane(lane).to_f64()),
            size: plan.params.size(solid.index).map(|x| x.lane(lane).to_f64()),
        }
    }

    fn local(&self, p: [f64; 3]) -> [f64; 3] {
        rotate_back(&self.axes, sub(p, self.origin))
    }
}

/// Force of all contacts on some bodies, and its torque about a point.
pub(super) fn wrench_on<R: Real>(plan: &LanePlan<R>, moment: &Moment<'_, R>, point: V3<R>, bodies: &[bool]) -> (V3<R>, V3<R>) {
    R::vectorize(
        #[inline(always)]
        || {
            let (mut force, mut torque): (V3<R>, V3<R>) = (zero(), zero());
            for lane in 0..R::LANES {
                let point = point.map(|x| x.lane(lane).to_f64());
                let (mut f, mut t) = ([0.0; 3], [0.0; 3]);
                for slot in 0..moment.contacts.count[lane] {
                    let [first, second] = parties(plan, moment.contacts, slot, lane)[1].map(|b| bodies[b]);
                    if first == second {
                        continue;
                    }
                    let contact = Contact::of(plan, moment.contacts, moment.h, slot, lane);
                    let sign = if second { 1.0 } else { -1.0 };
                    let push = scale(contact.world_force(), sign);
                    t = add(t, scale(contact.world(contact.torque), sign));
                    f = add(f, push);
                    t = add(t, cross(sub(contact.pos, point), push));
                }
                for k in 0..3 {
                    force[k].set_lane(lane, Scalar::from_f64(f[k]));
                    torque[k].set_lane(lane, Scalar::from_f64(t[k]));
                }
            }
            (force, torque)
        },
    )
}

/// Sum of the normal forces on a body whose line meets a volume, N.
pub fn touch<R: Real>(plan: &LanePlan<R>, kinematics: &Kinematics<R>, moment: &Moment<'_, R>, body: usize, solid: &Solid<R::Scalar>) -> R {
    let mut reading = R::zero();
    for lane in 0..R::LANES {
        let mut sum = 0.0;
        for slot in 0..moment.contacts.count[lane] {
            if !parties(plan, moment.contacts, slot, lane)[1].contains(&body) {
                continue;
            }
            let contact = Contact::of(plan, moment.contacts, moment.h, slot, lane);
            if contact.force[0] <= 0.0 {
                continue;
            }
            let zone = Zone::of(plan, kinematics, solid, lane);
            // Along the force on the other body, away from this one.
            let away = scale(contact.axes[0], if contact.bodies[1] == body { -1.0 } else { 1.0 });
            let direction = rotate_back(&zone.axes, away);
            if ray(solid.form, zone.size, zone.local(contact.pos), direction) < f64::INFINITY {
                sum += contact.force[0];
            }
        }
        reading.set_lane(lane, Scalar::from_f64(sum));
    }
    reading
}

/// Readings of a contact sensor.
#[expect(clippy::too_many_arguments, reason = "what the sensor selects, and what it selects from")]
pub fn contacts<R: Real>(
    plan: &LanePlan<R>,
    kinematics: &Kinematics<R>,
    room: &mut Room<R>,
    moment: &Moment<'_, R>,
    sides: &[Side<R::Scalar>; 2],
    fields: &[ContactField],
    (reduction, slots): (ContactReduction, usize),
    at: usize,
) {
    let width: usize = fields.iter().map(|f| f.dim()).sum();
    for lane in 0..R::LANES {
        let mut put = |k: usize, x: f64| room.truth[at + k].set_lane(lane, Scalar::from_f64(x));
        (0..width * slots).for_each(|k| put(k, 0.0));
        let order = &mut room.order;
        order.clear();
        for slot in 0..moment.contacts.count[lane] {
            let contact = Contact::of(plan, moment.contacts, moment.h, slot, lane);
            if matches(plan, kinematics, sides, &contact, lane).is_some() {
                let key = match reduction {
                    ContactReduction::MinDistance => contact.distance,
                    ContactReduction::MaxForce => -dot(contact.force, contact.force),
                    ContactReduction::None | ContactReduction::NetForce => 0.0,
                };
                order.push((key, slot));
            }
        }
        // Insertion sort: few, nearly in order, and nothing is allocated.
        for i in 1..order.len() {
            let mut j = i;
            while j > 0 && order[j].0 < order[j - 1].0 {
                order.swap(j, j - 1);
                j -= 1;
            }
        }
        let found = order.len();
        if found > 0 && reduction == ContactReduction::NetForce {
            let all = order.iter().map(|&(_, slot)| seen(plan, kinematics, moment, sides, slot, lane));
            let net = net_force(all);
            let mut put = |k: usize, x: f64| room.truth[at + k].set_lane(lane, Scalar::from_f64(x));
            report(&net, fields, found, &mut put);
            continue;
        }
        for k in 0..found.min(slots) {
            let contact = seen(plan, kinematics, moment, sides, room.order[k].1, lane);
            let mut put = |i: usize, x: f64| room.truth[at + k * width + i].set_lane(lane, Scalar::from_f64(x));
            report(&contact, fields, found, &mut put);
        }
    }
}

/// Whether a contact is between the sides, and whether it has to be turned round for that.
fn matches<R: Real>(
    plan: &LanePlan<R>,
    kinematics: &Kinematics<R>,
    sides: &[Side<R::Scalar>; 2],
    contact: &Contact,
    lane: usize,
) -> Option<bool> {
    let fits = |side: &Side<R::Scalar>, geom: usize| match side {
        Side::Geoms(which) => which[geom],
        Side::Zone(solid) => {
            let zone = Zone::of(plan, kinematics, solid, lane);
            holds(solid.form, zone.size, zone.local(contact.pos))
        }
    };
    let [a, b] = contact.geoms;
    if fits(&sides[0], a) && fits(&sides[1], b) {
        Some(false)
    } else if fits(&sides[0], b) && fits(&sides[1], a) {
        Some(true)
    } else {
        None
    }
}

/// A contact that matches, seen from the first side.
fn seen<R: Real>(
    plan: &LanePlan<R>,
    kinematics: &Kinematics<R>,
    moment: &Moment<'_, R>,
    sides: &[Side<R::Scalar>; 2],
    slot: usize,
    lane: usize,
) -> Contact {
    let mut contact = Contact::of(plan, moment.contacts, moment.h, slot, lane);
    if matches(plan, kinematics, sides, &contact, lane) == Some(true) {
        // Normal and first tangent turn round, and so does the force: along both its components stay.
        let [n, t, s] = contact.axes;
        contact.axes = [scale(n, -1.0), scale(t, -1.0), s];
        contact.force[2] = -contact.force[2];
        contact.torque[2] = -contact.torque[2];
    }
    contact
}

/// The sum of all forces at the mean of their positions, weighted by force, in world axes; and their torque about that point.
fn net_force(all: impl Iterator<Item = Contact> + Clone) -> Contact {
    let (mut force, mut weighted, mut weight, mut plain, mut count) = ([0.0; 3], [0.0; 3], 0.0, [0.0; 3], 0.0);
    let mut nearest = f64::INFINITY;
    for contact in all.clone() {
        let size = dot(contact.force, contact.force).sqrt();
        force = add(force, contact.world_force());
        weighted = add_scaled(weighted, contact.pos, size);
        plain = add(plain, contact.pos);
        weight += size;
        count += 1.0;
        nearest = if contact.distance < nearest { contact.distance } else { nearest };
    }
    let pos = if weight > 0.0 { scale(weighted, 1.0 / weight) } else { scale(plain, 1.0 / count) };
    let torque = all.fold([0.0; 3], |sum, c| add(add(sum, c.world(c.torque)), cross(sub(c.pos, pos), c.world_force())));
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    Contact { geoms: [0; 2], bodies: [0; 2], distance: nearest, pos, axes, force, torque }
}

fn report(contact: &Contact, fields: &[ContactField], found: usize, put: &mut impl FnMut(usize, f64)) {
    let mut at = 0;
    for &field in fields {
        let x = match field {
            ContactField::Found => [found as f64, 0.0, 0.0],
            ContactField::Force => contact.force,
            ContactField::Torque => contact.torque,
            ContactField::Distance => [contact.distance, 0.0, 0.0],
            ContactField::Pos => contact.pos,
            ContactField::Normal => contact.axes[0],
            ContactField::Tangent => contact.axes[1],
        };
        (0..field.dim()).for_each(|k| put(at + k, x[k]));
        at += field.dim();
    }
}
