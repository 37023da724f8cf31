//! Convolution and max pooling of bordered NHWC activation maps.

use std::sync::OnceLock;

use super::activation_map::{ActivationMap, Window};
use super::kernels::{
    Epilogue, GROUP, Gemm, Im2col, Level, Nonlinearity, Panels, Residual, Scheme, Storage, gemm, max_pool,
    stored_channels,
};
use super::winograd::{Winograd, WinogradWorkspace, best_scheme};
use crate::error::Result;

/// A convolution with bias, an optional residual connection and an optional nonlinearity.
#[derive(Debug)]
pub struct Conv {
    level: Level,
    window: Window,
    panels: Panels,
    im2col: Im2col,
    input: ActivationMap,
    /// Shape of one output map.
    pub output: ActivationMap,
    nonlinearity: Nonlinearity,
    winograd: [OnceLock<Winograd>; Scheme::ALL.len()],
}

/// Weights of a convolution in torch's layout: (outputs, inputs, kernel, kernel) and (outputs,).
#[derive(Debug, Clone, Copy)]
pub struct ConvWeights<'a> {
    /// Kernels.
    pub weight: &'a [f32],
    /// One per output channel.
    pub bias: &'a [f32],
    /// Input channels, without padding.
    pub inputs: usize,
    /// Factor on all kernels.
    pub scale: f32,
}

impl ConvWeights<'_> {
    /// One weight of a square kernel, scaled.
    #[must_use]
    pub fn at(&self, kernel: usize, output: usize, row: usize, column: usize, channel: usize) -> f32 {
        self.scale * self.weight[((output * self.inputs + channel) * kernel + row) * kernel + column]
    }
}

impl Conv {
    /// Packs the weights for input maps of a fixed shape, whose border must be at least the window's padding.
    ///
    /// # Errors
    /// [`crate::error::Error::ModelFile`] if the sizes are impossible.
    pub fn new(
        level: Level,
        storage: Storage,
        weights: ConvWeights<'_>,
        window: Window,
        input: ActivationMap,
        border: usize,
        nonlinearity: Nonlinearity,
    ) -> Result<Self> {
        let outputs = weights.bias.len();
        let (height, width) = (window.output(input.height)?, window.output(input.width)?);
        let stored = stored_channels(level, outputs);
        let output = ActivationMap::new(height, width, stored, border)?;
        let corners = window.corners(&input, &output);
        let run_len = window.kernel * input.channels;
        let im2col = Im2col {
            input: corners.iter().map(|c| c[0]).collect(),
            output: corners.iter().map(|c| c[1]).collect(),
            runs: window.kernel,
            run_len,
            run_stride: input.row_stride(),
        };
        let weight_at = |out: usize, k: usize| {
            let (row, column, channel) = (k / run_len, k % run_len / input.channels, k % input.channels);
            if channel >= weights.inputs { 0.0 } else { weights.at(window.kernel, out, row, column, channel) }
        };
        let inputs = window.kernel * run_len;
        let panels = Panels::pack(level, storage, (outputs, stored), inputs, weight_at, |out| weights.bias[out]);
        Ok(Self { level, window, panels, im2col, input, output, nonlinearity, winograd: Default::default() })
    }

    /// Runs over a batch.
    pub fn run(
        &self,
        batch: usize,
        input: &[f32],
        output: &mut [f32],
        residual: Residual,
        workspace: &mut WinogradWorkspace,
    ) {
        if residual == Residual::None {
            for image in output.chunks_exact_mut(self.output.len()).take(batch) {
                self.output.clear_border(image);
            }
        }
        let epilogue = Epilogue { residual, nonlinearity: self.nonlinearity };
        let whole_groups = self.input.channels.is_multiple_of(GROUP) && self.output.channels.is_multiple_of(GROUP);
        if whole_groups
            && self.window == (Window { kernel: 3, stride: 1, padding: 1 })
            && let Some(scheme) = best_scheme(&self.output, batch)
        {
            let winograd = self.winograd[scheme as usize].get_or_init(|| self.transformed(scheme));
            winograd.run(batch, input, output, epilogue, workspace);
            return;
        }
        gemm(&mut Gemm {
            panels: &self.panels,
            im2col: &self.im2col,
            batch,
            input,
            input_stride: self.input.len(),
            output,
            output_stride: self.output.len(),
            epilogue,
        });
    }

    /// The same convolution in Winograd form, made when first used.
    fn transformed(&self, scheme: Scheme) -> Winograd {
        let inputs = self.input.channels;
        let kernel = |out: usize, channel: usize| {
            std::array::from_fn(|at| f64::from(self.panels.weight(out, at * inputs + channel)))
        };
        Winograd::new(self.level, scheme, self.input, self.output, kernel, |out| self.panels.bias(out))
    }
}

/// Max pooling 3 x 3, stride 2, padding 1, of maps without negative numbers.
#[derive(Debug)]
pub struct MaxPool {
    level: Level,
    windows: Vec<[u32; 2]>,
    input: ActivationMap,
    /// Shape of one output map.
    pub output: ActivationMap,
}

impl MaxPool {
    /// Prepares the pooling of maps of a fixed shape, whose border must be at least 1.
    ///
    /// # Errors
    /// [`crate::error::Error::ModelFile`] if the sizes are impossible.
    pub fn new(level: Level, input: ActivationMap, border: usize) -> Result<Self> {
        let window = Window { kernel: 3, stride: 2, padding: 1 };
        let output =
            ActivationMap::new(window.output(input.height)?, window.output(input.width)?, input.channels, border)?;
        Ok(Self { level, windows: window.corners(&input, &output), input, output })
    }

    /// Runs over a batch.
    pub fn run(&self, batch: usize, input: &[f32], output: &mut [f32]) {
        let images = input.chunks_exact(self.input.len()).zip(output.chunks_exact_mut(self.output.len()));
        for (from, to) in images.take(batch) {
            self.output.clear_border(to);
            max_pool(self.level, &self.windows, self.input.channels, self.input.row_stride(), from, to);
        }
    }
}
