//! Parameters: the numbers of a compiled model that every environment may have for itself.
//!
//! They are one flat list of tables, so that a place in it is all it takes to say which of them environments have of their own: a batch keeps
//! (place, a number for every lane) of those alone, and a worker writes them over the shared ones before it steps a group. Stages read them
//! through a [`LaneModel`], one number per lane, and need not know which is which.

use stepper_real::{Real, Scalar};

/// What a contact is like.
#[derive(Clone, Copy, Debug)]
pub struct ContactParams<T> {
    /// Sliding friction; 0 for a frictionless contact.
    pub mu: T,
    /// Torsional friction, m; 0 for none.
    pub torsion: T,
    /// Rolling friction, m; 0 for none.
    pub rolling: T,
    /// Coefficient of restitution.
    pub restitution: T,
}

/// Mass, centre of mass and inertia of a link or of a part of one.
#[derive(Clone, Copy, Debug)]
pub struct Inertial<T> {
    /// kg
    pub mass: T,
    /// In the link's frame, m.
    pub com: [T; 3],
    /// About the centre of mass: xx, yy, zz, xy, xz, yz, kg m^2.
    pub inertia: [T; 6],
}

/// What a degree of freedom adds to the mass matrix.
#[derive(Clone, Copy, Debug)]
pub struct DofParams<T> {
    /// Viscous damping.
    pub damping: T,
    /// Stiffness of its joint's spring that is taken implicitly: 0 for one that pushes away.
    pub stiffness: T,
    /// Added inertia.
    pub armature: T,
}

/// The numbers that environments may have of their own, for all environments (`T` a scalar) or for the lanes of a group.
#[derive(Clone, Debug, Default)]
pub struct Params<T> {
    pub(super) numbers: Vec<T>,
    pub(super) at: Tables,
}

/// Where each table begins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Tables {
    pub(super) gravity: usize,
    pub(super) inertials: usize,
    pub(super) totals: usize,
    pub(super) dofs: usize,
    pub(super) springs: usize,
    pub(super) limits: usize,
    pub(super) ball_limits: usize,
    pub(super) frictions: usize,
    pub(super) actuators: usize,
    pub(super) geoms: usize,
    pub(super) pairs: usize,
    pub(super) members: usize,
    pub(super) bodies: usize,
    pub(super) holds: usize,
    pub(super) fluid: usize,
    pub(super) places: usize,
    pub(super) sizes: usize,
}

/// Numbers of a row of each table that is read in parts.
pub(super) const GEOM: usize = 9;
pub(super) const FLUID: usize = 15;

impl<T: Copy> Params<T> {
    /// Numbers that there are.
    pub fn len(&self) -> usize {
        self.numbers.len()
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    /// All numbers, by their place.
    pub fn numbers(&self) -> &[T] {
        &self.numbers
    }

    /// The same in other numbers.
    pub fn map<U>(&self, f: impl FnMut(T) -> U) -> Params<U> {
        Params { numbers: self.numbers.iter().copied().map(f).collect(), at: self.at }
    }

    #[inline(always)]
    pub(super) fn take<const N: usize>(&self, at: usize) -> [T; N] {
        *self.numbers[at..at + N].first_chunk().expect("N numbers were taken")
    }

    /// Gravitational acceleration, m/s^2.
    #[inline(always)]
    pub fn gravity(&self) -> [T; 3] {
        self.take(self.at.gravity)
    }

    /// Of link `i`, or of part `i - links` of those that sensors read.
    #[inline(always)]
    pub fn inertial(&self, i: usize) -> Inertial<T> {
        let at = self.at.inertials + 10 * i;
        let [mass] = self.take(at);
        Inertial { mass, com: self.take(at + 1), inertia: self.take(at + 4) }
    }

    /// Mass of a subtree that sensors read, kg.
    #[inline(always)]
    pub fn total(&self, subtree: usize) -> T {
        self.numbers[self.at.totals + subtree]
    }

    /// Of a degree of freedom.
    #[inline(always)]
    pub fn dof(&self, i: usize) -> DofParams<T> {
        let [damping, stiffness, armature] = self.take(self.at.dofs + 3 * i);
        DofParams { damping, stiffness, armature }
    }

    /// Of all degrees of freedom: damping, stiffness, armature.
    #[inline(always)]
    pub fn dofs(&self) -> &[[T; 3]] {
        self.numbers[self.at.dofs..self.at.springs].as_chunks().0
    }

    /// Stiffness of a joint's spring, N/m or N m/rad.
    #[inline(always)]
    pub fn spring(&self, joint: usize) -> T {
        self.numbers[self.at.springs + joint]
    }

    /// Lowest and highest position of a limit of the compiled model.
    #[inline(always)]
    pub fn limit(&self, i: usize) -> [T; 2] {
        self.take(self.at.limits + 2 * i)
    }

    /// Greatest angle of the rotation of a ball joint with a limit, rad.
    #[inline(always)]
    pub fn ball_limit(&self, i: usize) -> T {
        self.numbers[self.at.ball_limits + i]
    }

    /// Dry friction, N or N m.
    #[inline(always)]
    pub fn friction(&self, i: usize) -> T {
        self.numbers[self.at.frictions + i]
    }

    /// Affine gain and bias of an actuator.
    #[inline(always)]
    pub fn actuator(&self, i: usize) -> [[T; 3]; 2] {
        let at = self.at.actuators + 6 * i;
        [self.take(at), self.take(at + 3)]
    }

    /// Origin of a geom of the compiled model in its frame, m.
    #[inline(always)]
    pub fn geom_pos(&self, geom: usize) -> [T; 3] {
        self.take(self.at.geoms + GEOM * geom)
    }

    /// radius, half length (capsule, cylinder), half sizes (box) or half axes (ellipsoid), m.
    #[inline(always)]
    pub fn geom_size(&self, geom: usize) -> [T; 3] {
        self.take(self.at.geoms + GEOM * geom + 3)
    }

    /// Radius of a ball about a geom's origin that holds it; infinite for a plane, m.
    #[inline(always)]
    pub fn bounding_radius(&self, geom: usize) -> T {
        self.numbers[self.at.geoms + GEOM * geom + 6]
    }

    /// How thin a geom is: half its least width, infinite for what has one side only, m.
    #[inline(always)]
    pub fn inscribed_radius(&self, geom: usize) -> T {
        self.numbers[self.at.geoms + GEOM * geom + 7]
    }

    /// How far a geom reaches beyond the ball of that radius, which turning cannot be seen of, m.
    #[inline(always)]
    pub fn rotation_reach(&self, geom: usize) -> T {
        self.numbers[self.at.geoms + GEOM * geom + 8]
    }

    #[inline(always)]
    pub(super) fn contact(&self, pair: usize) -> ContactParams<T> {
        let [mu, torsion, rolling, restitution] = self.take(self.at.pairs + 4 * pair);
        ContactParams { mu, torsion, rolling, restitution }
    }

    /// Friction (sliding, torsional, rolling) and restitution that a geom of a crowd brings, by its index in the model.
    #[inline(always)]
    pub(super) fn member(&self, geom: usize) -> [T; 4] {
        self.take(self.at.members + 4 * geom)
    }

    /// Centre of mass of a body of the model in its frame, m.
    #[inline(always)]
    pub fn body_com(&self, body: usize) -> [T; 3] {
        self.take(self.at.bodies + 3 * body)
    }

    /// Where a force against gravity acts in its link's frame (m), and that force (N, world axes).
    #[inline(always)]
    pub fn hold(&self, i: usize) -> [[T; 3]; 2] {
        let at = self.at.holds + 6 * i;
        [self.take(at), self.take(at + 3)]
    }

    /// Centre of a body that the medium acts on, in its link's frame, m.
    #[inline(always)]
    pub fn fluid_pos(&self, i: usize) -> [T; 3] {
        self.take(self.at.fluid + FLUID * i)
    }

    /// Viscous (N m s, N s/m) and quadratic drag (N m s^2, N s^2/m^2) of a box in the medium, torques before forces.
    #[inline(always)]
    pub fn fluid_box(&self, i: usize) -> [[T; 6]; 2] {
        let at = self.at.fluid + FLUID * i + 3;
        [self.take(at), self.take(at + 6)]
    }

    /// Position in its frame of a place that sensors read, m.
    #[inline(always)]
    pub fn place(&self, i: usize) -> [T; 3] {
        self.take(self.at.places + 3 * i)
    }

    /// Size of a shape that sensors read: radius, half length; or semi-axes; or half sizes; m.
    #[inline(always)]
    pub fn size(&self, i: usize) -> [T; 3] {
        self.take(self.at.sizes + 3 * i)
    }
}

impl Params<f64> {
    /// Writes numbers to their places.
    pub fn set(&mut self, numbers: &[(u32, f64)]) {
        numbers.iter().for_each(|&(place, x)| self.numbers[place as usize] = x);
    }
}

impl<S: Scalar> Params<S> {
    /// The same numbers in every lane.
    pub fn in_lanes<R: Real<Scalar = S>>(&self) -> Params<R> {
        self.map(R::splat)
    }
}

impl<R: Real> Params<R> {
    /// Writes the numbers of a group of lanes to their places, (places, lanes).
    pub fn load_lanes(&mut self, places: &[u32], numbers: &[R::Scalar]) {
        for (&place, lanes) in places.iter().zip(numbers.chunks_exact(R::LANES)) {
            self.numbers[place as usize] = R::load(lanes);
        }
    }
}
