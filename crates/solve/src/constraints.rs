//! Kinds of constraints, and the macros that list all kinds.
//!
//! Each kind has a file with the rows of one constraint and their implementation of [`Row`](constraint_set::Row). Most of the crate treats
//! all kinds alike, by the macros `by_kind`, `each_kind` and `make_kinds`, which have one line per kind.

pub(crate) mod constraint_set;
pub(crate) mod friction;
pub(crate) mod orthogonalisation;
pub(crate) mod rolling;
pub(crate) mod scalar;
pub(crate) mod sliding;

/// Declares a struct with a field for each kind of constraint (`scalars`, `contacts`, `rolling_contacts`), in the order in which sweeps
/// visit them. The fields in the braces come first.
///
/// The words after `each` are the type of these fields: `same T` is the type `T`. `T[A]` is `T<A, Row>`, for the type `Row` of the rows of
/// one constraint of the kind.
macro_rules! by_kind {
    ($(#[$meta:meta])* $vis:vis struct $name:ident[$($generics:tt)*] { $($fields:tt)* } each same $type:ty) => {
        $crate::constraints::by_kind! {
            @ [$type] [$type] [$type] $(#[$meta])* $vis struct $name[$($generics)*] { $($fields)* }
        }
    };
    ($(#[$meta:meta])* $vis:vis struct $name:ident[$($generics:tt)*] { $($fields:tt)* } each $type:ident[$($argument:tt)?]) => {
        $crate::constraints::by_kind! {
            @
            [$type<$($argument,)? $crate::constraints::scalar::ScalarRow<R>>]
            [$type<$($argument,)? $crate::constraints::sliding::SlidingContact<R>>]
            [$type<$($argument,)? $crate::constraints::rolling::RollingContact<R>>]
            $(#[$meta])* $vis struct $name[$($generics)*] { $($fields)* }
        }
    };
    (
        @ [$scalars:ty] [$contacts:ty] [$rolling_contacts:ty]
        $(#[$meta:meta])* $vis:vis struct $name:ident[$($generics:tt)*] { $($fields:tt)* }
    ) => {
        $(#[$meta])*
        $vis struct $name<$($generics)*> {
            $($fields)*
            /// Field for the scalar rows: equalities, limits and dry friction.
            pub scalars: $scalars,
            /// Field for the contacts with sliding friction, whose rows are (n, t1, t2).
            pub contacts: $contacts,
            /// Field for the contacts with torsional or rolling friction. The rows of such a contact are scaled so that all have the same
            /// friction coefficient.
            pub rolling_contacts: $rolling_contacts,
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

/// Evaluates an expression for contact `i`. The index `i` counts the `count` contacts with three rows first, then those with six rows
/// (rolling friction).
///
/// `at_contact!(i of count, [set: &problem] => set.activate(i, lanes))` binds `set` as in [`each_kind`], and `i` to the index in the kind.
macro_rules! at_contact {
    ($i:ident of $count:expr, $([$binding:ident: $($place:tt)+])+ => $value:expr) => {
        match $i.checked_sub($count) {
            None => {
                $(let $binding = $($place)+.contacts;)+
                $value
            }
            Some($i) => {
                $(let $binding = $($place)+.rolling_contacts;)+
                $value
            }
        }
    };
}

pub(crate) use {at_contact, by_kind, each_kind, make_kinds};
