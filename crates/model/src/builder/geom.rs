//! A geom.

use nalgebra::{Quaternion, UnitQuaternion};

use crate::builder::WORLD;
use crate::orientation::Orientation;
use crate::{ContactSpring, Description, Geom, MassProperties, Shape, Softness};

/// Density of a geom that gives neither mass nor density: that of water, kg/m^3.
const DENSITY: f64 = 1000.0;

/// A geom; solid of density 1000 kg/m^3 unless told otherwise.
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
            body: WORLD,
            shape,
            pos: [0.0; 3],
            quat: [1.0, 0.0, 0.0, 0.0],
            contype: 1,
            conaffinity: 1,
            condim: 3,
            priority: 0,
            friction: [1.0, 0.005, 0.0001],
            restitution: 0.0,
            margin: 0.0,
            gap: 0.0,
            surface_velocity: [0.0; 6],
            fluid: None,
            softness: Softness::default(),
            solmix: 1.0,
            spring: ContactSpring::default(),
        };
        Self { geom, mass: None, density: DENSITY }
    }

    /// The half space below the frame's xy plane.
    pub fn plane(name: &str) -> Self {
        Self::new(name, Shape::Plane)
    }

    /// A ball; radius in m.
    pub fn sphere(name: &str, radius: f64) -> Self {
        Self::new(name, Shape::Sphere { radius })
    }

    /// A segment along z of twice this half length, thickened; m.
    pub fn capsule(name: &str, radius: f64, half_length: f64) -> Self {
        Self::new(name, Shape::Capsule { radius, half_length })
    }

    /// A solid cylinder along z; m.
    pub fn cylinder(name: &str, radius: f64, half_length: f64) -> Self {
        Self::new(name, Shape::Cylinder { radius, half_length })
    }

    /// An ellipsoid; semi-axes in m.
    pub fn ellipsoid(name: &str, radii: impl Into<[f64; 3]>) -> Self {
        Self::new(name, Shape::Ellipsoid { radii: radii.into() })
    }

    /// A box; half sizes in m.
    pub fn cuboid(name: &str, half: impl Into<[f64; 3]>) -> Self {
        Self::new(name, Shape::Box { half: half.into() })
    }

    /// The convex hull of the mesh `asset` of the builder.
    pub fn mesh(name: &str, asset: &str) -> Self {
        Self::new(name, Shape::Mesh { asset: asset.into(), concave: false })
    }

    /// The surface of the mesh `asset` of the builder, hollows included; without mass.
    pub fn concave_mesh(name: &str, asset: &str) -> Self {
        Self::new(name, Shape::Mesh { asset: asset.into(), concave: true }).mass(0.0)
    }

    /// The height field `asset` of the builder; without mass.
    pub fn height_field(name: &str, asset: &str) -> Self {
        Self::new(name, Shape::HeightField { asset: asset.into() }).mass(0.0)
    }

    /// Places it in the body's frame, m.
    pub fn pos(mut self, pos: impl Into<[f64; 3]>) -> Self {
        self.geom.pos = pos.into();
        self
    }

    /// Turns it in the body's frame: quaternion [w, x, y, z], or nalgebra's with the feature `nalgebra`.
    pub fn quat(mut self, quat: impl Into<Orientation>) -> Self {
        self.geom.quat = quat.into().0;
        self
    }

    /// Places and turns it, in the body's frame.
    #[cfg(feature = "nalgebra")]
    pub fn pose(self, pose: nalgebra::Isometry3<f64>) -> Self {
        self.pos(pose.translation.vector).quat(pose.rotation)
    }

    /// Gives it a mass, kg; 0 makes it a shape without mass.
    pub fn mass(mut self, mass: f64) -> Self {
        self.mass = Some(mass);
        self
    }

    /// Gives it a density, kg/m^3.
    pub fn density(mut self, density: f64) -> Self {
        (self.mass, self.density) = (None, density);
        self
    }

    /// Sets `contype` and `conaffinity`; (0, 0) collides with nothing.
    pub fn masks(mut self, contype: u32, conaffinity: u32) -> Self {
        (self.geom.contype, self.geom.conaffinity) = (contype, conaffinity);
        self
    }

    /// Sets the rows of a contact: 1 frictionless, 3 sliding friction.
    pub fn condim(mut self, condim: u8) -> Self {
        self.geom.condim = condim;
        self
    }

    /// Sets the priority of its friction and condim.
    pub fn priority(mut self, priority: i32) -> Self {
        self.geom.priority = priority;
        self
    }

    /// Sets friction: sliding (1), torsional (m), rolling (m).
    pub fn friction(mut self, friction: [f64; 3]) -> Self {
        self.geom.friction = friction;
        self
    }

    /// Makes its surface a spring (N/m) and a damper (N s/m) in place of a rigid one.
    pub fn spring(mut self, stiffness: f64, damping: f64) -> Self {
        self.geom.spring = ContactSpring { stiffness, damping };
        self
    }

    /// Sets Newton's coefficient of restitution, 0 to 1.
    pub fn restitution(mut self, restitution: f64) -> Self {
        self.geom.restitution = restitution;
        self
    }

    /// Sets the distance at which a contact begins to push, m.
    pub fn margin(mut self, margin: f64) -> Self {
        self.geom.margin = margin;
        self
    }

    /// Sets the distance beyond the margin within which a contact is reported, m.
    pub fn gap(mut self, gap: f64) -> Self {
        self.geom.gap = gap;
        self
    }

    /// Lets its surface move as contacts see it, in its own axes: linear (m/s) and angular about its origin (rad/s).
    pub fn surface_velocity(mut self, velocity: [f64; 6]) -> Self {
        self.geom.surface_velocity = velocity;
        self
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
        let solid = solid.unwrap_or_else(MassProperties::zero);
        let quat = Quaternion::new(g.quat[0], g.quat[1], g.quat[2], g.quat[3]);
        solid.placed(g.pos.into(), UnitQuaternion::new_normalize(quat))
    }
}
