//! Weights as they are kept in memory.

use half::bf16;

use super::Buffer;
use super::vector::Vector;

/// How weights are kept in memory; arithmetic is f32 either way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Storage {
    /// As in the file.
    #[default]
    F32,
    /// Rounded to bf16: half the memory traffic.
    Bf16,
}

/// Packed weights.
#[derive(Debug, Clone)]
pub enum Stored {
    /// As they were.
    F32(Buffer),
    /// Rounded.
    Bf16(Vec<bf16>),
}

impl Stored {
    /// Keeps `values` as `storage` says.
    #[must_use]
    pub fn new(storage: Storage, values: Buffer) -> Self {
        match storage {
            Storage::F32 => Self::F32(values),
            Storage::Bf16 => Self::Bf16(values.iter().map(|&value| bf16::from_f32(value)).collect()),
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
