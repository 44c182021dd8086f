//! Convex hulls of points, with their faces.

use thiserror::Error;

use crate::blocks::{self, Block, Ring, SIDE, rings};
use crate::linear_algebra::*;
use crate::proof::Suspect;
use crate::quickhull;
use crate::vectors::{V, furthest, unit_or};

/// Points are taken for coplanar within this share of the hull's size: vertices of mesh files are in single precision ...
const COPLANAR: f64 = 1e-6;
/// ... and within this share of its thickness: the faces of a thin one are no more bent than those of a thick one.
const COPLANAR_THICKNESS: f64 = 1e-3;
/// Of a product of two vectors, as a share of their lengths.
const ROUNDING: f64 = 2e-15;
/// A face is exactly flat within this share.
const EXACT: f64 = 1e-12;
/// Points that are searched one after the other; in larger hulls the search climbs along edges.
const FEW: usize = 40;

/// Why points have no hull.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum HullError {
    /// Fewer than four points.
    #[error("fewer than four points")]
    TooFew,
    /// All on one plane, line or point, up to rounding.
    #[error("its points lie on one plane")]
    Flat,
    /// Not finite.
    #[error("a coordinate is not finite")]
    NotFinite,
    /// So large that its volume is not finite.
    #[error("its volume is not finite")]
    TooLarge,
    /// The surface that was given for that of their hull is another.
    #[error("the surface kept as its convex hull is not that of its vertices")]
    OtherSurface,
}

/// A flat face.
#[derive(Clone, Debug, PartialEq)]
pub struct Face {
    /// Outward unit normal.
    pub normal: V,
    /// Its vertices, counter-clockwise seen from outside.
    pub vertices: Vec<u32>,
}

/// The convex hull of points, in their frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    /// Places of its vertices among the points that it was made of, ascending.
    corners: Vec<u32>,
    points: Vec<V>,
    triangles: Vec<[u32; 3]>,
    faces: Vec<Face>,
    /// Faces around every point.
    around: Vec<Vec<u32>>,
    /// Points across an edge from every point: those of point v are in `rings[first[v]..first[v + 1]]`.
    rings: Vec<Ring>,
    first: Vec<u32>,
    blocks: Vec<Block>,
    /// Points furthest along the directions through the cells of a cube's sides: where searches begin.
    start: Vec<u32>,
    /// Points furthest along the axes and against them.
    extreme: [usize; 6],
    centre: V,
    bound: f64,
    least: f64,
}

impl Hull {
    /// The convex hull of points (m).
    ///
    /// # Errors
    /// [`HullError`] where they are not finite, span no volume, or one that is not finite.
    pub fn new(points: &[V]) -> Result<Self, HullError> {
        if points.iter().flatten().any(|x| !x.is_finite()) {
            return Err(HullError::NotFinite);
        }
        if points.len() < 4 {
            return Err(HullError::TooFew);
        }
        // Distances from the plane of three points, unscaled, are products of up to four lengths.
        let extent = points.iter().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
        let none = if extent.powi(4).is_finite() { HullError::Flat } else { HullError::TooLarge };
        let triangles = quickhull::triangles(points).ok_or(none)?;
        let (corners, triangles) = corners(points.len(), &triangles);
        let beside = beside(corners.len(), &triangles).expect("the surface of a hull is closed");
        Self::of_surface(points, corners, triangles, &beside)
    }

    /// The convex hull of points (m), from its [`Hull::surface`]: the same bits, sooner. Where it cannot be shown that the surface is
    /// theirs, the hull is made anew and compared.
    ///
    /// # Errors
    /// [`HullError::OtherSurface`] where the triangles are not the surface of a convex body that holds the points.
    pub fn of_known(points: &[V], surface: &[[u32; 3]]) -> Result<Self, HullError> {
        Self::shown(points, surface)
            .or_else(|| Self::new(points).ok().filter(|hull| hull.surface() == surface))
            .ok_or(HullError::OtherSurface)
    }

    /// The hull of a surface that is certainly convex, and holds the points within the tolerance of its own faces.
    fn shown(points: &[V], surface: &[[u32; 3]]) -> Option<Self> {
        if surface.iter().flatten().any(|&v| v as usize >= points.len()) || points.iter().flatten().any(|x| !x.is_finite()) {
            return None;
        }
        let (corners, triangles) = corners(points.len(), surface);
        let beside = beside(corners.len(), &triangles)?;
        let hull = Self::of_surface(points, corners, triangles, &beside).ok()?;
        let suspect = Suspect { points: &hull.points, triangles: &hull.triangles, beside: &beside, centre: hull.centre };
        (suspect.is_convex() && suspect.holds(points, COPLANAR * hull.bound)).then_some(hull)
    }

    /// The hull with some of the points (m) for vertices, with triangles of these, and the triangles across their edges.
    fn of_surface(points: &[V], corners: Vec<u32>, triangles: Vec<[u32; 3]>, beside: &[[u32; 3]]) -> Result<Self, HullError> {
        if corners.is_empty() {
            return Err(HullError::TooFew);
        }
        let points: Vec<V> = corners.iter().map(|&v| points[v as usize]).collect();
        let (volume, area, centre) = volume(&points, &triangles);
        let bound = points.iter().map(|p| norm(sub(*p, centre))).fold(0.0, f64::max);
        if !(volume.is_finite() && area.is_finite() && bound.is_finite()) {
            return Err(HullError::TooLarge);
        }
        if volume <= 0.0 {
            return Err(HullError::Flat);
        }
        // A ball within it has no larger radius than 3 volume / area.
        let thickness = 3.0 * volume / area;
        let faces = merge(&points, &triangles, beside, (COPLANAR * bound).min(COPLANAR_THICKNESS * thickness));
        if faces.len() < 4 {
            return Err(HullError::Flat);
        }
        let mut around = vec![vec![]; points.len()];
        for (f, face) in faces.iter().enumerate() {
            face.vertices.iter().for_each(|&v| around[v as usize].push(f as u32));
        }
        let (rings, first) = rings(&points, &triangles);
        let blocks: Vec<Block> = points.chunks(SIDE).map(Block::new).collect();
        let start = if points.len() > FEW { starts(&blocks) } else { vec![] };
        let extreme = std::array::from_fn(|k| {
            let mut d = [0.0; 3];
            d[k / 2] = if k % 2 == 0 { 1.0 } else { -1.0 };
            blocks::furthest(&blocks, d)
        });
        let depth = |f: &Face| dot(f.normal, sub(points[f.vertices[0] as usize], centre));
        let least = faces.iter().map(depth).fold(f64::INFINITY, f64::min);
        Ok(Self { corners, points, triangles, faces, around, rings, first, blocks, start, extreme, centre, bound, least })
    }

    /// Its vertices, m.
    pub fn points(&self) -> &[V] {
        &self.points
    }

    /// Its surface, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Its surface, counter-clockwise seen from outside, as triangles of the points that it was made of.
    pub fn surface(&self) -> Vec<[u32; 3]> {
        self.triangles.iter().map(|t| t.map(|v| self.corners[v as usize])).collect()
    }

    /// Its flat faces.
    pub fn faces(&self) -> &[Face] {
        &self.faces
    }

    pub(super) fn face(&self, f: usize) -> &Face {
        &self.faces[f]
    }

    /// Centre of its volume, m.
    pub fn centre(&self) -> V {
        self.centre
    }

    /// Least distance of the centre from a face, m.
    pub fn inscribed_radius(&self) -> f64 {
        let height = |face: &Face| dot(face.normal, sub(self.points[face.vertices[0] as usize], self.centre));
        self.faces.iter().map(height).fold(f64::INFINITY, f64::min).max(0.0)
    }

    /// Least and greatest coordinates along each axis, m.
    pub(super) fn extent(&self) -> [V; 2] {
        let along = |k: usize, side: usize| self.points[self.extreme[2 * k + side]][k];
        [std::array::from_fn(|k| along(k, 1)), std::array::from_fn(|k| along(k, 0))]
    }

    /// Radius of a ball about its centre that holds it, m.
    pub(super) fn bound(&self) -> f64 {
        self.bound
    }

    /// From its centre to the nearest face, m.
    pub(super) fn least(&self) -> f64 {
        self.least
    }

    /// The least q, m, for which the ball of radius (q + e) about p - q m, `m` being a unit vector, holds all vertices.
    pub(super) fn curve(&self, p: V, m: V, e: f64) -> f64 {
        let mut q = 0.0;
        for block in &self.blocks {
            // With d = p - w: d . d - e^2 <= 2 q (d . m + e).
            let (along, most) = (add_scaled(scale(p, -2.0), m, 2.0 * q), 2.0 * q * (dot(p, m) + e) + e * e - dot(p, p));
            if block.highest(along) > most {
                let needed = block.points().map(|w| {
                    let d = sub(p, w);
                    (dot(d, d) - e * e) / (2.0 * (dot(d, m) + e))
                });
                q = needed.fold(q, f64::max);
            }
        }
        q
    }

    /// The vertex furthest along `d`. On a convex surface a vertex with no better neighbour is the best.
    pub(super) fn support(&self, d: V) -> usize {
        if self.points.len() <= FEW {
            return furthest(&self.points, d);
        }
        self.climb(self.start[cell(d)] as usize, d)
    }

    /// The vertex furthest along `d`, from one that is nearly so.
    pub(super) fn climb(&self, from: usize, d: V) -> usize {
        // Among what is equal up to rounding there is nothing to climb, and around a flat face a long way to go.
        let level = ROUNDING * self.bound * (d[0].abs() + d[1].abs() + d[2].abs());
        let mut at = from;
        // No vertex comes twice, but for what underflow makes of a direction.
        for _ in 0..self.points.len() {
            let mut best = (level, at);
            for ring in self.rings(at) {
                let rise = ring.along(d);
                let highest = blocks::highest(rise);
                if highest > best.0 {
                    let k = (0..SIDE).fold(0, |k, i| if rise[i] == highest { i } else { k });
                    best = (highest, ring.to[k] as usize);
                }
            }
            if best.1 == at {
                break;
            }
            at = best.1;
        }
        at
    }

    fn rings(&self, vertex: usize) -> &[Ring] {
        &self.rings[self.first[vertex] as usize..self.first[vertex + 1] as usize]
    }

    /// The faces around a vertex.
    pub(super) fn faces_around(&self, vertex: usize) -> &[u32] {
        &self.around[vertex]
    }

    /// The face around a vertex whose normal is nearest to `d`.
    pub(super) fn facing_at(&self, vertex: usize, d: V) -> usize {
        let mut best = (f64::NEG_INFINITY, 0);
        for &f in &self.around[vertex] {
            let x = dot(self.faces[f as usize].normal, d);
            if x > best.0 {
                best = (x, f as usize);
            }
        }
        best.1
    }

    /// The vertex across the edge of a vertex that is nearest to right angles to `d`, the first of equals.
    pub(super) fn level(&self, vertex: usize, d: V) -> usize {
        let mut best = (f64::INFINITY, vertex);
        for ring in self.rings(vertex) {
            let rise = ring.along(d);
            for k in 0..SIDE {
                // 0 / 0 where there is none: never less.
                let square = rise[k] * rise[k] / ring.square[k];
                if square < best.0 {
                    best = (square, ring.to[k] as usize);
                }
            }
        }
        best.1
    }

    /// How far a point over a face is from its outline, m; negative beside it, and where the face is flat only up to the tolerance of its
    /// making.
    pub(super) fn room_over(&self, face: usize, p: V) -> f64 {
        let Face { normal, vertices } = &self.faces[face];
        let n = vertices.len();
        let corner = |k: usize| self.points[vertices[k % n] as usize];
        let o = corner(0);
        let mut room = f64::INFINITY;
        for k in 0..n {
            let (q, r) = (corner(k), corner(k + 1));
            if n > 3 && dot(*normal, sub(q, o)).abs() > EXACT * self.bound {
                return f64::NEG_INFINITY;
            }
            let inwards = cross(*normal, sub(r, q));
            let x = dot(inwards, sub(p, q)) / norm(inwards);
            if x <= 0.0 {
                return x;
            }
            room = room.min(x);
        }
        room
    }

    /// Normals of faces that may separate it from something at `towards`: all of a small hull, else those that face it around the
    /// vertices furthest that way and along the axes.
    pub(super) fn directions(&self, towards: V, mut visit: impl FnMut(V)) {
        if self.faces.len() <= FEW {
            self.faces.iter().for_each(|f| visit(f.normal));
            return;
        }
        let starts = self.extreme.into_iter().chain([self.support(towards)]);
        for vertex in starts {
            self.around[vertex].iter().for_each(|&f| visit(self.faces[f as usize].normal));
        }
    }
}

/// Cells along the edge of a side of the cube of [`Hull::start`].
const CELLS: usize = 16;

/// The cell of the cube's surface that a direction points to.
fn cell(d: V) -> usize {
    let k = crate::vectors::widest(d);
    let side = 2 * k + usize::from(d[k] < 0.0);
    let scale = 0.5 * CELLS as f64 / d[k].abs();
    // Saturating: 0 / 0 has some cell too.
    let at = |x: f64| ((x * scale + 0.5 * CELLS as f64) as usize).min(CELLS - 1);
    (side * CELLS + at(d[(k + 1) % 3])) * CELLS + at(d[(k + 2) % 3])
}

/// The points furthest along the directions through the middles of all cells.
fn starts(points: &[Block]) -> Vec<u32> {
    let middle = |i: usize| (2 * i + 1) as f64 / CELLS as f64 - 1.0;
    let through = |c: usize| {
        let (side, at) = (c / (CELLS * CELLS), c % (CELLS * CELLS));
        let (k, mut d) = (side / 2, [0.0; 3]);
        d[k] = if side % 2 == 0 { 1.0 } else { -1.0 };
        d[(k + 1) % 3] = middle(at / CELLS);
        d[(k + 2) % 3] = middle(at % CELLS);
        d
    };
    (0..6 * CELLS * CELLS).map(|c| blocks::furthest(points, through(c)) as u32).collect()
}

/// The points that triangles have for corners, of so many, in their order; and the triangles with their places among them.
fn corners(points: usize, triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<[u32; 3]>) {
    let mut place = vec![u32::MAX; points];
    triangles.iter().flatten().for_each(|&v| place[v as usize] = 0);
    let corners: Vec<u32> = (0..points as u32).filter(|&v| place[v as usize] == 0).collect();
    (0..).zip(&corners).for_each(|(i, &v)| place[v as usize] = i);
    let triangles = triangles.iter().map(|t| t.map(|v| place[v as usize])).collect();
    (corners, triangles)
}

/// The triangles across the edges that leave the corners of each; `None` where any edge of this many points has not one triangle on either
/// side.
fn beside(points: usize, triangles: &[[u32; 3]]) -> Option<Vec<[u32; 3]>> {
    // The edges that leave point v, as where they lead and whose they are, are in leaving[first[v]..first[v + 1]].
    let mut first = vec![0; points + 1];
    triangles.iter().flatten().for_each(|&v| first[v as usize + 1] += 1);
    (0..points).for_each(|v| first[v + 1] += first[v]);
    let mut next = first.clone();
    let mut leaving = vec![(0, 0); 3 * triangles.len()];
    for (i, t) in (0..).zip(triangles) {
        for k in 0..3 {
            let (from, to) = (t[k] as usize, t[(k + 1) % 3]);
            if leaving[first[from]..next[from]].iter().any(|&(other, _)| other == to) {
                return None;
            }
            leaving[next[from]] = (to, i);
            next[from] += 1;
        }
    }
    let across = |from: u32, to: u32| {
        let from = from as usize;
        leaving[first[from]..first[from + 1]].iter().find(|&&(other, _)| other == to).map(|&(_, t)| t)
    };
    triangles.iter().map(|&[a, b, c]| Some([across(b, a)?, across(c, b)?, across(a, c)?])).collect()
}

/// Volume, area and the centre of the volume: tetrahedra from a point of it to the triangles, none of which counts less than nothing.
fn volume(points: &[V], triangles: &[[u32; 3]]) -> (f64, f64, V) {
    let origin = points[0];
    let (mut sum, mut area, mut moment) = (0.0, 0.0, [0.0; 3]);
    for t in triangles {
        let six = -quickhull::outside(points, *t, 0);
        let [a, b, c] = t.map(|i| sub(points[i as usize], origin));
        sum += six;
        area += 0.5 * norm(area_of([a, b, c]));
        moment = add_scaled(moment, add(add(a, b), c), six / 4.0);
    }
    (sum / 6.0, area, add_scaled(origin, moment, 1.0 / sum))
}

/// Twice the area of a triangle along its normal, from its two shorter edges: of a narrow one nothing else is left of two long ones.
fn area_of(corners: [V; 3]) -> V {
    let edges: [V; 3] = std::array::from_fn(|k| sub(corners[(k + 1) % 3], corners[k]));
    let square = edges.map(|e| dot(e, e));
    let longest = (0..3).fold(0, |best, k| if square[k] > square[best] { k } else { best });
    cross(edges[(longest + 1) % 3], edges[(longest + 2) % 3])
}

/// Triangles on one plane become one face; the largest decide the planes.
fn merge(points: &[V], triangles: &[[u32; 3]], beside: &[[u32; 3]], tolerance: f64) -> Vec<Face> {
    let corner = |t: usize, k: usize| points[triangles[t][k] as usize];
    let areas: Vec<V> = (0..triangles.len()).map(|t| area_of([corner(t, 0), corner(t, 1), corner(t, 2)])).collect();
    let mut order: Vec<(f64, usize)> = areas.iter().map(|a| norm(*a)).zip(0..).collect();
    order.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    // The face that has each triangle, by its largest.
    let mut owner = vec![usize::MAX; triangles.len()];
    let mut faces = vec![];
    for (_, seed) in order {
        if owner[seed] != usize::MAX {
            continue;
        }
        let normal = unit_or(areas[seed], [0.0; 3]);
        let on_plane = |t: usize| (0..3).all(|k| dot(normal, sub(corner(t, k), corner(seed, 0))).abs() <= tolerance);
        let (mut patch, mut next) = (vec![], vec![seed]);
        owner[seed] = seed;
        while let Some(t) = next.pop() {
            patch.push(t);
            for n in beside[t].map(|n| n as usize) {
                if owner[n] == usize::MAX && on_plane(n) && dot(normal, areas[n]) >= 0.0 {
                    owner[n] = seed;
                    next.push(n);
                }
            }
        }
        let edges = patch.iter().flat_map(|&t| (0..3).map(move |k| (t, k)));
        let outer = edges.filter(|&(t, k)| owner[beside[t][k] as usize] != seed);
        let vertices = outline(outer.map(|(t, k)| (triangles[t][k], triangles[t][(k + 1) % 3])).collect());
        let area = patch.iter().fold([0.0; 3], |sum, &t| add(sum, areas[t]));
        faces.push(Face { normal: unit_or(area, normal), vertices });
    }
    faces.retain(|f: &Face| f.vertices.len() >= 3);
    faces
}

/// The vertices along a boundary from the first of them on, given by its edges. Where it meets itself the last edge counts.
fn outline(mut edges: Vec<(u32, u32)>) -> Vec<u32> {
    edges.sort_unstable();
    let mut left = vec![true; edges.len()];
    let mut vertices = vec![];
    let mut at = edges.first().map(|edge| edge.0);
    while let Some(vertex) = at {
        let after = edges.partition_point(|edge| edge.0 <= vertex);
        at = after.checked_sub(1).filter(|&e| edges[e].0 == vertex && std::mem::take(&mut left[e])).map(|e| edges[e].1);
        if at.is_some() {
            vertices.push(vertex);
        }
    }
    vertices
}
