//! What is in the way of what at a model's reference pose: overlaps, and joints outside their range.
//!
//! Models that were made for soft contact often begin with bodies inside one another. Hard contact takes them apart, so that the robot
//! moves from its reference pose by itself, or jams; whoever loads the model should know.

use stepper_real::{Mask, Real};

use crate::collision::contact_set::Contacts;
use crate::collision::detection::GeomPoses;
use crate::compile::{CompiledModel, LaneModel};
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;
use crate::model::{JointKind, Model};
use crate::probe::NoProbe;
use crate::stages::s03_detect::detect;

/// Overlap that is worth a line, m; of limits also rad. Files give lengths with as many digits.
const WORTH_A_LINE: f64 = 1e-4;

/// Overlaps shown.
const SHOWN: usize = 12;

/// Two geoms that overlap at the reference pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// Indices of the geoms in the model.
    pub geoms: [usize; 2],
    /// Depth of the deepest point beyond the pair's margin, m.
    pub depth: f64,
}

/// A joint outside its range at the reference pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OutOfRange {
    /// Index of the joint in the model.
    pub joint: usize,
    /// How far, rad or m.
    pub by: f64,
}

/// Pairs of geoms that overlap by more than 0.1 mm at the reference pose, the deepest first.
pub fn overlaps(model: &Model) -> Vec<Overlap> {
    let compiled: CompiledModel<f64> = CompiledModel::new(model);
    let lanes: LaneModel<f64> = LaneModel::new(&compiled);
    let (mut kinematics, mut poses) = (Kinematics::new(&compiled), GeomPoses::new(&lanes));
    for m in &compiled.mocap {
        kinematics.pos[m.frame] = m.pos;
        kinematics.mat[m.frame] = quat_to_mat(quat_normalize(m.quat));
    }
    kinematics.update(&lanes, &model.qpos0);
    poses.update_static_poses(&lanes);
    poses.begin();
    let mut contacts = Contacts::new(compiled.contact_points);
    let rest = vec![0.0; compiled.nv];
    let alive = <f64 as Real>::Mask::splat(true);
    detect(&lanes, &kinematics, [&rest, &rest], [model.timestep, 0.0], alive, &mut poses, &mut contacts, NoProbe);
    let mut found: Vec<Overlap> = Vec::new();
    for k in 0..contacts.count[0] {
        let depth = -contacts.data[k].point.distance;
        let geoms = compiled.pair_geoms(contacts.ids[k][0].pair()).expect("made from this compiled").map(|g| compiled.geoms[g].index);
        match found.iter_mut().find(|o| o.geoms == geoms) {
            Some(known) => known.depth = known.depth.max(depth),
            None => found.push(Overlap { geoms, depth }),
        }
    }
    found.retain(|o| o.depth > WORTH_A_LINE);
    found.sort_by(|a, b| b.depth.total_cmp(&a.depth).then(a.geoms.cmp(&b.geoms)));
    found
}

/// Hinges and slides that are outside their range by more than 1e-4 rad or m at the reference pose, the farthest first.
pub fn out_of_range(model: &Model) -> Vec<OutOfRange> {
    let addresses = model.joint_addresses();
    let mut found: Vec<OutOfRange> = (model.joints.iter().zip(&addresses).enumerate())
        .filter(|(_, (joint, _))| matches!(joint.kind, JointKind::Hinge | JointKind::Slide))
        .filter_map(|(j, (joint, &(q, _)))| {
            let [low, high] = joint.range?;
            let by = (low - model.qpos0[q]).max(model.qpos0[q] - high);
            (by > WORTH_A_LINE).then_some(OutOfRange { joint: j, by })
        })
        .collect();
    found.sort_by(|a, b| b.by.total_cmp(&a.by));
    found
}

/// [`Model::explain`] with what is in the way at the reference pose.
pub fn explain(model: &Model) -> String {
    let mut lines: Vec<String> = overlaps(model)
        .iter()
        .map(|o| {
            let [a, b] = o.geoms.map(|g| model.geom_label(g));
            format!("{a} and {b} overlap by {:.2} mm", 1e3 * o.depth)
        })
        .collect();
    let contacts = lines.len();
    lines.truncate(SHOWN);
    if contacts > SHOWN {
        lines.push(format!("{} more pairs overlap", contacts - SHOWN));
    }
    let limits = out_of_range(model);
    let joints = limits.iter().map(|l| format!("{} is outside its range by {:.3} (rad or m)", model.joint_label(l.joint), l.by));
    lines.extend(joints.take(SHOWN));
    if limits.len() > SHOWN {
        lines.push(format!("{} more joints are outside their range", limits.len() - SHOWN));
    }
    if contacts > 0 {
        lines.push(
            "Contact is hard: overlaps are taken apart from the first step on, by at most max_correction_speed, and what contradicts is left \
             (status INFEASIBLE). Remedy: give a pose without overlap (a keyframe, qpos0), make the geoms smaller, or exclude the pair \
             (<exclude>, contype and conaffinity)."
                .into(),
        );
    }
    if !limits.is_empty() {
        lines.push("Joints outside their range come back from the first step on. Remedy: a pose inside, or a wider range.".into());
    }
    let text = if lines.is_empty() { "\n  nothing".into() } else { lines.iter().map(|l| format!("\n  {l}")).collect::<String>() };
    format!("{}\n\nIn the way at the reference pose:{text}", model.explain())
}
