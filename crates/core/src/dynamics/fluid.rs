//! Forces of the surrounding fluid on moving bodies: MuJoCo's two models (its documentation, "Fluid forces"; `engine_passive.c`).
//!
//! v and w are the linear and angular velocity relative to the fluid. The box model has, along every principal axis, the force
//! -(a + b |v|) v and the torque -(c + d |w|) w. Here a, c are Stokes' drag of a ball, and b, d the drag of the faces of the box with the
//! body's inertia.
//!
//! The ellipsoid model has Magnus' lift w x v, Kutta's lift, drag, and added mass. With the added mass m_a and the added inertia I_a, let
//! p = m_a v and L = I_a w. Added mass causes the force p x w and the torque p x v + L x w.
//!
//! Drag dissipates energy, but explicit drag on a mass m reverses the motion and adds energy if h b |v| > 2 m for a time step h. Drag is
//! therefore linearised, and enters the mass matrix like joint damping. The linearisation is the secant B = a + b |v|, drag divided by
//! velocity, at the velocity u before the step. Let f be the force, and v* the velocity at which forces are evaluated. The step applies the
//! force f(v*) + B (v* - u). The linearised drag in the mass matrix adds the rest.

use stepper_real::Real;

use crate::compile::{CompiledEllipsoid, FluidParams, FluidShape, LaneModel, ModelStructure};
use crate::dynamics::kinematics::Kinematics;
use crate::math::spatial::*;

/// Forces of the surrounding fluid, with their workspace; empty for scenes without a fluid.
#[derive(Clone, Debug)]
pub struct Fluid<R: Real> {
    /// Velocity of every body relative to the fluid before the step, in body axes.
    before: Vec<V6<R>>,
    /// Linearised drag of each body, per axis: drag divided by velocity, at the velocity `before`.
    drag: Vec<V6<R>>,
    /// Linearised drag of every link with its descendants, as three matrices: torque per angular velocity, torque per linear velocity, and
    /// force per linear velocity.
    composite: Vec<[M3<R>; 3]>,
    /// Buffer for the spatial velocity of every link.
    velocity: Vec<V6<R>>,
}

impl<R: Real> Fluid<R> {
    /// Creates the fluid forces of a compiled model, without a linearisation of drag.
    pub fn new(compiled: &ModelStructure<R::Scalar>) -> Self {
        let (n, links) = (compiled.fluid.len(), if compiled.fluid.is_empty() { 0 } else { compiled.links.len() });
        Self { before: vec![zero(); n], drag: vec![zero(); n], composite: vec![[zero(); 3]; links], velocity: vec![zero(); links] }
    }

    /// Makes drag explicit in the next step: discards the linearisation.
    #[inline(always)]
    pub fn make_drag_explicit(&mut self) {
        self.before.fill(zero());
        self.drag.fill(zero());
    }

    /// Adds `time` times the linearised drag at the velocity `v` to `entries`, the entries of the mass matrix.
    #[inline(always)]
    pub fn linearise(&mut self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, v: &[R], time: R, entries: &mut [R]) {
        kinematics.velocities(compiled, v, &mut self.velocity);
        self.composite.fill([zero(); 3]);
        for (i, body) in compiled.fluid.iter().enumerate() {
            let (mat, arm) = place(compiled, kinematics, i);
            self.before[i] = local(compiled, &self.velocity[body.link], &mat, arm);
            self.drag[i] = secant(compiled, i, &self.before[i]);
            let sum = &mut self.composite[body.link];
            let added = at_origin(&self.drag[i], &mat, arm);
            *sum = array!(|k| add(sum[k], added[k]));
        }
        for l in (0..compiled.links.len()).rev() {
            let link = &compiled.links[l];
            let drag = self.composite[l];
            for d in link.dofs.clone() {
                let resistance = apply(&drag, &kinematics.axes[d]);
                let dof = &compiled.dofs[d];
                let row = &mut entries[dof.chain..dof.chain + dof.depth];
                for (entry, &a) in row.iter_mut().zip(compiled.chain_of(d)) {
                    *entry += time * dot6(kinematics.axes[a as usize], resistance);
                }
            }
            if !link.is_root {
                let sum = &mut self.composite[link.parent - 1];
                *sum = array!(|k| add(sum[k], drag[k]));
            }
        }
    }

    /// Subtracts the fluid's forces at the link velocities `motion` from `force`, the forces on the links.
    #[inline(always)]
    pub fn subtract(&self, compiled: &LaneModel<R>, kinematics: &Kinematics<R>, motion: &[V6<R>], force: &mut [V6<R>]) {
        for (i, body) in compiled.fluid.iter().enumerate() {
            let (mat, arm) = place(compiled, kinematics, i);
            let v = local(compiled, &motion[body.link], &mat, arm);
            let own = match &body.shape {
                FluidShape::Box => {
                    let drag = secant(compiled, i, &v);
                    array!(|k| -(drag[k] * v[k]))
                }
                FluidShape::Ellipsoid(e) => ellipsoid_force(e, &v),
            };
            let own = add(own, times(self.drag[i], sub(v, self.before[i])));
            let (torque, push) = (rotate(&mat, angular(&own)), rotate(&mat, linear(&own)));
            let wrench = spatial(add(torque, cross(arm, push)), push);
            force[body.link] = sub(force[body.link], wrench);
        }
    }
}

/// Rotation matrix of a body in the fluid, and its centre relative to the reference point of its kinematic tree, m. `i` is the index of the
/// body in the list of bodies in a fluid.
#[inline(always)]
fn place<R: Real>(compiled: &LaneModel<R>, kinematics: &Kinematics<R>, i: usize) -> (M3<R>, V3<R>) {
    let body = &compiled.fluid[i];
    let frame = body.link + 1;
    let mat = mat_mul(&kinematics.mat[frame], &splat(body.mat));
    (mat, sub(kinematics.point(frame, compiled.params.fluid(i).pos), kinematics.origin[compiled.links[body.link].tree]))
}

/// Velocity of a body relative to the fluid, in body axes. `motion` is the link's spatial velocity at the reference point of its tree,
/// `mat` the body's rotation matrix, and `arm` the body's centre relative to this point.
#[inline(always)]
fn local<R: Real>(compiled: &LaneModel<R>, motion: &V6<R>, mat: &M3<R>, arm: V3<R>) -> V6<R> {
    let velocity = sub(velocity_at(motion, arm), splat(compiled.wind));
    spatial(rotate_back(mat, angular(motion)), rotate_back(mat, velocity))
}

/// Drag of a body in the fluid divided by its velocity `v`, per axis. `i` is the index of the body in the list of bodies in a fluid. The
/// velocity is relative to the fluid, in body axes.
#[inline(always)]
fn secant<R: Real>(compiled: &LaneModel<R>, i: usize, v: &V6<R>) -> V6<R> {
    match &compiled.fluid[i].shape {
        FluidShape::Box => {
            let FluidParams { viscous, quadratic: drag, .. } = compiled.params.fluid(i);
            array!(|k| viscous[k] + drag[k] * v[k].abs())
        }
        FluidShape::Ellipsoid(e) => {
            let [spin, slide] = ellipsoid_drag(e, v).0.map(|d| d * R::splat(e.share));
            [spin, spin, spin, slide, slide, slide]
        }
    }
}

/// Drag matrices of a body at the reference point of its kinematic tree: torque per angular velocity, torque per linear velocity, and force
/// per linear velocity.
///
/// `drag` is the drag divided by velocity per body axis, `mat` the body's rotation matrix, and `arm` the body's centre relative to the
/// point.
#[inline(always)]
fn at_origin<R: Real>(drag: &V6<R>, mat: &M3<R>, arm: V3<R>) -> [M3<R>; 3] {
    let (spin, slide) = (turned(angular(drag), mat), turned(linear(drag), mat));
    let [x, y, z] = arm;
    let o = R::zero();
    let lever = [o, -z, y, z, o, -x, -y, x, o];
    let levered = mat_mul(&lever, &slide);
    // The transpose of lever is -lever.
    [sub(spin, mat_mul(&levered, &lever)), levered, slide]
}

/// Product X diag(d) X^T of the matrix `x` and the diagonal `d`.
#[inline(always)]
fn turned<R: Real>(d: V3<R>, x: &M3<R>) -> M3<R> {
    array!(|k| {
        let (i, j) = (k / 3, k % 3);
        d[0] * x[3 * i] * x[3 * j] + d[1] * x[3 * i + 1] * x[3 * j + 1] + d[2] * x[3 * i + 2] * x[3 * j + 2]
    })
}

/// Torque and force of the drag at the spatial velocity `motion`, with the opposite sign, so that they point along the velocity. The
/// matrices are torque per angular velocity, torque per linear velocity, and force per linear velocity.
#[inline(always)]
fn apply<R: Real>([spin, lever, slide]: &[M3<R>; 3], motion: &V6<R>) -> V6<R> {
    let (w, v) = (angular(motion), linear(motion));
    spatial(add(rotate(spin, w), rotate(lever, v)), add(rotate_back(lever, w), rotate(slide, v)))
}

/// Projection of an ellipsoid on the plane perpendicular to its velocity.
#[derive(Clone, Copy, Debug)]
struct Projection<R> {
    speed: R,
    /// Unit vector of the velocity.
    along: V3<R>,
    /// Projected area, m^2.
    area: R,
    /// Vector along the normal of the ellipsoid's surface, see [`projection`]. Its length is the area times the cosine of the angle between
    /// this normal and the velocity.
    normal: V3<R>,
}

/// Projection of an ellipsoid on the plane perpendicular to its velocity `v`. The area is pi sqrt(sum b_k^4 v_k^2 / sum b_k^2 v_k^2), with
/// b_k the product of the two other semi-axes. The surface normal is along b_k^2 v_k.
///
/// The area is a product of the ellipsoid's largest projected area and a ratio. A test for zero area therefore needs no bound in m^2 or
/// m/s, which small or slow bodies could reach. Needles that fly along their axis, b / a^2 < 3e-8 with the longest semi-axis a, have no
/// area, as in MuJoCo (4.0).
#[inline(always)]
fn projection<R: Real>(e: &CompiledEllipsoid<R::Scalar>, v: V3<R>) -> Projection<R> {
    let areas: V3<R> = splat(e.areas);
    let speed = norm(v);
    let along = scale(v, speed.max(R::of(1e-15)).recip());
    let (mut denominator, mut numerator) = (R::zero(), R::zero());
    for k in 0..3 {
        denominator += (areas[k].square() * along[k]).square();
        numerator += (areas[k] * along[k]).square();
    }
    let there = numerator.gt(R::splat(e.no_area));
    let (numerator, denominator) = (R::select(there, numerator, R::one()), R::select(there, denominator, R::zero()));
    let area = R::splat(e.widest) * (denominator / numerator).sqrt();
    // Factor of the normal vector. A body with a projected area has a nonzero denominator.
    let inverse = R::splat(e.widest) * (numerator / R::select(there, denominator, numerator)).sqrt();
    let share = R::select(there, inverse, R::zero());
    Projection { speed, along, area, normal: array!(|k| areas[k].square() * along[k] * share) }
}

/// Drag of an ellipsoid divided by its velocity `v`: one factor for rotation and one for translation. Also returns the ellipsoid's
/// projection on the plane perpendicular to `v`.
#[inline(always)]
fn ellipsoid_drag<R: Real>(e: &CompiledEllipsoid<R::Scalar>, v: &V6<R>) -> ([R; 2], Projection<R>) {
    let projection = projection(e, linear(v));
    let w = angular(v);
    let [blunt, slender]: [R; 2] = splat(e.drag);
    let [spin, slide]: [R; 2] = splat(e.viscous);
    let moments: V3<R> = splat(e.moments);
    let density = R::splat(e.density);
    let turning = spin + density * norm([w[0] * moments[0], w[1] * moments[1], w[2] * moments[2]]);
    let Projection { speed, area, .. } = projection;
    let sliding = slide + density * speed * (area * blunt + slender * (R::splat(e.widest) - area));
    ([turning, sliding], projection)
}

#[inline(always)]
fn ellipsoid_force<R: Real>(e: &CompiledEllipsoid<R::Scalar>, motion: &V6<R>) -> V6<R> {
    let ([turning, sliding], projection) = ellipsoid_drag(e, motion);
    let (w, v) = (angular(motion), linear(motion));
    let (m, i): (V3<R>, V3<R>) = (splat(e.added_mass), splat(e.added_inertia));
    let p: V3<R> = times(m, v);
    let l: V3<R> = times(i, w);
    let mut torque = add(cross(p, v), cross(l, w));
    let mut force = add(cross(p, w), scale(cross(w, v), R::splat(e.magnus)));
    let circulation = scale(cross(projection.normal, projection.along), R::splat(e.kutta) * projection.speed);
    force = add(force, cross(circulation, v));
    torque = sub(torque, scale(w, turning));
    force = sub(force, scale(v, sliding));
    scale(spatial(torque, force), R::splat(e.share))
}
