//! Narrow phase of packed pairs: pairs of a ball or capsule with a box that are near in few lanes, see [`PackedPairs`].

use stepper_geometry::pairs::{ContactPoint, Segment, capsule_box, face_clearance, sphere_box};
use stepper_real::{Mask, Real, kernel};

use crate::collision::contact_set::Contacts;
use crate::collision::detection::Scene;
use crate::collision::packed_pairs::{Found, Item, PackedPairs, Queue, gather, gather_boxes, gather_scalars};
use crate::compile::CompiledPair;
use crate::math::lanes::each_of;
use crate::math::spatial::*;

impl<R: Real> Scene<'_, R> {
    /// Computes the contact points of all packed pairs, and stores them in `packed`.
    #[inline(never)]
    pub(crate) fn test_packed(&self, packed: &mut PackedPairs<R::Scalar>) {
        kernel!(R, || {
            let Queue { items, found_points: found, .. } = &mut packed.balls;
            for items in items.chunks(R::LANES) {
                let [radius] = gather!(items, |item| [self.compiled.params.geom_size(item.geoms[0])[0]]);
                let centre = gather!(items, |item| self.poses.pos[item.geoms[0]]);
                let cuboid = gather_boxes(self.compiled, &self.poses.pos, &self.poses.mat, items);
                let point = sphere_box(centre, radius, &cuboid);
                self.append_points(items, &[point], [R::Mask::splat(true)], face_clearance(centre, &cuboid), found);
            }
            let Queue { items, found_points: found, .. } = &mut packed.capsules;
            for items in items.chunks(R::LANES) {
                let [radius, half_length] = gather!(items, |item| {
                    let [radius, half_length, _] = self.compiled.params.geom_size(item.geoms[0]);
                    [radius, half_length]
                });
                let centre = gather!(items, |item| self.poses.pos[item.geoms[0]]);
                let axis = gather!(items, |item| column(&self.poses.mat[item.geoms[0]], 2));
                let (points, exist) = capsule_box(
                    &Segment { centre, axis, half_length, radius },
                    &gather_boxes(self.compiled, &self.poses.pos, &self.poses.mat, items),
                );
                self.append_points(items, &points, exist, R::zero(), found);
            }
        });
    }

    /// Adds the contact points of a packed pair, which [`Scene::test_packed`] found, to `contacts`. Returns false if the pair is not
    /// packed.
    #[inline(always)]
    pub(crate) fn take_packed(
        &self,
        index: usize,
        pair: &CompiledPair<R::Scalar>,
        near: R::Mask,
        packed: &mut PackedPairs<R::Scalar>,
        contacts: &mut Contacts<R>,
    ) -> bool {
        let Some(queue) = packed.queue::<R>(pair.kernel, near.bits()) else { return false };
        let first = queue.taken;
        queue.taken += queue.found_points[first..].iter().take_while(|found| found.index == index).count();
        let own = &queue.found_points[first..queue.taken];
        for feature in 0..2 {
            let (mut lanes, mut clearance) = (0, R::zero());
            let mut point = ContactPoint { distance: R::zero(), pos: zero(), normal: zero() };
            for found in own.iter().filter(|found| found.feature == feature) {
                lanes |= 1 << found.lane;
                clearance.set_lane(found.lane, found.clearance);
                point.distance.set_lane(found.lane, found.point.distance);
                for k in 0..3 {
                    point.pos[k].set_lane(found.lane, found.point.pos[k]);
                    point.normal[k].set_lane(found.lane, found.point.normal[k]);
                }
            }
            if lanes != 0 {
                let over_face = self.stays_over_face(pair, &point, clearance);
                self.store_point(index, feature, pair, R::Mask::from_bits(lanes), over_face, point, contacts);
            }
        }
        true
    }

    /// Appends to `found` those contact points of `items` whose gap is small enough to close within two steps. `exist` has the items that
    /// have each point. `clearance` is [`Found::clearance`] of each item, m.
    #[inline(always)]
    fn append_points<const N: usize>(
        &self,
        items: &[Item<R::Scalar>],
        points: &[ContactPoint<R>; N],
        exist: [R::Mask; N],
        clearance: R,
        found: &mut Vec<Found<R::Scalar>>,
    ) {
        let margin = gather_scalars(
            items,
            #[inline(always)]
            |item| item.margin,
        );
        let [reach] = gather!(items, |item| {
            let [a, b] = item.geoms;
            [self.poses.search_displacement[a] + self.poses.search_displacement[b] + self.slack]
        });
        let mut near = [0; N];
        for feature in 0..N {
            near[feature] = exist[feature].and((points[feature].distance - margin).lt(reach)).bits();
        }
        let any = near.iter().fold(0, |bits, near| bits | near);
        for place in each_of(any).take_while(|&place| place < items.len()) {
            for feature in (0..N).filter(|&feature| near[feature] >> place & 1 == 1) {
                let (of, point) = (|x: R| x.lane(place), &points[feature]);
                let point = ContactPoint { distance: of(point.distance), pos: point.pos.map(of), normal: point.normal.map(of) };
                found.push(Found {
                    index: items[place].index,
                    feature: feature as u32,
                    lane: items[place].lane,
                    point,
                    clearance: of(clearance),
                });
            }
        }
    }
}
