//! Linear layers.

use super::conv::Plane;
use super::kernels::{Gather, Level, Panels, Product, Storage, matmul, padded};

/// `y = [relu](W x + b)` for rows whose lengths are padded to whole groups.
#[derive(Debug)]
pub struct Linear {
    panels: Panels,
    gather: Gather,
    relu: bool,
}

impl Linear {
    /// Packs `weight(output, input)`, where `input` counts the numbers of a stored row, padding included.
    #[must_use]
    pub fn new(
        level: Level,
        storage: Storage,
        outputs: usize,
        inputs: usize,
        weight: impl Fn(usize, usize) -> f32,
        bias: &[f32],
        relu: bool,
    ) -> Self {
        let panels = Panels::pack(level, storage, (outputs, padded(outputs)), inputs, weight, |output| bias[output]);
        Self { panels, gather: Gather::row(inputs), relu }
    }

    /// As [`Linear::new`], over all pixels of a bordered image: `input` counts its numbers without the border.
    #[must_use]
    pub fn over_map(
        level: Level,
        storage: Storage,
        outputs: usize,
        map: &Plane,
        weight: impl Fn(usize, usize) -> f32,
        bias: &[f32],
        relu: bool,
    ) -> Self {
        let inputs = map.height * map.width * map.channels;
        Self { gather: map.rows(), ..Self::new(level, storage, outputs, inputs, weight, bias, relu) }
    }

    /// Length of an output row, padding included.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.panels.outputs()
    }

    /// Runs over rows that are `input_stride` and `output_stride` apart.
    pub fn run(&self, rows: usize, input: &[f32], input_stride: usize, output: &mut [f32], output_stride: usize) {
        matmul(&mut Product {
            panels: &self.panels,
            gather: &self.gather,
            batch: rows,
            input,
            input_stride,
            output,
            output_stride,
            accumulate: false,
            relu: self.relu,
        });
    }
}
