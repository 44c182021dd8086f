//! Checks of the parameters of MuJoCo's contact law.

use crate::finish::element::{Checked, Element};
use crate::{Description, Softness};

/// Checks the softness of every element, and the inverse weights.
pub(super) fn check(model: &Description) -> Checked {
    let scene = Element("model".into());
    scene.positive("impratio", &[model.soft.impratio], "")?;
    scene.size("noslip_tolerance", &[model.soft.noslip.tolerance], "")?;
    if let Some(weights) = &model.soft.inverse_weights {
        let bodies = weights.bodies.as_flattened();
        scene.length("inverse weights of bodies", bodies, 2 * model.bodies.len(), "two for every body")?;
        scene.length("inverse weights of dofs", &weights.dofs, model.nv(), "nv of the joints")?;
        scene.length("inverse weights of tendons", &weights.tendons, model.tendons.len(), "one for every tendon")?;
        for (what, numbers) in [("bodies", bodies), ("dofs", &weights.dofs), ("tendons", &weights.tendons)] {
            scene.size(&format!("inverse weights of {what}"), numbers, "")?;
        }
    }
    for (i, joint) in model.joints.iter().enumerate() {
        let at = Element::new("joint", &joint.name, i);
        softness(&at, &joint.limit_softness)?;
        softness(&at, &joint.friction_softness)?;
    }
    for (i, geom) in model.geoms.iter().enumerate() {
        let at = Element::new("geom", &geom.name, i);
        softness(&at, &geom.softness)?;
        at.size("solmix", &[geom.solmix], "")?;
    }
    for (i, pair) in model.pairs.iter().enumerate() {
        let at = Element::new("pair", &pair.name, i);
        softness(&at, &pair.softness)?;
        at.finite("solref_friction", &pair.solref_friction)?;
        at.size("anisotropy", &pair.anisotropy, "")?;
    }
    for (i, tendon) in model.tendons.iter().enumerate() {
        let at = Element::new("tendon", &tendon.name, i);
        softness(&at, &tendon.limit_softness)?;
        softness(&at, &tendon.friction_softness)?;
    }
    for (i, equality) in model.equalities.iter().enumerate() {
        softness(&Element::new("equality", &equality.name, i), &equality.softness)?;
    }
    Ok(())
}

fn softness(at: &Element, softness: &Softness) -> Checked {
    at.finite("solref", &softness.solref)?;
    at.finite("solimp", &softness.solimp)
}
