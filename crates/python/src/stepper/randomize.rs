//! `Stepper.randomize`: parameters per environment.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping};
use stepper_core::{ActuatorNumbers, Parameter, Precision};

use crate::array::{array, described, no_mapping, read_only, unknown_field};
use crate::device_models::drives;
use crate::error::value_error;
use crate::selection::Selection;
use crate::stepper::recording::notify;
use crate::stepper::{Stepper, Writing};

/// Name of the argument of `randomize` that takes an actuator model. All other names are fields of the model.
const ACTUATORS: &str = "actuators";

impl Stepper {
    /// Sets parameters of the selected environments.
    ///
    /// The dictionary `fields` has an array for each field name, and the actuator model under the key "actuators". An array has one row
    /// for each environment of the batch, or for each index of a selection by index. For a stepper without an environment axis and a
    /// selection without indices, an array has the shape of the field in the model.
    ///
    /// A value None restores the values of the model, or the drives (models of single actuators) that the stepper was created with. An
    /// empty or missing `fields` restores everything.
    pub(super) fn randomize_from_dict(&mut self, fields: Option<&Bound<'_, PyDict>>, selection: &Selection) -> PyResult<()> {
        let envs = &selection.ascending()[..];
        let mut given: Vec<(Parameter, Option<Vec<f64>>)> = Vec::new();
        let mut specs = None;
        // An unknown name is reported before wrong values of other fields.
        for (name, _) in fields.into_iter().flatten() {
            let text: String = name.extract()?;
            if text != ACTUATORS && text.parse::<Parameter>().is_err() {
                let known = Parameter::ALL.into_iter().map(Parameter::name).chain([ACTUATORS]).collect();
                return Err(unknown_field(name.py(), "Stepper.randomize", &text, known, "help(stepper.Stepper.randomize)")?);
            }
        }
        for (name, value) in fields.into_iter().flatten() {
            let name: String = name.extract()?;
            let Ok(parameter) = name.parse::<Parameter>() else {
                specs = Some(if value.is_none() { None } else { Some(drives(&value, &self.model, self.n(), Some(envs))?) });
                continue;
            };
            no_mapping("Stepper.randomize", &name, &value)?;
            if value.is_none() {
                given.push((parameter, None));
                continue;
            }
            let (tail, _) = self.simulation.model().field(&name).expect("a field of the model");
            let values = self.selected_rows(&value, &name, &tail, false, selection)?;
            given.push((parameter, Some(values.as_slice()?.to_vec())));
        }
        if given.is_empty() && specs.is_none() {
            return self.simulation.reset_parameters(envs).map_err(value_error);
        }
        let assigned: Vec<(Parameter, Option<&[f64]>)> = given.iter().map(|(parameter, values)| (*parameter, values.as_deref())).collect();
        let actuators = match &specs {
            None => ActuatorNumbers::Kept,
            Some(None) => ActuatorNumbers::Original,
            Some(Some(specs)) => ActuatorNumbers::Given(specs),
        };
        self.simulation.randomize_all(&assigned, actuators, envs).map_err(value_error)
    }

    /// Dictionary of the per-environment parameters: a read-only array for each field that `randomize` set, and a `stepper.ActuatorModel`
    /// with the drives under the key "actuators".
    pub(super) fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for (parameter, values) in self.simulation.per_env_fields() {
            let name = parameter.name();
            let (tail, _) = self.simulation.model().field(name).expect("a field of the model");
            let values = array(py, &self.shape(&tail), values.to_vec(), Precision::F64)?;
            all.set_item(name, read_only(values)?)?;
        }
        if let Some(specs) = self.simulation.per_env_actuators() {
            let rows = pythonize::pythonize(py, specs).map_err(|e| PyValueError::new_err(e.to_string()))?;
            let class = py.import("stepper")?.getattr("ActuatorModel")?;
            all.set_item(ACTUATORS, class.call_method1("_from_rows", (self.model.clone_ref(py), rows))?)?;
        }
        Ok(all)
    }
}

#[pymethods]
impl Stepper {
    /// Sets parameters of some or all environments, with the effect of `Model.replace`. Dependent quantities are recomputed.
    ///
    /// With hard contact, an environment then moves, bit for bit, as in a `Stepper` of the model that `Model.replace` returns. With
    /// MuJoCo's contact law, the inverse weights stay those of the stepper's model. Parameters are not part of the state: `reset` and
    /// `set_state` keep them, and pickles and recordings include them. Fields that a call does not name keep their values. Fields that are
    /// never randomized cost neither time nor memory.
    ///
    /// Contacts of an explicit pair use pair_friction and pair_restitution, and ignore geom_friction and geom_restitution. So a new
    /// geom_friction for a geom of an explicit pair is an error without pair_friction. Give pair_friction in this call or an earlier one,
    /// with new values or the values of the model. One earlier call suffices for all environments, also for environments that it did not
    /// select. The same holds for geom_restitution and pair_restitution.
    ///
    ///     sim.randomize(geom_friction=friction)  # (num_envs, ngeom, 3)
    ///     sim.randomize({"geom_friction[floor,box][0]": sliding}, envs=[3, 5])  # (2, 2)
    ///
    /// Args:
    ///     values: Values by selector, `field[names][columns]` (docs/reference/what_can_vary.md). Other entries of these fields keep their
    ///         values. Each array has the axis of environments, then an axis for the selected elements and one for the selected columns, as
    ///         in NumPy's indexing. A single name, index or column has no axis. If `envs` has indices, the axis of environments has one
    ///         entry per index, otherwise num_envs. An array with this axis alone sets all selected entries of an environment to one
    ///         value. A scalar sets the selected entries of all selected environments. None restores the values of the model. The first
    ///         argument may also be `envs`, without values.
    ///     envs: Environments to change, as in `reset`.
    ///     **fields: Values of whole fields, (num_envs, ...) with the shape of the field in the model. None restores the values of
    ///         the model. A call with neither values nor fields restores all fields and drives; an empty dict as `values` changes nothing.
    ///
    ///         * gravity (num_envs, 3), m/s^2
    ///         * body_mass (num_envs, nbody), kg; body_ipos (num_envs, nbody, 3), centre of mass, m; body_inertia (num_envs, nbody, 3),
    ///           principal moments, kg m^2. They are independent: a new mass does not change the inertia.
    ///         * geom_friction (num_envs, ngeom, 3), sliding, torsional (m), rolling (m); geom_restitution (num_envs, ngeom)
    ///         * pair_friction (num_envs, npair, 3) and pair_restitution (num_envs, npair) of explicit pairs
    ///         * geom_size and geom_pos (num_envs, ngeom, 3), m. Masses do not change.
    ///         * jnt_stiffness (num_envs, njnt), N/m or N m/rad; jnt_range (num_envs, njnt, 2), m or rad
    ///         * dof_damping, dof_armature, dof_frictionloss (num_envs, nv)
    ///         * eq_data (num_envs, neq, 11), anchors, relative pose and torquescale, or polynomial, as in MuJoCo; see `closed_eq_data`
    ///         * actuator_gainprm, actuator_biasprm (num_envs, nu, 10), as in MuJoCo. With affine gain and bias, the force is
    ///           gain[:3] . (1, length, velocity) times the input plus bias[:3] . (1, length, velocity). Entries that the type of an
    ///           actuator does not use are 0.
    ///         * actuators, a `stepper.ActuatorModel`: its drives replace the drives of the matching actuators completely. Arrays in drives
    ///           have num_envs entries, also if `envs` has indices. Other actuators keep their drives, and None restores the drives that
    ///           were given to the constructor. A new drive must have the structure of the constructor's drive: both or neither have a
    ///           servo, a sampling period, a motor and a torque-speed curve. Gear, rotor inertia and control of the motor are the same. A
    ///           new drive can have lag, limits or friction only if the constructor's drive has them in at least one environment. Delays
    ///           must not exceed the longest delay there. Delay lines, lags and integrals are state: they are kept until `reset`.
    ///
    /// Raises:
    ///     TypeError, IndexError: An argument `envs` is invalid, as in `reset`, or `values` is no dict.
    ///     ValueError: A selector or a shape is wrong, or two selectors set the same number. Or a drive has an invalid value, another
    ///         structure or a longer delay. No parameter changes.
    ///     ModelError: The field must be the same in all environments, a value is invalid, or an explicit pair overrides the value. Or the
    ///         value needs a feature that the model lacks, such as dry friction in a joint without it. The message has field, element and
    ///         environment. No parameter changes.
    #[pyo3(signature = (values=None, /, envs=None, **fields))]
    fn randomize(
        slf: &Bound<'_, Self>,
        values: Option<Bound<'_, PyAny>>,
        envs: Option<Bound<'_, PyAny>>,
        fields: Option<Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        let (values, envs) = match values {
            Some(first) if first.cast::<PyMapping>().is_err() => {
                if envs.is_some() {
                    return Err(PyTypeError::new_err(format!(
                        "Stepper.randomize: values is {}, must be a dict of selectors, as {{'geom_friction[floor][0]': 0.5}}",
                        described(&first)
                    )));
                }
                (None, Some(first))
            }
            values => (values, envs),
        };
        let fields = match values {
            None => fields,
            Some(values) if values.is_empty()? && fields.is_none() => return Ok(()),
            Some(values) => {
                let selectors = slf.py().import("stepper.shared.selectors")?;
                Some(selectors.call_method1("randomized_fields", (slf, values, envs.as_ref(), fields))?.cast_into::<PyDict>()?)
            }
        };
        let mut this = Writing::try_from(slf)?;
        let selection = this.selection(envs.as_ref())?;
        if selection.envs.is_empty() {
            return Ok(());
        }
        this.randomize_from_dict(fields.as_ref(), &selection)?;
        notify(slf, this, "randomize", &[("envs", envs), ("fields", fields.map(Bound::into_any))])
    }
}
