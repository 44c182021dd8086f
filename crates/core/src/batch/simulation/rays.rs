//! Ray casting in all environments of a simulation.

use crate::batch::engine::with_batch;
use crate::batch::inputs::StepInputs;
use crate::batch::ray_query::RayCast;
use crate::batch::rollout::Numbers;
use crate::batch::simulation::{Error, Simulation};
use crate::compile::sensing::{Form, TargetForm};
use crate::error::check_length;

impl Simulation {
    /// Casts rays in all environments. Writes the distance to the first hit, m, and the index of the geom, (num_envs, count) each. Both are
    /// -1 for a ray without a hit.
    ///
    /// Distances are in the precision of the simulation. The state does not change. Rays hit a plane, which is infinite, from its front
    /// only. They hit a mesh on its triangles, even if contacts use its hull, and a height field also on its sides and base. A ray that
    /// begins inside a geom hits the point where it leaves the geom.
    ///
    /// # Errors
    /// [`Error::Element`] for a geom that does not exist, and [`Error::NoForm`] for a shape that rays cannot hit. [`Error::Length`] and
    /// [`Error::ArrayPrecision`] for the arrays, [`Error::NotFinite`] and [`Error::TooLarge`] for a point. [`Error::Direction`] for an
    /// invalid direction, [`Error::Threads`] when threads cannot be started.
    pub fn cast_rays(&mut self, rays: &RayCast<'_>, distances: Numbers<'_>, geoms: &mut [i32]) -> Result<(), Error> {
        let (n, count) = (self.num_envs, rays.count);
        self.check_array("distances", &distances, n * count)?;
        check_length("geoms", geoms.len(), n * count)?;
        for (name, given) in [("points", rays.points), ("directions", rays.directions)] {
            if given.len() != 3 * count {
                check_length(name, given.len(), 3 * n * count)?;
            }
        }
        self.check_numbers(rays.points, |i| (format!("points[{}]", i / 3 % count), i / 3 / count))?;
        let directions = directions(rays)?;
        let mut surfaces = Vec::with_capacity(rays.geoms.len());
        for &geom in rays.geoms {
            let all = self.model.geoms.len();
            let shape = &self.model.geoms.get(geom).ok_or(Error::Element { element: "geom", found: geom, count: all })?.shape;
            let surface = self.surfaces.get_or_make(&self.model, shape);
            if surface.is_none() && Form::of(shape).is_none() {
                return Err(Error::NoForm { geom: self.model.geom_label(geom), shape: shape.name() });
            }
            surfaces.push(surface.map(TargetForm::Surface));
        }
        let inputs = StepInputs { ctrl: &self.ctrl, ..self.applied.complete(&StepInputs::default()) };
        let rays = RayCast { directions: &directions, ..*rays };
        with_batch!(&mut self.engine, batch => batch.cast_rays(&inputs, &rays, surfaces, distances, geoms))
    }
}

/// Directions of the rays, normalised to unit length.
fn directions(rays: &RayCast<'_>) -> Result<Vec<f64>, Error> {
    let mut all = Vec::with_capacity(rays.directions.len());
    for (i, &found) in rays.directions.as_chunks::<3>().0.iter().enumerate() {
        // Divide by the largest component first, so that no square overflows or underflows.
        let most = found.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
        let d = found.map(|x| x / most);
        let length = (d[0] * d[0] + d[1] * d[1] + d[2] * d[2]).sqrt();
        if !length.is_finite() {
            return Err(Error::Direction { ray: i % rays.count, env: i / rays.count, found });
        }
        all.extend(d.map(|x| x / length));
    }
    Ok(all)
}
