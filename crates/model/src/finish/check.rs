//! Checks of all elements of a model.

mod assets;

use std::collections::HashSet;

use crate::finish::element::{Checked, Element, elements};
use crate::hulls::Hulls;
use crate::tendon::{PathElement, round};
use crate::{
    Activation, Actuator, BiasType, Description, ElementKind, EqualityKind, ForceModel, GainType, JointKind, ModelError, Muscle, Shape,
    Transmission,
};

/// Largest relative excess of a body's largest principal moment over the sum of the other two. A smaller excess counts as rounding error of
/// a source in single precision.
const TRIANGLE: f64 = 1e-6;

/// Checks that must run first: the body tree, the bodies to which joints and geoms refer, and the lengths of arrays.
pub(super) fn structure(model: &Description) -> Checked {
    tree(model)?;
    order("joint", model.joints.iter().map(|j| (j.name.as_str(), j.body)), model.bodies.len())?;
    order("geom", model.geoms.iter().map(|g| (g.name.as_str(), g.body)), model.bodies.len())?;
    joints_fit_bodies(model)?;
    let (nq, nv) = (model.nq(), model.nv());
    let scene = Element("model".into());
    scene.length("qpos0", &model.qpos0, nq, "nq of the joints")?;
    scene.length("qpos_spring", &model.qpos_spring, nq, "nq of the joints")?;
    for (at, key) in elements("keyframe", &model.keyframes, |key| &key.name) {
        at.finite("time", &[key.time])?;
        at.length("qpos", &key.qpos, nq, "nq of the joints")?;
        at.length("qvel", &key.qvel, nv, "nv of the joints")?;
        at.length("act", &key.act, model.na(), "one for every actuator with activation")?;
        at.length("ctrl", &key.ctrl, model.nu(), "one for every actuator")?;
    }
    Ok(())
}

/// Number of joints of each body.
fn joint_counts(model: &Description) -> Vec<usize> {
    let mut counts = vec![0; model.bodies.len()];
    for joint in &model.joints {
        if let Some(count) = counts.get_mut(joint.body) {
            *count += 1;
        }
    }
    counts
}

fn tree(model: &Description) -> Checked {
    let Some(world) = model.bodies.first() else {
        return Element("model".into()).fail("there are no bodies", "begin with the world body");
    };
    let is_misplaced = world.parent != 0 || world.mocap;
    Element::new("body", &world.name, 0).fail_if(is_misplaced, "the world has a parent or is mocap", "give parent 0 and mocap false")?;
    let joint_counts = joint_counts(model);
    for (i, body) in model.bodies.iter().enumerate().skip(1) {
        let at = Element::new("body", &body.name, i);
        let what = format_args!("its parent is body {}, itself body {i}", body.parent);
        at.fail_if(body.parent >= i, what, "list parents before their children")?;
        if body.mocap && body.parent != 0 {
            let what = format!("it is a mocap body, and its parent is body {:?}", model.body_label(body.parent));
            return at.fail(what, "make it a child of the world, or remove mocap");
        }
        let has_joints = joint_counts[i] > 0;
        at.fail_if(body.mocap && has_joints, "it is a mocap body, and has joints", "remove its joints, or remove mocap")?;
    }
    Ok(())
}

fn order<'a>(kind: &str, elements: impl Iterator<Item = (&'a str, usize)>, nbody: usize) -> Checked {
    let mut last = 0;
    for (i, (name, body)) in elements.enumerate() {
        let at = Element::new(kind, name, i);
        at.index("body", body, nbody)?;
        let what = format_args!("belongs to body {body}, and the {kind} before it to body {last}");
        at.fail_if(body < last, what, format_args!("list {kind}s in the order of bodies"))?;
        last = body;
    }
    Ok(())
}

fn joints_fit_bodies(model: &Description) -> Checked {
    let joint_counts = joint_counts(model);
    for (at, joint) in elements("joint", &model.joints, |joint| &joint.name) {
        at.fail_if(joint.body == 0, "belongs to the world, which does not move", "give it to another body")?;
        if joint.kind != JointKind::Free {
            continue;
        }
        let body = model.body_label(joint.body);
        if model.bodies[joint.body].parent != 0 {
            let what = format!("is the free joint of body {body:?}, whose parent is not the world");
            return at.fail(what, "make the body a child of the world");
        }
        let what = format_args!("is a free joint, and body {body:?} has other joints too");
        at.fail_if(joint_counts[joint.body] > 1, what, "remove the other joints of the body")?;
    }
    Ok(())
}

/// Checks the values of all elements. Returns the convex hulls of the meshes.
pub(super) fn values(model: &Description, hulls: &Hulls) -> Result<Hulls, ModelError> {
    let scene = Element("model".into());
    scene.positive("timestep", &[model.timestep], " s")?;
    scene.finite("magnetic", &model.magnetic)?;
    scene.size("density", &[model.medium.density], " kg/m^3")?;
    scene.size("viscosity", &[model.medium.viscosity], " Pa s")?;
    scene.finite("wind", &model.medium.wind)?;
    names(model)?;
    parameters(model)?;
    let hulls = assets::check(model, hulls)?;
    tendons(model)?;
    crate::finish::sensors::check(model)?;
    softness(model)?;
    Ok(hulls)
}

/// Checks the scene's settings of MuJoCo's contact law, including the inverse weights ([`InverseWeights`](crate::InverseWeights)).
fn softness(model: &Description) -> Checked {
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
    Ok(())
}

/// Checks only the values that may differ between environments. The other values of the model must be checked already.
pub(crate) fn parameters(model: &Description) -> Checked {
    Element("model".into()).finite("gravity", &model.gravity)?;
    bodies(model)?;
    joints(model)?;
    geoms(model)?;
    pairs(model)?;
    equalities(model)?;
    actuators(model)
}

/// Checks that names are unique, because users refer to elements by name.
fn names(model: &Description) -> Checked {
    for kind in ElementKind::ALL {
        let mut seen = HashSet::new();
        let repeated = kind.names(model).into_iter().find(|name| !name.is_empty() && !seen.insert(*name));
        if let Some(name) = repeated {
            let kind = kind.name();
            return Element(format!("{kind} {name:?}"))
                .fail(format!("another {kind} has the same name"), "give each its own name, or none");
        }
    }
    Ok(())
}

fn bodies(model: &Description) -> Checked {
    for (at, body) in elements("body", &model.bodies, |body| &body.name) {
        at.finite("pos", &body.pos)?;
        at.finite("centre of mass", &body.ipos)?;
        at.size("mass", &[body.mass], " kg")?;
        at.size("inertia", &body.inertia, " kg m^2")?;
        at.finite("gravcomp", &[body.gravcomp])?;
        let [a, b, c] = sorted(body.inertia);
        let moments = body.inertia;
        at.fail_if(
            c > (a + b) * (1.0 + TRIANGLE),
            format_args!("principal moments {moments:?} violate the triangle inequality: {c} > {a} + {b}; no body has such moments"),
            "correct the moments or their units, or compute them from geoms (MJCF: compiler inertiafromgeom or balanceinertia)",
        )?;
    }
    Ok(())
}

fn sorted(mut x: [f64; 3]) -> [f64; 3] {
    x.sort_by(f64::total_cmp);
    x
}

fn joints(model: &Description) -> Checked {
    for (at, joint) in elements("joint", &model.joints, |joint| &joint.name) {
        at.finite("pos", &joint.pos)?;
        at.finite("stiffness", &[joint.stiffness])?;
        at.size("damping", &[joint.damping], "")?;
        at.size("armature", &[joint.armature], "")?;
        at.size("frictionloss", &[joint.frictionloss], "")?;
        let is_limited_free = joint.range.is_some() && joint.kind == JointKind::Free;
        at.fail_if(is_limited_free, "is a free joint with a range", "remove the range: free joints have no limits")?;
        at.range("range", joint.range)?;
        at.finite("range", &joint.range.unwrap_or_default())?;
        at.range("actuator_force_range", joint.actuator_force_range)?;
        joint.velocity_limit.map_or(Ok(()), |limit| at.size("velocity_limit", &[limit], ""))?;
        at.softness(&joint.limit_softness)?;
        at.softness(&joint.friction_softness)?;
    }
    Ok(())
}

fn geoms(model: &Description) -> Checked {
    for (at, geom) in elements("geom", &model.geoms, |geom| &geom.name) {
        match geom.shape {
            Shape::Plane | Shape::HeightField { .. } | Shape::Mesh { .. } => {}
            Shape::Sphere { radius } => at.positive("radius", &[radius], " m")?,
            Shape::Capsule { radius, half_length } => {
                at.positive("radius", &[radius], " m")?;
                at.size("half length", &[half_length], " m")?;
            }
            Shape::Cylinder { radius, half_length } => {
                at.positive("radius", &[radius], " m")?;
                at.positive("half length", &[half_length], " m")?;
            }
            Shape::Ellipsoid { radii } => at.positive("semi-axis", &radii, " m")?,
            Shape::Box { half } => at.positive("half size", &half, " m")?,
        }
        at.finite("pos", &geom.pos)?;
        at.finite("surface velocity", &geom.surface_velocity)?;
        if let Some(e) = &geom.fluid {
            at.positive("semi-axis in the medium", &e.axes, " m")?;
            at.size("drag in the medium", &[e.share, e.blunt_drag, e.slender_drag, e.angular_drag], "")?;
            at.finite("lift in the medium", &[e.kutta_lift, e.magnus_lift])?;
            at.size("virtual mass", &e.virtual_mass, " m^3")?;
            at.size("virtual inertia", &e.virtual_inertia, " m^5")?;
        }
        at.contact(geom.condim, &geom.friction, geom.restitution, geom.margin, geom.gap)?;
        at.spring(geom.spring)?;
        at.softness(&geom.softness)?;
        at.size("solmix", &[geom.solmix], "")?;
    }
    Ok(())
}

fn pairs(model: &Description) -> Checked {
    for (at, pair) in elements("pair", &model.pairs, |pair| &pair.name) {
        pair.geoms.iter().try_for_each(|&g| at.index("geom", g, model.geoms.len()))?;
        at.distinct("geom", pair.geoms, |geom| model.geom_label(geom), "name two geoms")?;
        at.contact(pair.condim, &pair.friction, pair.restitution, pair.margin, pair.gap)?;
        at.spring(pair.spring)?;
        at.softness(&pair.softness)?;
        at.finite("solref_friction", &pair.solref_friction)?;
        at.size("anisotropy", &pair.anisotropy, "")?;
    }
    for (i, exclude) in model.excludes.iter().enumerate() {
        exclude.iter().try_for_each(|&b| Element::new("exclude", "", i).index("body", b, model.bodies.len()))?;
    }
    for (i, overlap) in model.excluded_overlaps.iter().enumerate() {
        let at = Element::new("excluded overlap", "", i);
        overlap.geoms.iter().try_for_each(|&g| at.index("geom", g, model.geoms.len()))?;
        at.size("depth", &[overlap.depth], " m")?;
    }
    Ok(())
}

/// Checks the path of a spatial tendon: each branch between pulleys begins and ends with a site, and a geom is between two sites.
fn path(at: &Element, model: &Description, path: &[PathElement]) -> Checked {
    let (mut after_site, mut count) = (false, 0);
    for (k, element) in path.iter().enumerate() {
        let ends_in_site = k == 0 || matches!(path[k - 1], PathElement::Site(_));
        match *element {
            PathElement::Site(site) => {
                at.index("site", site, model.sites.len())?;
                (after_site, count) = (true, count + 1);
            }
            PathElement::Wrap { geom, side } => {
                at.index("geom", geom, model.geoms.len())?;
                side.map_or(Ok(()), |site| at.index("site", site, model.sites.len()))?;
                if round(&model.geoms[geom].shape).is_none() {
                    let what = format!("wraps around geom {:?}, which is no sphere or cylinder", model.geom_label(geom));
                    return at.fail(what, "wrap around a sphere or a cylinder");
                }
                let between = after_site && ends_in_site && matches!(path.get(k + 1), Some(PathElement::Site(_)));
                if !between {
                    let what = format!("geom {:?} in its path is not between two sites", model.geom_label(geom));
                    return at.fail(what, "put a site before and after the geom");
                }
            }
            PathElement::Pulley(divisor) => {
                at.positive("divisor of a pulley", &[divisor], "")?;
                let is_short = !ends_in_site || (k > 0 && count < 2);
                at.fail_if(is_short, "a branch of its path has no two sites", "end each branch with a site, and give it two sites")?;
                (after_site, count) = (false, 0);
            }
        }
    }
    let is_short = !path.is_empty() && count < 2;
    at.fail_if(is_short, "the last branch of its path has no two sites", "give each branch two sites")
}

fn tendons(model: &Description) -> Checked {
    for (at, tendon) in elements("tendon", &model.tendons, |tendon| &tendon.name) {
        for &(joint, coefficient) in &tendon.joints {
            at.scalar_joint(model, joint)?;
            at.finite("coefficient", &[coefficient])?;
        }
        path(&at, model, &tendon.path)?;
        at.range("range", tendon.range)?;
        at.size("stiffness", &[tendon.stiffness], "")?;
        at.range("spring_length", Some(tendon.spring_length))?;
        at.finite("spring_length", &tendon.spring_length)?;
        at.size("damping", &[tendon.damping], "")?;
        at.size("armature", &[tendon.armature], "")?;
        let wraps = tendon.path.iter().any(|element| matches!(element, PathElement::Wrap { .. }));
        let what = format_args!("armature is {}, and its path wraps around a geom", tendon.armature);
        at.fail_if(tendon.armature > 0.0 && wraps, what, "leave out the geom, or give the armature to joints")?;
        at.size("frictionloss", &[tendon.frictionloss], "")?;
        at.softness(&tendon.limit_softness)?;
        at.softness(&tendon.friction_softness)?;
    }
    Ok(())
}

fn equalities(model: &Description) -> Checked {
    for (at, equality) in elements("equality", &model.equalities, |equality| &equality.name) {
        at.finite("data", &equality.data())?;
        let stiffness = equality.stiffness;
        let remedy = "give a number of at least 0, or infinity for a hard equality";
        at.fail_if(stiffness.is_nan() || stiffness < 0.0, format_args!("stiffness is {stiffness}"), remedy)?;
        at.size("damping", &[equality.damping], "")?;
        at.softness(&equality.softness)?;
        match &equality.kind {
            EqualityKind::Connect { bodies, .. } | EqualityKind::Weld { bodies, .. } => {
                bodies.iter().try_for_each(|&b| at.index("body", b, model.bodies.len()))?;
                at.distinct("body", *bodies, |body| model.body_label(body), "name two bodies")?;
            }
            &EqualityKind::Joint { joint, other, .. } => {
                at.scalar_joint(model, joint)?;
                if let Some(other) = other {
                    at.scalar_joint(model, other)?;
                    at.distinct("joint", [joint, other], |joint| model.joint_label(joint), "name two joints, or one")?;
                }
            }
            &EqualityKind::Tendon { tendon, other, .. } => {
                at.index("tendon", tendon, model.tendons.len())?;
                other.map_or(Ok(()), |t| at.index("tendon", t, model.tendons.len()))?;
                at.fail_if(other == Some(tendon), format_args!("both elements are tendon {tendon}"), "name two tendons, or one")?;
            }
        }
        if let EqualityKind::Weld { torquescale, .. } = equality.kind {
            at.size("torquescale", &[torquescale], " m")?;
        }
    }
    Ok(())
}

fn force_model(at: &Element, actuator: &Actuator) -> Checked {
    let ForceModel { gain, bias, .. } = actuator.force_model;
    let fits = match gain {
        GainType::Fixed | GainType::Affine | GainType::Muscle => bias != BiasType::DcMotor,
        GainType::DcMotor => bias == BiasType::DcMotor,
        GainType::PidPosition | GainType::PidVelocity => bias == BiasType::Affine,
    };
    let what = format_args!("gaintype is {:?} and biastype is {:?}", gain.name(), bias.name());
    at.fail_if(!fits, what, "give \"dcmotor\" both or neither, and \"affine\" as the bias of \"pid\"")?;
    if gain == GainType::DcMotor {
        at.positive("resistance, column 0 of gainprm,", &actuator.gain[..1], " Ohm")?;
    }
    let Muscle { length_range, acceleration, gain, bias } = &actuator.muscle;
    at.finite("muscle parameters", &[&length_range[..], &[*acceleration], gain, bias].concat())?;
    let (gain, bias) = actuator.affine_force();
    at.finite("gain", &gain)?;
    at.finite("bias", &bias)
}

fn actuators(model: &Description) -> Checked {
    for (at, actuator) in elements("actuator", &model.actuators, |actuator| &actuator.name) {
        match actuator.transmission {
            Transmission::Joint(j) => at.scalar_joint(model, j)?,
            Transmission::Tendon(t) => at.index("tendon", t, model.tendons.len())?,
            Transmission::Body(b) => {
                at.index("body", b, model.bodies.len())?;
                let what = "acts on the contacts of a body, and its force depends on its length or velocity";
                at.fail_if(actuator.force_depends_on_motion(), what, "give gain and bias no coefficients of length and velocity")?;
            }
            Transmission::JointWrench { joint, wrench, .. } => {
                at.index("joint", joint, model.joints.len())?;
                if !matches!(model.joints[joint].kind, JointKind::Ball | JointKind::Free) {
                    let what = format!("a wrench acts on joint {:?}, which is no ball or free joint", model.joint_label(joint));
                    return at.fail(what, "give the joint itself as transmission, with a gear");
                }
                at.finite("wrench", &wrench)?;
            }
            Transmission::SliderCrank { crank, slider, rod } => {
                at.index("site", crank, model.sites.len())?;
                at.index("site", slider, model.sites.len())?;
                at.positive("length of the rod", &[rod], " m")?;
            }
            Transmission::Site { site, reference, wrench } => {
                at.index("site", site, model.sites.len())?;
                reference.map_or(Ok(()), |r| at.index("site", r, model.sites.len()))?;
                at.finite("wrench", &wrench)?;
            }
        }
        match actuator.activation {
            Activation::Filter(tau) | Activation::FilterExact(tau) => at.positive("time constant", &[tau], " s")?,
            Activation::Muscle { rise, fall, smoothing } => {
                at.positive("time constant of activation or deactivation", &[rise, fall], " s")?;
                at.size("width of the switch between time constants", &[smoothing], "")?;
            }
            Activation::None | Activation::Integrator => {}
        }
        at.finite("gear", &[actuator.gear])?;
        let gear = actuator.gear;
        let what = format_args!("gear is {gear:e}, and its square, which scales inertia, is not finite");
        at.fail_if(!(gear * gear).is_finite(), what, "give a smaller one")?;
        at.size("delay", &[actuator.delay], " s")?;
        at.finite("gain", &actuator.gain)?;
        at.finite("bias", &actuator.bias)?;
        force_model(&at, actuator)?;
        at.range("ctrl_range", actuator.ctrl_range)?;
        at.range("force_range", actuator.force_range)?;
        at.range("act_range", actuator.act_range)?;
    }
    Ok(())
}
