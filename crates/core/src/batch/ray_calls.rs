//! Ray casting of a batch: one call for all environments, on one thread or several.

use crate::batch::call::{Part, Schedule};
use crate::batch::environments::Batch;
use crate::batch::inputs::StepInputs;
use crate::batch::ray_query::{RayCast, RayQuery};
use crate::batch::rollout::Numbers;
use crate::batch::worker::LaneScalar;
use crate::compile::sensing::{Target, TargetForm};
use crate::error::Error;

impl<S: LaneScalar> Batch<S> {
    /// Casts rays with directions of unit length. Writes distances, m, in the precision of the lanes, and the geoms that the rays hit. Both
    /// are -1 for a ray without a hit.
    ///
    /// For each geom of `rays`, `surfaces` has the mesh or height field that rays hit; `None` for a simple shape.
    ///
    /// # Errors
    /// [`Error::Threads`] when threads cannot be started.
    pub(super) fn cast_rays(
        &mut self,
        inputs: &StepInputs<'_>,
        rays: &RayCast<'_>,
        surfaces: Vec<Option<TargetForm>>,
        distances: Numbers<'_>,
        geoms: &mut [i32],
    ) -> Result<(), Error> {
        if rays.count == 0 {
            return Ok(());
        }
        self.workers.start_threads()?;
        let sensing = &self.compiled.sensing;
        let target = |(&geom, surface): (&usize, Option<TargetForm>)| {
            let simple = || sensing.forms[geom].map(|(form, index)| TargetForm::Simple(form, index));
            let form = surface.or_else(simple).expect("a geom without a surface is a simple shape");
            (geom, Target { place: sensing.geoms[geom], form })
        };
        let targets: Vec<_> = rays.geoms.iter().zip(surfaces).map(target).collect();
        let query = RayQuery { rays: *rays, targets: &targets };
        let call = self.call(inputs, Schedule { controls: 1, nstep: 0 }, Part::whole(0));
        let row = self.lanes * rays.count;
        let rows = S::numbers(distances).chunks_mut(row).zip(geoms.chunks_mut(row));
        self.share_groups(self.groups.iter().zip(rows), |worker, first, (group, rows)| worker.cast_rays(&call, group, first, &query, rows));
        Ok(())
    }
}
