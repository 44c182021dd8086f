//! Report of overlapping geoms and violated joint limits at a model's reference pose.
//!
//! Bodies of models for soft contact often overlap at the reference pose. Hard contact pushes them apart, so that the robot moves without
//! control, or jams. The report names the geoms and a remedy.

use std::collections::BTreeMap;

use stepper_real::{Mask, Real};

use crate::analysis::quantities::kinematics_at;
use crate::collision::contact_set::Contacts;
use crate::collision::detection::CollisionWorkspace;
use crate::compile::CompiledModel;
use crate::model::{Description, JointKind, Model, Overlap, Shape, WideHull, weld_groups};
use crate::probe::NoProbe;
use crate::stages::s03_detect::detect;

/// Smallest violation of a joint limit that the report lists, m or rad. Evidence: model files give lengths with about four decimal digits.
const MIN_REPORTED_VIOLATION: f64 = 1e-4;

/// Overlap above which the report lists a pair of geoms, and above which [`exclude`] disables the collision of their bodies, m. By default,
/// position correction leaves an overlap of this size, see [`Options::slop`](crate::Options).
const MIN_REPORTED_OVERLAP: f64 = 1e-5;

/// Contact capacity of the first search for overlaps. The search doubles it until all contacts fit.
const FIRST_CAPACITY: usize = 1024;

/// Largest number of lines of each kind in the report.
const SHOWN: usize = 12;

/// Joint outside its range at the reference pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutOfRange {
    /// Index of the joint in the model.
    pub joint: usize,
    /// Distance beyond the range, rad or m.
    pub by: f64,
}

/// Pairs of geoms that overlap by more than 0.01 mm at the reference pose, the deepest first. Pairs with the ground are included.
pub fn overlaps(model: &Model) -> Vec<Overlap> {
    let compiled = CompiledModel::<f64>::new(model);
    let kinematics = kinematics_at(&compiled, &model.qpos0, compiled.mocap.iter().map(|m| (m.pos, m.quat)));
    let mut collision = CollisionWorkspace::new(&compiled);
    collision.narrow_phase.begin_step();
    let rest = vec![0.0; compiled.nv];
    let alive = <f64 as Real>::Mask::splat(true);
    let mut capacity = compiled.contact_points.min(FIRST_CAPACITY);
    let contacts = loop {
        let mut contacts = Contacts::new(capacity);
        detect(&compiled, &kinematics, [&rest, &rest], [model.timestep, 0.0], alive, &mut collision, &mut contacts, NoProbe);
        if contacts.full == 0 || capacity == compiled.contact_points {
            break contacts;
        }
        capacity = (2 * capacity).min(compiled.contact_points);
    };
    let mut depths: BTreeMap<[usize; 2], f64> = BTreeMap::new();
    for k in 0..contacts.count[0] {
        let depth = -contacts.data[k].point.distance;
        let geoms =
            compiled.pair_geoms(contacts.ids[k][0].pair()).expect("a pair index of this compiled model").map(|g| compiled.geoms[g].index);
        let deepest = depths.entry(geoms).or_insert(depth);
        *deepest = deepest.max(depth);
    }
    depths.retain(|_, depth| *depth > MIN_REPORTED_OVERLAP);
    let mut found: Vec<Overlap> = depths.into_iter().map(|(geoms, depth)| Overlap { geoms, depth }).collect();
    found.sort_by(|a, b| b.depth.total_cmp(&a.depth).then(a.geoms.cmp(&b.geoms)));
    found
}

/// Copy of a model in which bodies that overlap at the reference pose (`qpos0`) do not collide. Overlaps at keyframes have no effect.
///
/// [`Description::excluded_overlaps`] lists the overlaps. As with SRDF and `<exclude>`, no geoms of the two bodies collide, because their
/// other geoms would jam as soon as a joint moves. World geoms are excluded one by one, because the world is not a link.
///
/// Overlaps with the ground are not excluded, because their remedy is another pose. These are overlaps of planes and height fields with
/// anything, and of fixed geoms with a body on a free joint.
pub fn exclude(model: &Model) -> Model {
    let mut model = model.clone();
    loop {
        let ground = Ground::of(&model);
        let found: Vec<Overlap> = overlaps(&model).into_iter().filter(|o| !ground.is_in(o, &model)).collect();
        if found.is_empty() {
            return model;
        }
        // Each round finds a limited number of contacts, so that another round may find more.
        model.exclude_overlaps(found);
    }
}

/// Two flags for every body, to test whether an overlap is with the ground.
struct Ground {
    /// Whether the body is fixed to the world.
    fixed: Vec<bool>,
    /// Whether a free joint moves the body.
    free: Vec<bool>,
}

impl Ground {
    fn of(model: &Description) -> Self {
        let (group, moves) = weld_groups(model);
        let mut free = vec![false; model.bodies.len()];
        model.joints.iter().filter(|j| j.kind == JointKind::Free).for_each(|j| free[j.body] = true);
        for (i, body) in model.bodies.iter().enumerate().skip(1) {
            free[i] |= free[body.parent];
        }
        Self { fixed: group.iter().map(|&g| !moves[g]).collect(), free }
    }

    /// Whether an overlap is with the ground. Then [`exclude`] does not disable the collision.
    fn is_in(&self, overlap: &Overlap, model: &Description) -> bool {
        let geoms = overlap.geoms.map(|g| &model.geoms[g]);
        let endless = geoms.iter().any(|g| matches!(g.shape, Shape::Plane | Shape::HeightField { .. }));
        let [a, b] = geoms.map(|g| g.body);
        endless || (self.fixed[a] && self.free[b]) || (self.fixed[b] && self.free[a])
    }
}

/// Hinges and slides that are outside their range by more than 1e-4 rad or m at the reference pose, the largest violation first.
pub fn out_of_range(model: &Model) -> Vec<OutOfRange> {
    let addresses = model.joint_addresses();
    let mut found: Vec<OutOfRange> = (model.joints.iter().zip(&addresses).enumerate())
        .filter(|(_, (joint, _))| matches!(joint.kind, JointKind::Hinge | JointKind::Slide))
        .filter_map(|(j, (joint, &(q, _)))| {
            let [low, high] = joint.range?;
            let by = (low - model.qpos0[q]).max(model.qpos0[q] - high);
            (by > MIN_REPORTED_VIOLATION).then_some(OutOfRange { joint: j, by })
        })
        .collect();
    found.sort_by(|a, b| b.by.total_cmp(&a.by));
    found
}

/// Text of [`Model::explain`], with excluded overlaps, large convex hulls, and overlaps and violated limits at the reference pose.
pub fn explain(model: &Model) -> String {
    let excluded = model.excluded_overlaps.iter().map(|o| described(o, model)).collect();
    let hulls = model.wide_hulls().iter().map(|h| hull_line(h, model)).collect();
    let found = overlaps(model);
    let overlapping = shortened(found.iter().map(|o| described(o, model)).collect(), "pairs overlap");
    let limits = out_of_range(model);
    let joints = limits.iter().map(|l| format!("{} is outside its range by {:.3} (rad or m)", model.joint_label(l.joint), l.by));
    let outside = shortened(joints.collect(), "joints are outside their range");
    let violated = [with_remedy(overlapping, OVERLAP_REMEDY), with_remedy(outside, RANGE_REMEDY)].concat();
    [
        model.explain(),
        section("Excluded from contact, because they overlap at the reference pose", &shortened(excluded, "pairs are excluded")),
        section("Convex hulls larger than their mesh", &with_remedy(shortened(hulls, "hulls are larger"), HULL_REMEDY)),
        section("Overlaps and violated limits at the reference pose", &violated),
    ]
    .join("\n\n")
}

/// Remedy that the report gives for overlaps at the reference pose.
const OVERLAP_REMEDY: &str = "From the first step on, position correction pushes these geoms apart at up to max_correction_speed. Where \
     that is impossible, the status has INFEASIBLE. Remedy: disable contact between these bodies, except with the ground, by \
     analysis::overlaps::exclude(&model); or choose a pose without overlap (qpos0), make the geoms smaller, or exclude pairs yourself \
     (<exclude>, contype and conaffinity).";

/// Remedy that the report gives for joints outside their range.
const RANGE_REMEDY: &str = "From the first step on, position correction moves these joints into their range. Remedy: choose a \
     reference pose inside the range (qpos0), or widen the range (jnt_range).";

/// Description of an overlap, for the report.
pub fn described(overlap: &Overlap, model: &Description) -> String {
    let [a, b] = overlap.geoms.map(|g| model.geom_label_with_body(g));
    format!("{a} and {b} overlap by {:.2} mm", 1e3 * overlap.depth)
}

/// Description of a convex hull that is larger than its mesh, for the report.
pub fn hull_line(hull: &WideHull, model: &Description) -> String {
    let name = model.geom_label_with_body(hull.geom);
    let times = if hull.ratio < 100.0 { format!("{:.1}", hull.ratio) } else { "more than 100".into() };
    format!("{name} collides as the convex hull of its mesh, which has {times} times the volume of the mesh")
}

/// Remedy that the report gives for hulls that are larger than their mesh.
pub const HULL_REMEDY: &str = "Remedy: model.replace(\"geom_concave\", ..) lets a mesh collide as its triangles (docs/how-to/terrain.md); for \
     moving bodies, split the mesh into convex pieces.";

/// Appends the line `remedy` to the lines of the report, unless there are no lines.
fn with_remedy(mut lines: Vec<String>, remedy: &str) -> Vec<String> {
    if !lines.is_empty() {
        lines.push(remedy.into());
    }
    lines
}

/// First [`SHOWN`] of the lines. If there are more, a last line gives their number and the text `what`, for example "3 more pairs overlap".
fn shortened(mut lines: Vec<String>, what: &str) -> Vec<String> {
    let more = lines.len().saturating_sub(SHOWN);
    lines.truncate(SHOWN);
    lines.extend((more > 0).then(|| format!("{more} more {what}")));
    lines
}

fn section(title: &str, lines: &[String]) -> String {
    let text = if lines.is_empty() { "\n  nothing".into() } else { lines.iter().map(|l| format!("\n  {l}")).collect::<String>() };
    format!("{title}:{text}")
}
