//! Compiled paths of spatial tendons, and their lengths and moment arms in a group of lanes.

use stepper_real::{Real, Scalar};

use crate::compile::merging::{Merged, Pose, matrix};
use crate::compile::tree::scalars;
use crate::model::{Model, Object, PathSegment, Tendon, round};

/// Pose of a site or geom in a frame of the compiled model.
#[derive(Clone, Copy, Debug)]
pub struct Spot<S> {
    /// Index of the frame in the compiled model.
    pub frame: usize,
    /// Position in the frame, m.
    pub pos: [S; 3],
    /// Rotation matrix from the axes of the site or geom to the frame's, row-major.
    pub mat: [S; 9],
}

impl<S: Scalar> Spot<S> {
    pub(super) fn new(pose: &Pose) -> Self {
        Self { frame: pose.frame, pos: scalars(pose.pos.into()), mat: matrix(&pose.quat) }
    }
}

/// Path of a spatial tendon.
#[derive(Clone, Debug)]
pub struct CompiledPath<S> {
    /// Parts of the path between two sites each.
    pub segments: Vec<CompiledSegment<S>>,
    /// Degrees of freedom on which the length depends, ascending.
    pub dofs: Vec<u32>,
    /// Index of the path's first moment arm in [`PathLengths::arms`]. The arms have the order of [`Self::dofs`].
    pub arms: usize,
}

/// Point in a frame of the compiled model.
#[derive(Clone, Copy, Debug)]
pub struct PathPoint<S> {
    /// Index of the frame.
    pub frame: usize,
    /// Position in the frame, m.
    pub pos: [S; 3],
}

/// Part of a path between two sites.
#[derive(Clone, Debug)]
pub struct CompiledSegment<S> {
    /// The two sites.
    pub ends: [PathPoint<S>; 2],
    /// Sphere or cylinder around which the tendon wraps between the sites.
    pub obstacle: Option<CompiledObstacle<S>>,
    /// Factor of the length: one divided by the divisor of the pulley.
    pub weight: S,
    /// Degrees of freedom that move the first site, the second site, and the obstacle: index of the moment arm, and degree of freedom.
    /// Those that move all of them are left out.
    pub moved: [Vec<(usize, usize)>; 3],
}

/// Sphere or cylinder in a path.
#[derive(Clone, Copy, Debug)]
pub struct CompiledObstacle<S> {
    /// Pose of the geom.
    pub place: Spot<S>,
    /// Radius, m.
    pub radius: S,
    /// Whether the geom is a cylinder; otherwise it is a sphere.
    pub is_cylinder: bool,
    /// Site near which the tendon passes; `None` selects the shorter way.
    pub side: Option<PathPoint<S>>,
    /// Index of the obstacle in [`PathLengths::touches`].
    pub index: usize,
}

/// Lengths and moment arms of all paths at one configuration.
#[derive(Clone, Debug, Default)]
pub struct PathLengths<R> {
    /// Length of each path, m.
    pub lengths: Vec<R>,
    /// Moment arms of all paths, one path after the other: derivatives of the length with respect to the degrees of freedom, m or m/rad.
    pub arms: Vec<R>,
    /// For each obstacle of all paths, 1 if the tendon touches it, otherwise 0.
    pub touches: Vec<R>,
}

impl<R: Real> PathLengths<R> {
    /// Workspace for the paths of a compiled model.
    pub(crate) fn new<S>(paths: &[CompiledPath<S>]) -> Self {
        let zeros = |n: usize| vec![R::zero(); n];
        let arms = paths.iter().map(|path| path.dofs.len()).sum();
        Self { lengths: zeros(paths.len()), arms: zeros(arms), touches: zeros(obstacle_count(paths)) }
    }
}

/// Number of obstacles of all paths.
pub(crate) fn obstacle_count<S>(paths: &[CompiledPath<S>]) -> usize {
    paths.iter().flat_map(|path| &path.segments).filter(|segment| segment.obstacle.is_some()).count()
}

/// Length of a path as a term of a linear combination.
#[derive(Clone, Debug)]
pub struct PathTerm {
    /// Index of the path.
    pub path: usize,
    /// Degrees of freedom on which the length depends, ascending.
    pub dofs: Vec<u32>,
    /// Index of the first moment arm in [`PathLengths::arms`].
    pub arms: usize,
}

/// Index of the path of tendon `t` among the paths of the model; `None` for a fixed tendon.
pub(super) fn path_of(model: &Model, t: usize) -> Option<usize> {
    let has_path = |tendon: &&Tendon| !tendon.path.is_empty();
    has_path(&&model.tendons[t]).then(|| model.tendons[..t].iter().filter(has_path).count())
}

/// Compiles the paths of all spatial tendons.
pub(super) fn paths<S: Scalar>(model: &Model, merged: &Merged) -> Vec<CompiledPath<S>> {
    let (mut arms, mut obstacles) = (0, 0..);
    let spatial = model.tendons.iter().filter(|tendon| !tendon.path.is_empty());
    spatial
        .map(|tendon| {
            let segments = tendon.segments();
            let frames: Vec<Vec<usize>> = segments.iter().map(|segment| frames(model, merged, segment)).collect();
            // A degree of freedom that moves all frames of a segment does not change its length.
            let changes = |dof: usize, frames: &[usize]| frames.iter().any(|&f| merged.moves(dof, f) != merged.moves(dof, frames[0]));
            let dofs: Vec<u32> = (0..model.nv()).filter(|&dof| frames.iter().any(|f| changes(dof, f))).map(|dof| dof as u32).collect();
            let moved_by = |segment: usize, frame: usize| {
                let all = &frames[segment];
                let moves = |&(_, &dof): &(usize, &u32)| changes(dof as usize, all) && merged.moves(dof as usize, frame);
                dofs.iter().enumerate().filter(moves).map(|(k, &dof)| (arms + k, dof as usize)).collect::<Vec<_>>()
            };
            let compiled = segments.iter().enumerate().map(|(i, segment)| {
                let ends = segment.sites.map(|site| point(model, merged, site));
                let obstacle = segment.wrap.and_then(|(geom, side)| obstacle(model, merged, geom, side, &mut obstacles));
                let at = |k: usize| frames[i].get(k).map_or_else(Vec::new, |&frame| moved_by(i, frame));
                CompiledSegment { ends, obstacle, weight: S::from_f64(1.0 / segment.divisor), moved: [at(0), at(1), at(2)] }
            });
            let path = CompiledPath { segments: compiled.collect(), arms, dofs: dofs.clone() };
            arms += dofs.len();
            path
        })
        .collect()
}

/// Frames of the two sites of a segment, and of the geom around which it wraps.
fn frames(model: &Model, merged: &Merged, segment: &PathSegment) -> Vec<usize> {
    let sites = segment.sites.iter().map(|&site| merged.frame[model.sites[site].body]);
    sites.chain(segment.wrap.map(|(geom, _)| merged.frame[model.geoms[geom].body])).collect()
}

fn point<S: Scalar>(model: &Model, merged: &Merged, site: usize) -> PathPoint<S> {
    let Pose { frame, pos, .. } = merged.pose(model, Object::Site(site));
    PathPoint { frame, pos: scalars(pos.into()) }
}

fn obstacle<S: Scalar>(
    model: &Model,
    merged: &Merged,
    geom: usize,
    side: Option<usize>,
    indices: &mut impl Iterator<Item = usize>,
) -> Option<CompiledObstacle<S>> {
    let (radius, is_cylinder) = round(&model.geoms[geom].shape)?;
    let place = Spot::new(&merged.pose(model, Object::Geom(geom)));
    let side = side.map(|site| point(model, merged, site));
    Some(CompiledObstacle { place, radius: S::from_f64(radius), is_cylinder, side, index: indices.next()? })
}
