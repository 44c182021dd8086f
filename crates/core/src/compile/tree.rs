//! Elements of a compiled model: links, joints, degrees of freedom, mechanisms, bodies and limits.

use std::ops::Range;

use stepper_real::Scalar;

use crate::model::JointKind;

/// Link: a moving body together with everything welded to it.
#[derive(Clone, Debug)]
pub struct Link<S> {
    /// Index of the link's parent frame.
    pub parent: usize,
    /// Index of the link's kinematic tree.
    pub tree: usize,
    /// Whether the link is the root of its kinematic tree.
    pub is_root: bool,
    /// Position in the parent frame at the reference configuration of the link's joints, m.
    pub pos: [S; 3],
    /// Rotation matrix to the parent frame at the reference configuration of the link's joints; `None` if it is the identity.
    pub mat: Option<[S; 9]>,
    /// Unit quaternion (w, x, y, z) of the rotation `mat`.
    pub quat: [S; 4],
    /// Range of the link's joints in the list of joints.
    pub joints: Range<usize>,
    /// Range of the link's degrees of freedom.
    pub dofs: Range<usize>,
}

/// Joint of a link.
#[derive(Clone, Debug)]
pub struct CompiledJoint<S> {
    /// Kind of the joint: hinge, slide, ball or free.
    pub kind: JointKind,
    /// Address of the joint's first coordinate in q.
    pub q: usize,
    /// Address of the joint's first degree of freedom in v.
    pub v: usize,
    /// Position of the joint's anchor in the link's frame, m.
    pub anchor: [S; 3],
    /// Whether the joint's anchor is at the origin of the link.
    pub centred: bool,
    /// Unit axis of the joint in the link's frame.
    pub axis: [S; 3],
    /// Index of the frame axis that is parallel to the joint's axis, and whether the two point in opposite directions. `None` if no frame
    /// axis is parallel to it.
    pub principal: Option<(usize, bool)>,
    /// Position coordinate at which the joint does not displace its link, m or rad.
    pub reference: S,
    /// Whether the joint has a spring.
    pub sprung: bool,
    /// Rest position of the spring: one coordinate (hinge, slide), a quaternion (ball), or position and quaternion (free).
    pub rest: [S; 7],
}

/// Degree of freedom of a joint.
#[derive(Clone, Debug)]
pub struct Dof {
    /// Index of the link that the degree of freedom moves.
    pub link: usize,
    /// Index of the kinematic tree of the degree of freedom.
    pub tree: usize,
    /// Start of the chain of the degree of freedom (itself and its ancestors) in the list of chains. The row of the degree of freedom in
    /// the mass matrix has the same start in the list of entries.
    pub chain: usize,
    /// Length of the chain of the degree of freedom, which contains it and its ancestors.
    pub depth: usize,
    /// Whether the dof's body is simple (`body_simple`): MuJoCo stores a diagonal mass matrix for such a body.
    pub is_simple: bool,
    /// Range of the descendants of the degree of freedom in the list of descendants.
    pub descendants: Range<usize>,
}

/// Descendant of a degree of freedom, in the list of descendants.
#[derive(Clone, Copy, Debug)]
pub struct Descendant {
    /// Index of the descendant, a degree of freedom.
    pub dof: u32,
    /// Index of the mass matrix entry of the descendant (row) and the degree of freedom (column). The next entries of the row belong to the
    /// ancestors of the degree of freedom.
    pub entry: u32,
}

/// Single body: a link on a free or ball joint that is alone in its kinematic tree. Its gyroscopic torque is integrated separately.
#[derive(Clone, Debug)]
pub struct CompiledSingleBody<S> {
    /// Index of the link.
    pub link: usize,
    /// Index of the joint's first degree of freedom.
    pub dof: usize,
    /// Kind of the joint: free or ball.
    pub kind: JointKind,
    /// Position of the joint in the link's frame, m.
    pub anchor: [S; 3],
}

/// Mocap body. The user sets its pose.
#[derive(Clone, Debug)]
pub struct CompiledMocap<S> {
    /// Index of the frame of the mocap body in the compiled model.
    pub frame: usize,
    /// Position of the mocap body at reset in world axes, m.
    pub pos: [S; 3],
    /// Orientation of the mocap body at reset, a unit quaternion (w, x, y, z).
    pub quat: [S; 4],
}

/// Body of the model: frame to which it is fixed, and its pose in that frame.
#[derive(Clone, Debug)]
pub struct CompiledBody<S> {
    /// Index of the parent body; the world's is 0.
    pub parent: usize,
    /// Index of the frame to which the body is fixed.
    pub frame: usize,
    /// Origin of the body in the frame to which it is fixed, m.
    pub pos: [S; 3],
    /// Rotation matrix from the body's axes to the frame's, row-major.
    pub mat: [S; 9],
    /// Unit quaternion (w, x, y, z) of the rotation `mat`.
    pub quat: [S; 4],
}

/// Limit of a hinge, slide or ball joint.
#[derive(Clone, Debug)]
pub struct CompiledLimit {
    /// Index of the joint in the model.
    pub joint: usize,
    /// Address of the joint's first coordinate in q.
    pub q: usize,
    /// Index of the joint's first degree of freedom.
    pub dof: usize,
    /// Index of the limit's impulse in the list of impulses of scalar constraint rows.
    pub impulse_index: usize,
}

/// Dry friction (`frictionloss`) of a degree of freedom.
#[derive(Clone, Debug)]
pub struct CompiledFriction {
    /// Index of the degree of freedom.
    pub dof: usize,
    /// Index of the joint in the model.
    pub joint: usize,
    /// Whether an actuator's friction losses are added to this dry friction.
    pub driven: bool,
}

/// Mechanisms of a model: sets of kinematic trees that equalities, tendons or actuators couple. Only contacts couple different mechanisms.
///
/// A mocap body belongs to the mechanism to which an equality attaches it. Without such an equality it is a mechanism without degrees of
/// freedom.
#[derive(Clone, Debug, Default)]
pub struct Mechanisms {
    /// Number of mechanisms.
    pub count: usize,
    /// Mechanism of each kinematic tree.
    pub of_tree: Vec<usize>,
    /// Mechanism of each mocap body.
    pub of_mocap: Vec<usize>,
    /// Runs of consecutive degrees of freedom of one mechanism, in order. A mechanism may have several.
    pub parts: Vec<MechanismPart>,
}

/// Consecutive degrees of freedom of one mechanism.
#[derive(Clone, Debug)]
pub struct MechanismPart {
    /// Index of the mechanism.
    pub mechanism: usize,
    /// Range of the degrees of freedom.
    pub dofs: Range<usize>,
    /// Ranges of those degrees of freedom that are rotations.
    pub rotations: Vec<Range<usize>>,
}

/// Converts numbers from f64 to the scalar type of the lanes.
pub(crate) fn scalars<S: Scalar, const N: usize>(x: [f64; N]) -> [S; N] {
    x.map(S::from_f64)
}
