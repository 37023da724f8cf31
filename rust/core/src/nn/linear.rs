//! Linear layers.

use super::activation_map::ActivationMap;
use super::kernels::{Epilogue, Gemm, Im2col, Level, Nonlinearity, Panels, Residual, Storage, gemm, padded};

/// `y = [relu](W x + b)` for rows padded to whole groups.
#[derive(Debug)]
pub struct Linear {
    panels: Panels,
    im2col: Im2col,
    nonlinearity: Nonlinearity,
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
        nonlinearity: Nonlinearity,
    ) -> Self {
        let panels = Panels::pack(level, storage, (outputs, padded(outputs)), inputs, weight, |output| bias[output]);
        Self { panels, im2col: Im2col::row(inputs), nonlinearity }
    }

    /// As [`Linear::new`], over all pixels of a bordered map: `input` counts its numbers without the border.
    #[must_use]
    pub fn over_map(
        level: Level,
        storage: Storage,
        outputs: usize,
        map: &ActivationMap,
        weight: impl Fn(usize, usize) -> f32,
        bias: &[f32],
        nonlinearity: Nonlinearity,
    ) -> Self {
        let inputs = map.height * map.width * map.channels;
        Self { im2col: map.whole(), ..Self::new(level, storage, outputs, inputs, weight, bias, nonlinearity) }
    }

    /// Length of an output row, padding included.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.panels.outputs()
    }

    /// Runs over rows that are `input_stride` and `output_stride` apart.
    pub fn run(&self, rows: usize, input: &[f32], input_stride: usize, output: &mut [f32], output_stride: usize) {
        gemm(&mut Gemm {
            panels: &self.panels,
            im2col: &self.im2col,
            batch: rows,
            input,
            input_stride,
            output,
            output_stride,
            epilogue: Epilogue { residual: Residual::None, nonlinearity: self.nonlinearity },
        });
    }
}
