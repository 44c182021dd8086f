//! Compiled softness of constraints: the numbers of MuJoCo's contact law from solref, solimp and the inverse weights of a model.

use stepper_real::{Real, Scalar};
use stepper_solve::soft::{Cone, SlipEffort};

use crate::compile::tree::scalars;
use crate::model::{ContactSpring, GeomPair, MIN_VALUE, Softness};

/// Least and largest impedance (`mjMINIMP`, `mjMAXIMP`).
const IMPEDANCE: [f64; 2] = [1e-4, 0.9999];

/// Least coefficient of friction (`mjMINMU`).
pub(crate) const MIN_FRICTION: f64 = 1e-5;
/// Mobility below which a row is immovable.
pub(crate) const MIN_MOBILITY: f64 = MIN_VALUE;

/// Law of a soft row: reference acceleration -B v - K d(r) r and regularisation (1 - d(r)) / d(r) times its weight.
///
/// r is the error of the row, v its rate and d the impedance.
#[derive(Clone, Copy, Debug)]
pub struct SoftLaw<S> {
    /// Stiffness K, 1/s^2.
    pub stiffness: S,
    /// Damping B, 1/s.
    pub damping: S,
    /// Impedance without error, and its growth with the error.
    impedance: [S; 2],
    /// Inverse of the width over which the impedance grows.
    inverse_width: S,
    /// Midpoint of the impedance curve, and factors of the curve before and after it.
    midpoint: S,
    factors: [S; 2],
    power: S,
    /// Approximate inverse inertia along the row.
    pub weight: S,
    /// Whether a discrete step softens the law if its spring is stiffer than the step resolves (`refsafe`).
    pub yields: bool,
}

/// Law of the contacts of a pair of geoms.
#[derive(Clone, Copy, Debug)]
pub struct SoftContactLaw<S> {
    /// Law of the normal row.
    pub normal: SoftLaw<S>,
    /// Damping B of the friction rows, 1/s.
    pub friction_damping: S,
    /// Number of rows: 1, 3, 4 or 6.
    pub condim: u8,
    /// Anisotropy of friction, see [`Pair::anisotropy`](crate::model::Pair::anisotropy).
    pub anisotropy: [S; 2],
    /// Regularisation R of the normal force of a spring, 1/kg, which the edges of a pyramid share. 0 where the contact has the law of its
    /// solref and solimp.
    pub spring: S,
}

/// Laws of all constraints of a model.
#[derive(Clone, Debug)]
pub struct CompiledSoftness<S> {
    /// Shape of the friction cones.
    pub cone: Cone,
    /// Ratio of the impedance of friction to that of normal forces.
    pub impratio: S,
    /// Sweeps that remove slip, if any.
    pub noslip: Option<SlipEffort<S>>,
    /// Laws of the listed pairs.
    pub pairs: Vec<SoftContactLaw<S>>,
    /// Laws of limits, dry friction and limits of ball joints, as the compiled model lists them.
    pub limits: Vec<SoftLaw<S>>,
    /// Laws of dry friction, see `limits`.
    pub frictions: Vec<SoftLaw<S>>,
    /// Laws of the limits of ball joints, see `limits`.
    pub ball_limits: Vec<SoftLaw<S>>,
    /// Laws of limits and of dry friction of the compiled tendons.
    pub tendons: Vec<[SoftLaw<S>; 2]>,
    /// Laws of the model's equalities, of translation and of rotation.
    pub equalities: Vec<[SoftLaw<S>; 2]>,
    /// Parameters of the contact laws of dynamic pairs.
    pub(super) maker: LawMaker,
    /// Translational inverse weight of every geom's body.
    pub(super) geom_weights: Vec<f64>,
    /// Body of every geom of the model.
    pub geom_bodies: Vec<u32>,
    /// Degrees of freedom in the order of the solver's matrix, which it eliminates from the last to the first.
    pub order: Vec<u32>,
}

/// Parameters of soft laws that do not depend on the constraint.
#[derive(Clone, Copy, Debug)]
pub(super) struct LawMaker {
    /// Smallest time constant, s.
    pub(super) least_time: f64,
    /// Time step, s.
    pub(super) timestep: f64,
    /// Whether limits and contacts yield, see [`SoftLaw::yields`].
    pub(super) yields: bool,
}

impl<S: Scalar> SoftLaw<S> {
    /// Impedance at the error r.
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

    /// Regularisation R at this impedance, for this weight.
    #[inline(always)]
    pub fn regularisation<R: Real<Scalar = S>>(impedance: R, weight: R) -> R {
        ((R::one() - impedance) * weight / impedance).max(R::of(MIN_VALUE))
    }

    /// Reference acceleration and D = 1 / R of a row at the error r, whose rate is v, in the lanes `active`; D is 0 in the others.
    #[inline(always)]
    pub fn row<R: Real<Scalar = S>>(&self, r: R, v: R, active: R::Mask) -> [R; 2] {
        self.row_at(self.impedance(r), r, v, active)
    }

    /// Reference acceleration and regularisation at a given impedance, for several errors that share one.
    #[inline(always)]
    pub fn row_at<R: Real<Scalar = S>>(&self, impedance: R, r: R, v: R, active: R::Mask) -> [R; 2] {
        let reference = -(R::splat(self.damping) * v) - R::splat(self.stiffness) * impedance * r;
        let weight = R::one() / Self::regularisation(impedance, R::splat(self.weight));
        [reference, R::select(active, weight, R::zero())]
    }
}

/// Law of a row whose spring and damper are evaluated at the end of a discrete step.
///
/// a_ref = -(K d r + (B + h K d) v) / f and R / f, with f = 1 + h B + h^2 K d (MuJoCo's documentation, "Integrators").
#[derive(Clone, Copy, Debug)]
pub(crate) struct EndLaw<R> {
    /// Coefficients of the error and of its rate in the reference acceleration, before the division by f.
    pub(crate) spring: [R; 2],
    /// Factor f = 1 + h B + h^2 K d.
    pub(crate) factor: R,
}

impl<R: Real> EndLaw<R> {
    /// Effective law at an impedance, for a step of `h` seconds.
    ///
    /// A law that is stiffer than the step resolves, h^2 K d > 1, becomes the stiffest law that does not bounce. It keeps its damping ratio
    /// as far as the largest impedance permits.
    #[inline(always)]
    pub(crate) fn new(law: &SoftLaw<R::Scalar>, impedance: R, h: R) -> Self {
        let (mut stiffness, mut damping) = (R::splat(law.stiffness) * impedance, R::splat(law.damping));
        if law.yields {
            let (rate, most) = (R::one() / h, R::of(IMPEDANCE[1]));
            let excess = h * h * stiffness;
            let unresolved = excess.gt(R::one());
            let largest = most * (R::one() - impedance) / (impedance * (R::one() - most));
            let ratio = damping / R::select(unresolved, excess, R::one()).sqrt();
            let softened = ratio.min((largest - R::of(2.0)).max(R::zero()) * rate);
            stiffness = R::select(unresolved, rate * rate, stiffness);
            damping = R::select(unresolved, softened, damping);
        }
        Self { spring: [stiffness, damping + h * stiffness], factor: R::one() + h * damping + h * h * stiffness }
    }

    /// Regularisation R at this impedance, for this weight, at least that of the largest impedance.
    #[inline(always)]
    pub(crate) fn regularisation(&self, impedance: R, weight: R) -> R {
        let own = SoftLaw::<R::Scalar>::regularisation(impedance, weight) / self.factor;
        own.max((Self::least() * weight).max(R::of(MIN_VALUE)))
    }

    /// Least regularisation divided by the weight.
    #[inline(always)]
    pub(crate) fn least() -> R {
        R::of((1.0 - IMPEDANCE[1]) / IMPEDANCE[1])
    }
}

/// Power x^p, for x in [0, 1].
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

/// Solref with both numbers in one format, or the default.
fn in_one_format(solref: [f64; 2]) -> [f64; 2] {
    if (solref[0] > 0.0) == (solref[1] > 0.0) { solref } else { Softness::default().solref }
}

impl LawMaker {
    /// Stiffness and damping of a solref, which grow with the inverse of the largest impedance.
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
            yields: self.yields && in_one_format(softness.solref)[0] > 0.0,
        }
    }

    /// Law of an equality, which never yields.
    pub(super) fn equality<S: Scalar>(self, softness: &Softness, weight: f64) -> SoftLaw<S> {
        SoftLaw { yields: false, ..self.law(softness, weight) }
    }

    /// Law of dry friction, which has no stiffness.
    pub(super) fn friction<S: Scalar>(self, softness: &Softness, weight: f64) -> SoftLaw<S> {
        SoftLaw { stiffness: S::default(), ..self.equality(softness, weight) }
    }

    pub(super) fn contact<S: Scalar>(self, pair: &GeomPair, weight: f64) -> SoftContactLaw<S> {
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

    /// Spring and damper along the normal, evaluated at the end of the step by Euler's implicit rule.
    ///
    /// f = -K (r + h v+) - D v+ is R f = a_ref - a with R = 1 / (h (h K + D)) and a_ref = -v/h - K r R. With an impedance of 1/2, the
    /// regularisation R equals the inverse weight of the row.
    fn spring_contact<S: Scalar>(self, pair: &GeomPair) -> SoftContactLaw<S> {
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
            yields: false,
        };
        let condim = pair.condim;
        SoftContactLaw { normal, friction_damping: normal.damping, condim, anisotropy: scalars(pair.anisotropy), spring: normal.weight }
    }
}

impl<S: Scalar> CompiledSoftness<S> {
    /// Law of a pair of the compiled model outside the list.
    pub(crate) fn unlisted(&self, pair: &GeomPair) -> SoftContactLaw<S> {
        let [a, b] = pair.geoms;
        self.maker.contact(pair, self.geom_weights[a] + self.geom_weights[b])
    }
}
