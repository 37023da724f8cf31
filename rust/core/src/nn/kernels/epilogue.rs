//! What happens to a sum of products before it is stored: an epilogue, as GEMM libraries call it.

use super::vector::Vector;

/// Whether a layer adds to what its output buffer already holds: a residual connection.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Residual {
    /// The output is overwritten.
    None,
    /// The sum is added to the output, before the nonlinearity.
    FromOutput,
}

/// The function applied last.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Nonlinearity {
    /// None: the layer is affine.
    None,
    /// Negative numbers become zero.
    Relu,
}

/// The steps after a layer's sum of products and its bias.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Epilogue {
    /// Comes first.
    pub residual: Residual,
    /// Comes last.
    pub nonlinearity: Nonlinearity,
}

impl Epilogue {
    /// The sums as they are.
    pub const NONE: Self = Self { residual: Residual::None, nonlinearity: Nonlinearity::None };

    /// Applies the steps to a register of sums and stores it at `to`.
    #[inline(always)]
    pub(super) unsafe fn store<V: Vector>(self, sum: V, to: *mut f32) {
        let mut value = sum;
        unsafe {
            if self.residual == Residual::FromOutput {
                value = value.add(V::load(to));
            }
            if self.nonlinearity == Nonlinearity::Relu {
                value = value.max(V::zero());
            }
            value.store(to);
        }
    }
}
