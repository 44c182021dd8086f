//! Mass properties of shapes in closed form, and their combination.

use nalgebra::{Matrix3, Rotation3, SymmetricEigen, UnitQuaternion, Vector3};

use crate::Shape;

/// Mass, centre of mass and inertia of a body, all in the same frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MassProperties {
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass, m.
    pub com: Vector3<f64>,
    /// Inertia about the centre of mass in the axes of the frame, kg m^2.
    pub inertia: Matrix3<f64>,
}

impl MassProperties {
    /// Volume of a shape, m^3. `None` for shapes without a volume (plane, height field) and for meshes, whose volume
    /// [`Mesh::mass_properties`](crate::Mesh::mass_properties) computes.
    pub fn volume(shape: &Shape) -> Option<f64> {
        use std::f64::consts::PI;
        match *shape {
            Shape::Sphere { radius: r } => Some(4.0 / 3.0 * PI * r.powi(3)),
            Shape::Capsule { radius: r, half_length: h } => Some(PI * r * r * (2.0 * h + 4.0 / 3.0 * r)),
            Shape::Cylinder { radius: r, half_length: h } => Some(PI * r * r * 2.0 * h),
            Shape::Ellipsoid { radii: [a, b, c] } => Some(4.0 / 3.0 * PI * a * b * c),
            Shape::Box { half: [a, b, c] } => Some(8.0 * a * b * c),
            Shape::Plane | Shape::Mesh { .. } | Shape::HeightField { .. } => None,
        }
    }

    /// Mass properties of a solid of uniform density with the mass `mass`, kg, in the geom's frame. The result is `None` for shapes for
    /// which [`MassProperties::volume`] is `None`.
    pub fn solid(shape: &Shape, mass: f64) -> Option<Self> {
        let moments = match *shape {
            Shape::Sphere { radius: r } => [0.4 * r * r; 3],
            Shape::Capsule { radius, half_length } => capsule(radius, half_length),
            Shape::Cylinder { radius: r, half_length: h } => {
                let across = (3.0 * r * r + 4.0 * h * h) / 12.0;
                [across, across, r * r / 2.0]
            }
            Shape::Ellipsoid { radii: [a, b, c] } => [b * b + c * c, a * a + c * c, a * a + b * b].map(|x| x / 5.0),
            Shape::Box { half: [a, b, c] } => [b * b + c * c, a * a + c * c, a * a + b * b].map(|x| x / 3.0),
            Shape::Plane | Shape::Mesh { .. } | Shape::HeightField { .. } => return None,
        };
        Some(Self { mass, com: Vector3::zeros(), inertia: Matrix3::from_diagonal(&Vector3::from(moments.map(|i| i * mass))) })
    }

    /// Mass properties in a parent frame. `pos` (m) and `quat` are the position and orientation, in the parent frame, of the frame to which
    /// `self` refers.
    pub fn placed(&self, pos: Vector3<f64>, quat: UnitQuaternion<f64>) -> Self {
        let r = quat.to_rotation_matrix();
        Self { mass: self.mass, com: pos + r * self.com, inertia: r.matrix() * self.inertia * r.matrix().transpose() }
    }

    /// Mass properties of two bodies combined, by the parallel axis theorem.
    pub fn plus(&self, other: &Self) -> Self {
        let mass = self.mass + other.mass;
        if mass == 0.0 {
            return Self { mass, com: self.com, inertia: self.inertia + other.inertia };
        }
        let com = (self.com * self.mass + other.com * other.mass) / mass;
        Self { mass, com, inertia: self.inertia_about(com) + other.inertia_about(com) }
    }

    /// Inertia about the point `point` in the axes of the frame, kg m^2.
    pub fn inertia_about(&self, point: Vector3<f64>) -> Matrix3<f64> {
        let d = self.com - point;
        self.inertia + (Matrix3::identity() * d.norm_squared() - d * d.transpose()) * self.mass
    }

    /// Orientation of the principal axes in the frame, and the principal moments, kg m^2. If the inertia is diagonal, the orientation is
    /// the identity.
    pub fn principal(&self) -> (UnitQuaternion<f64>, Vector3<f64>) {
        let i = &self.inertia;
        let off = i.m12.abs().max(i.m13.abs()).max(i.m23.abs());
        if off <= 1e-14 * i.diagonal().amax() {
            return (UnitQuaternion::identity(), i.diagonal());
        }
        let eigen = SymmetricEigen::new((i + i.transpose()) / 2.0);
        let mut axes = eigen.eigenvectors;
        if axes.determinant() < 0.0 {
            axes.column_mut(2).neg_mut();
        }
        (UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes)), eigen.eigenvalues.map(|x| x.max(0.0)))
    }
}

/// Principal moments of a capsule per unit of mass, m^2. The capsule is a cylinder and two hemispheres of the same density. `r` is the
/// radius and `h` half the length of the cylinder, m.
///
/// The centre of mass of a hemisphere is 3/8 r from its flat face, and its transverse moment per unit of mass about that centre is (2/5 -
/// 9/64) r^2.
fn capsule(r: f64, h: f64) -> [f64; 3] {
    let (cylinder, ball) = (2.0 * h, 4.0 / 3.0 * r);
    let (cylinder, ball) = (cylinder / (cylinder + ball), ball / (cylinder + ball));
    let across = cylinder * (3.0 * r * r + 4.0 * h * h) / 12.0 + ball * ((0.4 - 9.0 / 64.0) * r * r + (h + 0.375 * r).powi(2));
    [across, across, cylinder * r * r / 2.0 + ball * 0.4 * r * r]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) {
        assert!((a - b).abs() <= 1e-12 * b.abs().max(1e-9), "{a} {b}");
    }

    /// Volume (m^3) of a region, and its principal moments per unit of mass (m^2), computed from the points of a fine grid that are inside.
    fn by_grid(extent: [f64; 3], inside: impl Fn(Vector3<f64>) -> bool) -> (f64, [f64; 3]) {
        let n = 80;
        let at = |k: usize, e: f64| -e + (2 * k + 1) as f64 * e / n as f64;
        let (mut count, mut second) = (0.0, Vector3::zeros());
        for (x, y, z) in (0..n * n * n).map(|k| (at(k % n, extent[0]), at(k / n % n, extent[1]), at(k / n / n, extent[2]))) {
            if inside(Vector3::new(x, y, z)) {
                count += 1.0;
                second += Vector3::new(y * y + z * z, x * x + z * z, x * x + y * y);
            }
        }
        let cell = 8.0 * extent.iter().product::<f64>() / (n * n * n) as f64;
        (count * cell, (second / count).into())
    }

    #[test]
    fn closed_forms_match_a_grid() {
        type Inside = fn(Vector3<f64>) -> bool;
        let shapes: [(Shape, [f64; 3], Inside); 4] = [
            (Shape::Sphere { radius: 0.5 }, [0.5; 3], |p| p.norm() < 0.5),
            (Shape::Capsule { radius: 0.3, half_length: 0.5 }, [0.3, 0.3, 0.8], |p| {
                Vector3::new(p.x, p.y, (p.z.abs() - 0.5).max(0.0)).norm() < 0.3
            }),
            (Shape::Cylinder { radius: 0.3, half_length: 0.5 }, [0.3, 0.3, 0.5], |p| p.xy().norm() < 0.3),
            (Shape::Ellipsoid { radii: [0.3, 0.4, 0.5] }, [0.3, 0.4, 0.5], |p| Vector3::new(p.x / 0.3, p.y / 0.4, p.z / 0.5).norm() < 1.0),
        ];
        for (shape, extent, inside) in shapes {
            let (volume, moments) = by_grid(extent, inside);
            let solid = MassProperties::solid(&shape, 2.0).unwrap();
            assert!((MassProperties::volume(&shape).unwrap() / volume - 1.0).abs() < 2e-3, "{shape:?}");
            for k in 0..3 {
                assert!((solid.inertia[(k, k)] / (2.0 * moments[k]) - 1.0).abs() < 2e-3, "{shape:?} {k}");
            }
        }
    }

    #[test]
    fn two_halves_make_the_whole() {
        let half = MassProperties::solid(&Shape::Box { half: [0.5, 0.2, 0.1] }, 3.0).unwrap();
        let whole = MassProperties::solid(&Shape::Box { half: [1.0, 0.2, 0.1] }, 6.0).unwrap();
        let at = |x: f64| half.placed(Vector3::new(x, 0.0, 0.0), UnitQuaternion::identity());
        let sum = at(-0.5).plus(&at(0.5));
        close(sum.mass, 6.0);
        (0..3).for_each(|k| close(sum.inertia[(k, k)], whole.inertia[(k, k)]));
        assert_eq!(sum.com.norm(), 0.0);
    }

    #[test]
    fn principal_axes_rebuild_the_inertia() {
        let turned = UnitQuaternion::from_euler_angles(0.3, -0.7, 1.1);
        let solid = MassProperties::solid(&Shape::Box { half: [0.5, 0.2, 0.1] }, 3.0).unwrap().placed(Vector3::zeros(), turned);
        let (quat, moments) = solid.principal();
        let r = quat.to_rotation_matrix();
        let rebuilt = r.matrix() * Matrix3::from_diagonal(&moments) * r.matrix().transpose();
        assert!((rebuilt - solid.inertia).norm() < 1e-14);
    }

    #[test]
    fn a_mesh_has_no_closed_form() {
        assert!(MassProperties::solid(&Shape::Mesh { asset: "cow".into(), concave: false }, 1.0).is_none());
        assert!(MassProperties::volume(&Shape::Plane).is_none());
    }
}
