//! Values of the attributes of element classes, such as `Body` and `Joint`, from a model.

use numpy::IntoPyArray;
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use stepper_core::Precision;
use stepper_core::model::{Activation, JointKind, Model as Core, Shape, Transmission};

use crate::array::{array, read_only};
use crate::elements::{Actuator, Body, Geom, Joint, Keyframe, Pair, Sensor, Site, Tendon};

/// Converter of model values to Python objects.
#[derive(Clone, Copy)]
struct Values<'a, 'py> {
    py: Python<'py>,
    model: &'a Core,
}

impl<'py> Values<'_, 'py> {
    fn of(self, value: impl IntoPyObject<'py>) -> PyResult<Py<PyAny>> {
        value.into_py_any(self.py)
    }

    /// Read-only NumPy array with the numbers of one element in the model field `field`.
    fn row(self, numbers: &[f64], field: &str) -> PyResult<Py<PyAny>> {
        Ok(read_only(array(self.py, &[numbers.len()], numbers.to_vec(), Precision::F64)?, field)?.unbind())
    }

    fn bounds(self, range: Option<[f64; 2]>, field: &str) -> PyResult<Py<PyAny>> {
        self.row(&range.unwrap_or([f64::NEG_INFINITY, f64::INFINITY]), field)
    }
}

/// Index of the first true value of an iterator, and number of true values. If no value is true, the index is -1.
fn span(mut among: impl Iterator<Item = bool>) -> (i64, usize) {
    match among.by_ref().position(|is| is) {
        Some(first) => (first as i64, 1 + among.filter(|&is| is).count()),
        None => (-1, 0),
    }
}

impl Body {
    pub(crate) fn of(py: Python<'_>, model: &Core, i: usize) -> PyResult<Self> {
        let (v, body) = (Values { py, model }, &model.bodies[i]);
        let (jntadr, jntnum) = span(model.joints.iter().map(|j| j.body == i));
        let (geomadr, geomnum) = span(model.geoms.iter().map(|g| g.body == i));
        let own = usize::try_from(jntadr).map_or(0..0, |first| first..first + jntnum);
        let mocapid = if body.mocap { model.bodies[..i].iter().filter(|b| b.mocap).count() as i64 } else { -1 };
        Ok(Self {
            id: v.of(i)?,
            name: v.of(&body.name)?,
            parentid: v.of(body.parent)?,
            mass: v.of(body.mass)?,
            inertia: v.row(&body.inertia, "body_inertia")?,
            pos: v.row(&body.pos, "body_pos")?,
            quat: v.row(&body.quat, "body_quat")?,
            ipos: v.row(&body.ipos, "body_ipos")?,
            iquat: v.row(&body.iquat, "body_iquat")?,
            mocapid: v.of(mocapid)?,
            jntadr: v.of(jntadr)?,
            jntnum: v.of(jntnum)?,
            dofadr: v.of(own.clone().next().map_or(-1, |j| model.joint_addresses()[j].1 as i64))?,
            dofnum: v.of(own.map(|j| model.joints[j].kind.nv()).sum::<usize>())?,
            geomadr: v.of(geomadr)?,
            geomnum: v.of(geomnum)?,
        })
    }
}

impl Joint {
    pub(crate) fn of(py: Python<'_>, model: &Core, i: usize) -> PyResult<Self> {
        let (v, joint) = (Values { py, model }, &model.joints[i]);
        let (qposadr, dofadr) = model.joint_addresses()[i];
        let kind = match joint.kind {
            JointKind::Free => "free",
            JointKind::Ball => "ball",
            JointKind::Slide => "slide",
            JointKind::Hinge => "hinge",
        };
        Ok(Self {
            id: v.of(i)?,
            name: v.of(&joint.name)?,
            r#type: v.of(kind)?,
            bodyid: v.of(joint.body)?,
            qposadr: v.of(qposadr)?,
            dofadr: v.of(dofadr)?,
            nq: v.of(joint.kind.nq())?,
            nv: v.of(joint.kind.nv())?,
            limited: v.of(joint.range.is_some())?,
            range: v.bounds(joint.range, "jnt_range")?,
            pos: v.row(&joint.pos, "jnt_pos")?,
            axis: v.row(&joint.axis, "jnt_axis")?,
            stiffness: v.of(joint.stiffness)?,
            damping: v.of(joint.damping)?,
            armature: v.of(joint.armature)?,
            frictionloss: v.of(joint.frictionloss)?,
            velocity_limit: v.of(joint.velocity_limit.unwrap_or(f64::INFINITY))?,
        })
    }
}

impl Geom {
    pub(crate) fn of(py: Python<'_>, model: &Core, i: usize) -> PyResult<Self> {
        let (v, geom) = (Values { py, model }, &model.geoms[i]);
        let sizes = v.model.field("geom_size").expect("a field of every model").1;
        Ok(Self {
            id: v.of(i)?,
            name: v.of(&geom.name)?,
            bodyid: v.of(geom.body)?,
            r#type: v.of(if let Shape::HeightField { .. } = geom.shape { "hfield" } else { geom.shape.name() })?,
            size: v.row(&sizes[3 * i..3 * i + 3], "geom_size")?,
            pos: v.row(&geom.pos, "geom_pos")?,
            quat: v.row(&geom.quat, "geom_quat")?,
            contype: v.of(geom.contype)?,
            conaffinity: v.of(geom.conaffinity)?,
            condim: v.of(geom.condim)?,
            priority: v.of(geom.priority)?,
            friction: v.row(&geom.friction, "geom_friction")?,
            restitution: v.of(geom.restitution)?,
            margin: v.of(geom.margin)?,
            gap: v.of(geom.gap)?,
        })
    }
}

impl Pair {
    pub(crate) fn of(py: Python<'_>, model: &Core, i: usize) -> PyResult<Self> {
        let (v, pair) = (Values { py, model }, &model.pairs[i]);
        Ok(Self {
            id: v.of(i)?,
            name: v.of(&pair.name)?,
            geom1: v.of(pair.geoms[0])?,
            geom2: v.of(pair.geoms[1])?,
            dim: v.of(pair.condim)?,
            friction: v.row(&pair.friction, "pair_friction")?,
            restitution: v.of(pair.restitution)?,
            margin: v.of(pair.margin)?,
            gap: v.of(pair.gap)?,
        })
    }
}

impl Site {
    pub(crate) fn of(py: Python<'_>, model: &Core, i: usize) -> PyResult<Self> {
        let (v, site) = (Values { py, model }, &model.sites[i]);
        Ok(Self {
            id: v.of(i)?,
            name: v.of(&site.name)?,
            bodyid: v.of(site.body)?,
            r#type: v.of(site.shape.name())?,
            pos: v.row(&site.pos, "site_pos")?,
            quat: v.row(&site.quat, "site_quat")?,
        })
    }
}

impl Actuator {
    pub(crate) fn of(py: Python<'_>, model: &Core, i: usize) -> PyResult<Self> {
        let (v, actuator) = (Values { py, model }, &model.actuators[i]);
        let (trntype, trnid) = match actuator.transmission {
            Transmission::Joint(j) => ("joint", j),
            Transmission::Tendon(t) => ("tendon", t),
            Transmission::Site { site, .. } => ("site", site),
        };
        let has_activation = |a: &stepper_core::model::Actuator| a.activation != Activation::None;
        let before = model.actuators[..i].iter().filter(|a| has_activation(a)).count() as i64;
        Ok(Self {
            id: v.of(i)?,
            name: v.of(&actuator.name)?,
            trntype: v.of(trntype)?,
            trnid: v.of(trnid)?,
            actadr: v.of(if has_activation(actuator) { before } else { -1 })?,
            ctrlrange: v.bounds(actuator.ctrl_range, "actuator_ctrlrange")?,
            forcerange: v.bounds(actuator.force_range, "actuator_forcerange")?,
            actrange: v.bounds(actuator.act_range, "actuator_actrange")?,
            gear: v.row(&actuator.gear_row(), "actuator_gear")?,
            gaintype: v.of(actuator.force_model.gain.word())?,
            gainprm: v.row(&actuator.gain_row(), "actuator_gainprm")?,
            biastype: v.of(actuator.force_model.bias.word())?,
            biasprm: v.row(&actuator.bias_row(), "actuator_biasprm")?,
        })
    }
}

impl Sensor {
    pub(crate) fn of(py: Python<'_>, model: &Core, i: usize) -> PyResult<Self> {
        let (v, sensor) = (Values { py, model }, &model.sensors[i]);
        Ok(Self {
            id: v.of(i)?,
            name: v.of(&sensor.name)?,
            r#type: v.of(sensor.word())?,
            adr: v.of(model.sensor_addresses()[i])?,
            dim: v.of(sensor.dim(&model.sensors))?,
            noise: v.of(sensor.noise)?,
            cutoff: v.of(sensor.cutoff)?,
        })
    }
}

impl Tendon {
    pub(crate) fn of(py: Python<'_>, model: &Core, i: usize) -> PyResult<Self> {
        let (v, tendon) = (Values { py, model }, &model.tendons[i]);
        let joints: Vec<i64> = tendon.joints.iter().map(|&(j, _)| j as i64).collect();
        let coefficients: Vec<f64> = tendon.joints.iter().map(|&(_, c)| c).collect();
        Ok(Self {
            id: v.of(i)?,
            name: v.of(&tendon.name)?,
            jntid: read_only(joints.into_pyarray(py).into_any(), "tendon_jntid")?.unbind(),
            coef: v.row(&coefficients, "tendon_coef")?,
            limited: v.of(tendon.range.is_some())?,
            range: v.bounds(tendon.range, "tendon_range")?,
            stiffness: v.of(tendon.stiffness)?,
            damping: v.of(tendon.damping)?,
            armature: v.of(tendon.armature)?,
            frictionloss: v.of(tendon.frictionloss)?,
        })
    }
}

impl Keyframe {
    pub(crate) fn of(py: Python<'_>, model: &Core, i: usize) -> PyResult<Self> {
        let (v, key) = (Values { py, model }, &model.keyframes[i]);
        Ok(Self {
            id: v.of(i)?,
            name: v.of(&key.name)?,
            time: v.of(key.time)?,
            qpos: v.row(&key.qpos, "key_qpos")?,
            qvel: v.row(&key.qvel, "key_qvel")?,
            act: v.row(&key.act, "key_act")?,
            ctrl: v.row(&key.ctrl, "key_ctrl")?,
        })
    }
}
