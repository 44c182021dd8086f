//! Flags of kinks near a step, as Python's `stepper.derivatives.Kink` has them.

/// Contacts that push in one step and not in the other.
pub const CONTACT: u32 = 1;
/// Contacts that stick in one step and slip in the other.
pub const SLIP: u32 = 2;
/// Contacts or limits that are open in one step and overlap in the other.
pub const GAP: u32 = 4;
/// Joints that are at a limit in one step only.
pub const LIMIT: u32 = 8;
/// Joints that dry friction holds in one step only.
pub const DRY_FRICTION: u32 = 16;
/// Actuators at the bound of their effort.
pub const SATURATION: u32 = 32;
/// Slopes that differ between the two sides.
pub const SLOPE: u32 = 64;
/// Step that was not solved, not finite, or too long for its motion.
pub const UNSOLVED: u32 = 128;
