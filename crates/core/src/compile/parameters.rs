//! Parameters: the numbers of a compiled model that can differ between environments.
//!
//! They are one flat list of tables, so that an index identifies each. A batch stores (index, a number for every lane) of the overridden
//! ones alone. A worker writes these over the shared numbers before it steps a group. Stages read all through a
//! [`LaneModel`](crate::compile::LaneModel), one number per lane.
//!
//! The type of a row defines its width and how it is read and written. The list of the tables defines the types of their rows.

use stepper_real::{Real, Scalar};

use crate::compile::parameter_row::{ParameterRow, parameter_rows};

parameter_rows! {
    /// Friction and restitution of a contact.
    ContactParams {
        /// Sliding friction; 0 for a frictionless contact.
        mu: T,
        /// Torsional friction, m; 0 for none.
        torsion: T,
        /// Rolling friction, m; 0 for none.
        rolling: T,
        /// Coefficient of restitution.
        restitution: T,
    }

    /// Mass, centre of mass and inertia of a link or of a part of one.
    Inertial {
        /// Mass, kg.
        mass: T,
        /// Centre of mass in the link's frame, m.
        com: [T; 3],
        /// Inertia about the centre of mass: xx, yy, zz, xy, xz, yz, kg m^2.
        inertia: [T; 6],
    }

    /// Terms that a degree of freedom adds to the mass matrix.
    DofParams {
        /// Viscous damping.
        damping: T,
        /// Implicit stiffness of the joint's spring: 0 for a negative stiffness.
        stiffness: T,
        /// Added inertia.
        armature: T,
    }

    /// Affine force of an actuator.
    ActuatorParams {
        /// Force per unit of control or activation: constant, per length, per velocity.
        gain: [T; 3],
        /// Force without control: constant, per length, per velocity.
        bias: [T; 3],
    }

    /// Placement and sizes of a geom of the compiled model.
    GeomParams {
        /// Origin in its frame, m.
        pos: [T; 3],
        /// Size: radius, half length (capsule, cylinder), half sizes (box) or half axes (ellipsoid), m.
        size: [T; 3],
        /// Radius of a ball about the origin that contains the geom; infinite for a plane, m.
        bounding_radius: T,
        /// Half the least width of the geom, m: infinite for a plane, 0 for a surface, a tenth of the bounding radius for a mesh.
        inscribed_radius: T,
        /// Lever arm with which a rotation moves the geom's surface, m: bounding radius minus inscribed radius.
        ///
        /// 0 for a plane, and for a sphere, whose rotation moves nothing.
        rotation_reach: T,
    }

    /// Force against gravity on a body.
    CompensationParams {
        /// Point of application in the link's frame, m.
        pos: [T; 3],
        /// Force in world axes, N.
        force: [T; 3],
    }

    /// Drag of a body in the medium, as a box; torques before forces.
    FluidParams {
        /// Centre of the body in its link's frame, m.
        pos: [T; 3],
        /// Viscous drag, N m s and N s/m.
        viscous: [T; 6],
        /// Quadratic drag, N m s^2 and N s^2/m^2.
        quadratic: [T; 6],
    }
}

/// Declares the tables: their ranges, the types of their rows, and how one is read.
macro_rules! parameter_tables {
    ($($(#[$doc:meta])* $table:ident: $row:ident($($index:ident)?) -> $kind:ty;)*) => {
        /// Beginning and end of each table.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        struct Tables {
            $($table: [usize; 2],)*
        }

        /// Rows of every table.
        pub(super) struct ParameterRows<T> {
            $($(#[$doc])* pub(super) $table: Vec<$kind>,)*
        }

        impl<T: Copy> From<ParameterRows<T>> for Params<T> {
            fn from(rows: ParameterRows<T>) -> Self {
                let mut numbers = Vec::new();
                let tables = Tables { $($table: write_table(rows.$table, &mut numbers),)* };
                Self { numbers, tables }
            }
        }

        impl<T: Copy> Params<T> {
            $(
                $(#[$doc])*
                #[inline(always)]
                pub fn $row(&self $(, $index: usize)?) -> $kind {
                    self.row(self.tables.$table, 0 $(+ $index)?)
                }
            )*
        }
    };
}

parameter_tables! {
    /// Gravitational acceleration, m/s^2.
    gravity: gravity() -> [T; 3];
    /// Inertial parameters of link `i`, or of part `i - links` of those that sensors read.
    inertials: inertial(i) -> Inertial<T>;
    /// Mass of a subtree that sensors read, kg.
    totals: total(subtree) -> T;
    /// Parameters of a degree of freedom.
    dofs: dof(i) -> DofParams<T>;
    /// Stiffness of a joint's spring, N/m or N m/rad.
    springs: spring(joint) -> T;
    /// Lowest and highest position of a limit of the compiled model.
    limits: limit(i) -> [T; 2];
    /// Largest angle of a ball joint with a limit, rad.
    ball_limits: ball_limit(i) -> T;
    /// Dry friction, N or N m.
    frictions: friction(i) -> T;
    /// Affine force of an actuator.
    actuators: actuator(i) -> ActuatorParams<T>;
    /// Placement and sizes of a geom of the compiled model.
    geoms: geom(i) -> GeomParams<T>;
    /// Contact parameters of a listed pair.
    pairs: listed_contact(pair) -> ContactParams<T>;
    /// Contact parameters of a geom of dynamic pairs, by its index in the model.
    members: member(geom) -> ContactParams<T>;
    /// Centre of mass of a body of the model in its frame, m.
    bodies: body_com(body) -> [T; 3];
    /// Mass of a body of the model, kg.
    masses: mass(body) -> T;
    /// Inertia of a body of the model about its centre of mass in the axes of its frame: xx, yy, zz, xy, xz, yz, kg m^2.
    moments: body_inertia(body) -> [T; 6];
    /// Force against gravity on a body.
    compensations: compensation(i) -> CompensationParams<T>;
    /// Drag of a body in the medium.
    fluid: fluid(i) -> FluidParams<T>;
    /// Position in its frame of an object that sensors read, m.
    places: place(i) -> [T; 3];
    /// Size of a shape that sensors read: radius, half length; or semi-axes; or half sizes; m.
    sizes: size(i) -> [T; 3];
}

/// Numbers that can differ between environments, for all environments (`T` a scalar) or for the lanes of a group.
#[derive(Clone, Debug, Default)]
pub struct Params<T> {
    numbers: Vec<T>,
    tables: Tables,
}

fn write_table<T: Copy, Row: ParameterRow<T>>(rows: Vec<Row>, numbers: &mut Vec<T>) -> [usize; 2] {
    let start = numbers.len();
    rows.into_iter().for_each(|row| row.write(numbers));
    [start, numbers.len()]
}

impl<T: Copy> Params<T> {
    /// Total number of parameters.
    pub fn len(&self) -> usize {
        self.numbers.len()
    }

    /// Whether there are no numbers.
    pub fn is_empty(&self) -> bool {
        self.numbers.is_empty()
    }

    /// All numbers, in the order of the tables.
    pub fn numbers(&self) -> &[T] {
        &self.numbers
    }

    /// Converts the numbers to another type.
    pub fn map<U>(&self, f: impl FnMut(T) -> U) -> Params<U> {
        Params { numbers: self.numbers.iter().copied().map(f).collect(), tables: self.tables }
    }

    #[inline(always)]
    fn row<Row: ParameterRow<T>>(&self, table: [usize; 2], i: usize) -> Row {
        let at = table[0] + Row::WIDTH * i;
        Row::read(&self.numbers[at..at + Row::WIDTH])
    }

    /// Numbers of all degrees of freedom, those of a [`DofParams`] each: damping, stiffness, armature.
    #[inline(always)]
    pub fn dofs(&self) -> &[[T; 3]] {
        let [start, end] = self.tables.dofs;
        self.numbers[start..end].as_chunks().0
    }

    /// Whether any of some places, ascending, is in the table of geoms.
    pub fn has_geoms(&self, places: &[u32]) -> bool {
        let [start, end] = self.tables.geoms.map(|at| places.partition_point(|&place| (place as usize) < at));
        start < end
    }

    /// Origin of a geom of the compiled model in its frame, m.
    #[inline(always)]
    pub fn geom_pos(&self, geom: usize) -> [T; 3] {
        self.geom(geom).pos
    }

    /// Size of a geom: radius, half length (capsule, cylinder), half sizes (box) or half axes (ellipsoid), m.
    #[inline(always)]
    pub fn geom_size(&self, geom: usize) -> [T; 3] {
        self.geom(geom).size
    }

    /// Radius of a ball about a geom's origin that contains the geom; infinite for a plane, m.
    #[inline(always)]
    pub fn bounding_radius(&self, geom: usize) -> T {
        self.geom(geom).bounding_radius
    }

    /// Half the least width of a geom, m; see [`GeomParams`].
    #[inline(always)]
    pub fn inscribed_radius(&self, geom: usize) -> T {
        self.geom(geom).inscribed_radius
    }

    /// Lever arm with which a rotation moves a geom's surface, m; see [`GeomParams`].
    #[inline(always)]
    pub fn rotation_reach(&self, geom: usize) -> T {
        self.geom(geom).rotation_reach
    }
}

impl Params<f64> {
    /// Writes numbers to their places.
    pub fn set(&mut self, numbers: &[(u32, f64)]) {
        numbers.iter().for_each(|&(place, x)| self.numbers[place as usize] = x);
    }
}

impl<S: Scalar> Params<S> {
    /// Copies the numbers to every lane.
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
