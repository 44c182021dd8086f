//! Functions of structs whose fields are lane-interleaved arrays.

/// Implements functions that do the same with every lane-interleaved array of a struct: copy lanes, set lanes, and report sizes. The
/// macro's list has the names of these fields.
macro_rules! lane_arrays {
    ($state:ident: $($array:ident)*) => {
        impl<S: Scalar> $state<S> {
            /// Copy of the arrays with the lanes `first` to `first + n`, exclusive. All other fields have their default values.
            fn part_of_arrays(&self, lanes: usize, first: usize, n: usize) -> Self {
                Self { $($array: columns(&self.$array, lanes, first, n),)* ..Self::default() }
            }

            /// Copies the arrays of `part`, which has `n` lanes, to the lanes `target`.
            fn set_arrays(&mut self, lanes: usize, target: DestinationLanes, n: usize, part: &Self) {
                $(set_columns(&mut self.$array, lanes, target, n, &part.$array);)*
            }

            /// Memory of the arrays, bytes.
            fn bytes_of_arrays(&self) -> usize {
                0 $(+ size_of_val(&self.$array[..]))*
            }

            /// Lengths of the arrays.
            fn lengths(&self) -> Vec<usize> {
                vec![$(self.$array.len()),*]
            }
        }
    };
}

pub(crate) use lane_arrays;

/// Sets the values of one lane of a lane-interleaved array to zero, from index `first` on. To clear all values of a lane, `first` is the
/// index of the lane.
pub(crate) fn clear_column<T: Default>(rows: &mut [T], lanes: usize, first: usize) {
    rows.iter_mut().skip(first).step_by(lanes).for_each(|x| *x = T::default());
}
