//! Compiled equalities and tendons: parameters of their constraint rows, and blocks of equalities whose rows are assembled together.

use std::ops::Range;

use stepper_real::{Real, Scalar};

use crate::compile::merging::Merged;
use crate::compile::merging::matrix;
use crate::compile::paths::{CompiledPath, PathLengths, PathTerm, path_of};
use crate::compile::tree::scalars;
use crate::model::{EqualityKind, Model};

/// Length of a tendon, or position of a joint: a linear combination of scalar joint positions, and the length of a path.
#[derive(Clone, Debug)]
pub struct Combination<S> {
    /// Terms of the linear combination of joint positions. Each is the address of a position in q, the degree of freedom, and the
    /// coefficient.
    pub terms: Vec<(usize, usize, S)>,
    /// Path of a spatial tendon, whose length is added; `None` for a fixed tendon and for a joint.
    pub path: Option<PathTerm>,
    /// Value of the combination at the model's reference configuration `qpos0`.
    pub reference: S,
}

impl<S: Scalar> Combination<S> {
    /// Value of the combination at the configuration `q`, with the lengths `paths` of all paths at the same configuration.
    #[inline(always)]
    pub fn value<R: Real<Scalar = S>>(&self, q: &[R], paths: &PathLengths<R>) -> R {
        let mut x = R::zero();
        for &(at, _, c) in &self.terms {
            x += R::splat(c) * q[at];
        }
        if let Some(term) = &self.path {
            x += paths.lengths[term.path];
        }
        x
    }

    /// Time derivative of the combination, at the generalized velocity `v`.
    #[inline(always)]
    pub fn rate<R: Real<Scalar = S>>(&self, v: &[R], paths: &PathLengths<R>) -> R {
        let mut x = R::zero();
        for &(_, dof, c) in &self.terms {
            x += R::splat(c) * v[dof];
        }
        if let Some(PathTerm { dofs, arms, .. }) = &self.path {
            for (&dof, &arm) in dofs.iter().zip(&paths.arms[*arms..]) {
                x += arm * v[dof as usize];
            }
        }
        x
    }

    /// Calls `f` with every entry of the combination's derivative with respect to the joint positions: degree of freedom, and moment arm.
    #[inline(always)]
    pub fn for_each_arm<R: Real<Scalar = S>>(&self, paths: &PathLengths<R>, mut f: impl FnMut(usize, R)) {
        for &(_, dof, c) in &self.terms {
            f(dof, R::splat(c));
        }
        if let Some(PathTerm { dofs, arms, .. }) = &self.path {
            for (&dof, &arm) in dofs.iter().zip(&paths.arms[*arms..]) {
                f(dof as usize, arm);
            }
        }
    }

    /// Degrees of freedom on which the combination depends.
    pub fn dofs(&self) -> impl Iterator<Item = usize> {
        self.terms.iter().map(|&(_, dof, _)| dof).chain(self.path.iter().flat_map(|term| term.dofs.iter().map(|&dof| dof as usize)))
    }
}

/// Kinematic path to one of two frames, from the nearest common ancestor of both frames.
#[derive(Clone, Debug, Default)]
pub struct FramePath {
    /// Index of the mocap body at the start of the path; `None` if the path starts at the world or at the common ancestor.
    pub mocap: Option<usize>,
    /// Links on the path, from its start to the frame.
    pub links: Vec<u32>,
}

/// Elements from which a step computes the constraint rows of an equality. `compile/parameters.rs` has their numbers.
#[derive(Clone, Debug)]
pub enum EqualityRows<S> {
    /// Two coincident points (connect), and two aligned orientations (weld).
    Points {
        /// Frames to which the two points are fixed.
        frames: [usize; 2],
        /// Indices of the two bodies in the model.
        bodies: [usize; 2],
        /// For weld: orientation of the second body in its frame. `None` for connect.
        turn: Option<[S; 9]>,
        /// Kinematic paths to the two frames from their nearest common ancestor.
        paths: [FramePath; 2],
    },
    /// Coupling `x - x_ref = polynomial(y - y_ref)` of two linear combinations of joint positions.
    Coupling {
        /// Linear combination x of joint positions, in x - x_ref = polynomial(y - y_ref).
        first: Combination<S>,
        /// Linear combination y of joint positions, in x - x_ref = polynomial(y - y_ref). `None` if x has a constant target.
        second: Option<Combination<S>>,
    },
}

/// Position error of a joint or tendon coupling, x - x_ref - polynomial(y - y_ref), in the unit of x.
#[inline(always)]
pub(crate) fn coupling_error<R: Real>(
    first: &Combination<R::Scalar>,
    second: Option<&Combination<R::Scalar>>,
    c: [R; 5],
    (q, paths): (&[R], &PathLengths<R>),
) -> R {
    let error = first.value(q, paths) - R::splat(first.reference) - c[0];
    let Some(second) = second else { return error };
    let x = second.value(q, paths) - R::splat(second.reference);
    error - x * (c[1] + x * (c[2] + x * (c[3] + x * c[4])))
}

/// Spring with damper and inertia along a constraint row. In the units of its fields, u is the unit of the row's coordinate, m or rad.
#[derive(Clone, Copy, Debug)]
pub struct Spring<S> {
    /// Stiffness, N/u with u = m or rad (N m/rad for a rotation).
    pub stiffness: S,
    /// Damping, N s/u with u = m or rad (N m s/rad for a rotation).
    pub damping: S,
    /// Inertia that acts along the row, N s^2/u with u = m or rad.
    pub inertia: S,
}

impl<S: Scalar> Spring<S> {
    /// Spring in the scalar type of the lanes.
    pub(super) fn new(stiffness: f64, damping: f64, inertia: f64) -> Self {
        let [stiffness, damping, inertia] = scalars([stiffness, damping, inertia]);
        Self { stiffness, damping, inertia }
    }
}

/// Equality of the model, active or not.
#[derive(Clone, Debug)]
pub struct CompiledEquality<S> {
    /// Index of the equality in the model.
    pub index: usize,
    /// Whether the equality is active by default.
    pub active: bool,
    /// Parameters of the equality's constraint rows.
    pub rows: EqualityRows<S>,
    /// Degrees of freedom on which the equality acts, and all their ancestors, ascending.
    pub dofs: Vec<u32>,
    /// Spring of a soft equality; `None` for a hard equality.
    pub spring: Option<Spring<S>>,
    /// Index of the impulse of the first row in the list of impulses of scalar constraint rows.
    pub impulse_index: usize,
}

impl<S> CompiledEquality<S> {
    /// Range of the impulses of the equality's rows in the list of impulses of scalar constraint rows.
    pub(crate) fn impulses(&self) -> Range<usize> {
        let rows = match &self.rows {
            EqualityRows::Points { turn: Some(_), .. } => 6,
            EqualityRows::Points { turn: None, .. } => 3,
            EqualityRows::Coupling { .. } => 1,
        };
        self.impulse_index..self.impulse_index + rows
    }
}

/// Block: equalities whose constraint rows are assembled together. All rows act on the same degrees of freedom, and the rows of hard
/// equalities are made orthogonal.
#[derive(Clone, Debug)]
pub struct EqualityBlock<S> {
    /// Equalities of the block.
    pub equalities: Vec<CompiledEquality<S>>,
    /// Degrees of freedom on which any equality of the block acts, with their ancestors, ascending.
    pub dofs: Vec<u32>,
    /// Number of constraint rows of the block.
    pub rows: usize,
    /// Whether all equalities of the block are hard. Their rows are then made orthogonal.
    pub hard: bool,
    /// Whether the block is hard and shares no degree of freedom with another hard block. The solver then eliminates its rows from all
    /// other rows.
    pub eliminated: bool,
    /// Set of the degrees of freedom in `dofs`, as bits of 64-bit words.
    pub set: Vec<u64>,
}

/// Tendon with constraint rows: a limit, dry friction, or a spring.
#[derive(Clone, Debug)]
pub struct CompiledTendon<S> {
    /// Index of the tendon in the model.
    pub index: usize,
    /// Length of the tendon.
    pub length: Combination<S>,
    /// Degrees of freedom of the tendon's joints, with their ancestors, ascending.
    pub dofs: Vec<u32>,
    /// Lowest and highest length, m or rad; `None` if the tendon has no limit.
    pub range: Option<[S; 2]>,
    /// Dry friction, N or N m; 0 for none.
    pub friction: S,
    /// Spring, damper and inertia of the tendon, and lowest and highest length at which the spring is slack. `None` if the tendon has no
    /// spring, damper or inertia.
    pub spring: Option<(Spring<S>, [S; 2])>,
    /// Index of the tendon's first impulse in the list of impulses of scalar constraint rows. The three impulses belong to limit, dry
    /// friction and spring.
    pub impulse_index: usize,
}

impl<S: Scalar> CompiledTendon<S> {
    /// Spring of the tendon, and its elongation beyond the lengths between which the spring is slack, m or rad. `None` without a spring.
    #[inline(always)]
    pub fn stretch<R: Real<Scalar = S>>(&self, q: &[R], paths: &PathLengths<R>) -> Option<(&Spring<S>, R)> {
        let (spring, [low, high]) = self.spring.as_ref()?;
        let length = self.length.value(q, paths);
        Some((spring, length - length.max(R::splat(*low)).min(R::splat(*high))))
    }
}

/// Largest number of constraint rows of equalities in one block. The solver makes the rows of a block orthogonal to each other, at a cost
/// that grows with the square of their number.
const MOST_ROWS: usize = 48;

/// Compiler of the equalities and tendons of a model.
pub(super) struct Compiler<'a> {
    pub(super) model: &'a Model,
    pub(super) merged: &'a Merged,
}

impl Compiler<'_> {
    /// Linear combination of the positions of joints, each with its coefficient.
    pub(super) fn combination<S: Scalar>(&self, joints: &[(usize, f64)]) -> Combination<S> {
        let terms = joints.iter().map(|&(j, c)| (self.merged.addresses[j].0, self.merged.addresses[j].1, S::from_f64(c))).collect();
        let reference = joints.iter().map(|&(j, c)| c * self.model.qpos0[self.merged.addresses[j].0]).sum();
        Combination { terms, path: None, reference: S::from_f64(reference) }
    }

    /// Lengths of all tendons.
    pub(super) fn lengths<S: Scalar>(&self, paths: &[CompiledPath<S>]) -> Vec<Combination<S>> {
        (0..self.model.tendons.len()).map(|t| self.length(t, paths)).collect()
    }

    /// Length of tendon `t`. `paths` are the paths of all spatial tendons.
    fn length<S: Scalar>(&self, t: usize, paths: &[CompiledPath<S>]) -> Combination<S> {
        let tendon = &self.model.tendons[t];
        let path = path_of(self.model, t).map(|path| PathTerm { path, dofs: paths[path].dofs.clone(), arms: paths[path].arms });
        let length = self.combination(&tendon.joints);
        let reference = path.as_ref().map_or(length.reference, |_| S::from_f64(tendon.reference_length(self.model)));
        Combination { path, reference, ..length }
    }

    /// List of the given degrees of freedom and all their ancestors, ascending.
    fn with_ancestors(&self, dofs: impl Iterator<Item = usize>) -> Vec<u32> {
        let mut all: Vec<u32> = dofs.flat_map(|d| self.merged.chain_of(d).to_vec()).collect();
        all.sort_unstable();
        all.dedup();
        all
    }

    fn rows<S: Scalar>(&self, kind: &EqualityKind, paths: &[CompiledPath<S>]) -> (EqualityRows<S>, Vec<u32>) {
        match kind {
            EqualityKind::Connect { bodies, .. } => self.points(*bodies, None),
            EqualityKind::Weld { bodies, .. } => self.points(*bodies, Some(matrix(&self.merged.quat[bodies[1]]))),
            EqualityKind::Joint { joint, other, .. } => {
                let position = |j: usize| self.combination(&[(j, 1.0)]);
                self.coupling(position(*joint), other.map(position))
            }
            EqualityKind::Tendon { tendon, other, .. } => {
                let length = |t: usize| self.length(t, paths);
                self.coupling(length(*tendon), other.map(length))
            }
        }
    }

    fn points<S: Scalar>(&self, bodies: [usize; 2], turn: Option<[S; 9]>) -> (EqualityRows<S>, Vec<u32>) {
        let frames = bodies.map(|b| self.merged.frame[b]);
        let moved_dofs = frames.into_iter().filter_map(|f| self.merged.last_dof[f]);
        let dofs = self.with_ancestors(moved_dofs);
        let paths = self.paths(frames);
        (EqualityRows::Points { frames, bodies, turn, paths }, dofs)
    }

    /// Kinematic paths to the two frames, from their nearest common ancestor.
    fn paths(&self, frames: [usize; 2]) -> [FramePath; 2] {
        let nlink = self.merged.leaders.len();
        let mut paths = frames.map(|mut frame| {
            let mut links = vec![];
            while (1..=nlink).contains(&frame) {
                links.push(frame as u32 - 1);
                frame = self.merged.parent_frame(self.model, frame - 1);
            }
            links.reverse();
            FramePath { mocap: frame.checked_sub(nlink + 1), links }
        });
        let [first, second] = &mut paths;
        if first.mocap == second.mocap {
            (first.mocap, second.mocap) = (None, None);
            let shared = first.links.iter().zip(&second.links).take_while(|(a, b)| a == b).count();
            first.links.drain(..shared);
            second.links.drain(..shared);
        }
        paths
    }

    fn coupling<S: Scalar>(&self, first: Combination<S>, second: Option<Combination<S>>) -> (EqualityRows<S>, Vec<u32>) {
        let dofs = self.with_ancestors(first.dofs().chain(second.iter().flat_map(Combination::dofs)));
        (EqualityRows::Coupling { first, second }, dofs)
    }

    /// Compiles the equalities and groups them in blocks, which a step assembles together. Hard equalities that share a degree of freedom
    /// are in one block, if the block then has at most [`MOST_ROWS`] constraint rows.
    ///
    /// The function increases `impulse_index`, the next free index in the list of impulses of scalar constraint rows.
    pub(super) fn equalities<S: Scalar>(&self, paths: &[CompiledPath<S>], impulse_index: &mut usize) -> Vec<EqualityBlock<S>> {
        let mut blocks: Vec<EqualityBlock<S>> = Vec::new();
        for (index, equality) in self.model.equalities.iter().enumerate() {
            let (rows, dofs) = self.rows(&equality.kind, paths);
            let count = equality.kind.rows();
            let compiled = CompiledEquality {
                index,
                active: equality.active,
                rows,
                dofs: dofs.clone(),
                spring: equality.stiffness.is_finite().then(|| Spring::new(equality.stiffness, equality.damping, 0.0)),
                impulse_index: *impulse_index,
            };
            *impulse_index += count;
            let hard = compiled.spring.is_none();
            let mut block = EqualityBlock { equalities: vec![compiled], dofs, rows: count, hard, eliminated: false, set: vec![] };
            let met = |b: &EqualityBlock<S>| hard && b.hard && b.dofs.iter().any(|d| block.dofs.binary_search(d).is_ok());
            let (together, apart): (Vec<_>, Vec<_>) = blocks.into_iter().partition(met);
            let total = count + together.iter().map(|b| b.rows).sum::<usize>();
            blocks = apart;
            if total > MOST_ROWS {
                blocks.extend(together);
            } else if !together.is_empty() {
                block = join(together, block, total);
            }
            blocks.push(block);
        }
        mark_eliminated(&mut blocks, self.model.nv());
        blocks
    }

    /// Compiles the tendons that have a limit, dry friction, spring, damper or inertia. The function increases `impulse_index`, the next
    /// free index in the list of impulses of scalar constraint rows.
    pub(super) fn tendons<S: Scalar>(&self, paths: &[CompiledPath<S>], impulse_index: &mut usize) -> Vec<CompiledTendon<S>> {
        let mut plans = Vec::new();
        for (index, tendon) in self.model.tendons.iter().enumerate() {
            let sprung = tendon.stiffness > 0.0 || tendon.damping > 0.0 || tendon.armature > 0.0;
            if !sprung && tendon.range.is_none() && tendon.frictionloss == 0.0 {
                continue;
            }
            let spring = Spring::new(tendon.stiffness, tendon.damping, tendon.armature);
            let length = self.length(index, paths);
            plans.push(CompiledTendon {
                index,
                dofs: self.with_ancestors(length.dofs()),
                length,
                range: tendon.range.map(scalars),
                friction: S::from_f64(tendon.frictionloss),
                spring: sprung.then(|| (spring, scalars(tendon.spring_length))),
                impulse_index: *impulse_index,
            });
            *impulse_index += 3;
        }
        plans
    }
}

fn join<S: Scalar>(blocks: Vec<EqualityBlock<S>>, last: EqualityBlock<S>, rows: usize) -> EqualityBlock<S> {
    let mut out = EqualityBlock { equalities: vec![], dofs: vec![], rows, hard: true, eliminated: false, set: vec![] };
    for block in blocks.into_iter().chain([last]) {
        out.equalities.extend(block.equalities);
        out.dofs.extend(block.dofs);
    }
    out.dofs.sort_unstable();
    out.dofs.dedup();
    out
}

/// Marks blocks of hard equalities as eliminated if they share no degree of freedom with another such block. Sorts the eliminated blocks to
/// the front.
fn mark_eliminated<S: Scalar>(blocks: &mut [EqualityBlock<S>], nv: usize) {
    let mut takers = vec![0; nv];
    for block in blocks.iter().filter(|b| b.hard) {
        block.dofs.iter().for_each(|&d| takers[d as usize] += 1);
    }
    for block in &mut *blocks {
        block.eliminated = block.hard && block.dofs.iter().all(|&d| takers[d as usize] == 1);
        block.set = vec![0; nv.div_ceil(64)];
        block.dofs.iter().for_each(|&d| block.set[d as usize / 64] |= 1 << (d % 64));
    }
    blocks.sort_by_key(|b| !b.eliminated);
}
