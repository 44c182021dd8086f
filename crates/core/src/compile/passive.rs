//! Compiled forces of the surrounding fluid, gravity compensation, and surfaces that move without a degree of freedom.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};
use stepper_real::Scalar;

use crate::compile::collision::CompiledGeom;
use crate::compile::merging::{Merged, matrix};
use crate::compile::tree::scalars;
use crate::model::{Body, Ellipsoid, Medium, Model, Object};

/// Body or geom on which the surrounding fluid exerts forces.
#[derive(Clone, Debug)]
pub struct CompiledFluid<S> {
    /// Index of the link to which the body or geom belongs.
    pub link: usize,
    /// Body or geom of the model.
    pub object: Object,
    /// Rotation matrix from the principal axes of the body or geom to the link's axes, row-major.
    pub mat: [S; 9],
    /// Fluid model: box or ellipsoid.
    pub shape: FluidShape<S>,
}

/// Shape that determines the fluid forces (MuJoCo's inertia box or ellipsoid model).
#[derive(Clone, Debug)]
pub enum FluidShape<S> {
    /// Inertia box: force or torque -(viscous + quadratic |v|) v along every axis.
    Box,
    /// Ellipsoid with added mass, lift and drag.
    Ellipsoid(Box<CompiledEllipsoid<S>>),
}

/// Coefficients of the ellipsoid fluid model, see [`crate::dynamics::fluid`].
#[derive(Clone, Debug)]
pub struct CompiledEllipsoid<S> {
    /// Factor that multiplies all forces and torques of this fluid model on the geom.
    pub share: S,
    /// Density of the fluid, kg/m^3.
    pub density: S,
    /// Added mass along each axis, kg.
    pub added_mass: [S; 3],
    /// Added inertia about each axis, kg m^2.
    pub added_inertia: [S; 3],
    /// Magnus coefficient times the mass of the displaced fluid, kg.
    pub magnus: S,
    /// Kutta coefficient times the density of the fluid, kg/m^3.
    pub kutta: S,
    /// Products of two semi-axes, b c, c a and a b, divided by the largest of the three.
    pub areas: [S; 3],
    /// Threshold of sum_k (a_k d_k)^2, below which the projected area counts as zero. a_k are the entries of `areas`, and d is the unit
    /// vector of the velocity.
    pub no_area: S,
    /// Largest projected area of the ellipsoid, m^2.
    pub widest: S,
    /// Coefficients of blunt drag and of slender drag.
    pub drag: [S; 2],
    /// Viscous drag coefficients in Stokes flow: of rotation, N m s, and of translation, N s/m.
    pub viscous: [S; 2],
    /// Quadratic drag coefficients of a rotation about each axis: moments of area, weighted by drag coefficients, m^5.
    pub moments: [S; 3],
}

/// Gravity compensation force of a body (`gravcomp`).
#[derive(Clone, Debug)]
pub struct GravityCompensation {
    /// Link on which the force acts.
    pub link: usize,
    /// Body of the model at whose centre of mass the force acts.
    pub body: usize,
}

/// Surface that moves without a degree of freedom: a conveyor, or a geom of a mocap body.
#[derive(Clone, Debug)]
pub struct CompiledSurface<S> {
    /// Index of the geom in the compiled model.
    pub geom: usize,
    /// Index, in the list of mocap bodies, of the body that carries the surface. `None` if no mocap body carries it.
    pub mocap: Option<usize>,
    /// Velocity of a conveyor in the axes of the geom's frame: linear at the geom's origin, m/s, then angular, rad/s. `None` if the surface
    /// is no conveyor.
    pub own: Option<[[S; 3]; 2]>,
}

/// Magnitude below which MuJoCo treats a number as zero.
const TINY: f64 = 1e-15;

pub(super) fn fluid<S: Scalar>(model: &Model, merged: &Merged) -> Vec<CompiledFluid<S>> {
    if !model.medium.acts() {
        return Vec::new();
    }
    let mut found = Vec::new();
    let mut geoms_of = vec![vec![]; model.bodies.len()];
    model.geoms.iter().enumerate().filter(|(_, g)| g.fluid.is_some()).for_each(|(g, geom)| geoms_of[geom.body].push((g, geom)));
    for b in 1..model.bodies.len() {
        let (body, frame) = (&model.bodies[b], merged.frame[b]);
        if frame == 0 || frame > merged.leaders.len() || body.mass < TINY {
            continue;
        }
        let mut push = |object: Object, shape| {
            found.push(CompiledFluid { link: frame - 1, object, mat: matrix(&merged.pose(model, object).quat), shape });
        };
        let geoms = std::mem::take(&mut geoms_of[b]);
        if geoms.is_empty() {
            push(Object::Body(b), FluidShape::Box);
        }
        for (g, geom) in geoms {
            let coefficients = geom.fluid.as_ref().expect("filtered above");
            push(Object::Geom(g), ellipsoid(coefficients, &model.medium));
        }
    }
    found
}

/// Viscous and quadratic drag coefficients of a body's equivalent inertia box (MuJoCo's documentation, "Inertia model"). Each of the two
/// arrays has three coefficients of rotation, then three of translation.
pub(super) fn inertia_box(&Body { mass, inertia: [ix, iy, iz], .. }: &Body, medium: &Medium) -> [[f64; 6]; 2] {
    let side = |sum: f64| (sum.max(TINY) / mass * 6.0).sqrt();
    let b = [side(iy + iz - ix), side(ix + iz - iy), side(ix + iy - iz)];
    let diameter = (b[0] + b[1] + b[2]) / 3.0;
    let [spin, slide] = [PI * diameter.powi(3) * medium.viscosity, 3.0 * PI * diameter * medium.viscosity];
    let others = |k: usize| (b[(k + 1) % 3], b[(k + 2) % 3]);
    let drag = std::array::from_fn(|k| match k {
        0..3 => medium.density * b[k] * (others(k).0.powi(4) + others(k).1.powi(4)) / 64.0,
        _ => 0.5 * medium.density * others(k - 3).0 * others(k - 3).1,
    });
    [[spin, spin, spin, slide, slide, slide], drag]
}

fn ellipsoid<S: Scalar>(e: &Ellipsoid, medium: &Medium) -> FluidShape<S> {
    let [a, b, c] = e.axes;
    let (most, least) = (a.max(b).max(c), a.min(b).min(c));
    let middle = a + b + c - most - least;
    let widest = (most * middle).max(f64::MIN_POSITIVE);
    let diameter = 2.0 / 3.0 * (a + b + c);
    let moment = |k: usize| 8.0 / 15.0 * PI * e.axes[k] * e.axes[(k + 1) % 3].max(e.axes[(k + 2) % 3]).powi(4);
    let largest = 8.0 / 15.0 * PI * middle * most.powi(4);
    let moments = std::array::from_fn(|k| e.angular_drag * moment(k) + e.slender_drag * (largest - moment(k)));
    let volume = 4.0 / 3.0 * PI * a * b * c;
    FluidShape::Ellipsoid(Box::new(CompiledEllipsoid {
        share: S::from_f64(e.share),
        density: S::from_f64(medium.density),
        added_mass: scalars(e.virtual_mass.map(|m| medium.density * m)),
        added_inertia: scalars(e.virtual_inertia.map(|m| medium.density * m)),
        magnus: S::from_f64(e.magnus_lift * medium.density * volume),
        kutta: S::from_f64(e.kutta_lift * medium.density),
        areas: scalars([b * c, c * a, a * b].map(|area| area / widest)),
        no_area: S::from_f64(1e-15 * (most * most / widest).powi(2)),
        widest: S::from_f64(PI * widest),
        drag: scalars([e.blunt_drag, e.slender_drag]),
        viscous: scalars([PI * diameter.powi(3), 3.0 * PI * diameter].map(|x| x * medium.viscosity)),
        moments: scalars(moments),
    }))
}

pub(super) fn compensation(model: &Model, merged: &Merged) -> Vec<GravityCompensation> {
    let acts = |&b: &usize| {
        let (body, frame) = (&model.bodies[b], merged.frame[b]);
        body.gravcomp != 0.0 && body.mass > 0.0 && frame > 0 && frame <= merged.leaders.len()
    };
    (1..model.bodies.len()).filter(acts).map(|body| GravityCompensation { link: merged.frame[body] - 1, body }).collect()
}

pub(super) fn surfaces<S: Scalar>(model: &Model, geoms: &[CompiledGeom<S>], links: usize) -> Vec<CompiledSurface<S>> {
    let compiled = |(i, g): (usize, &CompiledGeom<S>)| {
        let mocap = (g.frame > links).then(|| g.frame - links - 1);
        let speed = model.geoms[g.index].surface_velocity;
        let axes = Matrix3::from_row_slice(&g.mat.map(Scalar::to_f64));
        let turned = |k: usize| scalars((axes * Vector3::new(speed[k], speed[k + 1], speed[k + 2])).into());
        let own = (speed != [0.0; 6]).then(|| [turned(0), turned(3)]);
        (mocap.is_some() || own.is_some()).then_some(CompiledSurface { geom: i, mocap, own })
    };
    geoms.iter().enumerate().filter_map(compiled).collect()
}
