//! Precision (scalar type) of a simulation.

stepper_model::named! {
    /// Precision of a simulation: the scalar type of its lanes.
    pub enum Precision {
        /// 64-bit numbers, up to eight lanes per register.
        F64 = "f64",
        /// 32-bit numbers, up to sixteen lanes per register.
        F32 = "f32",
    }
}
