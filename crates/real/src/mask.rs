//! Truth values, one per lane.

use core::fmt::Debug;

/// One truth value per lane. Lane `i` is bit `i` of [`Mask::bits`]; no operation ever sets a bit at or above the number of lanes.
pub trait Mask: Copy + Debug + Send + Sync + 'static {
    /// The same truth value in every lane.
    fn splat(b: bool) -> Self;
    /// Lane `i` from bit `i`; higher bits are ignored.
    fn from_bits(bits: u32) -> Self;
    /// Bit `i` from lane `i`; higher bits are 0.
    fn bits(self) -> u32;
    /// `self & o`.
    fn and(self, o: Self) -> Self;
    /// `self | o`.
    fn or(self, o: Self) -> Self;
    /// `self & !o`.
    fn and_not(self, o: Self) -> Self;
    /// `!self`, in the lanes that exist.
    fn not(self) -> Self;
    /// True in at least one lane.
    fn any(self) -> bool;
    /// True in every lane.
    fn all(self) -> bool;
    /// True in no lane.
    #[inline(always)]
    fn none(self) -> bool {
        !self.any()
    }
}

impl Mask for bool {
    #[inline(always)]
    fn splat(b: bool) -> Self {
        b
    }
    #[inline(always)]
    fn from_bits(bits: u32) -> Self {
        bits & 1 != 0
    }
    #[inline(always)]
    fn bits(self) -> u32 {
        self as u32
    }
    // `&` and `|`, not `&&` and `||`: both sides are known already, so there is nothing to branch over.
    #[inline(always)]
    fn and(self, o: Self) -> Self {
        self & o
    }
    #[inline(always)]
    fn or(self, o: Self) -> Self {
        self | o
    }
    #[inline(always)]
    fn and_not(self, o: Self) -> Self {
        self & !o
    }
    #[inline(always)]
    fn not(self) -> Self {
        !self
    }
    #[inline(always)]
    fn any(self) -> bool {
        self
    }
    #[inline(always)]
    fn all(self) -> bool {
        self
    }
}
