//! Builder of a geom.

use nalgebra::{Quaternion, UnitQuaternion};

use crate::orientation::Orientation;
use crate::{ContactSpring, Description, Geom, MassProperties, Shape};

/// Density of a geom whose mass and density are not set, kg/m^3: the density of water.
const DENSITY: f64 = 1000.0;

/// Builder of a geom. By default it is a solid with a density of 1000 kg/m^3.
#[derive(Clone, Debug)]
pub struct GeomBuilder {
    pub(super) geom: Geom,
    mass: Option<f64>,
    density: f64,
}

impl GeomBuilder {
    fn new(name: &str, shape: Shape) -> Self {
        let geom = Geom {
            name: name.into(),
            shape,
            quat: [1.0, 0.0, 0.0, 0.0],
            contype: 1,
            conaffinity: 1,
            condim: 3,
            friction: [1.0, 0.005, 0.0001],
            solmix: 1.0,
            ..Geom::default()
        };
        Self { geom, mass: None, density: DENSITY }
    }

    /// Creates a builder of a geom whose shape is the surface of the mesh with the name `asset`, including its hollows. The geom has no
    /// mass.
    pub fn concave_mesh(name: &str, asset: &str) -> Self {
        Self::new(name, Shape::Mesh { asset: asset.into(), concave: true }).mass(0.0)
    }

    /// Creates a builder of a geom whose shape is the height field with the name `asset`, see
    /// [`ModelBuilder::height_field`](crate::ModelBuilder::height_field). The geom has no mass.
    pub fn height_field(name: &str, asset: &str) -> Self {
        Self::new(name, Shape::HeightField { asset: asset.into() }).mass(0.0)
    }

    /// Sets the pose in the body's frame.
    #[cfg(feature = "nalgebra")]
    pub fn pose(self, pose: nalgebra::Isometry3<f64>) -> Self {
        self.pos(pose.translation.vector).quat(pose.rotation)
    }

    pub(super) fn mass_properties(&self, model: &Description) -> MassProperties {
        let g = &self.geom;
        let solid = match (model.mesh_of(&g.shape), self.mass) {
            (Some(mesh), Some(mass)) => {
                mesh.mass_properties(1.0).map(|unit| MassProperties { mass, inertia: unit.inertia * (mass / unit.mass), ..unit })
            }
            (Some(mesh), None) => mesh.mass_properties(self.density),
            (None, mass) => {
                let mass = mass.or_else(|| MassProperties::volume(&g.shape).map(|v| v * self.density));
                mass.and_then(|m| MassProperties::solid(&g.shape, m))
            }
        };
        let solid = solid.unwrap_or_else(MassProperties::default);
        let quat = Quaternion::new(g.quat[0], g.quat[1], g.quat[2], g.quat[3]);
        solid.placed(g.pos.into(), UnitQuaternion::new_normalize(quat))
    }
}

constructors! { GeomBuilder
    /// Creates a builder of a plane, which is the half space below the xy plane of the geom's frame.
    plane() { Shape::Plane }
    /// Creates a builder of a sphere with the given radius, m.
    sphere(radius: f64) { Shape::Sphere { radius } }
    /// Creates a builder of a capsule along z with the given radius, m. `half_length` is half the length of its segment, m.
    capsule(radius: f64, half_length: f64) { Shape::Capsule { radius, half_length } }
    /// Creates a builder of a solid cylinder along z with the given radius, m. `half_length` is half the length of the cylinder, m.
    cylinder(radius: f64, half_length: f64) { Shape::Cylinder { radius, half_length } }
    /// Creates a builder of an ellipsoid with the given semi-axes, m.
    ellipsoid(radii: impl Into<[f64; 3]>) { Shape::Ellipsoid { radii: radii.into() } }
    /// Creates a builder of a box with the given half sizes, m.
    cuboid(half: impl Into<[f64; 3]>) { Shape::Box { half: half.into() } }
    /// Creates a builder of a geom whose shape is the convex hull of the mesh with the name `asset`, see
    /// [`ModelBuilder::mesh`](crate::ModelBuilder::mesh).
    mesh(asset: &str) { Shape::Mesh { asset: asset.into(), concave: false } }
}

setters! { GeomBuilder
    /// Sets the position in the body's frame, m.
    pos(pos: impl Into<[f64; 3]>) { geom.pos = pos.into() }
    /// Sets the orientation in the body's frame: quaternion [w, x, y, z], or nalgebra's `UnitQuaternion` with the feature `nalgebra`.
    quat(quat: impl Into<Orientation>) { geom.quat = quat.into().0 }
    /// Sets the mass, kg. The value 0 makes a shape without mass.
    mass(mass: f64) { mass = Some(mass) }
    /// Sets the density, kg/m^3.
    density(density: f64) { mass = None; density = density }
    /// Sets the collision bit masks `contype` and `conaffinity`. A geom with (0, 0) collides with nothing, except in explicit pairs.
    masks(contype: u32, conaffinity: u32) { geom.contype = contype; geom.conaffinity = conaffinity }
    /// Sets the dimension of contacts: 1 for frictionless, 3 for sliding, 4 also for torsional, and 6 also for rolling friction.
    condim(condim: u8) { geom.condim = condim }
    /// Sets the priority. A contact has the friction and condim of its geom with the higher priority.
    priority(priority: i32) { geom.priority = priority }
    /// Sets the friction coefficients: sliding, torsional (m) and rolling (m).
    friction(friction: [f64; 3]) { geom.friction = friction }
    /// Makes the surface compliant: `stiffness` in N/m, `damping` in N s/m.
    spring(stiffness: f64, damping: f64) { geom.spring = ContactSpring { stiffness, damping } }
    /// Sets Newton's coefficient of restitution, from 0 to 1.
    restitution(restitution: f64) { geom.restitution = restitution }
    /// Sets the distance below which a contact pushes, m.
    margin(margin: f64) { geom.margin = margin }
    /// Sets the distance beyond the margin up to which a contact is reported without pushing, m.
    gap(gap: f64) { geom.gap = gap }
    /// Sets the velocity of the surface in contacts, as of a conveyor, in the geom's axes: linear at its origin (m/s), and angular (rad/s).
    surface_velocity(velocity: [f64; 6]) { geom.surface_velocity = velocity }
}
