//! Projection on the friction cone with any number of tangents, in scalar f64.

/// Region of a point (n, |t|) that is projected on the cone of friction `mu`.
#[derive(Clone, Copy, Debug)]
pub(super) enum ConeRegion {
    /// The polar cone: the nearest point is 0.
    Zero,
    /// The cone itself.
    Inside,
    /// The region between them: the nearest point has this normal component, and mu times it along the tangent.
    Surface { height: f64 },
}

impl ConeRegion {
    #[inline(always)]
    pub(super) fn of(n: f64, tangent: f64, mu: f64) -> Self {
        if n >= 0.0 && tangent <= mu * n {
            Self::Inside
        } else if mu * tangent <= -n {
            Self::Zero
        } else {
            Self::Surface { height: (mu * tangent + n) / (1.0 + mu * mu) }
        }
    }

    /// Projection: the normal component of the nearest point, and the factor of its tangential ones.
    #[inline(always)]
    pub(super) fn image(self, n: f64, tangent: f64, mu: f64) -> (f64, f64) {
        match self {
            ConeRegion::Zero => (0.0, 0.0),
            ConeRegion::Inside => (n, 1.0),
            ConeRegion::Surface { height } => (height, if tangent > 0.0 { mu * height / tangent } else { 0.0 }),
        }
    }
}

/// Length of a vector.
#[inline(always)]
pub(super) fn norm(x: &[f64]) -> f64 {
    inner(x, x).sqrt()
}

/// Sum of products, one after the other.
#[inline(always)]
pub(super) fn inner(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).fold(0.0, |sum, (a, b)| sum + a * b)
}
