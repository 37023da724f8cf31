//! How weights are kept in memory.

use half::bf16;

use super::Buffer;
use super::vector::Vector;

/// How weights are kept in memory. Arithmetic is f32 either way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Storage {
    /// As in the file.
    #[default]
    F32,
    /// Rounded to bf16 in layers of at least [`ROUNDED_FROM`], where that halves the memory traffic.
    Bf16,
}

/// A layer with at least this many bytes of f32 weights is worth rounding. Smaller layers stay in the second-level cache
/// from one plan to the next, so rounding them would move the plan for no gain.
pub const ROUNDED_FROM: usize = 1 << 20;

/// Packed weights.
#[derive(Debug, Clone)]
pub enum Stored {
    /// As they were.
    F32(Buffer),
    /// Rounded.
    Bf16(Buffer<bf16>),
}

impl Stored {
    /// Keeps `values` as `storage` says.
    #[must_use]
    pub fn new(storage: Storage, values: Buffer) -> Self {
        match storage {
            Storage::Bf16 if size_of_val(&values[..]) >= ROUNDED_FROM => {
                let mut rounded = Buffer::zeros(values.len());
                for (slot, &value) in rounded.iter_mut().zip(values.iter()) {
                    *slot = bf16::from_f32(value);
                }
                Self::Bf16(rounded)
            }
            Storage::F32 | Storage::Bf16 => Self::F32(values),
        }
    }

    /// Number of weights.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::F32(values) => values.len(),
            Self::Bf16(values) => values.len(),
        }
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// One weight.
    ///
    /// # Panics
    /// If there is no such weight.
    #[must_use]
    pub fn at(&self, index: usize) -> f32 {
        match self {
            Self::F32(values) => values[index],
            Self::Bf16(values) => values[index].to_f32(),
        }
    }
}

/// A stored weight that widens to f32.
pub(super) trait Weight: Copy {
    unsafe fn load<V: Vector>(from: *const Self) -> V;
}

impl Weight for f32 {
    #[inline(always)]
    unsafe fn load<V: Vector>(from: *const Self) -> V {
        unsafe { V::load(from) }
    }
}

impl Weight for bf16 {
    #[inline(always)]
    unsafe fn load<V: Vector>(from: *const Self) -> V {
        unsafe { V::load_bf16(from) }
    }
}
