//! What the benches share: input numbers and the loop over instruction sets.

use criterion::{BenchmarkGroup, Criterion, measurement::WallTime};
use ocplanner_core::nn::kernels::Level;

/// `len` numbers in -1..1, the same on every call.
#[must_use]
pub fn noise(len: usize) -> Vec<f32> {
    let mut state = 0x9e37_79b9_u32;
    let mut next = || {
        state ^= state << 13;
        state ^= state >> 17;
        state ^= state << 5;
        state as f32 / u32::MAX as f32 * 2.0 - 1.0
    };
    (0..len).map(|_| next()).collect()
}

/// Runs one group of benches, `name/<level>`, per instruction set of this processor.
pub fn on_every_level(
    criterion: &mut Criterion,
    name: &str,
    mut bench: impl FnMut(&mut BenchmarkGroup<'_, WallTime>, Level),
) {
    for level in Level::available() {
        let mut group = criterion.benchmark_group(format!("{name}/{}", level.name()));
        bench(&mut group, level);
        group.finish();
    }
}
