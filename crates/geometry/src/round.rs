//! Closest points of a triangle and a ball or capsule, in closed form. The general search (`separation.rs`) has the same results and takes
//! longer.

use arrayvec::ArrayVec;

use crate::facing::{Facing, Separation};
use crate::linear_algebra::*;
use crate::pair::Pair;
use crate::shape::ConvexShape;
use crate::vectors::V;

/// Distance of a triangle from a ball's centre or a capsule's axis below which the closed form is not used, relative to the size of the
/// pair. The direction between the closest points is then inexact.
pub(super) const CLOSE: f64 = 1e-6;

/// Ends of the axis of a ball or capsule, m: the centre of a ball, or both ends of a capsule's segment.
pub(super) type Ends = ArrayVec<V, 2>;

/// Centre of a ball or both ends of a capsule's segment, in the frame of the first shape, m; `None` for other shapes. The ball or capsule
/// is the second shape.
pub(super) fn ends(pair: &Pair<'_>) -> Option<Ends> {
    match *pair.b {
        ConvexShape::Sphere { .. } => Some(Ends::from_iter([pair.pos])),
        ConvexShape::Capsule { half_length, .. } => {
            let arm = scale(column(&pair.mat, 2), half_length);
            Some(Ends::from([sub(pair.pos, arm), add(pair.pos, arm)]))
        }
        _ => None,
    }
}

/// Whether a ball or capsule may touch a triangle. The function may return true for one that does not touch, but never false for one that
/// does.
///
/// `ends` are the centre of the ball or the ends of the capsule's segment. `reach` is the radius plus the distance within which contacts
/// count, m. The result is false if one edge excludes all ends. All ends then lie outside the edge by more than `reach`, and by more than
/// their depth behind the plane of the triangle.
pub(super) fn may_touch(corners: &[V; 3], normal: V, ends: &[V], reach: f64) -> bool {
    (0..3).all(|k| {
        let edge = sub(corners[(k + 1) % 3], corners[k]);
        let (out, square) = (cross(edge, normal), dot(edge, edge));
        ends.iter().any(|end| {
            let arm = sub(*end, corners[k]);
            let (beyond, most) = (dot(out, arm), reach.max(-dot(normal, arm)));
            beyond <= 0.0 || beyond * beyond <= most * most * square
        })
    })
}

/// Whether the projection of the point `p` onto the plane of a triangle is inside the triangle.
pub(super) fn is_over(corners: &[V; 3], normal: V, p: V) -> bool {
    (0..3).all(|k| dot(cross(sub(corners[(k + 1) % 3], corners[k]), normal), sub(p, corners[k])) <= 0.0)
}

/// Separation of a triangle and the centre of a ball or segment of a capsule. The triangle is the first shape of the pair.
///
/// `None` for other shapes, and if the triangle touches or nearly touches the centre or segment.
pub(super) fn nearest(pair: &Pair<'_>) -> Option<Facing> {
    let ConvexShape::Triangle(corners) = pair.a else { return None };
    let [x, y] = match ends(pair)?[..] {
        [p, q] => nearest_of_segment(corners, [p, q])?,
        _ => [nearest_of_triangle(corners, pair.pos), pair.pos],
    };
    let apart = sub(y, x);
    let separation = norm(apart);
    let normal = scale(apart, 1.0 / separation);
    (separation > CLOSE * pair.size).then(|| Facing::new(pair, Separation { normal, separation, points: [x, y] }))
}

/// Point of a triangle that is closest to `p` (Ericson, 2005, section 5.1.5).
pub(super) fn nearest_of_triangle([a, b, c]: &[V; 3], p: V) -> V {
    let (ab, ac) = (sub(*b, *a), sub(*c, *a));
    let (ap, bp, cp) = (sub(p, *a), sub(p, *b), sub(p, *c));
    let (d1, d2, d3, d4, d5, d6) = (dot(ab, ap), dot(ac, ap), dot(ab, bp), dot(ac, bp), dot(ab, cp), dot(ac, cp));
    if d1 <= 0.0 && d2 <= 0.0 {
        return *a;
    }
    if d3 >= 0.0 && d4 <= d3 {
        return *b;
    }
    if d6 >= 0.0 && d5 <= d6 {
        return *c;
    }
    let vc = d1 * d4 - d3 * d2;
    if vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0 {
        return add_scaled(*a, ab, d1 / (d1 - d3));
    }
    let vb = d5 * d2 - d1 * d6;
    if vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0 {
        return add_scaled(*a, ac, d2 / (d2 - d6));
    }
    let va = d3 * d6 - d5 * d4;
    if va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0 {
        return add_scaled(*b, sub(*c, *b), (d4 - d3) / ((d4 - d3) + (d5 - d6)));
    }
    // The point is along the normal, whose direction is accurate at any distance.
    let n = cross(ab, ac);
    add_scaled(p, n, -dot(n, ap) / dot(n, n))
}

/// Closest points of a triangle and a segment, m. `None` if the segment crosses the triangle.
///
/// Candidates are the triangle with each end of the segment, and each edge of the triangle with the segment. The closest pair is the
/// result.
fn nearest_of_segment(corners: &[V; 3], ends: [V; 2]) -> Option<[V; 2]> {
    let [a, b, c] = *corners;
    let n = cross(sub(b, a), sub(c, a));
    let [from, to] = ends.map(|end| dot(n, sub(end, a)));
    if (from > 0.0) != (to > 0.0) {
        let crossing = add_scaled(ends[0], sub(ends[1], ends[0]), from / (from - to));
        let is_inside = |k: usize| {
            let (p, q) = (corners[k], corners[(k + 1) % 3]);
            dot(cross(n, sub(q, p)), sub(crossing, p)) >= 0.0
        };
        if (0..3).all(is_inside) {
            return None;
        }
    }
    let mut best = [[0.0; 3]; 2];
    let mut least = f64::INFINITY;
    let mut offer = |x: V, y: V| {
        let d = sub(y, x);
        let square = dot(d, d);
        if square < least {
            (least, best) = (square, [x, y]);
        }
    };
    for end in ends {
        offer(nearest_of_triangle(corners, end), end);
    }
    for k in 0..3 {
        let [x, y] = nearest_of_segments([corners[k], corners[(k + 1) % 3]], ends);
        offer(x, y);
    }
    Some(best)
}

/// Closest points of two segments (Ericson, 2005, section 5.1.9).
fn nearest_of_segments([p, q]: [V; 2], [r, s]: [V; 2]) -> [V; 2] {
    let (u, v, w) = (sub(q, p), sub(s, r), sub(p, r));
    let (uu, vv, uv, uw, vw) = (dot(u, u), dot(v, v), dot(u, v), dot(u, w), dot(v, w));
    let determinant = uu * vv - uv * uv;
    let mut along = if determinant > 0.0 { ((uv * vw - uw * vv) / determinant).clamp(0.0, 1.0) } else { 0.0 };
    let mut other = if vv > 0.0 { (uv * along + vw) / vv } else { 0.0 };
    if !(0.0..=1.0).contains(&other) {
        other = other.clamp(0.0, 1.0);
        along = if uu > 0.0 { ((uv * other - uw) / uu).clamp(0.0, 1.0) } else { 0.0 };
    }
    [add_scaled(p, u, along), add_scaled(r, v, other)]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::expand::Polytope;
    use crate::separation::search;
    use crate::vectors::unit_or;
    use proptest::prelude::*;

    fn vector() -> impl Strategy<Value = V> {
        prop::array::uniform3(-0.5..0.5f64)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(4000))]

        /// The general search finds the same distance and direction as the closed form.
        #[test]
        fn nearest_points_are_those_of_the_search(
            corners in prop::array::uniform3(vector()), pos in vector(), axis in vector(), turn in -3.0..3.0f64, half in 0.02..0.4f64,
            is_ball in prop::bool::ANY, in_plane in prop::bool::ANY,
        ) {
            let corners = if in_plane { corners.map(|[x, y, _]| [x, y, 0.0]) } else { corners };
            let area = norm(cross(sub(corners[1], corners[0]), sub(corners[2], corners[0])));
            prop_assume!(area > 1e-3);
            let shape = if is_ball { ConvexShape::Sphere { radius: 0.1 } } else { ConvexShape::Capsule { radius: 0.1, half_length: half } };
            let mat = axis_rotation(unit_or(axis, [0.0, 0.0, 1.0]), turn.sin(), turn.cos());
            let triangle = ConvexShape::Triangle(corners);
            let pair = Pair::between(&triangle, &shape, pos, mat);
            let Some(own) = nearest(&pair) else { return Ok(()) };
            let found = search(&pair, &f64::INFINITY.into(), &mut Polytope::default()).found;
            prop_assert!((own.found.separation - found.separation).abs() < 1e-12, "{:?} {found:?}", own.found);
            prop_assert!(norm(sub(own.found.normal, found.normal)) < 1e-8, "{:?} {found:?}", own.found);
        }
    }
}
