//! Parts of a compiled model: links, joints, degrees of freedom, and their attributes.

use stepper_real::Scalar;

use crate::model::JointKind;

/// Moving body with everything welded to it.
#[derive(Clone, Debug)]
pub struct Link<S> {
    /// Parent frame of the link.
    pub parent: usize,
    /// Kinematic tree of the link.
    pub tree: usize,
    /// Whether the link is the root of its tree.
    pub is_root: bool,
    /// Position in the parent frame before the link's joints, m.
    pub pos: [S; 3],
    /// Orientation in the parent frame before the link's joints; `None` if it is aligned.
    pub mat: Option<[S; 9]>,
    /// Orientation as a quaternion.
    pub quat: [S; 4],
    /// Joints of the link.
    pub joints: std::ops::Range<usize>,
    /// Degrees of freedom of the link.
    pub dofs: std::ops::Range<usize>,
}

/// Joint of a link.
#[derive(Clone, Debug)]
pub struct CompiledJoint<S> {
    /// Kind of the joint.
    pub kind: JointKind,
    /// Address in q.
    pub q: usize,
    /// Address in v.
    pub v: usize,
    /// Anchor in the link's frame, m.
    pub anchor: [S; 3],
    /// Whether the anchor is the link's origin.
    pub centred: bool,
    /// Axis in the link's frame.
    pub axis: [S; 3],
    /// Axis of the frame that the joint's axis coincides with, if any, and whether its sign is the same.
    pub principal: Option<(usize, bool)>,
    /// Position at which the joint has no effect on the pose.
    pub reference: S,
    /// Whether the joint has a spring.
    pub sprung: bool,
    /// Rest position of the spring: one coordinate, or a quaternion, or position and quaternion.
    pub rest: [S; 7],
}

/// Degree of freedom of a joint.
#[derive(Clone, Debug)]
pub struct Dof {
    /// Link that the degree of freedom moves.
    pub link: usize,
    /// Kinematic tree of the degree of freedom.
    pub tree: usize,
    /// Start of the dof's chain in the list of chains, and of its row among the entries of the mass matrix.
    pub chain: usize,
    /// Length of the chain.
    pub depth: usize,
    /// Whether the body is simple, so that MuJoCo's mass matrix is diagonal there.
    pub is_simple: bool,
    /// Range of its descendants in their list.
    pub descendants: std::ops::Range<usize>,
}

/// Descendant of a dof.
#[derive(Clone, Copy, Debug)]
pub struct Descendant {
    /// Index of the degree of freedom.
    pub dof: u32,
    /// Entry of the mass matrix with the ancestor, as an index in the chain. The ancestor's ancestors follow, as in its row.
    pub entry: u32,
}

/// Link alone on a free or ball joint.
#[derive(Clone, Debug)]
pub struct CompiledSpinner<S> {
    /// Index of the link.
    pub link: usize,
    /// First degree of freedom.
    pub dof: usize,
    /// Kind of the joint: free or ball.
    pub kind: JointKind,
    /// Position of the joint in the link's frame, m.
    pub anchor: [S; 3],
}

/// Mocap body, whose pose the user sets.
#[derive(Clone, Debug)]
pub struct CompiledMocap<S> {
    /// Frame of the body.
    pub frame: usize,
    /// Position at reset, m.
    pub pos: [S; 3],
    /// Orientation at reset.
    pub quat: [S; 4],
}

/// Place of a body of the model.
#[derive(Clone, Debug)]
pub struct CompiledBody<S> {
    /// Index of the parent; the world's is 0.
    pub parent: usize,
    /// Frame to which the body is fixed.
    pub frame: usize,
    /// Origin of the body in that frame, m.
    pub pos: [S; 3],
    /// Orientation of the body in that frame.
    pub mat: [S; 9],
    /// Orientation as a quaternion.
    pub quat: [S; 4],
}

/// Range of a hinge or slide.
#[derive(Clone, Debug)]
pub struct CompiledLimit {
    /// Address in q.
    pub q: usize,
    /// Degree of freedom.
    pub dof: usize,
}

/// Range of a ball joint.
#[derive(Clone, Debug)]
pub struct CompiledBallLimit {
    /// Address in q.
    pub q: usize,
    /// First degree of freedom.
    pub dof: usize,
    /// Index of the limit's impulse.
    pub owner: usize,
}

/// Dry friction of a degree of freedom.
#[derive(Clone, Debug)]
pub struct CompiledFriction {
    /// Degree of freedom.
    pub dof: usize,
    /// Joint in the model.
    pub joint: usize,
    /// Whether actuator dynamics add to the friction.
    pub driven: bool,
}

/// Converts numbers to the scalar type of the lanes.
pub(crate) fn scalars<S: Scalar, const N: usize>(x: [f64; N]) -> [S; N] {
    x.map(S::from_f64)
}
