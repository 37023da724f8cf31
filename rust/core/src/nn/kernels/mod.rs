//! The inner loops, compiled once per instruction set and chosen at run time.
//!
//! This is the crate's only module with unsafe code: the speed comes from intrinsics and from unchecked strided access.
//! Every entry point checks the extents of its slices before it hands out a pointer, and [`Level`] values exist only for
//! instruction sets that the processor has.
#![allow(unsafe_code)]
#![expect(clippy::needless_range_loop, reason = "these loops over constants index registers and are unrolled")]

mod buffer;
mod direct_conv;
mod epilogue;
mod gemm;
mod level;
mod lstm;
mod pool;
mod stored;
mod vector;
mod winograd;

pub use buffer::Buffer;
pub use direct_conv::{DIRECT_CHANNELS, DirectConv, DirectConvCall};
pub use epilogue::{Epilogue, Nonlinearity, Residual};
pub use gemm::{Gemm, Im2col, Panels, gemm};
pub use level::Level;
pub use lstm::{LstmStep, lstm_step};
pub use pool::{max_pool, spatial_softmax, tanh_in_place, widen};
pub use stored::{Storage, Stored};
pub use winograd::{Scheme, Tiles, transform_input, transform_output};

/// Channels are stored in groups of this many, padded with zeros.
pub const GROUP: usize = 16;

/// `count` rounded up to whole groups.
#[must_use]
pub const fn padded(count: usize) -> usize {
    count.div_ceil(GROUP) * GROUP
}

/// Channels of an activation map as stored: whole groups, or half a group where that fills a register of `level`.
#[must_use]
pub const fn stored_channels(level: Level, count: usize) -> usize {
    if count <= level.lanes() { level.lanes() } else { padded(count) }
}

/// Calls `$function::<V>($argument)` with the instruction set of `$level` enabled.
macro_rules! dispatch {
    ($level:expr, $function:ident $(::<$weight:ty>)?, $argument:ty, $value:expr) => {{
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx512f")]
        unsafe fn on_avx512(argument: $argument) {
            unsafe { $function::<$crate::nn::kernels::vector::Avx512 $(, $weight)?>(argument) }
        }
        #[cfg(target_arch = "x86_64")]
        #[target_feature(enable = "avx2,fma")]
        unsafe fn on_avx2(argument: $argument) {
            unsafe { $function::<$crate::nn::kernels::vector::Avx2 $(, $weight)?>(argument) }
        }
        // SAFETY: a level exists only where the processor has it; the caller upholds the rest.
        match $level.name() {
            #[cfg(target_arch = "x86_64")]
            "avx512" => unsafe { on_avx512($value) },
            #[cfg(target_arch = "x86_64")]
            "avx2" => unsafe { on_avx2($value) },
            _ => unsafe { $function::<$crate::nn::kernels::vector::Portable $(, $weight)?>($value) },
        }
    }};
}
pub(crate) use dispatch;
