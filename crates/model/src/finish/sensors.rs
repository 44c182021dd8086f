//! Checks of sites and sensors.

use crate::finish::element::{Checked, Element, elements};
use crate::{ContactSide, Description, EqualityKind, FrameReading, Geom, JointKind, Model, ModelError, Object, Sensor, SensorKind, Shape};

/// Checks every site and sensor.
pub(super) fn check(model: &Description) -> Checked {
    for (at, site) in elements("site", &model.sites, |site| &site.name) {
        at.index("body", site.body, model.bodies.len())?;
        at.finite("pos", &site.pos)?;
        match site.shape {
            Shape::Sphere { radius } => at.size("radius", &[radius], " m")?,
            Shape::Capsule { radius, half_length } | Shape::Cylinder { radius, half_length } => {
                at.size("size", &[radius, half_length], " m")?;
            }
            Shape::Ellipsoid { radii: size } | Shape::Box { half: size } => at.size("size", &size, " m")?,
            Shape::Plane | Shape::Mesh { .. } | Shape::HeightField { .. } => {
                return at.fail(format!("its volume is a {}", site.shape.name()), "give a sphere, capsule, ellipsoid, cylinder or box");
            }
        }
    }
    model.sensors.iter().enumerate().try_for_each(|(i, sensor)| one(model, i, sensor))
}

fn one(model: &Description, i: usize, sensor: &Sensor) -> Checked {
    use SensorKind as K;
    let at = Element::new("sensor", &sensor.name, i);
    at.size("noise", &[sensor.noise], "")?;
    at.size("cutoff", &[sensor.cutoff], "")?;
    at.size("delay", &[sensor.delay], " s")?;
    at.size("interval", &[sensor.interval], " s")?;
    let site = |s: usize| at.index("site", s, model.sites.len());
    let geoms = |which: &[usize]| which.iter().try_for_each(|&g| at.index("geom", g, model.geoms.len()));
    match &sensor.kind {
        &(K::JointPos(j)
        | K::JointVel(j)
        | K::JointActuatorForce(j)
        | K::JointLimitPos(j)
        | K::JointLimitVel(j)
        | K::JointLimitForce(j)) => at.scalar_joint(model, j),
        &(K::BallQuat(j) | K::BallAngVel(j)) => ball(model, &at, j),
        &(K::TendonPos(t)
        | K::TendonVel(t)
        | K::TendonActuatorForce(t)
        | K::TendonLimitPos(t)
        | K::TendonLimitVel(t)
        | K::TendonLimitForce(t)) => at.index("tendon", t, model.tendons.len()),
        &(K::ActuatorPos(a) | K::ActuatorVel(a) | K::ActuatorForce(a)) => at.index("actuator", a, model.actuators.len()),
        &(K::Force(s) | K::Torque(s)) => site(s).and_then(|()| open(model, &at, s, |e| model.equalities[e].active)),
        &(K::Magnetometer(s) | K::Velocimeter(s) | K::Gyro(s) | K::Accelerometer(s) | K::Touch(s)) => site(s),
        &(K::SubtreeCom(b) | K::SubtreeLinVel(b) | K::SubtreeAngMom(b)) => at.index("body", b, model.bodies.len()),
        K::PotentialEnergy | K::KineticEnergy | K::Clock => Ok(()),
        K::Frame { what, object: of, reference } => {
            object(model, &at, *of)?;
            match reference {
                Some(_) if matches!(what, FrameReading::LinAcc | FrameReading::AngAcc) => at.fail(
                    "measures an acceleration, and has a reference frame",
                    "leave the reference out: accelerations are relative to the world",
                ),
                Some(reference) => object(model, &at, *reference),
                None => Ok(()),
            }
        }
        K::InsideSite { object: of, site: s } => object(model, &at, *of).and_then(|()| site(*s)),
        K::RangeFinder { site: s, rays, fields, geoms: seen } => {
            site(*s)?;
            geoms(seen)?;
            ascending(&at, fields)?;
            seen.iter().try_for_each(|&g| formed(model, &at, g))?;
            rays.iter().try_for_each(|ray| {
                let length = ray.iter().map(|x| x * x).sum::<f64>().sqrt();
                let is_unit = (length - 1.0).abs() <= 1e-9;
                at.fail_if(!is_unit, format_args!("ray {ray:?} has length {length}"), "give one of length 1")
            })
        }
        K::Proximity { from, to, cutoff, .. } => {
            at.size("cutoff", &[*cutoff], " m")?;
            geoms(from)?;
            geoms(to)?;
            from.iter().try_for_each(|&a| to.iter().try_for_each(|&b| near(model, &at, a, b)))
        }
        K::Contact { first, second, fields, slots, .. } => {
            side(model, &at, *first)?;
            side(model, &at, *second)?;
            ascending(&at, fields)?;
            at.fail_if(*slots == 0, "it has 0 slots for contacts", "give one slot or more")
        }
        K::Combination(terms) => combination(model, &at, i, terms),
    }
}

impl Model {
    /// Model with additional sensors, which are appended to the existing ones.
    ///
    /// # Errors
    /// [`ModelError::Invalid`] for the first invalid sensor.
    pub fn with_sensors(&self, sensors: impl IntoIterator<Item = Sensor>) -> Result<Self, ModelError> {
        let mut model = self.description.clone();
        model.sensors.extend(sensors);
        model.check(&self.hulls)
    }

    /// Checks that no force or torque sensor is part of a loop that active equalities close. `acts(k)` returns whether the equality with
    /// the index k is active.
    ///
    /// # Errors
    /// [`ModelError::Invalid`] with the sensor and the equality.
    pub fn check_sensed_loops(&self, acts: impl Fn(usize) -> bool) -> Result<(), ModelError> {
        for (i, sensor) in self.sensors.iter().enumerate() {
            if let SensorKind::Force(site) | SensorKind::Torque(site) = sensor.kind {
                open(self, &Element::new("sensor", &sensor.name, i), site, &acts)?;
            }
        }
        Ok(())
    }

    /// Indices of the geoms that rays from a site can hit: all geoms of other bodies whose shape the model contains. `site` is the index of
    /// the site.
    pub fn geoms_seen_from(&self, site: usize) -> Vec<usize> {
        self.geoms_met_by_rays(self.sites.get(site).map(|site| site.body))
    }

    /// Indices of the geoms that rays can hit. Geoms of the body `except` are left out, and so are geoms whose mesh the model does not
    /// contain, such as meshes for visualization.
    pub fn geoms_met_by_rays(&self, except: Option<usize>) -> Vec<usize> {
        let met = |g: &Geom| Some(g.body) != except && (self.hull_of(&g.shape).is_some() || has_form(self, &g.shape));
        (0..self.geoms.len()).filter(|&g| met(&self.geoms[g])).collect()
    }
}

fn ball(model: &Description, at: &Element, joint: usize) -> Checked {
    at.index("joint", joint, model.joints.len())?;
    if model.joints[joint].kind == JointKind::Ball {
        return Ok(());
    }
    at.fail(format!("refers to joint {:?}, which is no ball joint", model.joint_label(joint)), "refer to a ball joint")
}

fn object(model: &Description, at: &Element, object: Object) -> Checked {
    match object {
        Object::Body(b) | Object::XBody(b) => at.index("body", b, model.bodies.len()),
        Object::Geom(g) => at.index("geom", g, model.geoms.len()),
        Object::Site(s) => at.index("site", s, model.sites.len()),
    }
}

/// Checks that stepper can compute the distance of two geoms. One geom must be a plane and the other a primitive shape, or both must be
/// balls or capsules.
fn near(model: &Description, at: &Element, a: usize, b: usize) -> Checked {
    let round = |s: &Shape| matches!(s, Shape::Sphere { .. } | Shape::Capsule { .. });
    let simple = |s: &Shape| !matches!(s, Shape::Plane | Shape::Mesh { .. } | Shape::HeightField { .. });
    let [p, q] = [a, b].map(|g| &model.geoms[g].shape);
    let plane = |p: &Shape, q: &Shape| matches!(p, Shape::Plane) && simple(q);
    if (round(p) && round(q)) || plane(p, q) || plane(q, p) {
        return Ok(());
    }
    let names = [a, b].map(|g| model.geom_label(g));
    let what = format!("the distance between {} {:?} and {} {:?} is not simulated yet", p.name(), names[0], q.name(), names[1]);
    at.fail(what, "measure between balls, capsules and planes, or leave the sensor out")
}

fn side(model: &Description, at: &Element, side: ContactSide) -> Checked {
    match side {
        ContactSide::Any => Ok(()),
        ContactSide::Geom(g) => at.index("geom", g, model.geoms.len()),
        ContactSide::Body(b) | ContactSide::Subtree(b) => at.index("body", b, model.bodies.len()),
        ContactSide::Site(s) => at.index("site", s, model.sites.len()),
    }
}

/// Checks that the model contains the mesh or height field of a geom, so that rays can hit the geom.
fn formed(model: &Description, at: &Element, geom: usize) -> Checked {
    let shape = &model.geoms[geom].shape;
    if has_form(model, shape) {
        return Ok(());
    }
    let what =
        format!("its rays can hit {} {:?}, whose mesh or height field the model does not have", shape.name(), model.geom_label(geom));
    at.fail(what, "add the mesh or height field to the model, or leave the geom out of the sensor's geoms")
}

/// Whether the model contains the surface of the shape. A mesh needs triangles or a convex hull, a height field needs its elevations. Other
/// shapes need no data.
fn has_form(model: &Description, shape: &Shape) -> bool {
    match shape {
        Shape::Mesh { .. } => model.mesh_of(shape).is_some_and(|mesh| !mesh.faces.is_empty() || mesh.hull().is_ok()),
        Shape::HeightField { .. } => model.height_field_of(shape).is_some(),
        _ => true,
    }
}

/// Checks that no active equality connects the body of a force sensor's site, or one of its descendants, to any other body.
///
/// Such an equality would close a loop and carry part of the load, which the sensor's reading does not include. `acts(k)` returns whether
/// the equality with the index k is active.
fn open(model: &Description, at: &Element, site: usize, acts: impl Fn(usize) -> bool) -> Checked {
    let mut carried = vec![false; model.bodies.len()];
    carried[model.sites[site].body] = true;
    for b in model.sites[site].body + 1..carried.len() {
        carried[b] = carried[model.bodies[b].parent];
    }
    for (_, equality) in model.equalities.iter().enumerate().filter(|(e, _)| acts(*e)) {
        let (EqualityKind::Connect { bodies, .. } | EqualityKind::Weld { bodies, .. }) = equality.kind else { continue };
        if carried[bodies[0]] != carried[bodies[1]] {
            let what = format!("equality {:?} also holds the bodies behind the sensor, and the sensor would lack its force", equality.name);
            return at.fail(what, "leave the sensor out, or measure beyond the loop");
        }
    }
    Ok(())
}

fn ascending<T: Ord + std::fmt::Debug>(at: &Element, fields: &[T]) -> Checked {
    let is_ascending = !fields.is_empty() && fields.windows(2).all(|w| w[0] < w[1]);
    let remedy = "give one or more, each once, in the order of their definition";
    at.fail_if(!is_ascending, format_args!("its fields are {fields:?}"), remedy)
}

fn combination(model: &Description, at: &Element, index: usize, terms: &[(usize, f64)]) -> Checked {
    at.fail_if(terms.is_empty(), "its terms are empty", "give one term or more")?;
    let dim = |s: usize| model.sensors[s].dim(&model.sensors);
    for &(sensor, coefficient) in terms {
        at.finite("coefficient", &[coefficient])?;
        let what = format_args!("is sensor {index}, and combines sensor {sensor}, which does not come before it");
        at.fail_if(sensor >= index, what, "combine sensors that come before it")?;
        if dim(sensor) != dim(terms[0].0) {
            let (a, b) = (model.sensor_label(terms[0].0), model.sensor_label(sensor));
            let what = format!("combines {a:?} of dimension {} with {b:?} of dimension {}", dim(terms[0].0), dim(sensor));
            return at.fail(what, "combine readings of one dimension");
        }
    }
    Ok(())
}
