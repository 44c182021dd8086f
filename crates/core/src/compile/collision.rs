//! Compiled collision geometry: geoms with their frames, and the pairs that can collide.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::marker::PhantomData;
use std::sync::Arc;

use stepper_geometry::{ConvexShape, Grid, MeshSurface, Solid, Surface};
use stepper_real::{Real, Scalar};

use crate::compile::equality::Spring;
use crate::compile::merging::{Merged, Pose, matrix, vector};
use crate::compile::parameters::{ContactParams, Params};
use crate::model::{ContactSpring, Filter, Geom, HeightField, Kernel, Mesh, Model, Object, Pair, Shape};

/// Geom that takes part in collision.
#[derive(Clone, Debug)]
pub struct CompiledGeom<S> {
    /// Index of the geom in the model.
    pub index: usize,
    /// Index of the frame to which the geom is fixed.
    pub frame: usize,
    /// Whether the geom is a plane (half space).
    pub is_plane: bool,
    /// Whether the geom is a sphere or a capsule. All points of its surface have the same distance from its centre or segment.
    pub is_round: bool,
    /// Rotations that map the geom's shape to itself.
    pub(crate) symmetry: Symmetry,
    /// Rotation matrix from the geom's axes to the frame's, row-major.
    pub mat: [S; 9],
    /// Whether detection needs the geom's whole orientation, and not only its z axis.
    pub full_orientation: bool,
    /// Collision shape for [`Kernel::Convex`], [`Kernel::Surface`], bounding boxes and the tunnelling check; `None` if no pair needs it.
    pub solid: Option<Solid>,
    /// Bounding and inscribed radius of a mesh or height field, which are equal in all environments; `None` for other shapes.
    pub(super) fixed_radii: Option<Radii>,
}

/// Rotations that map a shape to itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Symmetry {
    /// All rotations about the centre.
    Ball,
    /// Rotations about the z axis through the centre.
    Axis,
    /// Rotations about the axes of an ellipsoid that are perpendicular to two equal radii.
    Ellipsoid,
    /// No rotation, or unknown.
    None,
}

impl<S: Scalar> CompiledGeom<S> {
    /// Sets the geom's solid (collision shape). `collides` is true if [`Kernel::Convex`] or [`Kernel::Surface`] uses the solid; detection
    /// then needs the geom's whole orientation.
    fn set_solid(&mut self, model: &Model, shape: &Shape, collides: bool) {
        self.solid.get_or_insert_with(|| solid(model, shape));
        self.full_orientation |= collides;
    }
}

/// Pair of geoms that can collide, with its collision function and parameters.
#[derive(Clone, Copy, Debug)]
pub struct CompiledPair<S> {
    /// Indices of the geoms in the compiled model.
    pub geoms: [usize; 2],
    /// Function of the narrow phase for this pair of shapes.
    pub kernel: Kernel,
    /// Dimension of the pair's contacts, as in MuJoCo: 1, 3, 4 or 6. Hard contact makes three rows for 1 and 3.
    pub condim: u8,
    /// Margin of the pair: distance at which its contacts begin to push, m.
    pub margin: S,
    /// Spring of the pair's contacts; `None` for rigid contacts.
    pub spring: Option<Spring<S>>,
}

impl<S> CompiledPair<S> {
    /// Whether the first geom is a plane and the second a capsule.
    pub fn is_plane_and_capsule(&self) -> bool {
        matches!(self.kernel, Kernel::PlaneCapsule)
    }
}

/// Dynamic pairs: pairs that are too numerous for a list. In every step, the broad phase finds those that can touch. The geoms of dynamic
/// pairs are called members.
#[derive(Clone, Debug)]
pub struct DynamicPairs<S> {
    /// Geoms that form the dynamic pairs, ascending by their index in the model.
    pub members: Vec<Member>,
    /// Indices in `members` of the geoms that are not fixed to the world, if the broad phase searches for pairs of two such geoms. Empty if
    /// these pairs are listed, so that only pairs of a moving and a static geom are dynamic.
    pub moving: Vec<u32>,
    /// Largest sum of bounding radius and margin of a geom in `members`, m, with the sizes of the model.
    pub widest: f64,
    /// Indices of the dynamic pairs in the compiled model.
    pub(crate) table: PairTable,
    filter: Filter,
    /// Shapes of all geoms, by index of the geom in the model.
    shapes: Vec<Shape>,
    pub(super) has_rolling_friction: bool,
    scalar: PhantomData<S>,
}

/// Table whose entries are the dynamic pairs. Each entry has an index in the compiled model, row by row.
#[derive(Clone, Debug, Default)]
pub(crate) struct PairTable {
    /// Index of the first dynamic pair in the compiled model. Smaller indices belong to the pairs in the compiled model's list of pairs.
    first: usize,
    /// Member of each row, as its index in [`DynamicPairs::members`]. All members have a column.
    rows: Vec<u32>,
    /// Row of each member; [`NO_ROW`] for a member without a row.
    row_of: Vec<u32>,
}

impl PairTable {
    /// Table in which all members have a row. Among many members only moving ones have, because an index has 32 bits.
    fn new(first: usize, moves: Vec<bool>) -> Self {
        let is_square = moves.len() < MAX_SQUARE;
        let rows: Vec<u32> = (0..).zip(&moves).filter(|(_, moves)| is_square || **moves).map(|(i, _)| i).collect();
        let mut row_of = vec![NO_ROW; moves.len()];
        (0..).zip(&rows).for_each(|(row, &member)| row_of[member as usize] = row);
        Self { first, rows, row_of }
    }

    /// Index in the compiled model of the dynamic pair of the members `i` and `j`, at least one of which moves.
    #[inline(always)]
    pub(crate) fn index(&self, i: usize, j: usize) -> usize {
        let (low, high) = (i.min(j), i.max(j));
        let (row, column) = if self.row_of[low] == NO_ROW { (high, low) } else { (low, high) };
        self.first + self.row_of[row] as usize * self.row_of.len() + column
    }

    /// The two members of the dynamic pair `index`; `None` if there is no such pair.
    fn members_of(&self, index: usize) -> Option<[usize; 2]> {
        let (columns, k) = (self.row_of.len(), index.checked_sub(self.first)?);
        Some([*self.rows.get(k / columns)? as usize, k % columns])
    }
}

/// Geom in the set that forms the dynamic pairs. Any two geoms of the set have the index of a dynamic pair. [`DynamicPairs::pair`] returns
/// `None` for two geoms that do not collide.
#[derive(Clone, Copy, Debug)]
pub struct Member {
    /// Index of the geom in the compiled model.
    pub geom: usize,
    /// Index of the geom in the model.
    model_geom: usize,
    /// Contribution of this geom to the margin of a pair, m.
    pub margin: f64,
}

impl<S: Scalar> DynamicPairs<S> {
    /// The two entries of `members` that form the dynamic pair `index`; `None` if there is no such pair.
    fn members_of(&self, index: usize) -> Option<[&Member; 2]> {
        Some(self.table.members_of(index)?.map(|i| &self.members[i]))
    }

    /// Geoms of the dynamic pair `index`, as indices in the compiled model. The simpler shape is first. `None` if there is no such pair.
    pub fn geoms(&self, index: usize) -> Option<[usize; 2]> {
        let [a, b] = self.members_of(index)?;
        let swap = self.filter.ordered([a.model_geom, b.model_geom])[0] != a.model_geom;
        Some(if swap { [b.geom, a.geom] } else { [a.geom, b.geom] })
    }

    /// Compiled form of the dynamic pair `index`; `None` if there is no such pair, or if its geoms do not collide. The result
    /// is also `None` for an explicit pair, which is listed.
    pub fn pair(&self, index: usize) -> Option<CompiledPair<S>> {
        let [a, b] = self.members_of(index)?;
        let geoms = self.filter.ordered([a.model_geom, b.model_geom]);
        if self.filter.explicit_pair(geoms).is_some() {
            return None;
        }
        let shapes = geoms.map(|g| &self.shapes[g]);
        let pair = self.filter.pair(geoms)?;
        Some(compile_pair(&pair, Kernel::of(shapes[0], shapes[1])?, self.geoms(index)?))
    }

    /// Collision parameters of the dynamic pair `index`, with the geoms as indices in the model. `None` if the two geoms do not
    /// collide.
    pub(crate) fn geom_pair(&self, index: usize) -> Option<Pair> {
        let [a, b] = self.members_of(index)?;
        self.filter.pair(self.filter.ordered([a.model_geom, b.model_geom]))
    }

    /// Contact parameters of the dynamic pair `index`, combined from those of its geoms (see [`Filter::precedence`]).
    #[inline(always)]
    pub(super) fn contact<R: Real<Scalar = S>>(&self, index: usize, params: &Params<R>) -> ContactParams<R> {
        let [a, b] = self.members_of(index).expect("a pair of the dynamic pairs").map(|m| m.model_geom);
        let (order, condim) = self.filter.precedence([a, b]);
        let rigid = self.filter.is_rigid([a, b]);
        let (a, b) = (params.geom_contact(a), params.geom_contact(b));
        let either = |of: fn(&ContactParams<R>) -> R| match order {
            Ordering::Greater => of(&a),
            Ordering::Less => of(&b),
            Ordering::Equal => of(&a).max(of(&b)),
        };
        let coefficient = |least_condim: u8, x: R| if condim >= least_condim { x } else { R::zero() };
        ContactParams {
            mu: coefficient(3, either(|m| m.mu)),
            torsion: coefficient(4, either(|m| m.torsion)),
            rolling: coefficient(6, either(|m| m.rolling)),
            restitution: if rigid { a.restitution.max(b.restitution) } else { R::zero() },
        }
    }

    /// Number of contacts of dynamic pairs, per environment, for which memory is reserved. Only a limited number of geoms of similar size
    /// fits around each geom.
    pub fn contact_points(&self) -> usize {
        self.members.len() * NEIGHBOUR_POINTS
    }
}

/// Mark in [`PairTable::row_of`] of a member without a row.
const NO_ROW: u32 = u32::MAX;
/// Largest number of members all of which have rows in the table of dynamic pairs. With more members only moving ones have rows, because
/// the number of a pair has 32 bits.
const MAX_SQUARE: usize = 1 << 16;
/// Largest number of entries in the table of dynamic pairs.
const MAX_ENTRIES: usize = 1 << 31;
/// Number of contact points per geom for which memory is reserved in scenes with many similar geoms. Twelve neighbours fit around a ball
/// (the kissing number), with eight points each. A contact belongs to two geoms, so the number is half of the product.
const NEIGHBOUR_POINTS: usize = 48;
/// Largest number of pairs of bounded convex geoms, without those of [`LARGE`] geoms, for which the compiled model lists all pairs. With
/// more pairs, those of a moving and a static geom become dynamic pairs. If the pairs of two moving geoms alone are more than this number,
/// they become dynamic pairs too.
const LISTED_PAIRS: usize = 3000;
/// Ratio of a geom's bounding radius to the median radius of bounded convex geoms above which the geom counts as large. Pairs with a large
/// geom are listed. In the broad phase of dynamic pairs, a cell as wide as a large geom would contain very many other geoms.
const LARGE: f64 = 8.0;

/// Compiled collision geometry: geoms, listed pairs and dynamic pairs.
pub(crate) type Collision<S> = (Vec<CompiledGeom<S>>, Vec<CompiledPair<S>>, Option<DynamicPairs<S>>);

/// Compiles the collision geometry of a model.
pub(crate) fn compile<S: Scalar>(model: &Model, merged: &Merged) -> Collision<S> {
    let filter = Filter::new(model);
    let moves = |g: usize| merged.frame[model.geoms[g].body] != 0;
    let has_dynamic_pairs = geoms_with_dynamic_pairs(model, moves);
    let moving: Vec<usize> = (0..model.geoms.len()).filter(|&g| has_dynamic_pairs[g] && moves(g)).collect();
    let listed_moving = if number_of_pairs(moving.len()) <= LISTED_PAIRS { &moving[..] } else { &[] };
    let mut slot = vec![None; model.geoms.len()];
    let mut geoms: Vec<CompiledGeom<S>> = Vec::new();
    let mut place = |g: usize, geoms: &mut Vec<CompiledGeom<S>>| {
        *slot[g].get_or_insert_with(|| {
            geoms.push(geom(model, merged, g));
            geoms.len() - 1
        })
    };
    let mut pairs = Vec::new();
    for pair in listed_pairs(&filter, &has_dynamic_pairs, listed_moving) {
        let shapes = pair.geoms.map(|g| &model.geoms[g].shape);
        let Some(kernel) = Kernel::of(shapes[0], shapes[1]) else { continue };
        let places = pair.geoms.map(|g| place(g, &mut geoms));
        let collides = matches!(kernel, Kernel::Convex | Kernel::Surface);
        if collides || !shapes.iter().any(|shape| matches!(shape, Shape::Plane)) {
            places.into_iter().zip(shapes).for_each(|(g, shape)| geoms[g].set_solid(model, shape, collides));
        }
        pairs.push(compile_pair(&pair, kernel, places));
    }
    let mut members = Vec::new();
    for g in (0..model.geoms.len()).filter(|&g| has_dynamic_pairs[g]) {
        members.push(Member { geom: place(g, &mut geoms), model_geom: g, margin: model.geoms[g].margin });
    }
    // The collision function of two members depends on the kinds of their shapes alone.
    let mut of_each_shape: Vec<&Member> = Vec::new();
    let kind = |m: &Member| std::mem::discriminant(&model.geoms[m.model_geom].shape);
    for m in &members {
        if of_each_shape.iter().all(|other| kind(other) != kind(m)) {
            of_each_shape.push(m);
        }
    }
    for m in &members {
        let meets_convex = |other: &&Member| {
            let [a, b] = filter.ordered([m.model_geom, other.model_geom]).map(|g| &model.geoms[g].shape);
            matches!(Kernel::of(a, b), Some(Kernel::Convex | Kernel::Surface))
        };
        geoms[m.geom].set_solid(model, &model.geoms[m.model_geom].shape, of_each_shape.iter().any(meets_convex));
    }
    let dynamic_pairs = (!members.is_empty()).then(|| DynamicPairs {
        widest: members.iter().map(|m| bounding_radius(model, &model.geoms[m.model_geom].shape) + m.margin).fold(0.0, f64::max),
        moving: (0..).zip(&members).filter(|(_, m)| listed_moving.is_empty() && geoms[m.geom].frame != 0).map(|(i, _)| i).collect(),
        has_rolling_friction: members.iter().any(|m| model.geoms[m.model_geom].condim > 3),
        table: PairTable::new(pairs.len(), members.iter().map(|m| geoms[m.geom].frame != 0).collect()),
        members,
        filter,
        shapes: model.geoms.iter().map(|g| g.shape.clone()).collect(),
        scalar: PhantomData,
    });
    (geoms, pairs, dynamic_pairs)
}

/// Number in [`pair_groups`](crate::compile::ModelStructure::pair_groups) of a pair without a pair group.
pub const NO_PAIR_GROUP: u32 = u32::MAX;

/// Number of the pair group of each pair in `pairs`; [`NO_PAIR_GROUP`] for a pair without a group. A pair group has all listed pairs that
/// join the same two frames in the same order, and at least two pairs.
///
/// A pair group has two or more listed pairs whose first geoms have the same frame, and whose second geoms have the same frame. Pairs with
/// torsional or rolling friction or with contact springs have no group.
pub(super) fn pair_groups<S>(geoms: &[CompiledGeom<S>], pairs: &[CompiledPair<S>]) -> Vec<u32> {
    let mut of_frames: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for (i, pair) in pairs.iter().enumerate().filter(|(_, pair)| pair.condim <= 3 && pair.spring.is_none()) {
        of_frames.entry(pair.geoms.map(|g| geoms[g].frame)).or_default().push(i);
    }
    let mut pair_groups = vec![];
    for (pairs_of_group, number) in of_frames.values().filter(|pairs| pairs.len() > 1).zip(0..) {
        pair_groups.resize(pairs.len(), NO_PAIR_GROUP);
        pairs_of_group.iter().for_each(|&i| pair_groups[i] = number);
    }
    pair_groups
}

/// For each geom, whether it is a member of the dynamic pairs, which the broad phase finds in every step. There are no members if the
/// bounded convex geoms, without [`LARGE`] ones, form at most [`LISTED_PAIRS`] pairs, or too many for indices of 32 bits. `moves` is
/// whether a geom is not fixed to the world.
fn geoms_with_dynamic_pairs(model: &Model, moves: impl Fn(usize) -> bool) -> Vec<bool> {
    let can = |g: &Geom| (g.contype | g.conaffinity) != 0 && !g.shape.is_surface() && !matches!(g.shape, Shape::Plane);
    let size = |g: &Geom| bounding_radius(model, &g.shape);
    let mut sizes: Vec<f64> = model.geoms.iter().filter(|g| can(g)).map(size).collect();
    sizes.sort_by(f64::total_cmp);
    let median = sizes.get(sizes.len() / 2).copied().unwrap_or(0.0);
    let has_dynamic_pairs: Vec<bool> = model.geoms.iter().map(|g| can(g) && size(g) <= LARGE * median).collect();
    let n = has_dynamic_pairs.iter().filter(|&&x| x).count();
    let rows = if n < MAX_SQUARE { n } else { (0..model.geoms.len()).filter(|&g| has_dynamic_pairs[g] && moves(g)).count() };
    if number_of_pairs(n) > LISTED_PAIRS && (n < MAX_SQUARE || rows * n < MAX_ENTRIES) {
        has_dynamic_pairs
    } else {
        vec![false; model.geoms.len()]
    }
}

/// Number of pairs among `n` geoms.
fn number_of_pairs(n: usize) -> usize {
    n * n.saturating_sub(1) / 2
}

/// Makes the listed pairs of the model: all pairs that can collide and are not dynamic pairs. Pairs with rolling friction come first, then
/// those with torsional friction; otherwise the order is that of the geoms. Contacts are stored in the order of the pairs. The contacts in
/// a slot therefore mostly have the same number of rows in all lanes, and are one contact of the problem.
///
/// `has_dynamic_pairs` marks the members of the dynamic pairs. Two members are nevertheless a listed pair if both are in `listed_moving`,
/// or if they are an explicit pair.
fn listed_pairs(filter: &Filter, has_dynamic_pairs: &[bool], listed_moving: &[usize]) -> Vec<Pair> {
    let one_outside = filter.colliding(|g| !has_dynamic_pairs[g]).into_iter();
    let both_move = (1..listed_moving.len()).flat_map(|k| listed_moving[..k].iter().map(move |&a| [a, listed_moving[k]]));
    let is_listed = |g| listed_moving.binary_search(&g).is_ok();
    let explicit = filter.explicit().filter(|&[a, b]| has_dynamic_pairs[a] && has_dynamic_pairs[b] && !(is_listed(a) && is_listed(b)));
    let mut pairs: Vec<Pair> = one_outside.chain(both_move).chain(explicit).filter_map(|g| filter.pair(filter.ordered(g))).collect();
    pairs.sort_by_key(|p| (std::cmp::Reverse(p.condim.max(3)), p.geoms));
    pairs
}

/// Bounding radius and inscribed radius of a geom, m. The bounding ball about the geom's origin contains the geom, and the geom contains a
/// ball of the inscribed radius. The inscribed radius of a surface is 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Radii {
    pub(super) bounding_radius: f64,
    pub(super) inscribed_radius: f64,
}

/// Bounding radius and inscribed radius of the geom with index `geom` in the model.
pub(super) fn radii_of(model: &Model, geom: usize) -> Radii {
    let shape = &model.geoms[geom].shape;
    Radii { bounding_radius: bounding_radius(model, shape), inscribed_radius: inscribed_radius(model, shape) }
}

/// Compiled form of a pair, with the indices `geoms` of its geoms in the compiled model.
fn compile_pair<S: Scalar>(pair: &Pair, kernel: Kernel, geoms: [usize; 2]) -> CompiledPair<S> {
    let ContactSpring { stiffness, damping } = pair.spring;
    let spring = (!pair.spring.is_rigid()).then(|| Spring::new(stiffness, damping, 0.0));
    CompiledPair { geoms, kernel, condim: pair.condim, margin: S::from_f64(pair.margin), spring }
}

/// Compiled form of the geom with index `index` in the model, without a solid.
fn geom<S: Scalar>(model: &Model, merged: &Merged, index: usize) -> CompiledGeom<S> {
    let g = &model.geoms[index];
    let Pose { frame, quat, .. } = merged.pose(model, Object::Geom(index));
    CompiledGeom {
        index,
        frame,
        is_plane: matches!(g.shape, Shape::Plane),
        is_round: matches!(g.shape, Shape::Sphere { .. } | Shape::Capsule { .. }),
        symmetry: match g.shape {
            Shape::Sphere { .. } => Symmetry::Ball,
            Shape::Capsule { .. } | Shape::Cylinder { .. } => Symmetry::Axis,
            Shape::Ellipsoid { .. } => Symmetry::Ellipsoid,
            Shape::Plane | Shape::Box { .. } | Shape::Mesh { .. } | Shape::HeightField { .. } => Symmetry::None,
        },
        mat: matrix(&quat),
        full_orientation: !matches!(g.shape, Shape::Plane | Shape::Sphere { .. } | Shape::Capsule { .. }),
        solid: None,
        fixed_radii: matches!(g.shape, Shape::Mesh { .. } | Shape::HeightField { .. }).then(|| radii_of(model, index)),
    }
}

/// Size of a shape, m: radius, half length (capsule, cylinder), half sizes (box) or half axes (ellipsoid). Zeros for other shapes.
pub(super) fn size(shape: &Shape) -> [f64; 3] {
    match *shape {
        Shape::Sphere { radius } => [radius, 0.0, 0.0],
        Shape::Capsule { radius, half_length } | Shape::Cylinder { radius, half_length } => [radius, half_length, 0.0],
        Shape::Box { half } => half,
        Shape::Ellipsoid { radii } => radii,
        Shape::Plane | Shape::HeightField { .. } | Shape::Mesh { .. } => [0.0; 3],
    }
}

/// Inscribed radius of a shape, m: radius of the largest ball about the shape's centre that is inside the shape. Infinite for a plane; 0
/// for a height field and for a mesh that collides as its triangles.
fn inscribed_radius(model: &Model, shape: &Shape) -> f64 {
    let least = |sizes: &[f64]| sizes.iter().copied().fold(f64::INFINITY, f64::min);
    match *shape {
        Shape::Plane => f64::INFINITY,
        _ if shape.is_surface() => 0.0,
        Shape::Sphere { radius } | Shape::Capsule { radius, .. } => radius,
        Shape::Mesh { .. } => model.hull_of(shape).map_or(0.0, |hull| hull.inscribed_radius()),
        Shape::HeightField { .. } => 0.0,
        Shape::Cylinder { radius, half_length } => radius.min(half_length),
        Shape::Ellipsoid { radii } => least(&radii),
        Shape::Box { half } => least(&half),
    }
}

/// Solid (collision shape) of a shape.
fn solid(model: &Model, shape: &Shape) -> Solid {
    Solid::Convex(match *shape {
        Shape::Plane => return Solid::HalfSpace,
        Shape::Sphere { radius } => ConvexShape::Sphere { radius },
        Shape::Capsule { radius, half_length } => ConvexShape::Capsule { radius, half_length },
        Shape::Cylinder { radius, half_length } => ConvexShape::Cylinder { radius, half_length },
        Shape::Ellipsoid { radii } => ConvexShape::Ellipsoid { radii },
        Shape::Box { half } => ConvexShape::Box { half },
        Shape::Mesh { concave, .. } => {
            if concave {
                let mesh = model.mesh_of(shape).expect(CHECKED);
                return Solid::Surface(Arc::new(Surface::Mesh(MeshSurface::new(&mesh.vertices, &mesh.faces))));
            }
            ConvexShape::Hull(model.hull_of(shape).expect(CHECKED).clone())
        }
        Shape::HeightField { .. } => {
            let HeightField { shape, half, elevation, base, .. } = model.height_field_of(shape).expect(CHECKED).clone();
            return Solid::Surface(Arc::new(Surface::Grid(Grid::new(shape, half, elevation, base))));
        }
    })
}

/// Panic message for a missing mesh or height field, which would be an error of this program.
const CHECKED: &str = "a finished model has the form of every geom that can touch others";

/// Bounding radius of a shape, m: radius of the ball about the geom's origin that contains the geom. Infinite for a plane.
fn bounding_radius(model: &Model, shape: &Shape) -> f64 {
    match *shape {
        Shape::Plane => f64::INFINITY,
        // A mesh that cannot collide has no vertices here.
        Shape::Mesh { .. } => model.mesh_of(shape).map_or(f64::INFINITY, Mesh::radius),
        Shape::HeightField { .. } => {
            let field = model.height_field_of(shape).expect(CHECKED);
            let depth = field.elevation.iter().fold(field.base, |most, z| most.max(z.abs()));
            field.half[0].hypot(field.half[1]).hypot(depth)
        }
        Shape::Sphere { radius } => radius,
        Shape::Capsule { radius, half_length } => radius + half_length,
        Shape::Cylinder { radius, half_length } => radius.hypot(half_length),
        Shape::Ellipsoid { radii } => radii.into_iter().fold(0.0, f64::max),
        Shape::Box { half } => vector(half).norm(),
    }
}
