//! Merging of bodies that cannot move relative to their parent into links, and the tree of degrees of freedom.

use nalgebra::{Matrix3, Quaternion, UnitQuaternion, Vector3};
use stepper_real::Scalar;

use crate::compile::tree::{CompiledBody, CompiledJoint, CompiledMocap, Descendant, Dof, Link, scalars};
use crate::model::{Description, Joint, JointKind, Model, Object, simple_bodies, weld_groups};

/// Merged bodies and the tree of degrees of freedom. Bodies that cannot move relative to each other share one frame. For every body,
/// `frame` is the index of this frame, and `pos` and `quat` are the body's pose in it.
#[derive(Clone, Debug, Default)]
pub(crate) struct Merged {
    pub(crate) frame: Vec<usize>,
    pub(crate) pos: Vec<Vector3<f64>>,
    pub(crate) quat: Vec<UnitQuaternion<f64>>,
    /// For each link, which may consist of several merged bodies, index of the body that has the link's joints.
    pub(crate) leaders: Vec<usize>,
    /// Indices of the mocap bodies. The frames are, in this order, the world, the links and the mocap bodies.
    pub(crate) mocap: Vec<usize>,
    /// For each link, index of its kinematic tree.
    pub(crate) link_tree: Vec<usize>,
    /// Number of kinematic trees.
    pub(crate) ntree: usize,
    /// Addresses of each joint in q and v.
    pub(crate) addresses: Vec<(usize, usize)>,
    /// For each degree of freedom, index of the link that it moves relative to the parent.
    dof_link: Vec<usize>,
    /// For each degree of freedom (dof), start and length of its part of the list `chain`. The part contains the dof itself and its
    /// ancestors.
    dof_chain: Vec<(usize, usize)>,
    /// Chains of all degrees of freedom, one after the other, see `dof_chain`. Entry k of this list belongs to entry k of the mass matrix.
    pub(crate) chain: Vec<u32>,
    /// For each frame, the last of the degrees of freedom that move it, which is the nearest to the frame in the kinematic tree. `None` if
    /// the frame cannot move.
    pub(crate) last_dof: Vec<Option<usize>>,
}

/// Pose of an object (body, geom or site) in the frame to which it is fixed.
pub(crate) struct Pose {
    /// Index of the frame.
    pub(crate) frame: usize,
    /// Position in the frame, m.
    pub(crate) pos: Vector3<f64>,
    /// Rotation from the object's axes to the frame's.
    pub(crate) quat: UnitQuaternion<f64>,
}

pub(crate) fn vector(x: [f64; 3]) -> Vector3<f64> {
    Vector3::from(x)
}

pub(crate) fn quaternion(q: [f64; 4]) -> UnitQuaternion<f64> {
    UnitQuaternion::from_quaternion(Quaternion::new(q[0], q[1], q[2], q[3]))
}

/// Rotation matrix of a unit quaternion, row-major.
pub(crate) fn matrix<S: Scalar>(q: &UnitQuaternion<f64>) -> [S; 9] {
    let m = q.to_rotation_matrix();
    std::array::from_fn(|k| S::from_f64(m[(k / 3, k % 3)]))
}

/// Components (w, x, y, z) of a unit quaternion.
pub(crate) fn wxyz<S: Scalar>(q: &UnitQuaternion<f64>) -> [S; 4] {
    scalars([q.w, q.i, q.j, q.k])
}

impl Merged {
    pub(crate) fn new(model: &Model) -> Self {
        let n = model.bodies.len();
        let (_, has_joints) = weld_groups(model);
        let leaders: Vec<usize> = (0..n).filter(|&b| has_joints[b]).collect();
        let mocap: Vec<usize> = (0..n).filter(|&b| model.bodies[b].mocap).collect();
        let (mut frame, mut pos, mut quat) = (vec![0; n], vec![Vector3::zeros(); n], vec![UnitQuaternion::identity(); n]);
        for b in 1..n {
            let body = &model.bodies[b];
            if let Ok(link) = leaders.binary_search(&b) {
                frame[b] = 1 + link;
            } else if let Ok(k) = mocap.binary_search(&b) {
                frame[b] = 1 + leaders.len() + k;
            } else {
                let p = body.parent;
                frame[b] = frame[p];
                pos[b] = pos[p] + quat[p] * vector(body.pos);
                quat[b] = quat[p] * quaternion(body.quat);
            }
        }
        let mut merged = Self { frame, pos, quat, leaders, mocap, addresses: model.joint_addresses(), ..Self::default() };
        merged.grow_trees(model);
        merged
    }

    /// Position of a point of a body in the frame to which the body is fixed, m. `pos` is the position in the frame of the body.
    pub(crate) fn point(&self, body: usize, pos: [f64; 3]) -> Vector3<f64> {
        self.pos[body] + self.quat[body] * vector(pos)
    }

    /// Rotation to the frame to which a body is fixed. `quat` is the rotation to the axes of the body.
    pub(crate) fn rotation(&self, body: usize, quat: [f64; 4]) -> UnitQuaternion<f64> {
        self.quat[body] * quaternion(quat)
    }

    /// Pose of an object in the frame to which it is fixed.
    pub(crate) fn pose(&self, model: &Model, object: Object) -> Pose {
        let Description { bodies, geoms, sites, .. } = &**model;
        let (body, pos, quat) = match object {
            Object::XBody(b) => (b, [0.0; 3], [1.0, 0.0, 0.0, 0.0]),
            Object::Body(b) => (b, bodies[b].ipos, bodies[b].iquat),
            Object::Geom(g) => (geoms[g].body, geoms[g].pos, geoms[g].quat),
            Object::Site(s) => (sites[s].body, sites[s].pos, sites[s].quat),
        };
        Pose { frame: self.frame[body], pos: self.point(body, pos), quat: self.rotation(body, quat) }
    }

    /// Index of the parent frame of the link with index `link`.
    pub(crate) fn parent_frame(&self, model: &Model, link: usize) -> usize {
        self.frame[model.bodies[self.leaders[link]].parent]
    }

    fn grow_trees(&mut self, model: &Model) {
        let nlink = self.leaders.len();
        self.last_dof = vec![None; 1 + nlink + self.mocap.len()];
        for link in 0..nlink {
            let parent = self.parent_frame(model, link);
            let is_root = parent == 0 || parent > nlink;
            if is_root {
                self.ntree += 1;
            }
            self.link_tree.push(if is_root { self.ntree - 1 } else { self.link_tree[parent - 1] });
            let mut last = if is_root { None } else { self.last_dof[parent] };
            for joint in joints_of(model, self.leaders[link]) {
                for _ in 0..joint.kind.nv() {
                    let dof = self.dof_link.len();
                    let start = self.chain.len();
                    self.chain.push(dof as u32);
                    if let Some(p) = last {
                        let (s, len) = self.dof_chain[p];
                        self.chain.extend_from_within(s..s + len);
                    }
                    self.dof_link.push(link);
                    self.dof_chain.push((start, self.chain.len() - start));
                    last = Some(dof);
                }
            }
            self.last_dof[1 + link] = last;
        }
    }

    /// Chain of a degree of freedom: the dof itself and its ancestors, towards the root.
    pub(crate) fn chain_of(&self, dof: usize) -> &[u32] {
        let (start, len) = self.dof_chain[dof];
        &self.chain[start..start + len]
    }

    /// Whether the degree of freedom `dof` moves a frame.
    pub(crate) fn moves(&self, dof: usize, frame: usize) -> bool {
        self.last_dof[frame].is_some_and(|last| self.chain_of(last).contains(&(dof as u32)))
    }

    /// Index of the mass matrix entry for the degrees of freedom `below` and `above`. `None` if `above` is neither `below` itself nor an
    /// ancestor of `below`.
    pub(crate) fn entry(&self, below: usize, above: usize) -> Option<usize> {
        let (start, _) = self.dof_chain[below];
        self.chain_of(below).iter().position(|&d| d as usize == above).map(|k| start + k)
    }

    /// For each frame, the set of degrees of freedom that move it, as bits of 64-bit words.
    pub(crate) fn moved_dofs(&self, nv: usize) -> Vec<Vec<u64>> {
        let set = |last: &Option<usize>| {
            let mut words = vec![0u64; nv.div_ceil(64)];
            if let Some(d) = *last {
                let (start, len) = self.dof_chain[d];
                self.chain[start..start + len].iter().for_each(|&a| words[a as usize / 64] |= 1 << (a % 64));
            }
            words
        };
        self.last_dof.iter().map(set).collect()
    }
}

pub(crate) fn links<S: Scalar>(model: &Model, merged: &Merged) -> Vec<Link<S>> {
    let (mut joint, mut dof) = (0, 0);
    let nlink = merged.leaders.len();
    let link = |(l, &leader): (usize, &usize)| {
        let body = &model.bodies[leader];
        let parent = merged.parent_frame(model, l);
        let (pos, quat) = (merged.point(body.parent, body.pos), merged.rotation(body.parent, body.quat));
        let (joint0, dof0) = (joint, dof);
        for j in joints_of(model, leader) {
            joint += 1;
            dof += j.kind.nv();
        }
        Link {
            parent,
            tree: merged.link_tree[l],
            is_root: parent == 0 || parent > nlink,
            pos: scalars(pos.into()),
            mat: (quat != UnitQuaternion::identity()).then(|| matrix(&quat)),
            quat: wxyz(&quat),
            joints: joint0..joint,
            dofs: dof0..dof,
        }
    };
    merged.leaders.iter().enumerate().map(link).collect()
}

/// Joints of a body. A model lists joints in the order of their bodies.
fn joints_of(model: &Model, body: usize) -> &[Joint] {
    let first = model.joints.partition_point(|joint| joint.body < body);
    let count = model.joints[first..].partition_point(|joint| joint.body == body);
    &model.joints[first..first + count]
}

/// Combines the bodies `chosen`, which are all fixed to one frame, and ascend. Returns their total mass, their centre of mass in the frame,
/// and their inertia about the centre of mass in the frame's axes.
pub(crate) fn combined(model: &Model, merged: &Merged, chosen: impl IntoIterator<Item = usize>) -> (f64, Vector3<f64>, [f64; 6]) {
    let parts: Vec<usize> = chosen.into_iter().filter(|&b| model.bodies[b].mass > 0.0).collect();
    let com_of = |b: usize| merged.point(b, model.bodies[b].ipos);
    let mass: f64 = parts.iter().map(|&b| model.bodies[b].mass).sum();
    if mass == 0.0 {
        return (0.0, Vector3::zeros(), [0.0; 6]);
    }
    let com = parts.iter().map(|&b| com_of(b) * model.bodies[b].mass).sum::<Vector3<f64>>() / mass;
    let mut total = Matrix3::zeros();
    for &b in &parts {
        let body = &model.bodies[b];
        let axes = merged.rotation(b, body.iquat).to_rotation_matrix();
        let r = com_of(b) - com;
        total += axes * Matrix3::from_diagonal(&vector(body.inertia)) * axes.transpose()
            + (Matrix3::identity() * r.dot(&r) - r * r.transpose()) * body.mass;
    }
    (mass, com, [total[(0, 0)], total[(1, 1)], total[(2, 2)], total[(0, 1)], total[(0, 2)], total[(1, 2)]])
}

pub(crate) fn joints<S: Scalar>(model: &Model, merged: &Merged) -> Vec<CompiledJoint<S>> {
    let joint = |(j, &(q, v)): (&Joint, &(usize, usize))| {
        let principal = (0..3).find(|&k| j.axis[k].abs() == 1.0).map(|k| (k, j.axis[k] < 0.0));
        let mut rest = [0.0; 7];
        rest[..j.kind.nq()].copy_from_slice(&model.qpos_spring[q..q + j.kind.nq()]);
        let scalar = matches!(j.kind, JointKind::Hinge | JointKind::Slide);
        CompiledJoint {
            kind: j.kind,
            q,
            v,
            anchor: scalars(j.pos),
            centred: j.pos == [0.0; 3],
            axis: scalars(j.axis),
            principal,
            reference: S::from_f64(if scalar { model.qpos0[q] } else { 0.0 }),
            sprung: j.stiffness != 0.0,
            rest: scalars(rest),
        }
    };
    model.joints.iter().zip(&merged.addresses).map(joint).collect()
}

/// Degrees of freedom of the model, and the list of descendants of all dofs.
pub(crate) fn dofs(model: &Model, merged: &Merged) -> (Vec<Dof>, Vec<Descendant>) {
    let mut under = vec![vec![]; model.nv()];
    for d in (0..model.nv()).rev() {
        let (start, _) = merged.dof_chain[d];
        for (k, &ancestor) in merged.chain_of(d).iter().enumerate().skip(1) {
            under[ancestor as usize].push(Descendant { dof: d as u32, entry: (start + k) as u32 });
        }
    }
    let simple = simple_bodies(model);
    let is_simple: Vec<bool> = model.joints.iter().flat_map(|j| std::iter::repeat_n(simple[j.body], j.kind.nv())).collect();
    let mut descendants = vec![];
    let dof = |(d, mut own): (usize, Vec<Descendant>)| {
        let link = merged.dof_link[d];
        let (chain, depth) = merged.dof_chain[d];
        let tree = merged.link_tree[link];
        let from = descendants.len();
        descendants.append(&mut own);
        Dof { link, tree, chain, depth, is_simple: is_simple[d], descendants: from..descendants.len() }
    };
    (under.into_iter().enumerate().map(dof).collect(), descendants)
}

pub(crate) fn mocap<S: Scalar>(model: &Model, merged: &Merged) -> Vec<CompiledMocap<S>> {
    let compiled = |&b: &usize| {
        let body = &model.bodies[b];
        CompiledMocap { frame: merged.frame[b], pos: scalars(body.pos), quat: scalars(body.quat) }
    };
    merged.mocap.iter().map(compiled).collect()
}

pub(crate) fn bodies<S: Scalar>(model: &Model, merged: &Merged) -> Vec<CompiledBody<S>> {
    let compiled = |b: usize| CompiledBody {
        parent: model.bodies[b].parent,
        frame: merged.frame[b],
        pos: scalars(merged.pos[b].into()),
        mat: matrix(&merged.quat[b]),
        quat: wxyz(&merged.quat[b]),
    };
    (0..model.bodies.len()).map(compiled).collect()
}
