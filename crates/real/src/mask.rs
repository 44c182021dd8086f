//! Truth values, one per lane.

use core::fmt::Debug;

/// One truth value per lane. Lane `i` is bit `i` of [`Mask::bits`]; no operation ever sets a bit at or above the number of lanes.
pub trait Mask: Copy + Debug + Send + Sync + 'static {
    /// Mask with one truth value in all lanes.
    fn splat(b: bool) -> Self;
    /// Mask with lane `i` from bit `i`. Higher bits are ignored.
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
    /// Whether at least one lane is true.
    fn any(self) -> bool;
    /// Whether all lanes are true.
    fn all(self) -> bool;
    /// Whether no lane is true.
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
