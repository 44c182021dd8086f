//! `Stepper.randomize`: arrays in and out.

use numpy::PyUntypedArrayMethods;
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyMapping};
use stepper_core::{ActuatorNumbers, Parameter, Precision};

use crate::array::{array, check_shape_of, described, read_only_of_environments, readonly, unknown_field};
use crate::device_models::drives;
use crate::error::value_error;
use crate::selection::Selection;
use crate::stepper::recording::{notify, recorder_of};
use crate::stepper::{Reading, Stepper, borrow};

/// The field that is no field of the model.
const ACTUATORS: &str = "actuators";

impl Stepper {
    /// Assigns fields, (num_envs, ...) each, and `actuators` to some environments; None is the model's own numbers, and what drives were
    /// made with, and so is every field when none is named.
    pub(super) fn assign_parameters(&mut self, fields: Option<&Bound<'_, PyDict>>, selection: &Selection) -> PyResult<()> {
        let envs = &selection.ascending()[..];
        let mut given: Vec<(Parameter, Option<Vec<f64>>)> = Vec::new();
        let mut specs = None;
        for (name, value) in fields.into_iter().flatten() {
            let name: String = name.extract()?;
            if name == ACTUATORS {
                specs = Some(if value.is_none() { None } else { Some(drives(&value, &self.model, self.n(), Some(envs))?) });
                continue;
            }
            let Ok(parameter) = name.parse::<Parameter>() else {
                let known = Parameter::ALL.into_iter().map(Parameter::name).chain([ACTUATORS]).collect();
                return Err(unknown_field(value.py(), "Stepper.randomize", &name, known, "help(stepper.Stepper.randomize)")?);
            };
            if value.is_none() {
                given.push((parameter, None));
                continue;
            }
            let (tail, _) = self.simulation.model().field(&name).expect("a field of the model");
            let values = if self.batched || selection.by_index {
                let full: Vec<usize> = std::iter::once(self.n()).chain(tail).collect();
                selection.numbers(&value, &name, &full, None)?.as_slice()?.to_vec()
            } else {
                let numbers = readonly(&value, &name)?;
                check_shape_of(&value, &name, numbers.shape(), &[&tail])?;
                numbers.as_slice()?.to_vec()
            };
            given.push((parameter, Some(values)));
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

    /// The fields that environments have of their own, by name; drives as a `stepper.ActuatorModel`.
    pub(super) fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let all = PyDict::new(py);
        for (parameter, values) in self.simulation.own_parameters() {
            let name = parameter.name();
            let (tail, _) = self.simulation.model().field(name).expect("a field of the model");
            let values = array(py, &self.shape(&tail), values.to_vec(), Precision::F64)?;
            all.set_item(name, read_only_of_environments(values, name)?)?;
        }
        if let Some(specs) = self.simulation.own_actuators() {
            let rows = pythonize::pythonize(py, specs).map_err(|e| PyValueError::new_err(e.to_string()))?;
            let class = py.import("stepper")?.getattr("ActuatorModel")?;
            all.set_item(ACTUATORS, class.call_method1("_from_rows", (self.model.clone_ref(py), rows))?)?;
        }
        Ok(all)
    }
}

#[pymethods]
impl Stepper {
    /// Gives environments parameters of their own, as `Model.replace` would give them to a model; what derives from them follows.
    ///
    /// Every environment then moves as one of a `Stepper` of its own model, bit for bit. Parameters are not part of the state:
    /// `reset` and `set_state` leave them, pickles and recordings have them. Other fields stay as they are, whether the model's or
    /// randomized before. What no environment has of its own costs neither time nor memory.
    ///
    /// Contacts of an explicit pair use pair_friction and pair_restitution and ignore those of the geoms. A new geom_friction for a geom
    /// of a pair is therefore an error, unless pair_friction is given too, in this call or an earlier one: new values, or the model's to
    /// keep these contacts as they are. An earlier call counts for all environments, also for those that it did not select, whose pairs
    /// keep the model's values. Likewise geom_restitution and pair_restitution.
    ///
    ///     sim.randomize(geom_friction=friction)  # (num_envs, ngeom, 3)
    ///     sim.randomize({"geom_friction[floor,box][0]": sliding}, envs=[3, 5])  # (2, 2)
    ///
    /// Args:
    ///     values: Values by selector, `field[names][columns]` (docs/reference/what_can_vary.md); other numbers of these
    ///         fields stay as they are.
    ///         The shape is that of the selected numbers with num_envs in front: one name or index and one column have no axis of
    ///         their own. (num_envs,) is one number for all selected, a single number is the same in all environments, and None
    ///         gives the model's own numbers back. In place of values, `envs` may stand first.
    ///     envs: The environments that change, as of `reset`.
    ///     **fields: Arrays with num_envs in front of the shape that the field has in the model; None gives the model's own numbers
    ///         back, and so do all fields when none is named: gravity (num_envs, 3) m/s^2; body_mass (num_envs, nbody) kg, body_ipos
    ///         (num_envs, nbody, 3) m, the centre of mass, and body_inertia (num_envs, nbody, 3) kg m^2, principal moments, each by
    ///         itself: a body of twice the mass keeps its inertia unless it is given too; geom_friction (num_envs, ngeom, 3) sliding,
    ///         torsional (m), rolling (m); geom_restitution (num_envs, ngeom); pair_friction (num_envs, npair, 3) and pair_restitution
    ///         (num_envs, npair), the same of explicit pairs, see below; geom_size, geom_pos (num_envs, ngeom, 3) m, which
    ///         leave masses alone; jnt_stiffness (num_envs, njnt) N/m or N m/rad; jnt_range (num_envs, njnt, 2) m or rad;
    ///         dof_damping, dof_armature, dof_frictionloss (num_envs, nv); actuator_gainprm, actuator_biasprm (num_envs, nu, 10) as
    ///         MuJoCo has them: with their first three numbers the force is gain . (1, length, velocity) times the input plus
    ///         bias . (1, length, velocity); numbers that the type of an actuator's gain or bias does not read are 0. actuators, a
    ///         `stepper.ActuatorModel`: its drives take the place of those of the actuators it fits, with all their numbers (what a
    ///         `Drive` does not say is its default); other actuators keep theirs, and None gives back what the stepper was made with.
    ///         Stages are compiled: a servo, motor, lag, limits or friction must have been given to `Stepper(..., actuators=)`, to
    ///         one environment at least, and delays may be as long as the longest there. Delay lines, lags and integrals are state:
    ///         they stay as they are until `reset`.
    ///
    /// Raises:
    ///     TypeError, IndexError: As of `reset`.
    ///     ValueError: A wrong shape; both are named. A number that a drive may not have, or a stage or delay that it was not made
    ///         for, with the actuator. Nothing is changed then.
    ///     ModelError: A field that all environments share, numbers that no model may have, that ask for something that the model
    ///         has none of, such as dry friction where it has 0, or that an explicit pair overrides; with field, element and
    ///         environment. Nothing is changed then.
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
        let mut this = borrow(slf)?;
        let selection = this.selection(envs.as_ref())?;
        if selection.envs.is_empty() {
            return Ok(());
        }
        this.assign_parameters(fields.as_ref(), &selection)?;
        let recorder = recorder_of(slf.py(), this);
        notify(slf, recorder, "randomize", &[("envs", envs), ("fields", fields.map(Bound::into_any))])
    }

    /// What environments have of their own, as `randomize` takes it: arrays by field, and under "actuators" an `ActuatorModel`.
    #[getter]
    fn randomized<'py>(slf: Reading<'_>, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        slf.parameters(py)
    }
}
