//! Truth values, one per lane.

use core::fmt::Debug;

/// One truth value per lane. Lane `i` is bit `i` of [`Mask::bits`]. Bits at or above the number of lanes are always 0.
pub trait Mask: Copy + Debug + Send + Sync + 'static {
    /// Mask with one truth value in all lanes.
    fn splat(b: bool) -> Self;
    /// Mask whose lane `i` is bit `i` of `bits`. Higher bits are ignored.
    fn from_bits(bits: u32) -> Self;
    /// Bits of the mask: bit `i` is lane `i`. Higher bits are 0.
    fn bits(self) -> u32;
    /// Lanes that are true in both masks.
    fn and(self, o: Self) -> Self;
    /// Lanes that are true in at least one of the masks.
    fn or(self, o: Self) -> Self;
    /// Lanes that are true in `self` and false in `o`.
    fn and_not(self, o: Self) -> Self;
    /// Lanes that are false in `self`.
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
    crate::inline_functions! {
        fn splat(b: bool) -> Self = b;
        fn from_bits(bits: u32) -> Self = bits & 1 != 0;
        fn bits(self) -> u32 = self as u32;
        // `&` and `|`, not `&&` and `||`: both operands are already computed, so a branch would not save time.
        fn and(self, o: Self) -> Self = self & o;
        fn or(self, o: Self) -> Self = self | o;
        fn and_not(self, o: Self) -> Self = self & !o;
        fn not(self) -> Self = !self;
        fn any(self) -> bool = self;
        fn all(self) -> bool = self;
    }
}
