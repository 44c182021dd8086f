//! Distance of a convex shape from a surface of triangles.

use crate::narrow::Narrow;
use crate::pair::Pair;
use crate::round::ends;
use crate::separation;
use crate::shape::ConvexShape;
use crate::surface::{Surface, search_box};
use crate::vectors::Pose;
use crate::workspace::Workspace;

impl Narrow {
    /// Distance of a convex shape from the triangles of a surface, m; negative if the shape overlaps a triangle. A shape behind the
    /// surface has a positive distance, too. If the distance exceeds `most`, m, the result is `most`. `ground` is the pose of the
    /// surface, `body` the pose of the shape.
    pub fn clearance(&mut self, surface: &Surface, shape: &ConvexShape, [ground, body]: [Pose; 2], most: f64) -> f64 {
        let Workspace { triangles, polytope, .. } = &mut self.workspace;
        let nothing = ConvexShape::Sphere { radius: 0.0 };
        let whole = Pair::new(&nothing, &ground, shape, &body);
        let [low, high] = search_box(&whole, ends(&whole).as_deref(), most + shape.radius(), None);
        surface.candidates(low, high, triangles);
        let mut least = most;
        for &t in &*triangles {
            let triangle = ConvexShape::Triangle(surface.triangle(t));
            let pair = Pair::between(&triangle, shape, whole.pos, whole.mat);
            let found = separation::nearest(&pair, &least.into(), polytope).found;
            least = least.min(found.separation - pair.rounding_radii());
            if least < 0.0 {
                break;
            }
        }
        least
    }
}
