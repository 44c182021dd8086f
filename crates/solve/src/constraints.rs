//! Kinds of constraints, and the only list of all kinds.
//!
//! Each kind has a file with a set of constraints, its rows, and its implementation of [`ConstraintSet`](constraint_set::ConstraintSet).
//! The rest of the crate refers to a kind only by its line in `by_kind`, `each_kind` and `make_kinds`.

pub(crate) mod constraint_set;
pub(crate) mod friction;
pub(crate) mod orthogonalisation;
pub(crate) mod rolling;
pub(crate) mod scalar;
pub(crate) mod sliding;

/// Declares a struct with a field for each kind of constraint (`scalars`, `contacts`, `rolling_contacts`), in the order in which sweeps
/// visit them. The fields in the braces come first.
///
/// The word after `each` selects the type of these fields: `set` is a set of constraints, `rows` a reference to its rows, and `own_rows` an
/// owned list of rows. `impulses` is a list of impulses, `numbers` a list of numbers, `count` a number, and `saved` a list of saved
/// constraints.
macro_rules! by_kind {
    ($(#[$meta:meta])* $vis:vis struct $name:ident[$($generics:tt)*] { $($fields:tt)* } each $what:ident) => {
        $crate::constraints::by_kind! {
            @$what
            [
                "Equalities, limits and dry friction." scalars: $crate::constraints::scalar::ScalarRows<R>,
                "Contacts with sliding friction, in their frames (n, t1, t2)." contacts: $crate::constraints::sliding::SlidingContacts<R>,
                "Contacts with torsional or rolling friction, as their rows are scaled."
                rolling_contacts: $crate::constraints::rolling::RollingContacts<R>,
            ]
            $(#[$meta])* $vis struct $name[$($generics)*] { $($fields)* }
        }
    };
    (@set [$($doc:literal $kind:ident: $set:ty,)+] $($rest:tt)+) => {
        $crate::constraints::by_kind! { @struct [$($doc $kind: $set,)+] $($rest)+ }
    };
    (@rows [$($doc:literal $kind:ident: $set:ty,)+] $($rest:tt)+) => {
        $crate::constraints::by_kind! { @struct [$($doc $kind: &'a Rows<<$set as ConstraintSet<R>>::Row>,)+] $($rest)+ }
    };
    (@own_rows [$($doc:literal $kind:ident: $set:ty,)+] $($rest:tt)+) => {
        $crate::constraints::by_kind! { @struct [$($doc $kind: Rows<<$set as ConstraintSet<R>>::Row>,)+] $($rest)+ }
    };
    (@impulses [$($doc:literal $kind:ident: $set:ty,)+] $($rest:tt)+) => {
        $crate::constraints::by_kind! { @struct [$($doc $kind: Vec<<$set as ConstraintSet<R>>::Impulse>,)+] $($rest)+ }
    };
    (@numbers [$($doc:literal $kind:ident: $set:ty,)+] $($rest:tt)+) => {
        $crate::constraints::by_kind! { @struct [$($doc $kind: Vec<R>,)+] $($rest)+ }
    };
    (@saved [$($doc:literal $kind:ident: $set:ty,)+] $($rest:tt)+) => {
        $crate::constraints::by_kind! { @struct [$($doc $kind: Vec<SavedConstraint>,)+] $($rest)+ }
    };
    (@count [$($doc:literal $kind:ident: $set:ty,)+] $($rest:tt)+) => {
        $crate::constraints::by_kind! { @struct [$($doc $kind: usize,)+] $($rest)+ }
    };
    (
        @struct [$($doc:literal $kind:ident: $type:ty,)+]
        $(#[$meta:meta])* $vis:vis struct $name:ident[$($generics:tt)*] { $($fields:tt)* }
    ) => {
        $(#[$meta])*
        $vis struct $name<$($generics)*> {
            $($fields)*
            $(#[doc = $doc] pub $kind: $type,)+
        }
    };
}

/// Repeats an expression for each kind of constraint, in the order in which sweeps visit them.
///
/// `each_kind!([set: &problem] => set.clear())` binds `set` to `&problem.scalars`, then to the fields of the other kinds.
macro_rules! each_kind {
    (@ $kind:ident $([$name:ident: $($place:tt)+])+ => $body:expr) => {{
        $(let $name = $($place)+.$kind;)+
        $body;
    }};
    ($($binding:tt)+) => {
        $crate::constraints::each_kind!(@ scalars $($binding)+);
        $crate::constraints::each_kind!(@ contacts $($binding)+);
        $crate::constraints::each_kind!(@ rolling_contacts $($binding)+);
    };
}

/// Constructs a struct that [`by_kind`] has declared. The expression `value` gives the field of each kind; it may use names that are bound
/// as in [`each_kind`].
macro_rules! make_kinds {
    ($name:ident { $($own:tt)* } $([$binding:ident: $($place:tt)+])+ => $value:expr) => {
        $name {
            $($own)*
            scalars: { $(let $binding = $($place)+.scalars;)+ $value },
            contacts: { $(let $binding = $($place)+.contacts;)+ $value },
            rolling_contacts: { $(let $binding = $($place)+.rolling_contacts;)+ $value },
        }
    };
}

pub(crate) use {by_kind, each_kind, make_kinds};
