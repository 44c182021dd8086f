//! Flags of what switches near a step, as Python's `stepper.derivatives.Kink` has them.

/// Contacts begin or cease to push.
pub(crate) const CONTACT: u32 = 1;
/// Contacts that stick in one and slip in the other.
pub(crate) const SLIP: u32 = 2;
/// Contacts or limits that are open in one and overlap in the other.
pub(crate) const GAP: u32 = 4;
/// Joints that reach a limit or leave it.
pub(crate) const LIMIT: u32 = 8;
/// Joints that dry friction holds in one and not in the other.
pub(crate) const DRY_FRICTION: u32 = 16;
/// Actuators at the bound of their effort.
pub(crate) const SATURATION: u32 = 32;
/// Slopes on both sides differ.
pub(crate) const SLOPE: u32 = 64;
/// A step was not solved, not finite, or too long for its motion.
pub(crate) const UNSOLVED: u32 = 128;
