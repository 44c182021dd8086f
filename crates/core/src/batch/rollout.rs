//! Rollout: many controls in one call, with quantities recorded after each control.
//!
//! A thread steps the same environments during the whole rollout, so that they stay in its cache. Each thread writes to its part of every
//! output array.

use stepper_real::{Mask, Real, Scalar};

use crate::integrators::workspace::Workspace;
use crate::math::precision::Precision;
use crate::model::Model;

stepper_model::named! {
    /// Quantity that a rollout can record after each control.
    #[non_exhaustive]
    pub enum Quantity {
        /// Configuration, nq numbers per environment.
        Qpos = "qpos",
        /// Velocity, nv numbers per environment.
        Qvel = "qvel",
        /// Activations, na numbers per environment.
        Act = "act",
        /// Sensor readings, nsensordata numbers per environment.
        Observation = "sensordata",
    }
}

impl Quantity {
    /// Number of values of the quantity per environment.
    pub fn width(self, model: &Model) -> usize {
        match self {
            Self::Qpos => model.nq(),
            Self::Qvel => model.nv(),
            Self::Act => model.na(),
            Self::Observation => model.nsensordata(),
        }
    }
}

/// Mutable array in the precision of the simulation.
#[derive(Debug)]
pub enum Numbers<'a> {
    /// Array of 64-bit numbers.
    F64(&'a mut [f64]),
    /// Array of 32-bit numbers.
    F32(&'a mut [f32]),
}

impl Numbers<'_> {
    /// Scalar type of the array.
    pub fn precision(&self) -> Precision {
        match self {
            Self::F64(_) => Precision::F64,
            Self::F32(_) => Precision::F32,
        }
    }

    /// Length of the array.
    pub fn len(&self) -> usize {
        match self {
            Self::F64(x) => x.len(),
            Self::F32(x) => x.len(),
        }
    }

    /// Whether the array is empty.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

/// Output arrays of a rollout, row-major in their shapes. Their first axis has the controls that follow one another, the second the
/// environments.
#[derive(Debug)]
pub struct Recording<'a> {
    /// Recorded quantities and their arrays, (controls, num_envs, n) each, where n is the [width](Quantity::width) of the quantity.
    pub quantities: Vec<(Quantity, Numbers<'a>)>,
    /// Status flags of all steps with one control, as [`Status::bits`](crate::Status::bits): (controls, num_envs).
    pub status: &'a mut [u32],
    /// Largest residual of the steps with one control, m/s: (controls, num_envs).
    pub residual: &'a mut [f64],
}

/// Chunk of a recording: the output rows of consecutive environments (those of one chunk of groups), which one worker writes.
#[derive(Debug)]
pub struct RecordingChunk<'a, S> {
    /// Recorded quantities: quantity, number of values per environment, and one output slice for each control.
    quantities: Vec<(Quantity, usize, Vec<&'a mut [S]>)>,
    /// Status flags of the environments: one output slice for each control.
    status: Vec<&'a mut [u32]>,
    /// Residuals of the environments, m/s: one output slice for each control.
    residual: Vec<&'a mut [f64]>,
}

impl<'a> Recording<'a> {
    /// Splits the recording into chunks of `size` environments each; the last chunk has the rest. `numbers` returns the slice in an array
    /// of the simulation's precision.
    pub fn split<S: Scalar>(
        self,
        num_envs: usize,
        size: usize,
        numbers: impl Fn(Numbers<'a>) -> &'a mut [S],
    ) -> Vec<RecordingChunk<'a, S>> {
        let controls = self.status.len() / num_envs;
        let status = parts(self.status, num_envs, size);
        let residual = parts(self.residual, num_envs, size);
        let mut chunks: Vec<RecordingChunk<'a, S>> = status
            .into_iter()
            .zip(residual)
            .map(|(status, residual)| RecordingChunk { quantities: Vec::new(), status, residual })
            .collect();
        for (quantity, array) in self.quantities {
            if array.is_empty() {
                continue;
            }
            let width = array.len() / (controls * num_envs);
            for (chunk, rows) in chunks.iter_mut().zip(parts(numbers(array), num_envs * width, size * width)) {
                chunk.quantities.push((quantity, width, rows));
            }
        }
        chunks
    }
}

/// Splits every row of an array, of length `row`, into pieces of length `size`. Entry k of the result has piece k of all rows.
fn parts<T>(array: &mut [T], row: usize, size: usize) -> Vec<Vec<&mut [T]>> {
    let rows = array.len() / row;
    let mut out: Vec<Vec<&mut [T]>> = (0..row.div_ceil(size)).map(|_| Vec::with_capacity(rows)).collect();
    for row in array.chunks_exact_mut(row) {
        for (piece, out) in row.chunks_mut(size).zip(&mut out) {
            out.push(piece);
        }
    }
    out
}

impl<S: Scalar> RecordingChunk<'_, S> {
    /// Whether the recording contains this quantity.
    pub fn has(&self, quantity: Quantity) -> bool {
        self.quantities.iter().any(|q| q.0 == quantity)
    }

    /// Reads the status flags and residuals of one group that [`RecordingChunk::write`] stored for control number `call`. Copies the flags
    /// to `status`, and returns the residuals.
    ///
    /// A part of a rollout may end between two steps with this control. The next part then continues with these flags and residuals.
    /// `first` is the row in the arrays of `self` that belongs to the group's first environment.
    pub fn resume<R: Real<Scalar = S>>(&self, call: usize, first: usize, alive: R::Mask, status: &mut [u32]) -> R {
        let used = alive.bits().count_ones() as usize;
        status[..used].copy_from_slice(&self.status[call][first..first + used]);
        let mut residual = R::zero();
        for (l, &x) in self.residual[call][first..first + used].iter().enumerate() {
            residual.set_lane(l, Scalar::from_f64(x));
        }
        residual
    }

    /// Records the state, sensor readings, status flags and residual of one group after control number `call`. `first` is the row in the
    /// arrays of `self` that belongs to the group's first environment.
    pub fn write<R: Real<Scalar = S>>(&mut self, call: usize, first: usize, s: &Workspace<R>, readings: &[R], status: &[u32], residual: R) {
        let used = s.alive.bits().count_ones() as usize;
        self.status[call][first..first + used].copy_from_slice(&status[..used]);
        for (l, out) in self.residual[call][first..first + used].iter_mut().enumerate() {
            *out = residual.lane(l).to_f64();
        }
        for (quantity, width, rows) in &mut self.quantities {
            let from = match quantity {
                Quantity::Qpos => &s.state.q[..],
                Quantity::Qvel => &s.state.v[..],
                Quantity::Act => &s.state.act[..],
                Quantity::Observation => readings,
            };
            let rows = &mut rows[call][first * *width..(first + used) * *width];
            for (l, row) in rows.chunks_exact_mut(*width).enumerate() {
                for (out, x) in row.iter_mut().zip(from) {
                    *out = x.lane(l);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_are_disjoint_and_complete() {
        let (num_envs, calls, size) = (7, 3, 3);
        let mut q: Vec<f64> = (0..calls * num_envs * 2).map(|i| i as f64).collect();
        let (mut status, mut residual) = (vec![0; calls * num_envs], vec![0.0; calls * num_envs]);
        let quantities = vec![(Quantity::Qpos, Numbers::F64(&mut q)), (Quantity::Act, Numbers::F64(&mut []))];
        let recording = Recording { quantities, status: &mut status, residual: &mut residual };
        let chunks = recording.split(num_envs, size, |numbers| match numbers {
            Numbers::F64(x) => x,
            Numbers::F32(_) => unreachable!(),
        });
        let lengths: Vec<usize> = chunks.iter().map(|s| s.status[0].len()).collect();
        assert_eq!(lengths, [3, 3, 1]);
        assert!(chunks.iter().all(|s| s.quantities.len() == 1 && s.quantities[0].1 == 2 && s.status.len() == calls));
        // Environment 5 is the last of the second chunk.
        assert_eq!(chunks[1].quantities[0].2[1][4..], [24.0, 25.0]);
    }
}
