//! Force of a soft contact, and its derivative, for each shape of the friction cone.
//!
//! Let u = J a - r be the contact's acceleration relative to its reference acceleration r. The force is minus the slope of a convex
//! function s(u).

use serde::{Deserialize, Serialize};
use stepper_real::{Mask, Real};

use crate::soft::contact::SoftContact;

/// Shape of the friction cone of soft contacts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Cone {
    /// Pyramid whose edges are the directions n + mu_k t_k and n - mu_k t_k for the normal n and each tangent t_k. Each edge has a force.
    #[default]
    Pyramidal,
    /// Elliptic cone `sum (f_k / mu_k)^2 <= f_n^2`.
    Elliptic,
}

/// Region of the relative acceleration u of an elliptic contact: open, sticking or sliding.
struct Zone<R: Real> {
    /// Lanes in which the contact sticks: the force is linear in the relative acceleration.
    sticks: R::Mask,
    /// Lanes in which the contact slides: the force is on the surface of the friction cone.
    slides: R::Mask,
    /// Normal component of the relative acceleration u, scaled to the space in which the friction cone is circular.
    n: R,
    /// Length of the tangential part of the relative acceleration u, scaled to the space in which the friction cone is circular.
    t: R,
    /// Inverse 1 / t of the tangential length t of the relative acceleration u in the scaled space; 1 if t is 0.
    inv_t: R,
    /// Tangential components of the relative acceleration u, scaled to the space in which the friction cone is circular.
    tangents: [R; 6],
}

/// Region (open, sticking or sliding) of an elliptic contact at the relative acceleration `u`. Only the first `U` rows of the contact are
/// in use.
#[inline(always)]
fn zone<R: Real, const N: usize, const U: usize>(contact: &SoftContact<R, N>, u: &[R; N]) -> Zone<R> {
    let mu = contact.scale[0];
    let (n, mut tangents, mut sum) = (u[0] * mu, [R::zero(); 6], R::zero());
    for k in 1..U {
        tangents[k] = u[k] * contact.scale[k];
        sum += tangents[k] * tangents[k];
    }
    let t = sum.sqrt();
    let open = n.ge(mu * t);
    let sticks = (mu * n + t).le(R::zero()).and_not(open);
    let slides = R::Mask::splat(true).and_not(open.or(sticks));
    let inv_t = R::one() / R::select(t.gt(R::zero()), t, R::one());
    Zone { sticks, slides, n, t, inv_t, tangents }
}

impl Cone {
    /// Force of each row of a contact at the relative acceleration `u`, N or N m: minus the slope of the contact's convex function s(u).
    #[inline(always)]
    pub(crate) fn force<R: Real, const N: usize>(self, contact: &SoftContact<R, N>, u: &[R; N]) -> [R; N] {
        if N == 6 && contact.does_not_roll { self.force_of::<R, N, 4>(contact, u) } else { self.force_of::<R, N, N>(contact, u) }
    }

    /// Force of the first `U` rows of a contact, see [`Cone::force`].
    #[inline(always)]
    fn force_of<R: Real, const N: usize, const U: usize>(self, contact: &SoftContact<R, N>, u: &[R; N]) -> [R; N] {
        let mut force = [R::zero(); N];
        match self {
            Cone::Pyramidal => {
                for k in 1..U {
                    let (slope, weight) = (contact.scale[k] * u[k], contact.weight[k]);
                    let [up, down] = [-(u[0] + slope) * weight, -(u[0] - slope) * weight];
                    let (up, down) = (up.max(R::zero()), down.max(R::zero()));
                    force[0] += up + down;
                    // Large forces of both edges cancel. Their rounding errors would not.
                    let both = (u[0] + slope.abs()).lt(R::zero());
                    force[k] = R::select(both, -(slope + slope) * weight, up - down) * contact.scale[k];
                }
            }
            Cone::Elliptic => {
                let (zone, mu) = (zone::<R, N, U>(contact, u), contact.scale[0]);
                let slide = -contact.cone_weight * (zone.n - mu * zone.t) * mu;
                force[0] = R::select(zone.slides, slide, R::select(zone.sticks, -contact.weight[0] * u[0], R::zero()));
                for k in 1..U {
                    let along = -slide * zone.inv_t * zone.tangents[k] * contact.scale[k];
                    force[k] = R::select(zone.slides, along, R::select(zone.sticks, -contact.weight[k] * u[k], R::zero()));
                }
            }
        }
        force
    }

    /// For each friction row of a pyramid, sum of the forces of the row's two edges at the relative acceleration `u`, N. The first number
    /// is 0.
    #[inline(always)]
    pub(super) fn edges<R: Real, const N: usize>(self, contact: &SoftContact<R, N>, u: &[R; N]) -> [R; N] {
        let mut sum = [R::zero(); N];
        for k in 1..N {
            let (slope, weight) = (contact.scale[k] * u[k], contact.weight[k]);
            let [up, down] = [-(u[0] + slope) * weight, -(u[0] - slope) * weight];
            sum[k] = up.max(R::zero()) + down.max(R::zero());
        }
        sum
    }

    /// Second derivative of a contact's convex function s at the relative acceleration `u`: minus the derivative of the force. It is
    /// symmetric and positive semidefinite.
    #[inline(always)]
    pub(crate) fn curvature<R: Real, const N: usize>(self, contact: &SoftContact<R, N>, u: &[R; N]) -> [[R; N]; N] {
        if N == 6 && contact.does_not_roll { self.curvature_of::<R, N, 4>(contact, u) } else { self.curvature_of::<R, N, N>(contact, u) }
    }

    /// Second derivative of a contact's convex function s(u), for the first `U` rows, see [`Cone::curvature`].
    #[inline(always)]
    fn curvature_of<R: Real, const N: usize, const U: usize>(self, contact: &SoftContact<R, N>, u: &[R; N]) -> [[R; N]; N] {
        let mut c = [[R::zero(); N]; N];
        match self {
            Cone::Pyramidal => {
                for k in 1..U {
                    let (slope, weight, mu) = (contact.scale[k] * u[k], contact.weight[k], contact.scale[k]);
                    let up = R::select((u[0] + slope).lt(R::zero()), weight, R::zero());
                    let down = R::select((u[0] - slope).lt(R::zero()), weight, R::zero());
                    c[0][0] += up + down;
                    c[0][k] = (up - down) * mu;
                    c[k][0] = c[0][k];
                    c[k][k] = (up + down) * mu * mu;
                }
            }
            Cone::Elliptic => {
                let (zone, mu) = (zone::<R, N, U>(contact, u), contact.scale[0]);
                for k in 0..U {
                    c[k][k] = R::select(zone.sticks, contact.weight[k], R::zero());
                }
                if zone.slides.none() {
                    return c;
                }
                // With U = diag(mu, mu_1, ...) u and t = U_t / |U_t|: s = w/2 (U_0 - mu |U_t|)^2. The second derivative with respect to U
                // is w (1, -mu t)(1, -mu t)^T + w mu (mu |U_t| - U_0) / |U_t| (I - t t^T).
                let shrink = mu * (mu * zone.t - zone.n) * zone.inv_t;
                let mut row = [R::zero(); N];
                row[0] = R::one();
                for k in 1..U {
                    row[k] = -(mu * zone.tangents[k] * zone.inv_t);
                }
                for i in 0..U {
                    for j in i..U {
                        let mut x = row[i] * row[j];
                        if i > 0 {
                            let across = -(zone.tangents[i] * zone.inv_t * (zone.tangents[j] * zone.inv_t));
                            x += shrink * if i == j { R::one() + across } else { across };
                        }
                        let x = x * contact.cone_weight * contact.scale[i] * contact.scale[j];
                        c[i][j] = R::select(zone.slides, x, c[i][j]);
                        c[j][i] = c[i][j];
                    }
                }
            }
        }
        c
    }

    /// Second derivative of a contact's convex function s at the relative acceleration `u` along `du`. It is du^T C du with the
    /// [curvature](Self::curvature) C, computed without the matrix.
    #[inline(always)]
    pub(crate) fn curvature_along<R: Real, const N: usize>(self, contact: &SoftContact<R, N>, u: &[R; N], du: &[R; N]) -> R {
        if N == 6 && contact.does_not_roll {
            self.curvature_along_of::<R, N, 4>(contact, u, du)
        } else {
            self.curvature_along_of::<R, N, N>(contact, u, du)
        }
    }

    /// Second derivative of a contact's convex function s along `du`, for the first `U` rows, see [`Cone::curvature_along`].
    #[inline(always)]
    fn curvature_along_of<R: Real, const N: usize, const U: usize>(self, contact: &SoftContact<R, N>, u: &[R; N], du: &[R; N]) -> R {
        let mut sum = R::zero();
        match self {
            Cone::Pyramidal => {
                for k in 1..U {
                    let (slope, change, weight) = (contact.scale[k] * u[k], contact.scale[k] * du[k], contact.weight[k]);
                    let [up, down] = [du[0] + change, du[0] - change];
                    sum += R::select((u[0] + slope).lt(R::zero()), weight * up * up, R::zero());
                    sum += R::select((u[0] - slope).lt(R::zero()), weight * down * down, R::zero());
                }
            }
            Cone::Elliptic => {
                let (zone, mu) = (zone::<R, N, U>(contact, u), contact.scale[0]);
                for k in 0..U {
                    sum += contact.weight[k] * du[k] * du[k];
                }
                sum = R::select(zone.sticks, sum, R::zero());
                if zone.slides.none() {
                    return sum;
                }
                // Change of U, as in the curvature: component along t, and squared length.
                let (mut along, mut square) = (R::zero(), R::zero());
                for k in 1..U {
                    let change = contact.scale[k] * du[k];
                    along += zone.tangents[k] * zone.inv_t * change;
                    square += change * change;
                }
                let shrink = mu * (mu * zone.t - zone.n) * zone.inv_t;
                let outward = mu * du[0] - mu * along;
                let slides = contact.cone_weight * (outward * outward + shrink * (square - along * along).max(R::zero()));
                sum = R::select(zone.slides, slides, sum);
            }
        }
        sum
    }
}
