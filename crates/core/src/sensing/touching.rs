//! Contact sensors. They are evaluated lane by lane, because contacts are few and differ between lanes.

use stepper_real::{Real, Scalar, kernel};

use crate::collision::contact_set::Contacts;
use crate::compile::LaneModel;
use crate::compile::sensing::{Side, Solid};
use crate::math::spatial::*;
use crate::model::{ContactField, ContactReduction};
use crate::sensing::contact_list::{Contact, SensedContacts};
use crate::sensing::inputs::{SensorInput, SensorView};
use crate::sensing::rays::{holds, ray};

impl Contact {
    fn of<R: Real>(compiled: &LaneModel<R>, contacts: &Contacts<R>, h: R, slot: usize, lane: usize) -> Self {
        let pair = compiled.pair_geoms(contacts.ids[slot][lane].pair()).expect("a contact belongs to a pair");
        let geoms = pair.map(|g| compiled.geoms[g].index);
        let data = &contacts.data[slot];
        let h = h.lane(lane).to_f64();
        Self {
            geoms,
            bodies: geoms.map(|g| compiled.sensing.geom_body[g]),
            distance: data.point.distance.lane(lane).to_f64(),
            pos: of_lane(&data.point.pos, lane),
            axes: contact_frame(of_lane(&data.point.normal, lane)),
            force: of_lane(&data.impulse, lane).map(|x| x / h),
            torque: contacts.torque.get(slot).map_or([0.0; 3], |x| of_lane(x, lane).map(|x| x / h)),
        }
    }

    /// Converts a vector from the contact's axes to world axes.
    fn world(&self, x: [f64; 3]) -> [f64; 3] {
        let [n, a, b] = self.axes;
        add_scaled(add_scaled(scale(n, x[0]), a, x[1]), b, x[2])
    }
}

/// Volume of a site: position in the world, m, orientation, and size, m.
struct Volume<R> {
    origin: V3<R>,
    axes: M3<R>,
    size: V3<R>,
}

impl<R: Real> Volume<R> {
    fn of_lane(&self, lane: usize) -> Volume<f64> {
        Volume { origin: of_lane(&self.origin, lane), axes: of_lane(&self.axes, lane), size: of_lane(&self.size, lane) }
    }
}

impl Volume<f64> {
    fn local(&self, p: [f64; 3]) -> [f64; 3] {
        rotate_back(&self.axes, sub(p, self.origin))
    }
}

impl SensedContacts {
    /// Loads the contacts of all lanes from the step's results. All contact sensors read this list.
    pub(super) fn load_contacts<R: Real>(&mut self, compiled: &LaneModel<R>, input: &SensorInput<'_, R>) {
        self.contacts.clear();
        for lane in 0..R::LANES {
            for slot in 0..input.contacts.count[lane] {
                self.contacts.push(Contact::of(compiled, input.contacts, input.h, slot, lane));
            }
            self.ends[lane + 1] = self.contacts.len();
        }
    }

    /// Contacts of lane `lane` in the last step.
    fn lane(&self, lane: usize) -> &[Contact] {
        &self.contacts[self.ends[lane]..self.ends[lane + 1]]
    }

    /// Sum of the contact forces on the bodies marked in `bodies`, N, and sum of the contact torques on them about `point`, N m, in world
    /// axes. Contacts between two marked bodies do not count.
    pub(super) fn wrench_on<R: Real>(&self, point: V3<R>, bodies: &[bool]) -> (V3<R>, V3<R>) {
        let (mut force, mut torque): (V3<R>, V3<R>) = ([R::default(); 3], [R::default(); 3]);
        for lane in 0..R::LANES {
            let point = of_lane(&point, lane);
            let (mut f, mut t) = ([0.0; 3], [0.0; 3]);
            for contact in self.lane(lane) {
                let [first, second] = contact.bodies.map(|b| bodies[b]);
                if first == second {
                    continue;
                }
                let sign = if second { 1.0 } else { -1.0 };
                let push = scale(contact.world(contact.force), sign);
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
    }
}

/// Computes the force (N) and torque (N m) of all contacts on every body of the model in world axes, six values each.
///
/// The torque is about the body's centre of mass in `centres` (m). `h` is the time step, s, that converts impulses to forces.
pub fn contact_wrenches<R: Real>(compiled: &LaneModel<R>, contacts: &Contacts<R>, h: R, centres: &[V3<R>], out: &mut [[R; 6]]) {
    for lane in 0..R::LANES {
        for slot in 0..contacts.count[lane] {
            let contact = Contact::of(compiled, contacts, h, slot, lane);
            let (push, twist) = (contact.world(contact.force), contact.world(contact.torque));
            for (body, sign) in contact.bodies.into_iter().zip([-1.0, 1.0]) {
                let torque = add(twist, cross(sub(contact.pos, of_lane(&centres[body], lane)), push));
                for k in 0..3 {
                    for (at, x) in [(k, push[k]), (3 + k, torque[k])] {
                        let sum = out[body][at].lane(lane).to_f64() + sign * x;
                        out[body][at].set_lane(lane, Scalar::from_f64(sum));
                    }
                }
            }
        }
    }
}

/// Sum of several contacts as one contact in world axes. Its position is the mean of their positions, weighted by force. Its torque is
/// about this position.
fn net_force(all: impl Iterator<Item = Contact> + Clone) -> Contact {
    let (mut force, mut weighted, mut weight, mut plain, mut count) = ([0.0; 3], [0.0; 3], 0.0, [0.0; 3], 0.0);
    let mut nearest = f64::INFINITY;
    for contact in all.clone() {
        let size = dot(contact.force, contact.force).sqrt();
        force = add(force, contact.world(contact.force));
        weighted = add_scaled(weighted, contact.pos, size);
        plain = add(plain, contact.pos);
        weight += size;
        count += 1.0;
        nearest = if contact.distance < nearest { contact.distance } else { nearest };
    }
    let pos = if weight > 0.0 { scale(weighted, 1.0 / weight) } else { scale(plain, 1.0 / count) };
    let torque = all.fold([0.0; 3], |sum, c| add(add(sum, c.world(c.torque)), cross(sub(c.pos, pos), c.world(c.force))));
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    Contact { geoms: [0; 2], bodies: [0; 2], distance: nearest, pos, axes, force, torque }
}

/// Writes the fields of a contact to lane `lane` of `out`. `found` is the number of contacts that the sensor found.
fn report<R: Real>(contact: &Contact, fields: &[ContactField], found: usize, lane: usize, out: &mut [R]) {
    let mut out = out.iter_mut();
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
        // The numbers come first in `zip`, which would otherwise take one entry of `out` too many.
        x[..field.dim()].iter().zip(out.by_ref()).for_each(|(&x, out)| out.set_lane(lane, Scalar::from_f64(x)));
    }
}

impl<R: Real> SensorView<'_, R> {
    fn volume(&self, solid: &Solid<R::Scalar>) -> Volume<R> {
        kernel!(R, || Volume {
            origin: self.position(&solid.place),
            axes: self.orientation(&solid.place),
            size: self.compiled.params.size(solid.index),
        })
    }

    /// Reading of a touch sensor: sum of the normal forces on a body, N. Only forces whose lines of action intersect a volume count.
    pub fn touch(&self, body: usize, solid: &Solid<R::Scalar>) -> R {
        let mut reading = R::default();
        let mut volume = None;
        for lane in 0..R::LANES {
            let mut sum = 0.0;
            for contact in self.sensed_contacts.lane(lane) {
                if !contact.bodies.contains(&body) || contact.force[0] <= 0.0 {
                    continue;
                }
                let zone = volume.get_or_insert_with(|| self.volume(solid)).of_lane(lane);
                // Direction of the force on the other body, away from this one.
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

    /// Writes the readings of a contact sensor to `out`. `order` is a buffer for the contacts of a lane.
    pub fn contacts(
        &self,
        sides: &[Side<R::Scalar>; 2],
        fields: &[ContactField],
        reduction: ContactReduction,
        order: &mut Vec<(f64, usize)>,
        out: &mut [R],
    ) {
        let width: usize = fields.iter().map(|f| f.dim()).sum();
        for lane in 0..R::LANES {
            out.iter_mut().for_each(|x| x.set_lane(lane, R::Scalar::ZERO));
            let contacts = self.sensed_contacts.lane(lane);
            order.clear();
            for (slot, contact) in contacts.iter().enumerate() {
                if self.matches(sides, contact, lane).is_some() {
                    let key = match reduction {
                        ContactReduction::MinDistance => contact.distance,
                        ContactReduction::MaxForce => -dot(contact.force, contact.force),
                        ContactReduction::None | ContactReduction::NetForce => 0.0,
                    };
                    order.push((key, slot));
                }
            }
            // Insertion sort: the list is short and nearly in order, and nothing is allocated.
            for i in 1..order.len() {
                let mut j = i;
                while j > 0 && order[j].0 < order[j - 1].0 {
                    order.swap(j, j - 1);
                    j -= 1;
                }
            }
            let found = order.len();
            let mut seen = order.iter().map(|&(_, slot)| self.seen(sides, contacts[slot], lane));
            if found > 0 && reduction == ContactReduction::NetForce {
                report(&net_force(seen), fields, found, lane, out);
                continue;
            }
            for out in out.chunks_exact_mut(width.max(1)) {
                let Some(contact) = seen.next() else { break };
                report(&contact, fields, found, lane, out);
            }
        }
    }

    /// Tests whether one geom of a contact is on the first side of a contact sensor, and the other geom on its second side. A side is a set
    /// of geoms or a volume.
    ///
    /// The result is `None` if the contact does not match. Otherwise it is false if the contact's first geom is on the first side, and true
    /// if its second geom is.
    fn matches(&self, sides: &[Side<R::Scalar>; 2], contact: &Contact, lane: usize) -> Option<bool> {
        let fits = |side: &Side<R::Scalar>, geom: usize| match side {
            Side::Geoms(which) => which[geom],
            Side::Zone(solid) => {
                let zone = self.volume(solid).of_lane(lane);
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

    /// Contact with its normal from the first to the second of the contact sensor's two sides. A side is a set of geoms or a volume.
    ///
    /// If the contact's second geom is on the first side, the result has the opposite normal and the opposite force.
    fn seen(&self, sides: &[Side<R::Scalar>; 2], mut contact: Contact, lane: usize) -> Contact {
        if self.matches(sides, &contact, lane) == Some(true) {
            // Swapping reverses normal and first tangent, and the force. The components of the force along both are therefore unchanged.
            let [n, t, s] = contact.axes;
            contact.axes = [scale(n, -1.0), scale(t, -1.0), s];
            contact.force[2] = -contact.force[2];
            contact.torque[2] = -contact.torque[2];
        }
        contact
    }
}
