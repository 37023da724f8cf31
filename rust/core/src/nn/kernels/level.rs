//! The instruction set that the kernels use.

use std::sync::OnceLock;

/// The environment variable that selects a lower level than the processor's: `avx2` or `portable`.
pub const OVERRIDE: &str = "OCPLANNER_SIMD";

/// An instruction set that this processor has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Level(Kind);

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Avx512,
    Avx2,
    Portable,
}

impl Level {
    /// Plain Rust, which runs on every processor.
    pub const PORTABLE: Self = Self(Kind::Portable);

    /// The best level of this processor, or the lower one named by `OCPLANNER_SIMD`, which is read once.
    #[must_use]
    pub fn detect() -> Self {
        static DETECTED: OnceLock<Level> = OnceLock::new();
        *DETECTED.get_or_init(|| {
            let wanted = std::env::var(OVERRIDE).unwrap_or_default();
            let available = Self::available();
            *available.iter().find(|level| level.name() == wanted).unwrap_or(&available[0])
        })
    }

    /// All levels of this processor, best first.
    #[must_use]
    pub fn available() -> Vec<Self> {
        let mut levels = Vec::new();
        #[cfg(target_arch = "x86_64")]
        {
            if is_x86_feature_detected!("avx512f") {
                levels.push(Self(Kind::Avx512));
            }
            if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
                levels.push(Self(Kind::Avx2));
            }
        }
        levels.push(Self::PORTABLE);
        levels
    }

    /// `"avx512"`, `"avx2"` or `"portable"`.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self.0 {
            Kind::Avx512 => "avx512",
            Kind::Avx2 => "avx2",
            Kind::Portable => "portable",
        }
    }

    /// f32 numbers in a register.
    #[must_use]
    pub const fn lanes(self) -> usize {
        match self.0 {
            Kind::Avx512 => 16,
            Kind::Avx2 | Kind::Portable => 8,
        }
    }
}
