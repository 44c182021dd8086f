//! Flags of kinks near a step: changes at which the step is not differentiable. They are Python's `stepper.derivatives.Kink`.

/// Contacts that push at one of the compared states and not at the other.
pub const CONTACT: u32 = 1;
/// Contacts that stick at one of the compared states and slip at the other.
pub const SLIP: u32 = 2;
/// Contacts or limits that are open at one of the compared states and overlap at the other.
pub const GAP: u32 = 4;
/// Joints that are at a limit at only one of the compared states.
pub const LIMIT: u32 = 8;
/// Joints that dry friction holds at only one of the compared states.
pub const DRY_FRICTION: u32 = 16;
/// Actuators whose force is at its bound at only one of the compared states.
pub const SATURATION: u32 = 32;
/// Derivatives that differ between the two sides of the nominal state.
pub const SLOPE: u32 = 64;
/// Steps that were not solved, not finite, or too long for their motion, so that the derivative is unreliable.
pub const UNSOLVED: u32 = 128;
