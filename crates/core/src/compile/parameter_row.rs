//! Types for the rows of parameter tables: sizes, and conversion to and from numbers.

/// Row of a parameter table. The type defines how many numbers the row has, and their order in memory.
pub(super) trait ParameterRow<T: Copy>: Copy {
    /// Number of values in a row.
    const WIDTH: usize;

    /// Reads a row from the first values of `numbers`.
    fn read(numbers: &[T]) -> Self;

    /// Appends the values of the row to `numbers`.
    fn write(self, numbers: &mut Vec<T>);
}

impl<T: Copy> ParameterRow<T> for T {
    const WIDTH: usize = 1;

    #[inline(always)]
    fn read(numbers: &[T]) -> Self {
        numbers[0]
    }

    fn write(self, numbers: &mut Vec<T>) {
        numbers.push(self);
    }
}

impl<T: Copy, const N: usize> ParameterRow<T> for [T; N] {
    const WIDTH: usize = N;

    #[inline(always)]
    fn read(numbers: &[T]) -> Self {
        *numbers.first_chunk().expect("a row has its width")
    }

    fn write(self, numbers: &mut Vec<T>) {
        numbers.extend(self);
    }
}

/// Declares row types with named fields: the structs, and how they are read and written.
macro_rules! parameter_rows {
    ($($(#[$doc:meta])* $name:ident { $($(#[$part_doc:meta])* $part:ident: $kind:ty,)* })*) => { $(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        pub struct $name<T> {
            $($(#[$part_doc])* pub $part: $kind,)*
        }

        impl<T: Copy> ParameterRow<T> for $name<T> {
            const WIDTH: usize = 0 $(+ <$kind as ParameterRow<T>>::WIDTH)*;

            #[inline(always)]
            fn read(numbers: &[T]) -> Self {
                let rest = numbers;
                $(let ($part, rest) = (<$kind as ParameterRow<T>>::read(rest), &rest[<$kind as ParameterRow<T>>::WIDTH..]);)*
                let _ = rest;
                Self { $($part),* }
            }

            fn write(self, numbers: &mut Vec<T>) {
                $(self.$part.write(numbers);)*
            }
        }
    )* };
}
pub(super) use parameter_rows;
