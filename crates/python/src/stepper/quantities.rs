//! Quantities of all environments outside a step: mass matrix, energy, momentum.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use stepper_core::{DerivedQuantity, Precision, Snapshot, StepInputs};

use crate::arguments::{Env, no_others};
use crate::array::array;
use crate::error::value_error;
use crate::stepper::{Stepper, Writing};

impl Stepper {
    /// Concatenated results of `evaluate` for all environments. `evaluate` gets a snapshot of each environment with its current controls.
    fn of_each(&mut self, py: Python<'_>, evaluate: impl Fn(&mut Snapshot<'_>) -> Vec<f64>) -> PyResult<Vec<f64>> {
        self.apply(py)?;
        let mut values = Vec::new();
        for env in 0..self.n() {
            values.extend(evaluate(&mut self.simulation.snapshot(env, &StepInputs::default()).map_err(value_error)?));
        }
        Ok(values)
    }

    /// Splits the rows of `rows` into two arrays (num_envs, *width). Each row, one per environment, consists of two halves of shape
    /// `width`. If the stepper was created without `num_envs`, scalar halves give Python floats.
    fn halves<'py>(&self, py: Python<'py>, rows: &[f64], width: &[usize]) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let size: usize = width.iter().product();
        let half = |k: usize| {
            let values = rows.chunks_exact(2 * size).flat_map(|row| row[k * size..][..size].iter().copied()).collect();
            let values = array(py, &self.shape(width), values, Precision::F64)?;
            if self.batched || !width.is_empty() { Ok(values) } else { values.call_method0("item") }
        };
        Ok((half(0)?, half(1)?))
    }
}

#[pymethods]
impl Stepper {
    /// Mass matrices at the current configurations, including armature, without terms that depend on the time step.
    ///
    /// Returns:
    ///     Mass matrices, (num_envs, nv, nv), in the precision of the stepper.
    #[pyo3(signature = (**others), text_signature = "($self)")]
    fn mass_matrix<'py>(mut slf: Writing<'_>, py: Python<'py>, others: Option<&Bound<'_, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        no_others("Stepper.mass_matrix", others, &[])?;
        slf.apply(py)?;
        Ok(slf.derive(py, &[DerivedQuantity::MassMatrix])?.remove(0))
    }

    /// Mass matrix, bias force, smooth acceleration, energies and momenta of an environment, for the tests' reference trajectories.
    ///
    /// The list has these quantities in this order. They are computed in 64 bits, also for a stepper with precision "f32".
    fn _in_64_bits<'py>(mut slf: Writing<'_>, py: Python<'py>, env: Env) -> PyResult<Vec<Bound<'py, PyAny>>> {
        let env = slf.env(env)?;
        slf.apply(py)?;
        let snapshot = slf.simulation.snapshot(env, &StepInputs::default()).map_err(value_error)?;
        let (mass, bias, smooth) = (snapshot.mass_matrix(), snapshot.bias_force(), snapshot.smooth_acceleration());
        let ((potential, kinetic), (linear, angular)) = (snapshot.energy(), snapshot.momentum());
        let nv = bias.len();
        let arrays = [
            (vec![nv, nv], mass),
            (vec![nv], bias),
            (vec![nv], smooth),
            (vec![2], vec![potential, kinetic]),
            (vec![2, 3], linear.into_iter().chain(angular).collect()),
        ];
        arrays.into_iter().map(|(shape, values)| array(py, &shape, values, Precision::F64)).collect()
    }

    /// Potential energy (gravity, springs of joints and tendons) and kinetic energy (including armature) at the current states.
    ///
    /// Bodies that are fixed to the world do not count. MuJoCo's `energy` adds their constant potential energy.
    ///
    /// Returns:
    ///     Potential and kinetic energies: two arrays (num_envs,) float64, J.
    fn energy<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let rows = slf.of_each(py, |snapshot| <[f64; 2]>::from(snapshot.energy()).to_vec())?;
        slf.halves(py, &rows, &[])
    }

    /// Linear momentum, and angular momentum about the centre of mass, at the current states.
    ///
    /// Returns:
    ///     Linear and angular momenta in world axes: two arrays (num_envs, 3) float64, kg m/s and kg m^2/s.
    fn momentum<'py>(mut slf: Writing<'_>, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyAny>)> {
        let rows = slf.of_each(py, |snapshot| {
            let (linear, angular) = snapshot.momentum();
            linear.into_iter().chain(angular).collect()
        })?;
        slf.halves(py, &rows, &[3])
    }
}
