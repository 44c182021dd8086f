//! Tables of read-only attributes of Python classes.

/// Declares read-only attributes of a Python class, each with the expression that computes it. The doc comment of an entry becomes the
/// documentation of the attribute.
///
/// `|slf, py| (Reading<'_>)` names the borrowed object and the interpreter, and gives the type of the object. Each entry gives the type of
/// its attribute, unless the first line gives one type for all attributes.
macro_rules! getters {
    ($class:ident, |$slf:pat_param, $py:ident| ($borrow:ty) -> $type:ty; $($(#[$doc:meta])* $name:ident: $value:expr,)*) => {
        getters! { $class, |$slf, $py| ($borrow); $($(#[$doc])* $name -> $type { $value })* }
    };
    ($class:ident, |$slf:pat_param, $py:ident| ($borrow:ty); $($(#[$doc:meta])* $name:ident -> $type:ty { $value:expr })*) => {
        #[pymethods]
        impl $class {
            $(
                $(#[$doc])*
                #[getter]
                fn $name<'py>($slf: $borrow, $py: Python<'py>) -> $type {
                    $value
                }
            )*
        }
    };
}

pub(crate) use getters;
