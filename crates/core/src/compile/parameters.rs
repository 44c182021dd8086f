//! Parameters: the numbers of a compiled model that can differ between environments.
//!
//! All parameters are in one flat list, so that one index identifies each number. The list consists of tables, such as that of the contact
//! parameters of all pairs. A batch stores only overridden parameters: their indices, and a value for every lane. Before a worker steps a
//! group, it writes the group's values to its lane model (`load_lanes`). The stages of a step read all parameters from a
//! [`LaneModel`](crate::compile::LaneModel), one value per lane.
//!
//! Each table has a row type, which defines the width of its rows and how they are read and written.

use stepper_real::Real;

use crate::compile::parameter_row::{ParameterRow, parameter_rows};

parameter_rows! {
    /// Friction and restitution coefficients of a contact, or of a geom.
    ContactParams {
        /// Sliding friction coefficient; 0 for a frictionless contact.
        mu: T,
        /// Torsional friction coefficient, m; 0 for none.
        torsion: T,
        /// Rolling friction coefficient, m; 0 for none.
        rolling: T,
        /// Coefficient of restitution.
        restitution: T,
    }

    /// Mass, centre of mass and inertia of a link, or of a subtree part: the bodies of a sensor's subtree that are fixed to one frame.
    Inertial {
        /// Mass, kg.
        mass: T,
        /// Centre of mass in the link's frame, m.
        com: [T; 3],
        /// Inertia about the centre of mass in the link's axes: xx, yy, zz, xy, xz, yz, kg m^2.
        inertia: [T; 6],
    }

    /// Parameters of a degree of freedom that contribute to the mass matrix, or to the implicit terms that a step adds to the matrix.
    DofParams {
        /// Viscous damping, N s/m or N m s/rad.
        damping: T,
        /// Stiffness of the joint's spring in the implicit terms, N/m or N m/rad; 0 if the spring has a negative stiffness.
        stiffness: T,
        /// Armature inertia, kg or kg m^2.
        armature: T,
    }

    /// Coefficients of an actuator's affine force.
    ActuatorParams {
        /// Coefficients of the factor that multiplies the control or activation (`gainprm`): constant, per length, and per velocity.
        gain: [T; 3],
        /// Coefficients of the force without control (`biasprm`): constant, per length, and per velocity.
        bias: [T; 3],
    }

    /// Position and sizes of a geom of the compiled model.
    GeomParams {
        /// Origin of the geom in its frame, m.
        pos: [T; 3],
        /// Sizes of the geom, m: radius, half length (capsule, cylinder), half sizes (box) or half axes (ellipsoid).
        size: [T; 3],
        /// Radius of the ball about the geom's origin that contains the geom, m; infinite for a plane.
        bounding_radius: T,
        /// Radius of the largest ball about the shape's centre that is inside the geom, m. Infinite for a plane; 0 for a height field and
        /// for a mesh that collides as its triangles.
        inscribed_radius: T,
        /// Lever arm with which a rotation displaces the geom's surface, m: bounding radius minus inscribed radius.
        ///
        /// 0 for a plane, and for a sphere, which does not change when it rotates.
        rotation_reach: T,
    }

    /// Numbers of an equality: points and orientation of a connect or weld, or polynomial of a coupling. Numbers that the kind of equality
    /// does not have are 0.
    EqualityParams {
        /// Position of the connected point in the frame of the first body, m.
        first: [T; 3],
        /// Position of the connected point in the frame of the second body, m.
        second: [T; 3],
        /// Orientation in the first frame with which the second body is aligned, a rotation matrix.
        orientation: [T; 9],
        /// Weight of the rotation error relative to the position error, m/rad.
        weight: T,
        /// Coefficients of the polynomial, for the powers 0 to 4.
        polynomial: [T; 5],
    }

    /// Gravity compensation force on a body.
    CompensationParams {
        /// Point of application in the link's frame, m.
        pos: [T; 3],
        /// Force in world axes, N.
        force: [T; 3],
    }

    /// Drag coefficients of a body's inertia box in the surrounding fluid, rotation before translation. For a geom, whose fluid forces have
    /// the ellipsoid model, the coefficients are 0.
    FluidParams {
        /// Centre of mass of the body, or origin of the geom, in the frame to which the object is fixed, m.
        pos: [T; 3],
        /// Viscous drag coefficients: three of rotation, N m s, and three of translation, N s/m.
        viscous: [T; 6],
        /// Quadratic drag coefficients: three of rotation, N m s^2, and three of translation, N s^2/m^2.
        quadratic: [T; 6],
    }
}

/// Declares the parameter tables. For each table, it declares the range in the list of parameters, the type of a row, and a function that
/// reads a row.
macro_rules! parameter_tables {
    ($($(#[$doc:meta])* $table:ident: $row:ident($($index:ident)?) -> $kind:ty;)*) => {
        /// Range (start and end) of each table in the list of parameters.
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
        struct Tables {
            $($table: [usize; 2],)*
        }

        /// Rows of every parameter table, one list per table. The conversion to [`Params`] joins them to one list of numbers.
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
    /// Mass, centre of mass and inertia of link `i`. If `i` is at least the number of links, it selects a subtree part: the bodies of a
    /// sensor's subtree that are fixed to one frame.
    inertials: inertial(i) -> Inertial<T>;
    /// Mass of the subtree with index `subtree` among those that sensors read, kg.
    totals: total(subtree) -> T;
    /// Mass matrix parameters of degree of freedom `i`.
    dofs: dof(i) -> DofParams<T>;
    /// Stiffness of the spring of joint `joint`, N/m or N m/rad.
    springs: spring(joint) -> T;
    /// Lowest and highest position of limit `i` of the compiled model, m or rad.
    limits: limit(i) -> [T; 2];
    /// Largest rotation angle of ball joint limit `i`, rad.
    ball_limits: ball_limit(i) -> T;
    /// Dry friction force of entry `i` in the compiled model's list of dry friction, N or N m.
    frictions: friction(i) -> T;
    /// Affine force coefficients of actuator `i`.
    actuators: actuator(i) -> ActuatorParams<T>;
    /// Position and sizes of geom `i` of the compiled model.
    geoms: geom(i) -> GeomParams<T>;
    /// Contact parameters of the listed pair with index `pair` in the compiled model.
    pairs: listed_contact(pair) -> ContactParams<T>;
    /// Contact parameters of the geom with index `geom` in the model. The table has all geoms if the model has dynamic pairs, which the
    /// broad phase finds in every step, and is empty otherwise. A dynamic pair combines the parameters of its two geoms.
    geom_contacts: geom_contact(geom) -> ContactParams<T>;
    /// Centre of mass of a body of the model in the frame to which the body is fixed, m.
    bodies: body_com(body) -> [T; 3];
    /// Mass of a body of the model, kg.
    masses: mass(body) -> T;
    /// Inertia of a body of the model about its centre of mass: xx, yy, zz, xy, xz, yz, kg m^2. The axes are those of the frame to which
    /// the body is fixed.
    moments: body_inertia(body) -> [T; 6];
    /// Points, orientation and polynomial of the equality with index `i` in the model.
    equalities: equality(i) -> EqualityParams<T>;
    /// Gravity compensation force with index `i`, and its point of application.
    compensations: compensation(i) -> CompensationParams<T>;
    /// Drag coefficients of the body with index `i` in the compiled model's list of bodies and geoms in a fluid.
    fluid: fluid(i) -> FluidParams<T>;
    /// Position of the object with index `i` among the objects that sensors read, in the frame to which it is fixed, m.
    places: place(i) -> [T; 3];
    /// Size of the shape with index `i` among the shapes that sensors read, m: radius and half length, or half axes, or half sizes.
    sizes: size(i) -> [T; 3];
}

/// Parameters of a compiled model in one list. `T` is a scalar for values that environments share, or a SIMD type for one value per lane.
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
    /// All values, in the order of the tables.
    pub fn numbers(&self) -> &[T] {
        &self.numbers
    }

    /// Parameters with every value converted by `f`.
    pub fn map<U>(&self, f: impl FnMut(T) -> U) -> Params<U> {
        Params { numbers: self.numbers.iter().copied().map(f).collect(), tables: self.tables }
    }

    #[inline(always)]
    fn row<Row: ParameterRow<T>>(&self, table: [usize; 2], i: usize) -> Row {
        let at = table[0] + Row::WIDTH * i;
        Row::read(&self.numbers[at..at + Row::WIDTH])
    }

    /// Parameters of all degrees of freedom, in the order of [`DofParams`]: damping, stiffness, armature.
    #[inline(always)]
    pub fn dofs(&self) -> &[[T; 3]] {
        let [start, end] = self.tables.dofs;
        self.numbers[start..end].as_chunks().0
    }

    /// Whether any of the parameters with the indices `indices` (ascending) is in the table of geoms.
    pub fn has_geoms(&self, indices: &[u32]) -> bool {
        let [start, end] = self.tables.geoms.map(|at| indices.partition_point(|&index| (index as usize) < at));
        start < end
    }
}

impl Params<f64> {
    /// Sets parameters from pairs of parameter index and value.
    pub fn set(&mut self, numbers: &[(u32, f64)]) {
        numbers.iter().for_each(|&(index, x)| self.numbers[index as usize] = x);
    }
}

impl<R: Real> Params<R> {
    /// Sets the parameters with the indices `indices` to per-lane values. `numbers` has one value per lane for each index, index by index.
    pub fn load_lanes(&mut self, indices: &[u32], numbers: &[R::Scalar]) {
        for (&index, lanes) in indices.iter().zip(numbers.chunks_exact(R::LANES)) {
            self.numbers[index as usize] = R::load(lanes);
        }
    }
}
