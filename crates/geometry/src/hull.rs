//! Convex hulls of points, with their faces.

use thiserror::Error;

use crate::blocks::{self, Block, Ring, SIDE, rings};
use crate::linear_algebra::*;
use crate::proof::Suspect;
use crate::quickhull;
use crate::vectors::{V, furthest, unit_or};

/// Distance from a plane within which points are coplanar, relative to the size of the hull. Vertices of mesh files have single precision.
/// [`COPLANAR_THICKNESS`] is a second bound.
const COPLANAR: f64 = 1e-6;
/// Distance from a plane within which points are coplanar, relative to the thickness of the hull. It limits how much the faces of a thin
/// hull are bent.
const COPLANAR_THICKNESS: f64 = 1e-3;
/// Rounding error of a dot product, relative to the size of the hull and the sum of the direction's absolute values.
const ROUNDING: f64 = 2e-15;
/// Distance from its plane within which a face is exactly flat, relative to the size of the hull.
const EXACT: f64 = 1e-12;
/// Largest number of points for which the support point is found by testing all of them. In larger hulls the search climbs along edges.
const FEW: usize = 40;

/// Reason why points have no hull.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum HullError {
    /// Fewer than four points.
    #[error("fewer than four points")]
    TooFew,
    /// All points are on one plane, line or point, up to rounding.
    #[error("its points lie on one plane")]
    Flat,
    /// A coordinate is not finite.
    #[error("a coordinate is not finite")]
    NotFinite,
    /// The volume is not finite.
    #[error("its volume is not finite")]
    TooLarge,
    /// The given surface is not that of the hull of the points.
    #[error("the surface kept as its convex hull is not that of its vertices")]
    OtherSurface,
}

/// Flat face of a hull.
#[derive(Clone, Debug, PartialEq)]
pub struct Face {
    /// Outward unit normal.
    pub normal: V,
    /// Indices of its vertices, counter-clockwise seen from outside.
    pub vertices: Vec<u32>,
}

/// Convex hull of points, in their frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    /// Indices of its vertices in the list of given points, ascending.
    corners: Vec<u32>,
    points: Vec<V>,
    triangles: Vec<[u32; 3]>,
    faces: Vec<Face>,
    /// Indices of the faces around every vertex.
    around: Vec<Vec<u32>>,
    /// Neighbours of every vertex along edges. Those of vertex v are in `rings[first[v]..first[v + 1]]`.
    rings: Vec<Ring>,
    first: Vec<u32>,
    blocks: Vec<Block>,
    /// Vertex that is farthest along the direction through each cell of a cube's surface. Searches for support points start there.
    start: Vec<u32>,
    /// Vertices that are farthest along +x, -x, +y, -y, +z and -z.
    extreme: [usize; 6],
    centre: V,
    bound: f64,
    least: f64,
}

impl Hull {
    /// Convex hull of points, m.
    ///
    /// # Errors
    /// [`HullError`] if a coordinate is not finite, if the points span no volume, or if the volume is not finite.
    pub fn new(points: &[V]) -> Result<Self, HullError> {
        if points.iter().flatten().any(|x| !x.is_finite()) {
            return Err(HullError::NotFinite);
        }
        if points.len() < 4 {
            return Err(HullError::TooFew);
        }
        // Unscaled distances from the plane of three points are products of up to four lengths.
        let extent = points.iter().flatten().fold(0.0, |most: f64, x| most.max(x.abs()));
        let none = if extent.powi(4).is_finite() { HullError::Flat } else { HullError::TooLarge };
        let triangles = quickhull::triangles(points).ok_or(none)?;
        let (corners, triangles) = corners(points.len(), &triangles);
        let beside = beside(corners.len(), &triangles).expect("the surface of a hull is closed");
        Self::of_surface(points, corners, triangles, &beside)
    }

    /// Convex hull of points, m, from its [`Hull::surface`]. It has the same bits as [`Hull::new`] and takes less time.
    ///
    /// If the check of the surface fails, the hull is computed from the points and compared.
    ///
    /// # Errors
    /// [`HullError::OtherSurface`] if the triangles are not the surface of a convex body that contains the points.
    pub fn of_known(points: &[V], surface: &[[u32; 3]]) -> Result<Self, HullError> {
        Self::shown(points, surface)
            .or_else(|| Self::new(points).ok().filter(|hull| hull.surface() == surface))
            .ok_or(HullError::OtherSurface)
    }

    /// Hull with the given surface, if that is certainly convex and contains the points within the tolerance of the faces.
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

    /// Hull with some of the points, m, as vertices. `triangles` are its surface, and `beside` the triangles across their edges.
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
        // An inscribed ball has at most the radius 3 volume / area.
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

    /// Vertices, m.
    pub fn points(&self) -> &[V] {
        &self.points
    }

    /// Triangles of the surface as indices of vertices, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Triangles of the surface as indices of the given points, counter-clockwise seen from outside.
    pub fn surface(&self) -> Vec<[u32; 3]> {
        self.triangles.iter().map(|t| t.map(|v| self.corners[v as usize])).collect()
    }

    /// Flat faces. Coplanar triangles are one face.
    pub fn faces(&self) -> &[Face] {
        &self.faces
    }

    pub(super) fn face(&self, f: usize) -> &Face {
        &self.faces[f]
    }

    /// Centre of the volume, m.
    pub fn centre(&self) -> V {
        self.centre
    }

    /// Smallest distance of the centre from a face, m.
    pub fn inscribed_radius(&self) -> f64 {
        let height = |face: &Face| dot(face.normal, sub(self.points[face.vertices[0] as usize], self.centre));
        self.faces.iter().map(height).fold(f64::INFINITY, f64::min).max(0.0)
    }

    /// Smallest and largest coordinates along each axis, m.
    pub(super) fn extent(&self) -> [V; 2] {
        let along = |k: usize, side: usize| self.points[self.extreme[2 * k + side]][k];
        [std::array::from_fn(|k| along(k, 1)), std::array::from_fn(|k| along(k, 0))]
    }

    /// Radius of the smallest ball around the centre that contains the hull, m.
    pub(super) fn bound(&self) -> f64 {
        self.bound
    }

    /// Distance of the centre from the nearest face, m.
    pub(super) fn least(&self) -> f64 {
        self.least
    }

    /// Smallest q, m, for which the ball of radius q + e around p - q m contains all vertices. `m` is a unit vector.
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

    /// Vertex that is farthest along `d`. On a convex surface, a vertex without a farther neighbour is the farthest.
    pub(super) fn support(&self, d: V) -> usize {
        if self.points.len() <= FEW {
            return furthest(&self.points, d);
        }
        self.climb(self.start[cell(d)] as usize, d)
    }

    /// Vertex that is farthest along `d`. The search starts at the vertex `from`.
    pub(super) fn climb(&self, from: usize, d: V) -> usize {
        // Differences up to rounding do not count, because the search could go around a flat face.
        let level = ROUNDING * self.bound * (d[0].abs() + d[1].abs() + d[2].abs());
        let mut at = from;
        // No vertex comes twice, except by underflow of the direction.
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

    /// Indices of the faces around a vertex.
    pub(super) fn faces_around(&self, vertex: usize) -> &[u32] {
        &self.around[vertex]
    }

    /// Index of the face whose normal is closest to `d`, among the faces around a vertex.
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

    /// Neighbour of a vertex along the edge that is closest to perpendicular to `d`; the first one of several.
    pub(super) fn level(&self, vertex: usize, d: V) -> usize {
        let mut best = (f64::INFINITY, vertex);
        for ring in self.rings(vertex) {
            let rise = ring.along(d);
            for k in 0..SIDE {
                // 0 / 0 in empty places, which is never less.
                let square = rise[k] * rise[k] / ring.square[k];
                if square < best.0 {
                    best = (square, ring.to[k] as usize);
                }
            }
        }
        best.1
    }

    /// Distance of a point over a face from the outline of the face, m. Negative outside the outline, and if the face is not exactly flat.
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

    /// Visits normals of faces that may separate the hull from a shape at `towards`.
    ///
    /// These are all faces of a small hull. Of a larger one, they are the faces around the vertex that is farthest in this direction, and
    /// around the farthest vertices along the axes.
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

/// Number of cells along an edge of the cube of [`Hull::start`].
const CELLS: usize = 16;

/// Index of the cell of the cube's surface that a direction points to.
fn cell(d: V) -> usize {
    let k = crate::vectors::widest(d);
    let side = 2 * k + usize::from(d[k] < 0.0);
    let scale = 0.5 * CELLS as f64 / d[k].abs();
    // The conversion saturates, so that 0 / 0 has a cell too.
    let at = |x: f64| ((x * scale + 0.5 * CELLS as f64) as usize).min(CELLS - 1);
    (side * CELLS + at(d[(k + 1) % 3])) * CELLS + at(d[(k + 2) % 3])
}

/// Indices of the points that are farthest along the directions through the centres of all cells.
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

/// Indices of the points that are corners of triangles, ascending, and the triangles as indices of this list. `points` is the number of all
/// points.
fn corners(points: usize, triangles: &[[u32; 3]]) -> (Vec<u32>, Vec<[u32; 3]>) {
    let mut place = vec![u32::MAX; points];
    triangles.iter().flatten().for_each(|&v| place[v as usize] = 0);
    let corners: Vec<u32> = (0..points as u32).filter(|&v| place[v as usize] == 0).collect();
    (0..).zip(&corners).for_each(|(i, &v)| place[v as usize] = i);
    let triangles = triangles.iter().map(|t| t.map(|v| place[v as usize])).collect();
    (corners, triangles)
}

/// Neighbours of each triangle across the edges that start at its corners. `None` if an edge does not have one triangle on each side.
/// `points` is the number of points.
fn beside(points: usize, triangles: &[[u32; 3]]) -> Option<Vec<[u32; 3]>> {
    // leaving[first[v]..first[v + 1]] has the edges that start at point v: end point and triangle of each.
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

/// Volume, area and centre of the volume, from the tetrahedra between a vertex and the triangles. None of their volumes is negative.
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

/// Vector along the normal of a triangle whose length is twice the area. It is computed from the two shorter edges, because two long edges
/// of a narrow triangle have a large rounding error.
fn area_of(corners: [V; 3]) -> V {
    let edges: [V; 3] = std::array::from_fn(|k| sub(corners[(k + 1) % 3], corners[k]));
    let square = edges.map(|e| dot(e, e));
    let longest = (0..3).fold(0, |best, k| if square[k] > square[best] { k } else { best });
    cross(edges[(longest + 1) % 3], edges[(longest + 2) % 3])
}

/// Merges coplanar triangles to faces. The largest triangle of a face determines its plane.
fn merge(points: &[V], triangles: &[[u32; 3]], beside: &[[u32; 3]], tolerance: f64) -> Vec<Face> {
    let corner = |t: usize, k: usize| points[triangles[t][k] as usize];
    let areas: Vec<V> = (0..triangles.len()).map(|t| area_of([corner(t, 0), corner(t, 1), corner(t, 2)])).collect();
    let mut order: Vec<(f64, usize)> = areas.iter().map(|a| norm(*a)).zip(0..).collect();
    order.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    // Largest triangle of the face to which each triangle belongs.
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

/// Vertices along a boundary that is given by its edges, from the first vertex on. If the boundary touches itself, it follows the last
/// edge.
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
