//! Flags of kinks: changes between the nominal and a displaced state at which a step is not differentiable. They equal Python's
//! `stepper.derivatives.Kink`.

/// Flag: a contact pushes at only one of the two compared states (nominal, displaced).
pub const CONTACT: u32 = 1;
/// Flag: a contact sticks at one of the two compared states (nominal, displaced) and slips at the other.
pub const SLIP: u32 = 2;
/// Flag: a contact or limit is open at one of the two compared states (nominal, displaced) and overlaps at the other.
pub const GAP: u32 = 4;
/// Flag: a joint is at a limit at only one of the two compared states (nominal, displaced).
pub const LIMIT: u32 = 8;
/// Flag: dry friction holds a joint at only one of the two compared states (nominal, displaced).
pub const DRY_FRICTION: u32 = 16;
/// Flag: the force of an actuator is at its bound at only one of the two compared states (nominal, displaced).
pub const SATURATION: u32 = 32;
/// Flag: the slopes from the nominal state to two displaced states of the same coordinate differ.
pub const SLOPE: u32 = 64;
/// Flag: a step was not solved, not finite, or too long for the motion of the bodies, so that the derivative is unreliable.
pub const UNSOLVED: u32 = 128;
/// Flag: a tendon touches a geom in its path at only one of the two compared states (nominal, displaced).
pub const WRAP: u32 = 512;
/// Flag: adhesion pulls different numbers of contacts at the two compared states (nominal, displaced).
pub const ADHESION: u32 = 1024;
