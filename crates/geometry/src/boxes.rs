//! Separation of two boxes by their separating axes, in closed form (Gottschalk, Lin & Manocha, 1996).

use crate::facing::Separation;
use crate::linear_algebra::*;
use crate::pair::Pair;
use crate::vectors::{V, along_axis, neg};

/// Sine of the angle between edges of two boxes below which their cross product is not tested as a separating axis. Face normals then
/// suffice.
const PARALLEL: f64 = 1e-6;

/// Largest overlap of two boxes along each of two axes at which they have no contact, m.
///
/// Example: a box slides from one tile to the next. Its lower face is in the plane of the upper faces of the tiles, up to the gap or
/// overlap of a contact at rest. The side of the next tile must not stop it.
const SLIVER: f64 = 1e-5;

/// Largest value of 1 - cos(angle) between the normals of coplanar faces. Over 10 cm, their planes are then [`SLIVER`] apart.
const COPLANAR: f64 = 5e-9;

/// Whether two boxes touch in a sliver: a face of each is in the same plane, and another face separates the boxes up to [`SLIVER`].
///
/// `faces` has the separation, m, and the normal of the three axes of the first box, then of the second.
fn graze(faces: &[(f64, V); 6]) -> bool {
    let parallel = |f: &V, g: &V| 1.0 - dot(*f, *g).abs() <= COPLANAR;
    let touching = faces[..3].iter().filter(|f| f.0.abs() <= SLIVER && faces[3..].iter().any(|g| parallel(&f.1, &g.1)));
    touching.into_iter().any(|f| faces.iter().any(|g| g.0 >= -SLIVER && !parallel(&f.1, &g.1)))
}

/// Ratio of the overlap along a common perpendicular of two edges to the overlap along a face normal. Below this ratio the contact normal
/// is the common perpendicular, as in ODE and MuJoCo 4.
///
/// The overlap along a face normal is measured at a corner. Near an edge of the other box, this corner may have nothing below it. The
/// overlap of edges is therefore smaller wherever faces are inclined.
const CLEARLY_LESS: f64 = 0.95;

/// Largest separation of two boxes along their 15 separating axes, for a contact at a distance of at most `max_distance`, m.
///
/// `ha` and `hb` are the half sizes, m. The result is `None` if the boxes are farther apart, or if they only touch in a sliver (see
/// [`SLIVER`]). It is `Some(None)` if two edges or corners are closest: no axis then has the exact distance.
///
/// Faces are preferred to edges (see [`CLEARLY_LESS`]), and faces of the first box to faces of the second, unless the difference exceeds
/// rounding. The choice for boxes at rest therefore stays the same.
pub(super) fn separation(pair: &Pair<'_>, ha: V, hb: V, max_distance: f64) -> Option<Option<Separation>> {
    let r = &pair.mat;
    let p = pair.pos;
    let q = rotate_back(r, p);
    let cos = |i: usize, j: usize| r[3 * i + j].abs();
    let mut best = (f64::NEG_INFINITY, [0.0; 3]);
    let (mut faces, mut count) = ([best; 6], 0);
    let mut take = |s: f64, axis: V, advantage: f64| {
        faces[count] = (s, axis);
        count += 1;
        if s > best.0 + advantage {
            best = (s, axis);
        }
    };
    for i in 0..3 {
        let axis = along_axis(i, 1f64.copysign(p[i]));
        take(p[i].abs() - ha[i] - (hb[0] * cos(i, 0) + hb[1] * cos(i, 1) + hb[2] * cos(i, 2)), axis, 0.0);
    }
    let tie = pair.tolerance;
    for j in 0..3 {
        let axis = scale(column(r, j), 1f64.copysign(q[j]));
        take(q[j].abs() - hb[j] - (ha[0] * cos(0, j) + ha[1] * cos(1, j) + ha[2] * cos(2, j)), axis, tie);
    }
    let face = best;
    if face.0 > max_distance || graze(&faces) {
        return None;
    }
    let least = (CLEARLY_LESS * face.0).max(face.0) + 1e-6 * pair.size;
    let edge = edges(pair, ha, hb, least.min(max_distance));
    if edge.0 > max_distance {
        return None;
    }
    if edge.0 > least {
        if edge.0 > 0.0 {
            // If the edges are apart, their ends may be closest.
            return Some(None);
        }
        let points = edge_points(pair, ha, hb, edge.1, edge.2);
        return Some(Some(Separation { normal: edge.1, separation: edge.0, points }));
    }
    let points = [pair.a.support(face.1), pair.support_b(neg(face.1))];
    Some(Some(Separation { normal: face.1, separation: face.0, points }))
}

/// Largest separation of two boxes along an axis that is perpendicular to an edge of each: separation, m, unit axis, and indices of the
/// edge directions. Axes with a separation of at most `least`, m, may be left out.
///
/// Most axes are left out by the closed form of the separation times the length of the cross product, without its direction. It assumes
/// that rotations are exact, which the added millionth allows for.
fn edges(pair: &Pair<'_>, ha: V, hb: V, least: f64) -> (f64, V, [usize; 2]) {
    let mut best = (f64::NEG_INFINITY, [0.0; 3], [0; 2]);
    let (r, p, rounding) = (&pair.mat, &pair.pos, 1e-6 * pair.size);
    let next = |k: usize| [(k + 1) % 3, (k + 2) % 3];
    for i in 0..3 {
        let [i1, i2] = next(i);
        for j in 0..3 {
            let ([j1, j2], [x, y]) = (next(j), [r[3 * i1 + j], r[3 * i2 + j]]);
            let reach = ha[i1] * y.abs() + ha[i2] * x.abs() + hb[j1] * r[3 * i + j2].abs() + hb[j2] * r[3 * i + j1].abs();
            if (x * p[i2] - y * p[i1]).abs() - reach + rounding <= least * (x * x + y * y).sqrt() {
                continue;
            }
            let u = column(&pair.mat, j);
            let l = cross(along_axis(i, 1.0), u);
            let length = norm(l);
            if length < PARALLEL {
                continue;
            }
            let l = scale(l, 1.0 / length);
            let along = dot(l, pair.pos);
            let local = rotate_back(&pair.mat, l);
            let reach: f64 = (0..3).map(|k| ha[k] * l[k].abs() + hb[k] * local[k].abs()).sum();
            let s = along.abs() - reach;
            if s > best.0 {
                best = (s, scale(l, 1f64.copysign(along)), [i, j]);
            }
        }
    }
    best
}

/// Closest points of the two edges that face each other along the unit normal `n`, in the frame of the first box, m.
///
/// `[i, j]` are the indices of the edge directions. `ha` and `hb` are the half sizes, m.
fn edge_points(pair: &Pair<'_>, ha: V, hb: V, n: V, [i, j]: [usize; 2]) -> [V; 2] {
    let mut x = pair.a.support(n);
    x[i] = 0.0;
    let mut local = pair.b.support(rotate_back(&pair.mat, neg(n)));
    local[j] = 0.0;
    let y = add(pair.pos, rotate(&pair.mat, local));
    let e = along_axis(i, 1.0);
    let u = column(&pair.mat, j);
    // The points are x + s e and y + t u. At the closest points, the derivatives of the distance with respect to s and t vanish.
    let d = sub(y, x);
    let (de, du, eu) = (dot(d, e), dot(d, u), dot(e, u));
    let determinant = 1.0 - eu * eu;
    let s = ((de - eu * du) / determinant).clamp(-ha[i], ha[i]);
    let t = ((eu * de - du) / determinant).clamp(-hb[j], hb[j]);
    [add_scaled(x, e, s), add_scaled(y, u, t)]
}
