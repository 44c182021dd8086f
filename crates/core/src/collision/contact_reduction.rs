//! Reduction of contacts: in a flat contact area, the contacts at the corners can carry every load, and the others are redundant.
//!
//! Two bodies may touch by several geoms (a foot of seven capsules). The listed pairs of these geoms, without those with springs or with
//! torsional or rolling friction, form a pair group. The contacts of a pair group with the same normal and coefficient of friction, and
//! without restitution, form a contact area.
//!
//! A contact of an area is redundant if its gap is at least the linear interpolation, at its position, of the gaps of other contacts. There
//! are two reasons. The contact's normal velocity is the same interpolation of the velocities of the other contacts, so that its gap does
//! not close before theirs. And any force at the contact, within its friction cone, can be replaced by forces at the other contacts, within
//! their cones. These have the same sum and moment. A flat contact area therefore needs only the contacts at the corners of its convex
//! hull.
//!
//! Rigid-body mechanics does not determine how friction is shared in an area that rotates while it slips, with or without the redundant
//! contacts.

use stepper_real::{Real, Scalar};

use crate::collision::contact_set::Contacts;
use crate::compile::{ModelStructure, NO_PAIR_GROUP};
use crate::math::spatial::*;

/// Smallest number of contacts of a contact area for which the search for redundant contacts runs. Four contacts are usually all corners.
const MIN_CONTACTS: usize = 5;

/// Sine of the angle between two normals below which they count as equal.
const PARALLEL: f64 = 1e-9;

/// Length, relative to the size of a contact area, that counts as zero when redundant contacts are found: 2 micrometres for a foot. It is
/// the tolerance of three tests: whether a contact is on an edge of the area's hull; whether the gaps at the corners are a linear
/// function of position; and whether the gap of an inner contact is at least that of this function.
///
/// Evidence: files have orientations of six digits, which tilt the capsules of one sole by 1e-6.
const FLAT: f64 = 1e-5;

/// Workspace of the search for redundant contacts.
#[derive(Clone, Debug, Default)]
pub(crate) struct ContactReduction {
    /// Pair group of each contact of the present lane. [`NO_PAIR_GROUP`] for contacts of pairs without a group, and for contacts that
    /// [`ContactReduction::gather`] has assigned to an area.
    groups: Vec<u32>,
    /// Contacts of the present area.
    points: Vec<Point>,
    /// Corners of the convex hull of the present area.
    hull: Vec<Point>,
    /// Whether each contact of the present lane is kept.
    kept: Vec<bool>,
}

/// Contact as a point in the plane of its contact area.
#[derive(Clone, Copy, Debug)]
struct Point {
    /// Index of the contact in its lane.
    slot: usize,
    /// Coordinates in the plane of the area, relative to its first contact, m.
    x: [f64; 2],
    /// Gap of the contact, m.
    gap: f64,
}

impl ContactReduction {
    /// Removes the redundant contacts of all lanes.
    pub(crate) fn reduce<R: Real>(&mut self, compiled: &ModelStructure<R::Scalar>, contacts: &mut Contacts<R>) {
        if compiled.pair_groups.is_empty() {
            return;
        }
        for l in 0..R::LANES {
            if contacts.count[l] >= MIN_CONTACTS {
                self.reduce_lane(compiled, contacts, l);
            }
        }
    }

    /// Clears the workspace, and reserves memory for `contacts` contacts, so that later calls do not allocate.
    fn clear(&mut self, contacts: usize) {
        let Self { groups, points, hull, kept } = self;
        groups.clear();
        points.clear();
        hull.clear();
        kept.clear();
        groups.reserve(contacts);
        points.reserve(contacts);
        // Capacity for the two chains of the hull, and the point that they share.
        hull.reserve(2 * contacts + 1);
        kept.reserve(contacts);
    }

    /// Removes the redundant contacts of lane `l`.
    fn reduce_lane<R: Real>(&mut self, compiled: &ModelStructure<R::Scalar>, contacts: &mut Contacts<R>, l: usize) {
        let n = contacts.count[l];
        self.clear(contacts.data.len());
        self.groups.extend((0..n).map(|k| compiled.pair_groups.get(contacts.ids[k][l].pair()).copied().unwrap_or(NO_PAIR_GROUP)));
        self.kept.resize(n, true);
        let mut redundant = false;
        for first in 0..n {
            let group = self.groups[first];
            if group == NO_PAIR_GROUP || n - first < MIN_CONTACTS {
                continue;
            }
            let size = self.gather(contacts, l, first, group);
            if self.points.len() >= MIN_CONTACTS {
                redundant |= self.mark(size);
            }
        }
        if redundant {
            contacts.retain(l, |_, k, _| self.kept[k]);
        }
    }

    /// Gathers the contact area of contact `first` of lane `l`: the contacts of the pair group `group` with the same normal and
    /// friction, and without restitution.
    ///
    /// Sets their entries of `groups` to [`NO_PAIR_GROUP`]. Returns the size of the area, m. If the area is tiny, the result is a larger
    /// size, with which the tolerance [`FLAT`] exceeds the rounding errors of positions.
    fn gather<R: Real>(&mut self, contacts: &Contacts<R>, l: usize, first: usize, group: u32) -> f64 {
        let (origin, normal) = (of_lane(&contacts.data[first].point.pos, l), of_lane(&contacts.data[first].point.normal, l));
        let [_, a, b] = contact_frame(normal);
        let mu = contacts.data[first].mu.lane(l);
        let parallel = PARALLEL.max(4.0 * R::Scalar::EPSILON.to_f64());
        self.points.clear();
        let mut size = 0.0_f64;
        for k in first..contacts.count[l] {
            let slot = &contacts.data[k];
            if self.groups[k] != group || slot.mu.lane(l) != mu || slot.restitution.lane(l) != R::Scalar::default() {
                continue;
            }
            let (own, arm) = (of_lane(&slot.point.normal, l), sub(of_lane(&slot.point.pos, l), origin));
            if norm(cross(own, normal)) > parallel || dot(own, normal) < 0.0 {
                continue;
            }
            self.groups[k] = NO_PAIR_GROUP;
            let x = [dot(arm, a), dot(arm, b)];
            size = size.max(x[0].abs()).max(x[1].abs());
            self.points.push(Point { slot: k, x, gap: slot.point.distance.lane(l).to_f64() });
        }
        // The rounding errors grow with the distance of the area from the world's origin.
        let place = origin.iter().fold(size, |most, x| most.max(x.abs()));
        size.max(place * 64.0 * R::Scalar::EPSILON.to_f64() / FLAT)
    }

    /// Marks the redundant contacts of the gathered area as not kept (`kept`), if the gaps at the corners of its hull are on a plane.
    /// `size` is the size of the area, m. Returns whether any contact was redundant.
    fn mark(&mut self, size: f64) -> bool {
        let Self { points, hull, kept, .. } = self;
        let flat = FLAT * size;
        find_hull(points, hull, flat);
        let Some(plane) = Plane::through(hull, flat) else { return false };
        if hull.iter().any(|p| (p.gap - plane.gap(p.x)).abs() > flat) {
            return false;
        }
        let mut redundant = false;
        for p in points.iter().filter(|p| hull.iter().all(|corner| corner.slot != p.slot)) {
            // The contact is inside the hull, or outside by less than `flat`.
            if p.gap >= plane.gap(p.x) - flat {
                kept[p.slot] = false;
                redundant = true;
            }
        }
        redundant
    }
}

/// Linear function that interpolates the gap of a contact area from the position in its plane.
struct Plane {
    origin: Point,
    slope: [f64; 2],
}

impl Plane {
    /// Plane through the gaps of three corners of the hull that are far apart. `None` if all corners are on a line, within the distance
    /// `flat`, m.
    fn through(hull: &[Point], flat: f64) -> Option<Self> {
        let origin = *hull.first()?;
        let arm = |p: &Point| [p.x[0] - origin.x[0], p.x[1] - origin.x[1]];
        let farthest = |of: &dyn Fn(&Point) -> f64| hull.iter().max_by(|p, q| of(p).total_cmp(&of(q)));
        let b = farthest(&|p| square(arm(p)))?;
        let u = arm(b);
        let length = square(u).sqrt();
        let area = |p: &Point| u[0] * arm(p)[1] - u[1] * arm(p)[0];
        let c = farthest(&|p| area(p).abs())?;
        if area(c).abs() <= 10.0 * flat * length {
            return None;
        }
        let (v, rise) = (arm(c), [b.gap - origin.gap, c.gap - origin.gap]);
        let slope = [(rise[0] * v[1] - rise[1] * u[1]) / area(c), (u[0] * rise[1] - v[0] * rise[0]) / area(c)];
        Some(Self { origin, slope })
    }

    fn gap(&self, x: [f64; 2]) -> f64 {
        self.origin.gap + self.slope[0] * (x[0] - self.origin.x[0]) + self.slope[1] * (x[1] - self.origin.x[1])
    }
}

/// Finds the corners of the convex hull of `points` (monotone chain, Andrew, 1979), and writes them to `hull`. A point outside an edge by
/// less than `flat`, m, is not a corner.
fn find_hull(points: &mut [Point], hull: &mut Vec<Point>, flat: f64) {
    let order = |p: &Point, q: &Point| p.x[0].total_cmp(&q.x[0]).then(p.x[1].total_cmp(&q.x[1])).then(p.gap.total_cmp(&q.gap));
    points.sort_unstable_by(|p, q| order(p, q).then(p.slot.cmp(&q.slot)));
    hull.clear();
    let mut chain = |points: &mut dyn Iterator<Item = &Point>| {
        let start = hull.len();
        for p in points {
            while hull.len() >= start + 2 && !turns_left(&hull[hull.len() - 2], &hull[hull.len() - 1], p, flat) {
                hull.pop();
            }
            hull.push(*p);
        }
        // The last point starts the other chain.
        hull.pop();
    };
    chain(&mut points.iter());
    chain(&mut points.iter().rev());
}

/// Whether the path from `a` over `b` to `c` turns left, because `b` is to the right of the line from `a` to `c` by more than `flat`, m.
fn turns_left(a: &Point, b: &Point, c: &Point, flat: f64) -> bool {
    let (u, v) = ([c.x[0] - a.x[0], c.x[1] - a.x[1]], [b.x[0] - a.x[0], b.x[1] - a.x[1]]);
    v[0] * u[1] - v[1] * u[0] > flat * square(u).sqrt()
}

/// Squared length of a vector. `hypot` would take ten times as long.
fn square([x, y]: [f64; 2]) -> f64 {
    x * x + y * y
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Barycentric weights of `x` in the triangle of three points. `None` if the points are on a line, or if `x` is outside the triangle by
    /// more than rounding errors.
    fn weights([a, b, c]: [&Point; 3], x: [f64; 2]) -> Option<[f64; 3]> {
        let area = |p: [f64; 2], q: [f64; 2], r: [f64; 2]| (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0]);
        let whole = area(a.x, b.x, c.x);
        let w = [area(x, b.x, c.x) / whole, area(a.x, x, c.x) / whole, area(a.x, b.x, x) / whole];
        (whole.abs() > 1e-9 && w.iter().all(|&w| w >= -2e-4)).then_some(w)
    }

    /// Random contact areas, with a position in the plane.
    ///
    /// Positions are on a coarse grid, so that some coincide and many are on a line. The gaps are on a plane, except for some that are
    /// larger.
    fn area() -> impl Strategy<Value = (Vec<Point>, [f64; 2])> {
        let place = (0..6i32, 0..6i32, prop_oneof![3 => Just(0.0), 1 => 0.0..1e-3f64]);
        (prop::collection::vec(place, 5..16), prop::array::uniform2(-0.1..0.1f64)).prop_map(|(places, slope)| {
            let point = |(slot, (i, j, above)): (usize, (i32, i32, f64))| {
                let x = [0.04 * f64::from(i), 0.03 * f64::from(j)];
                Point { slot, x, gap: slope[0] * x[0] + slope[1] * x[1] + above }
            };
            (places.into_iter().enumerate().map(point).collect(), slope)
        })
    }

    proptest! {
        #[test]
        fn what_is_removed_is_a_mean_of_what_stays((points, _) in area()) {
            let mut reduction = ContactReduction { points: points.clone(), kept: vec![true; points.len()], ..ContactReduction::default() };
            let any = reduction.mark(0.2);
            prop_assert_eq!(any, reduction.kept.iter().any(|kept| !kept));
            let stay: Vec<&Point> = points.iter().filter(|p| reduction.kept[p.slot]).collect();
            for p in points.iter().filter(|p| !reduction.kept[p.slot]) {
                let triples = stay.iter().enumerate().flat_map(|(i, a)| {
                    let stay = &stay;
                    stay[..i].iter().enumerate().flat_map(move |(j, b)| stay[..j].iter().map(move |c| [*a, *b, *c]))
                });
                let covered = triples.filter_map(|t| weights(t, p.x).map(|w| (t, w))).any(|(t, w)| {
                    let mean: f64 = t.iter().zip(w).map(|(q, w)| w * q.gap).sum();
                    p.gap >= mean - 1e-5
                });
                prop_assert!(covered, "{p:?} of {stay:?}");
            }
        }

        #[test]
        fn a_flat_area_keeps_its_corners_alone((points, slope) in area()) {
            let flat: Vec<Point> = points.iter().map(|p| Point { gap: slope[0] * p.x[0] + slope[1] * p.x[1], ..*p }).collect();
            let mut reduction = ContactReduction { points: flat.clone(), kept: vec![true; flat.len()], ..ContactReduction::default() };
            reduction.mark(0.2);
            let stay: Vec<&Point> = flat.iter().filter(|p| reduction.kept[p.slot]).collect();
            // If all points are on a line, the hull has no area and all contacts stay.
            let spread = stay.iter().any(|p| stay.iter().any(|q| {
                stay.iter().any(|r| ((q.x[0] - p.x[0]) * (r.x[1] - p.x[1]) - (q.x[1] - p.x[1]) * (r.x[0] - p.x[0])).abs() > 1e-9)
            }));
            for (i, p) in stay.iter().enumerate().filter(|_| spread) {
                let others: Vec<&Point> = stay.iter().enumerate().filter(|(j, _)| *j != i).map(|(_, p)| *p).collect();
                let inside = others.iter().enumerate().any(|(i, a)| {
                    others[..i].iter().enumerate().any(|(j, b)| others[..j].iter().any(|c| weights([a, b, c], p.x).is_some()))
                });
                prop_assert!(!inside, "{p:?} of {stay:?}");
            }
        }
    }
}
