//! Compiled softness of constraints: parameters of MuJoCo's contact law, computed from solref, solimp and the inverse weights of a model.

use stepper_real::{Real, Scalar};
use stepper_solve::soft::{Cone, SlipEffort};

use crate::compile::tree::scalars;
use crate::model::{ContactSpring, MIN_VALUE, Pair, Softness};

/// Smallest and largest impedance (`mjMINIMP`, `mjMAXIMP`).
const IMPEDANCE: [f64; 2] = [1e-4, 0.9999];

/// Smallest coefficient of friction (`mjMINMU`).
pub(crate) const MIN_FRICTION: f64 = 1e-5;

/// Constraint law of a soft row: reference acceleration -B v - K d(r) r, and regularisation (1 - d(r)) / d(r) times an approximate inverse
/// inertia.
///
/// r is the position error of the row, v its time derivative, and d the impedance.
#[derive(Clone, Copy, Debug)]
pub struct SoftLaw<S> {
    /// Stiffness K, 1/s^2.
    pub stiffness: S,
    /// Damping B, 1/s.
    pub damping: S,
    /// Impedance at zero position error, and difference of the final impedance minus that impedance.
    impedance: [S; 2],
    /// Inverse of the error at which the impedance reaches its final value, 1/m or 1/rad; 0 for a constant impedance.
    inverse_width: S,
    /// Position error at the midpoint of the impedance curve, divided by the error at which the impedance reaches its final value.
    /// `factors` are the factors of the curve before and after the midpoint.
    midpoint: S,
    factors: [S; 2],
    /// Exponent of the impedance curve.
    power: S,
    /// Approximate inverse inertia along the row, 1/kg or 1/(kg m^2).
    pub weight: S,
}

/// Constraint law of the contacts of a pair of geoms.
#[derive(Clone, Copy, Debug)]
pub struct SoftContactLaw<S> {
    /// Constraint law of the row along the contact normal.
    pub normal: SoftLaw<S>,
    /// Damping B of the friction rows, 1/s.
    pub friction_damping: S,
    /// Number of constraint rows of a contact: 1, 3, 4 or 6.
    pub condim: u8,
    /// Anisotropy of friction along the two tangents, see [`Pair::anisotropy`](crate::model::Pair::anisotropy).
    pub anisotropy: [S; 2],
    /// Regularisation R of the normal force of a contact spring, 1/kg. 0 if the contact has no spring, and follows its solref and solimp
    /// instead.
    pub spring: S,
}

/// Constraint laws of all constraints of a model.
#[derive(Clone, Debug)]
pub struct CompiledSoftness<S> {
    /// Shape of the friction cones: elliptic or pyramidal.
    pub cone: Cone,
    /// Ratio of frictional to normal impedance (`impratio`).
    pub impratio: S,
    /// Number and tolerance of the noslip iterations; `None` if the solver makes no noslip iterations.
    pub noslip: Option<SlipEffort<S>>,
    /// Constraint laws of the contacts of every pair in the compiled model's list of pairs, in the same order.
    pub pairs: Vec<SoftContactLaw<S>>,
    /// Constraint laws of the limits of hinge and slide joints, in the order of the compiled model's `limits`.
    pub limits: Vec<SoftLaw<S>>,
    /// Constraint laws of the dry friction rows, in the order of the compiled model's `frictions`.
    pub frictions: Vec<SoftLaw<S>>,
    /// Constraint laws of the limits of ball joints, in the order of the compiled model's `ball_limits`.
    pub ball_limits: Vec<SoftLaw<S>>,
    /// Constraint laws of each compiled tendon: of its limit, and of its dry friction.
    pub tendons: Vec<[SoftLaw<S>; 2]>,
    /// Constraint laws of each equality of the model: of its translational rows, and of its rotational rows.
    pub equalities: Vec<[SoftLaw<S>; 2]>,
    /// Parameters from which the laws of dynamic pairs are computed.
    pub(super) maker: LawMaker,
    /// Translational inverse weight of the body of every geom, 1/kg.
    pub(super) geom_weights: Vec<f64>,
    /// Index of the body of every geom of the model.
    pub geom_bodies: Vec<u32>,
    /// Order of the degrees of freedom in the solver's matrix. The solver eliminates them in the reverse order.
    pub order: Vec<u32>,
}

/// Parameters of constraint laws that are the same for all constraints.
#[derive(Clone, Copy, Debug)]
pub(super) struct LawMaker {
    /// Smallest time constant that a solref may have, s; 0 for no bound.
    pub(super) least_time: f64,
    /// Time step, s.
    pub(super) timestep: f64,
}

impl<S: Scalar> SoftLaw<S> {
    /// Impedance d at the position error `r`.
    #[inline(always)]
    pub fn impedance<R: Real<Scalar = S>>(&self, r: R) -> R {
        let [start, growth] = self.impedance.map(R::splat);
        if self.inverse_width == S::default() {
            return start;
        }
        let x = r.abs() * R::splat(self.inverse_width);
        let below = x.le(R::splat(self.midpoint));
        let rest = (R::one() - x).max(R::zero());
        let base = R::select(below, x, rest);
        let factor = R::select(below, R::splat(self.factors[0]), R::splat(self.factors[1]));
        let curve = factor * power(base, self.power);
        let y = R::select(below, curve, R::one() - curve);
        start + growth * R::select(x.lt(R::one()), y, R::one())
    }

    /// Regularisation R of a row with the impedance `impedance` and the approximate inverse inertia `weight`.
    #[inline(always)]
    pub fn regularisation<R: Real<Scalar = S>>(impedance: R, weight: R) -> R {
        ((R::one() - impedance) * weight / impedance).max(R::of(MIN_VALUE))
    }

    /// Reference acceleration and weight D = 1 / R of a constraint row with the regularisation R. `r` is the position error of the row, and
    /// `v` its time derivative. D is 0 outside the lanes `active`.
    #[inline(always)]
    pub fn row<R: Real<Scalar = S>>(&self, r: R, v: R, active: R::Mask) -> [R; 2] {
        self.row_at(self.impedance(r), r, v, active)
    }

    /// Reference acceleration and weight D = 1 / R of a constraint row with the regularisation R. Unlike [`SoftLaw::row`], the function
    /// takes the impedance as an argument, for rows that share one impedance.
    ///
    /// `r` is the position error of the row, and `v` its time derivative. D is 0 outside the lanes `active`.
    #[inline(always)]
    pub fn row_at<R: Real<Scalar = S>>(&self, impedance: R, r: R, v: R, active: R::Mask) -> [R; 2] {
        let reference = -(R::splat(self.damping) * v) - R::splat(self.stiffness) * impedance * r;
        let weight = R::one() / Self::regularisation(impedance, R::splat(self.weight));
        [reference, R::select(active, weight, R::zero())]
    }
}

/// Power x^p for x in [0, 1].
#[inline(always)]
fn power<R: Real>(x: R, p: R::Scalar) -> R {
    let exponent = p.to_f64();
    if exponent == 1.0 {
        return x;
    }
    if exponent == 2.0 {
        return x * x;
    }
    let some = x.gt(R::zero());
    R::select(some, (R::splat(p) * R::select(some, x, R::one()).ln()).exp(), R::zero())
}

/// Solref with both numbers in one format: both positive or both negative. If their signs differ, the result is MuJoCo's default.
fn in_one_format(solref: [f64; 2]) -> [f64; 2] {
    if (solref[0] > 0.0) == (solref[1] > 0.0) { solref } else { Softness::default().solref }
}

impl LawMaker {
    /// Stiffness K, 1/s^2, and damping B, 1/s, of a constraint with the parameters `solref` and the largest impedance `largest`.
    fn spring(self, solref: [f64; 2], largest: f64) -> [f64; 2] {
        let [mut time, ratio] = in_one_format(solref);
        if time <= 0.0 {
            return [-time / (largest * largest).max(MIN_VALUE), -ratio / largest.max(MIN_VALUE)];
        }
        time = time.max(self.least_time);
        [1.0 / (largest * time * ratio).powi(2).max(MIN_VALUE), 2.0 / (largest * time).max(MIN_VALUE)]
    }

    pub(super) fn law<S: Scalar>(self, softness: &Softness, weight: f64) -> SoftLaw<S> {
        let [start, end, width, midpoint, power] = softness.solimp;
        let bounded = |x: f64| x.clamp(IMPEDANCE[0], IMPEDANCE[1]);
        let (start, end, midpoint, power) = (bounded(start), bounded(end), bounded(midpoint), power.max(1.0));
        let [stiffness, damping] = self.spring(softness.solref, end);
        let flat = start == end || width <= MIN_VALUE;
        let impedance = if flat { [0.5 * (start + end), 0.0] } else { [start, end - start] };
        let factors = [midpoint, 1.0 - midpoint].map(|x| 1.0 / x.powf(power - 1.0));
        let of = S::from_f64;
        SoftLaw {
            stiffness: of(stiffness),
            damping: of(damping),
            impedance: scalars(impedance),
            inverse_width: of(if flat { 0.0 } else { 1.0 / width }),
            midpoint: of(midpoint),
            factors: scalars(factors),
            power: of(power),
            weight: of(weight),
        }
    }

    /// Constraint law of dry friction, which has no stiffness.
    pub(super) fn friction<S: Scalar>(self, softness: &Softness, weight: f64) -> SoftLaw<S> {
        SoftLaw { stiffness: S::default(), ..self.law(softness, weight) }
    }

    pub(super) fn contact<S: Scalar>(self, pair: &Pair, weight: f64) -> SoftContactLaw<S> {
        if !pair.spring.is_rigid() {
            return self.spring_contact(pair);
        }
        let normal = self.law::<S>(&pair.softness, weight);
        let largest = pair.softness.solimp[1].clamp(IMPEDANCE[0], IMPEDANCE[1]);
        let [a, b] = pair.solref_friction;
        let own = (a != 0.0 || b != 0.0) && (a > 0.0) == (b > 0.0);
        let friction_damping = if own { S::from_f64(self.spring([a, b], largest)[1]) } else { normal.damping };
        SoftContactLaw { normal, friction_damping, condim: pair.condim, anisotropy: scalars(pair.anisotropy), spring: S::default() }
    }

    /// Constraint law of a contact spring with damper, evaluated at the end of the step by the implicit Euler rule.
    ///
    /// For the gap r, its velocities v and v+ before and after the step, and the time step h, the force is f = -K (r + h v+) - D v+. With
    /// the acceleration a = (v+ - v) / h, this equals R f = a_ref - a with R = 1 / (h (h K + D)) and a_ref = -v/h - K r R. With an
    /// impedance of 1/2, the regularisation R equals the inverse weight of the row.
    fn spring_contact<S: Scalar>(self, pair: &Pair) -> SoftContactLaw<S> {
        let (ContactSpring { stiffness, damping }, h) = (pair.spring, self.timestep);
        let weight = 1.0 / (h * (h * stiffness + damping));
        let (of, zero) = (S::from_f64, S::default());
        let normal = SoftLaw {
            stiffness: of(2.0 * stiffness * weight),
            damping: of(1.0 / h),
            impedance: [of(0.5), zero],
            inverse_width: zero,
            midpoint: of(0.5),
            factors: [of(1.0); 2],
            power: of(1.0),
            weight: of(weight),
        };
        let condim = pair.condim;
        SoftContactLaw { normal, friction_damping: normal.damping, condim, anisotropy: scalars(pair.anisotropy), spring: normal.weight }
    }
}
