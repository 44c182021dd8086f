//! Check for new values of geom fields that have no effect, because contacts of an explicit pair use a field of the pair instead.

use crate::pairs::{Filter, Verdict};
use crate::{Model, ModelError};

/// Fields of geoms, each with the field of explicit pairs that overrides it in contacts of the pair.
const OVERRIDING_FIELDS: [(&str, &str); 10] = [
    ("geom_friction", "pair_friction"),
    ("geom_restitution", "pair_restitution"),
    ("geom_margin", "pair_margin"),
    ("geom_gap", "pair_gap"),
    ("geom_condim", "pair_dim"),
    ("geom_solref", "pair_solref"),
    ("geom_solimp", "pair_solimp"),
    ("geom_solmix", "pair_solref"),
    ("geom_stiffness", "pair_stiffness"),
    ("geom_damping", "pair_damping"),
];

/// Explicit pairs of a model, and geom fields with new values that contacts of these pairs ignore.
pub(super) struct OverriddenGeomFields<'a> {
    model: &'a Model,
    /// Indices of the explicit pairs that have contacts: their geoms can collide, and no earlier explicit pair has the same geoms.
    pairs: Vec<usize>,
    fields: Vec<OverriddenField>,
}

/// Name of a geom field, name of the pair field that overrides it, and the model's values of the geom field.
struct OverriddenField {
    geom: &'static str,
    pair: &'static str,
    old_values: Vec<f64>,
}

impl<'a> OverriddenGeomFields<'a> {
    /// Finds the explicit pairs of a model that have contacts, and the geom fields among `names` that a field of such pairs overrides.
    pub(super) fn new<'n>(model: &'a Model, names: impl IntoIterator<Item = &'n str>) -> Self {
        if model.pairs.is_empty() {
            return Self { model, pairs: vec![], fields: vec![] };
        }
        let overriding = |name: &str| OVERRIDING_FIELDS.iter().find(|(geom, _)| *geom == name);
        let fields = names.into_iter().filter_map(overriding).map(|&(geom, pair)| {
            let old_values = model.field(geom).expect("a field of the model").1;
            OverriddenField { geom, pair, old_values }
        });
        let filter = Filter::new(model);
        let collides = |k: &usize| {
            let geoms = filter.ordered(model.pairs[*k].geoms);
            filter.explicit_pair(geoms) == Some(*k) && filter.verdict(geoms) == Verdict::Explicit
        };
        Self { model, pairs: (0..model.pairs.len()).filter(collides).collect(), fields: fields.collect() }
    }

    /// Checks that no explicit pair overrides a changed value of a geom. `given` lists the changed fields, each with its name and new
    /// values.
    ///
    /// A geom field is not checked if `given` also contains the pair field that overrides it. Pairs with condim 1 have no friction, and
    /// override no `geom_friction`.
    ///
    /// # Errors
    /// [`ModelError::Invalid`] with the first geom whose new value has no effect, the pair and the remedy.
    pub(super) fn check(&self, given: &[(&str, &[f64])]) -> Result<(), ModelError> {
        let values_of = |name: &str| given.iter().find(|(given, _)| *given == name).map(|(_, values)| *values);
        for OverriddenField { geom, pair, old_values } in self.fields.iter().filter(|field| values_of(field.pair).is_none()) {
            let Some(values) = values_of(geom) else { continue };
            let width = old_values.len() / self.model.geoms.len().max(1);
            let changes = |g: usize| (g * width..(g + 1) * width).any(|k| old_values[k].to_bits() != values[k].to_bits());
            for &k in self.pairs.iter().filter(|&&k| *geom != "geom_friction" || self.model.pairs[k].condim > 1) {
                if let Some(&g) = self.model.pairs[k].geoms.iter().find(|&&g| changes(g)) {
                    return Err(self.refusal(k, g, geom, pair));
                }
            }
        }
        Ok(())
    }

    fn refusal(&self, pair: usize, geom: usize, geom_field: &str, pair_field: &str) -> ModelError {
        let [a, b] = self.model.pairs[pair].geoms.map(|g| self.model.geom_label(g));
        let what = format!(
            "{geom_field} has no effect on contacts of geoms {a:?} and {b:?}, which use the {pair_field} of explicit pair {:?} instead",
            self.model.pair_label(pair)
        );
        let remedy = format!("give {pair_field} too: new values, or those of the model, which keep these contacts unchanged");
        ModelError::invalid(format!("geom {:?}", self.model.geom_label(geom)), what, remedy)
    }
}

#[cfg(test)]
mod tests {
    use crate::{BodyBuilder, GeomBuilder, JointBuilder, Model, WORLD};

    /// Two balls on a floor. The first ball has an explicit pair with the floor.
    fn balls() -> Model {
        let mut scene = Model::builder("balls");
        scene.geom(WORLD, GeomBuilder::plane("floor"));
        for (name, x) in [("paired", 0.0), ("free", 1.0)] {
            let body = BodyBuilder::new(name).pos([x, 0.0, 0.1]).joint(JointBuilder::free(""));
            scene.body(WORLD, body.geom(GeomBuilder::sphere(name, 0.1)));
        }
        scene.pair("floor", "paired", [0.5, 0.01, 0.001]);
        scene.finish().unwrap()
    }

    #[test]
    fn numbers_that_a_pair_overrides_are_refused_and_the_pair_is_named() {
        let model = balls();
        for (geom, pair, changed) in [("geom_friction", "pair_friction", 3), ("geom_margin", "pair_margin", 1), ("geom_gap", "pair_gap", 1)]
        {
            let mut values = model.field(geom).unwrap().1;
            values[changed] += 0.25;
            let error = model.replace(geom, &values).unwrap_err().to_string();
            for part in ["geom \"paired\"", geom, "explicit pair \"#0\"", "\"floor\"", &format!("give {pair} too")] {
                assert!(error.contains(part), "{part} in {error}");
            }
            let present = model.field(pair).unwrap().1;
            assert_eq!(model.replace_all(&[(geom, &values), (pair, &present)]).unwrap().pairs, model.pairs);
        }
    }

    #[test]
    fn geoms_without_a_pair_and_numbers_that_stay_are_free() {
        let model = balls();
        let mut friction = model.field("geom_friction").unwrap().1;
        assert!(model.replace("geom_friction", &friction).is_ok());
        friction[6] = 0.25;
        assert_eq!(model.replace("geom_friction", &friction).unwrap().geoms[2].friction[0], 0.25);
        friction[0] = 0.25;
        assert!(model.replace("geom_friction", &friction).is_err(), "the floor is in the pair, too");
        let frictionless = model.replace("pair_dim", &[1.0]).unwrap();
        assert!(frictionless.replace("geom_friction", &friction).is_ok(), "a pair without friction overrides none");
    }
}
