//! Convex hulls of points, with their faces.

use thiserror::Error;

use crate::blocks::{self, Block, Ring, SIDE, rings};
use crate::linear_algebra::*;
use crate::quickhull;
use crate::vectors::{V, along_axis, furthest, unit_or};

/// Largest distance of a face's vertices from the face's plane, relative to the size of the hull. Vertices of mesh files have single
/// precision. [`COPLANAR_THICKNESS`] is a second bound; the smaller distance holds.
const COPLANAR: f64 = 1e-6;
/// Largest distance of a face's vertices from the face's plane, relative to the thickness of the hull. This bound limits how much the faces
/// of a thin hull are bent.
const COPLANAR_THICKNESS: f64 = 1e-3;
/// Rounding error of the dot product of a vertex and a direction, relative to the size of the hull and the sum of the direction's absolute
/// values.
const ROUNDING: f64 = 2e-15;
/// Largest distance of a face's vertices from the face's plane at which the face counts as exactly flat, relative to the size of the hull.
const EXACT: f64 = 1e-12;
/// Largest number of vertices for which the support point is found by testing all of them. In larger hulls the search climbs along edges.
const FEW: usize = 40;

/// Reason why a convex hull of points cannot be made.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum HullError {
    /// Fewer than four points.
    #[error("fewer than four points")]
    TooFew,
    /// All points are on one plane or line, or at one place, up to rounding.
    #[error("its points lie on one plane")]
    Flat,
    /// A coordinate of a point is not finite.
    #[error("a coordinate is not finite")]
    NotFinite,
    /// The volume of the hull is not finite.
    #[error("its volume is not finite")]
    TooLarge,
}

/// Flat face of a convex hull.
#[derive(Clone, Debug, PartialEq)]
pub struct Face {
    /// Outward unit normal of the face.
    pub normal: V,
    /// Indices of the face's vertices in [`Hull::points`], counter-clockwise seen from outside.
    pub vertices: Vec<u32>,
}

/// Convex hull of points, in the frame of the points.
#[derive(Clone, Debug, PartialEq)]
pub struct Hull {
    /// Vertices of the hull, m.
    points: Vec<V>,
    /// Triangles of the hull's surface as vertex indices, counter-clockwise seen from outside.
    triangles: Vec<[u32; 3]>,
    /// Flat faces of the hull. Coplanar triangles are merged.
    pub(super) faces: Vec<Face>,
    /// Indices of the faces that meet at each vertex.
    pub(super) around: Vec<Vec<u32>>,
    /// Edges that start at each vertex. The edges of vertex v are in `rings[first[v]..first[v + 1]]`.
    rings: Vec<Ring>,
    /// For each vertex, index in `rings` of its first ring; the last entry is the number of rings.
    first: Vec<u32>,
    /// Vertices of the hull in blocks of eight.
    blocks: Vec<Block>,
    /// Vertices at which searches for a support point start. For each cell of a cube's surface, it is the vertex that is farthest along the
    /// direction through the cell. Empty for hulls of up to [`FEW`] vertices.
    start: Vec<u32>,
    /// Vertices that are farthest along +x, -x, +y, -y, +z and -z.
    extreme: [usize; 6],
    /// Smallest and largest coordinates of the vertices along each axis, m.
    pub(super) extent: [V; 2],
    /// Centre of the hull's volume, m.
    centre: V,
    /// Radius of the smallest ball around the hull's centre that contains the hull, m.
    pub(super) bound: f64,
    /// Smallest distance of the hull's centre from a face, m.
    pub(super) least: f64,
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
        let [triangles, neighbours] = quickhull::triangles(points).ok_or(none)?;
        let (points, triangles) = vertices(points, &triangles);
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
        let faces = merge(&points, &triangles, &neighbours, (COPLANAR * bound).min(COPLANAR_THICKNESS * thickness));
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
        let extreme: [usize; 6] =
            std::array::from_fn(|k| blocks::furthest(&blocks, along_axis(k / 2, if k % 2 == 0 { 1.0 } else { -1.0 })));
        let depth = |f: &Face| dot(f.normal, sub(points[f.vertices[0] as usize], centre));
        let least = faces.iter().map(depth).fold(f64::INFINITY, f64::min);
        let along = |k: usize, side: usize| points[extreme[2 * k + side]][k];
        let extent = [std::array::from_fn(|k| along(k, 1)), std::array::from_fn(|k| along(k, 0))];
        Ok(Self { points, triangles, faces, around, rings, first, blocks, start, extreme, extent, centre, bound, least })
    }

    /// Vertices of the hull, m.
    pub fn points(&self) -> &[V] {
        &self.points
    }

    /// Triangles of the surface as indices of vertices, counter-clockwise seen from outside.
    pub fn triangles(&self) -> &[[u32; 3]] {
        &self.triangles
    }

    /// Flat faces of the hull. Coplanar triangles are one face.
    pub fn faces(&self) -> &[Face] {
        &self.faces
    }

    /// Centre of the hull's volume, m.
    pub fn centre(&self) -> V {
        self.centre
    }

    /// Smallest distance of the hull's centre from a face, m.
    pub fn inscribed_radius(&self) -> f64 {
        self.least.max(0.0)
    }

    /// Smallest q >= 0, m, for which the ball of radius q + e around p - q m contains all vertices.
    ///
    /// `p` is a point and `m` a unit vector. The length `e`, m, is how far the ball bulges beyond p along m.
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

    /// Index of the hull's vertex that is farthest along `d`.
    pub(super) fn support(&self, d: V) -> usize {
        if self.points.len() <= FEW {
            return furthest(&self.points, d);
        }
        self.climb(self.start[cell(d)] as usize, d)
    }

    /// Index of the hull's vertex that is farthest along `d`. The search starts at the vertex `from` and follows edges.
    ///
    /// On a convex surface, a vertex without a farther neighbour is the farthest of all.
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

    /// Edges that start at a vertex.
    fn rings(&self, vertex: usize) -> &[Ring] {
        &self.rings[self.first[vertex] as usize..self.first[vertex + 1] as usize]
    }

    /// Index of the face whose normal is closest to `d`, among the faces that meet at a vertex.
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

    /// Vertex at the other end of that edge of `vertex` that is closest to perpendicular to `d`. Of several equal edges the first one
    /// counts.
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

    /// Distance of a point above a face from the outline of the face, m.
    ///
    /// The point `p` is in the frame of the hull, m. The result is negative outside the outline, and if the face is not exactly flat.
    pub(super) fn distance_from_outline(&self, face: usize, p: V) -> f64 {
        let Face { normal, vertices } = &self.faces[face];
        let n = vertices.len();
        let corner = |k: usize| self.points[vertices[k % n] as usize];
        let o = corner(0);
        let mut least = f64::INFINITY;
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
            least = least.min(x);
        }
        least
    }

    /// Calls `visit` with normals of faces that may separate the hull from another shape. `towards` is the vector from the centre of the
    /// hull to the centre of that shape, m.
    ///
    /// For a hull of few faces these are the normals of all faces. For a larger hull they are the normals of the faces that meet at the
    /// vertex farthest along `towards`, and at the vertices farthest along the axes.
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

/// Number of cells along an edge of a cube. Each cell of the cube's surface has an entry in [`Hull::start`].
const CELLS: usize = 16;

/// Index of the cell of a cube's surface that contains the direction `d`, see [`Hull::start`].
fn cell(d: V) -> usize {
    let k = crate::vectors::widest(d);
    let side = 2 * k + usize::from(d[k] < 0.0);
    let scale = 0.5 * CELLS as f64 / d[k].abs();
    // The conversion saturates, so that 0 / 0 has a cell too.
    let at = |x: f64| ((x * scale + 0.5 * CELLS as f64) as usize).min(CELLS - 1);
    (side * CELLS + at(d[(k + 1) % 3])) * CELLS + at(d[(k + 2) % 3])
}

/// For each cell of the cube's surface, index of the point that is farthest along the direction through its centre, see [`Hull::start`].
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

/// Points that are corners of triangles, in the given order, and the triangles with indices into this list.
fn vertices(points: &[V], triangles: &[[u32; 3]]) -> (Vec<V>, Vec<[u32; 3]>) {
    let mut place = vec![u32::MAX; points.len()];
    triangles.iter().flatten().for_each(|&v| place[v as usize] = 0);
    let corners: Vec<usize> = (0..points.len()).filter(|&v| place[v] == 0).collect();
    (0..).zip(&corners).for_each(|(i, &v)| place[v] = i);
    (corners.iter().map(|&v| points[v]).collect(), triangles.iter().map(|t| t.map(|v| place[v as usize])).collect())
}

/// Volume, m^3, surface area, m^2, and centre of the volume, m, of a convex hull with these triangles.
///
/// The volume is the sum of tetrahedra between a vertex and the triangles. None of them has a negative volume.
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

/// Normal vector of a triangle, with a length of twice the triangle's area, m^2.
///
/// The vector is computed from the two shorter edges, because two long edges of a narrow triangle have a large rounding error.
fn area_of(corners: [V; 3]) -> V {
    let edges: [V; 3] = std::array::from_fn(|k| sub(corners[(k + 1) % 3], corners[k]));
    let square = edges.map(|e| dot(e, e));
    let longest = (0..3).fold(0, |best, k| if square[k] > square[best] { k } else { best });
    cross(edges[(longest + 1) % 3], edges[(longest + 2) % 3])
}

/// Merges coplanar triangles to faces. The largest triangle of a face determines its plane, from which vertices may be `tolerance`, m,
/// away.
///
/// `neighbours` has the triangles across the edges that start at each corner.
fn merge(points: &[V], triangles: &[[u32; 3]], neighbours: &[[u32; 3]], tolerance: f64) -> Vec<Face> {
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
        let (mut group, mut next) = (vec![], vec![seed]);
        owner[seed] = seed;
        while let Some(t) = next.pop() {
            group.push(t);
            for n in neighbours[t].map(|n| n as usize) {
                if owner[n] == usize::MAX && on_plane(n) && dot(normal, areas[n]) >= 0.0 {
                    owner[n] = seed;
                    next.push(n);
                }
            }
        }
        let edges = group.iter().flat_map(|&t| (0..3).map(move |k| (t, k)));
        let outer = edges.filter(|&(t, k)| owner[neighbours[t][k] as usize] != seed);
        let vertices = outline(outer.map(|(t, k)| (triangles[t][k], triangles[t][(k + 1) % 3])).collect());
        let area = group.iter().fold([0.0; 3], |sum, &t| add(sum, areas[t]));
        faces.push(Face { normal: unit_or(area, normal), vertices });
    }
    faces.retain(|f: &Face| f.vertices.len() >= 3);
    faces
}

/// Vertices along the closed boundary that consists of directed `edges`, starting from the lowest index. At a vertex where several edges
/// start, the boundary continues along the one that leads to the highest index.
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
