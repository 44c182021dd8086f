//! Check that all moving bodies have inertia.
//!
//! In the reference configuration, degrees of freedom are eliminated from the leaves to the roots (the order of Featherstone's L^T D L,
//! "Rigid Body Dynamics Algorithms" 2008, section 6.5). The pivot of a degree of freedom is the inertia that its force accelerates while
//! all degrees of freedom farther from the root move freely. The mass matrix is singular if a pivot is zero.
//!
//! MuJoCo instead requires that every moving body has mass. Here a universal joint without mass between heavy bodies is valid, and two
//! hinges on one line with nothing between them are an error. Only the reference configuration is checked. If the mass matrix is singular
//! in another configuration, the step reports it.

use std::ops::{Index, IndexMut};

use nalgebra::{Matrix6, Quaternion, UnitQuaternion, Vector3, Vector6};

use crate::{Body, Description, JointKind, MassProperties, ModelError};

/// Ratio of a degree of freedom's pivot (see the top of this file) to its diagonal entry of the mass matrix, below which the pivot counts
/// as zero. The diagonal entry is the inertia of the whole subtree that the degree of freedom moves.
const NOTHING: f64 = 1e-13;

/// Ratio of kinetic energies below which a degree of freedom counts as not moving, in a motion that [`partners`] computes. The ratio is
/// that of the degree of freedom's energy to the energy of the degree of freedom without inertia.
const ROUNDING: f64 = 1e-9;

/// Degree of freedom: joint, motion, parent and number of ancestors. The motion is the spatial velocity per unit of joint velocity. The
/// spatial velocity is the angular velocity, then the linear velocity at the origin of the kinematic tree.
struct Dof {
    joint: usize,
    motion: Vector6<f64>,
    parent: Option<usize>,
    depth: usize,
}

/// Lower triangle of a mass matrix. It has entries only for a degree of freedom with itself and with its ancestors; the others are 0.
struct MassMatrix {
    /// Entries of each degree of freedom, from the root to itself.
    rows: Vec<Vec<f64>>,
    /// Number of ancestors of each degree of freedom.
    depths: Vec<usize>,
}

impl MassMatrix {
    fn diagonal(&self) -> Vec<f64> {
        (0..self.rows.len()).map(|i| self[(i, i)]).collect()
    }
}

impl Index<(usize, usize)> for MassMatrix {
    type Output = f64;

    fn index(&self, (i, j): (usize, usize)) -> &f64 {
        &self.rows[i][self.depths[j]]
    }
}

impl IndexMut<(usize, usize)> for MassMatrix {
    fn index_mut(&mut self, (i, j): (usize, usize)) -> &mut f64 {
        &mut self.rows[i][self.depths[j]]
    }
}

pub(crate) fn check(model: &Description) -> Result<(), ModelError> {
    let (poses, origins) = poses(model);
    let dofs = dofs(model, &poses, &origins);
    let inertias = composite(model, &poses, &origins);
    let mut matrix = mass_matrix(model, &dofs, &inertias);
    let whole = matrix.diagonal();
    let Some(dof) = first_without_inertia(&mut matrix, &dofs) else { return Ok(()) };
    let joint = dofs[dof].joint;
    let body = model.joints[joint].body;
    let name = model.joint_label(joint);
    let partners = partners(&matrix, &whole, &dofs, dof);
    let (what, remedy) = if partners.is_empty() {
        let Body { mass, inertia, .. } = &model.bodies[body];
        let what = format!(
            "joint {name:?} moves no inertia: the body has mass {mass} kg and principal moments {inertia:?} kg m^2, and its children and \
             fixed bodies have none"
        );
        (what, "give the body mass and inertia (a geom with density, or <inertial>), give the joint armature, or remove the joint")
    } else {
        let others: Vec<String> = partners.iter().map(|&j| format!("{:?}", model.joint_label(j))).collect();
        let what = format!(
            "joint {name:?} and {} can move without moving any inertia (their axes coincide or are linearly dependent), so that forces do not \
             determine their motion",
            others.join(", ")
        );
        (what, "remove one of these joints, give one of them armature, or give mass to a body between them")
    };
    Err(ModelError::invalid(format!("body {:?}", model.body_label(body)), what, remedy))
}

/// Degree of freedom `first` and its ancestors, towards the root.
fn chain(dofs: &[Dof], first: Option<usize>) -> impl Iterator<Item = usize> {
    std::iter::successors(first, |&dof| dofs[dof].parent)
}

/// Indices of the joints that can move together with the degree of freedom `dof` so that nothing with inertia moves.
///
/// The function computes the null vector of the mass matrix with the entry 1 for `dof`, and returns the joints of its other nonzero
/// entries. In `matrix`, the degrees of freedom after `dof` are already eliminated. `whole` is the diagonal of the mass matrix before the
/// elimination.
fn partners(matrix: &MassMatrix, whole: &[f64], dofs: &[Dof], dof: usize) -> Vec<usize> {
    let mut null = vec![0.0; dofs.len()];
    null[dof] = 1.0;
    for i in dof + 1..dofs.len() {
        for j in chain(dofs, dofs[i].parent) {
            null[i] -= matrix[(i, j)] / matrix[(i, i)] * null[j];
        }
    }
    // Motions are compared by energy, because the entries of different joints have different units.
    let energy = |i: usize| null[i] * null[i] * whole[i];
    let mut found: Vec<usize> = (dof + 1..dofs.len()).filter(|&i| energy(i) > ROUNDING * energy(dof)).map(|i| dofs[i].joint).collect();
    found.retain(|&j| j != dofs[dof].joint);
    found.dedup();
    found
}

type Pose = (Vector3<f64>, UnitQuaternion<f64>);

fn quaternion(q: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::new_unchecked(Quaternion::new(q[0], q[1], q[2], q[3]))
}

/// World pose of every body in the reference configuration, and world position of the origin of the kinematic tree that contains the body.
fn poses(model: &Description) -> (Vec<Pose>, Vec<Vector3<f64>>) {
    let (mut poses, mut origins): (Vec<Pose>, Vec<Vector3<f64>>) = (vec![], vec![]);
    for (i, body) in model.bodies.iter().enumerate() {
        let here = (Vector3::from(body.pos), quaternion(body.quat));
        let pose = if i == 0 {
            (Vector3::zeros(), UnitQuaternion::identity())
        } else {
            let (p, r) = poses[body.parent];
            (p + r * here.0, r * here.1)
        };
        origins.push(if body.parent == 0 { pose.0 } else { origins[body.parent] });
        poses.push(pose);
    }
    (poses, origins)
}

/// All degrees of freedom of the model, in the order of v.
fn dofs(model: &Description, poses: &[Pose], origins: &[Vector3<f64>]) -> Vec<Dof> {
    let mut dofs: Vec<Dof> = vec![];
    let mut last: Vec<Option<usize>> = vec![None; model.bodies.len()];
    let mut joints = model.joints.iter().enumerate().peekable();
    for b in 1..model.bodies.len() {
        last[b] = last[model.bodies[b].parent];
        while let Some((index, joint)) = joints.next_if(|(_, j)| j.body == b) {
            let (p, r) = poses[b];
            let anchor = p + r * Vector3::from(joint.pos) - origins[b];
            let turn = |axis: Vector3<f64>| spatial(axis, anchor.cross(&axis));
            let axes = [Vector3::x(), Vector3::y(), Vector3::z()];
            let motions = match joint.kind {
                JointKind::Hinge => vec![turn(r * Vector3::from(joint.axis))],
                JointKind::Slide => vec![spatial(Vector3::zeros(), r * Vector3::from(joint.axis))],
                JointKind::Ball => axes.map(turn).to_vec(),
                JointKind::Free => [axes.map(|a| spatial(Vector3::zeros(), a)), axes.map(turn)].concat(),
            };
            for motion in motions {
                let depth = last[b].map_or(0, |parent| dofs[parent].depth + 1);
                dofs.push(Dof { joint: index, motion, parent: last[b], depth });
                last[b] = Some(dofs.len() - 1);
            }
        }
    }
    dofs
}

fn spatial(angular: Vector3<f64>, linear: Vector3<f64>) -> Vector6<f64> {
    Vector6::new(angular.x, angular.y, angular.z, linear.x, linear.y, linear.z)
}

/// Spatial inertia of each body together with its descendants, about the origin of the kinematic tree that contains the body.
fn composite(model: &Description, poses: &[Pose], origins: &[Vector3<f64>]) -> Vec<Matrix6<f64>> {
    let mut inertias = vec![Matrix6::zeros(); model.bodies.len()];
    for (b, body) in model.bodies.iter().enumerate().skip(1).rev() {
        let own =
            MassProperties { mass: body.mass, com: Vector3::zeros(), inertia: nalgebra::Matrix3::from_diagonal(&body.inertia.into()) };
        let (p, r) = poses[b];
        let placed = own.placed(p + r * Vector3::from(body.ipos) - origins[b], r * quaternion(body.iquat));
        let cross = placed.com.cross_matrix() * body.mass;
        let mut about_origin = Matrix6::zeros();
        about_origin.fixed_view_mut::<3, 3>(0, 0).copy_from(&placed.inertia_about(Vector3::zeros()));
        about_origin.fixed_view_mut::<3, 3>(0, 3).copy_from(&cross);
        about_origin.fixed_view_mut::<3, 3>(3, 0).copy_from(&cross.transpose());
        about_origin.fixed_view_mut::<3, 3>(3, 3).fill_diagonal(body.mass);
        inertias[b] += about_origin;
        if body.parent != 0 {
            let whole = inertias[b];
            inertias[body.parent] += whole;
        }
    }
    inertias
}

/// Mass matrix of the model.
fn mass_matrix(model: &Description, dofs: &[Dof], inertias: &[Matrix6<f64>]) -> MassMatrix {
    let rows = dofs.iter().map(|dof| vec![0.0; dof.depth + 1]).collect();
    let mut matrix = MassMatrix { rows, depths: dofs.iter().map(|dof| dof.depth).collect() };
    for (i, dof) in dofs.iter().enumerate() {
        let force = inertias[model.joints[dof.joint].body] * dof.motion;
        for j in chain(dofs, Some(i)) {
            matrix[(i, j)] = force.dot(&dofs[j].motion);
        }
        matrix[(i, i)] += model.joints[dof.joint].armature;
    }
    matrix
}

/// Index of the first degree of freedom without inertia, when degrees of freedom are eliminated from the leaves; `None` if all have
/// inertia. The function overwrites the mass matrix `matrix`.
fn first_without_inertia(matrix: &mut MassMatrix, dofs: &[Dof]) -> Option<usize> {
    let whole = matrix.diagonal();
    for i in (0..dofs.len()).rev() {
        let pivot = matrix[(i, i)];
        if pivot <= NOTHING * whole[i] {
            return Some(i);
        }
        for row in chain(dofs, dofs[i].parent) {
            let factor = matrix[(i, row)] / pivot;
            for column in chain(dofs, Some(row)) {
                matrix[(row, column)] -= factor * matrix[(i, column)];
            }
        }
    }
    None
}
