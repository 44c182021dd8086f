//! Tables of read-only attributes of Python classes.

/// Declares read-only attributes of a Python class, each with the expression that computes it. The doc comment of an entry becomes the
/// documentation of the attribute. `|slf, py| (Reading<'_>)` names the borrowed object and the interpreter, and gives the type of the
/// object.
macro_rules! getters {
    ($class:ident, |$slf:pat_param, $py:ident| ($borrow:ty) -> $result:ty; $($(#[$doc:meta])* $name:ident: $value:expr,)*) => {
        #[pymethods]
        impl $class {
            $(
                $(#[$doc])*
                #[getter]
                fn $name<'py>($slf: $borrow, $py: Python<'py>) -> $result {
                    $value
                }
            )*
        }
    };
}

pub(crate) use getters;
