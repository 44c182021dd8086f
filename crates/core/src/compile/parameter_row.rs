//! Rows of tables of parameters.

/// Row of a table of parameters. It defines how many numbers the row has, and their order in memory.
pub(super) trait ParameterRow<T: Copy>: Copy {
    /// Length of a row.
    const WIDTH: usize;

    /// Row from the first numbers of a slice.
    fn read(numbers: &[T]) -> Self;

    /// Appends the numbers of the row.
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

/// Declares rows with named parts: their structs, and how they are read and written.
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
