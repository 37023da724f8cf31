//! Convolution and max pooling of bordered NHWC images.

use std::sync::OnceLock;

use super::kernels::{GROUP, Gather, Level, Panels, Product, Scheme, Storage, matmul, max_pool, stored_channels};
use super::winograd::{Winograd, WinogradWorkspace, best_scheme};
use crate::error::Result;
use crate::weights::fault;

/// Most numbers that a feature map of one image may hold, 256 MiB: far more than any real planner's, little enough that
/// a hostile file cannot exhaust the memory, and offsets fit 31 bits.
const MOST_NUMBERS: usize = 1 << 26;

/// Shape of one image in a buffer: height, width, channels as stored, and the border of zeros around it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plane {
    /// Rows without the border.
    pub height: usize,
    /// Columns without the border.
    pub width: usize,
    /// Numbers stored per pixel.
    pub channels: usize,
    /// Width of the border on every side.
    pub border: usize,
}

impl Plane {
    /// A plane, if its offsets can be represented.
    ///
    /// # Errors
    /// [`crate::error::Error::WeightFile`] if the image is empty or too large.
    pub fn new(height: usize, width: usize, channels: usize, border: usize) -> Result<Self> {
        let plane = Self { height, width, channels, border };
        let size = (height + 2 * border).checked_mul(width + 2 * border).and_then(|n| n.checked_mul(channels));
        match size {
            Some(1..MOST_NUMBERS) if height > 0 && width > 0 => Ok(plane),
            _ => Err(fault(format!("a feature map of {height} x {width} x {channels} is impossible"))),
        }
    }

    /// Numbers in a stored row.
    #[must_use]
    pub fn row_stride(&self) -> usize {
        (self.width + 2 * self.border) * self.channels
    }

    /// Numbers in a stored image.
    #[must_use]
    pub fn len(&self) -> usize {
        (self.height + 2 * self.border) * self.row_stride()
    }

    /// Whether the image has no pixels; never, once made by [`Plane::new`].
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Offset of a pixel, counted from the stored corner: (0, 0) is in the border if there is one.
    fn stored(&self, row: usize, column: usize) -> u32 {
        u32::try_from(row * self.row_stride() + column * self.channels).unwrap_or(u32::MAX)
    }

    /// A single window over the whole image without its border.
    #[must_use]
    pub fn rows(&self) -> Gather {
        Gather {
            input: vec![self.stored(self.border, self.border)],
            output: vec![0],
            runs: self.height,
            run_len: self.width * self.channels,
            run_stride: self.row_stride(),
        }
    }

    /// Writes zeros into the border of one stored image.
    pub fn clear_border(&self, image: &mut [f32]) {
        let (row, side) = (self.row_stride(), self.border * self.channels);
        image[..self.border * row].fill(0.0);
        image[(self.border + self.height) * row..self.len()].fill(0.0);
        for line in image[self.border * row..].chunks_exact_mut(row).take(self.height) {
            line[..side].fill(0.0);
            line[row - side..].fill(0.0);
        }
    }
}

/// Kernel, stride and zero padding of a convolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Window {
    /// Side of the square kernel.
    pub kernel: usize,
    /// Step between output pixels.
    pub stride: usize,
    /// Zeros assumed around the input.
    pub padding: usize,
}

impl Window {
    /// Output length along one side.
    ///
    /// # Errors
    /// [`crate::error::Error::WeightFile`] if the kernel is larger than the padded input.
    pub fn output(&self, length: usize) -> Result<usize> {
        (length + 2 * self.padding)
            .checked_sub(self.kernel)
            .map(|rest| rest / self.stride + 1)
            .ok_or_else(|| fault(format!("an image side of {length} is smaller than the {} kernel", self.kernel)))
    }

    /// The stored corner of every output pixel's window and of the pixel itself, in reading order.
    fn corners(&self, input: &Plane, output: &Plane) -> Vec<[u32; 2]> {
        let inset = input.border - self.padding;
        let pixels = (0..output.height).flat_map(|y| (0..output.width).map(move |x| (y, x)));
        pixels
            .map(|(y, x)| {
                let from = input.stored(y * self.stride + inset, x * self.stride + inset);
                [from, output.stored(y + output.border, x + output.border)]
            })
            .collect()
    }
}

/// A convolution with bias, optional residual and optional rectifier.
#[derive(Debug)]
pub struct Conv {
    level: Level,
    window: Window,
    panels: Panels,
    gather: Gather,
    input: Plane,
    /// Shape of an output image.
    pub output: Plane,
    relu: bool,
    winograd: [OnceLock<Winograd>; Scheme::ALL.len()],
}

/// Weights of a convolution in the layout of torch: (outputs, inputs, kernel, kernel) and (outputs,).
#[derive(Debug, Clone, Copy)]
pub struct ConvWeights<'a> {
    /// Kernels.
    pub weight: &'a [f32],
    /// One per output channel.
    pub bias: &'a [f32],
    /// Channels in, without padding.
    pub inputs: usize,
    /// Factor on all kernels.
    pub scale: f32,
}

impl ConvWeights<'_> {
    /// The number of a square kernel at a place, with its factor.
    #[must_use]
    pub fn at(&self, kernel: usize, output: usize, row: usize, column: usize, channel: usize) -> f32 {
        self.scale * self.weight[((output * self.inputs + channel) * kernel + row) * kernel + column]
    }
}

impl Conv {
    /// Packs the weights for input images of a fixed shape, whose border must be at least the window's padding.
    ///
    /// # Errors
    /// [`crate::error::Error::WeightFile`] if the sizes are impossible.
    pub fn new(
        level: Level,
        storage: Storage,
        weights: ConvWeights<'_>,
        window: Window,
        input: Plane,
        border: usize,
        relu: bool,
    ) -> Result<Self> {
        let outputs = weights.bias.len();
        let (height, width) = (window.output(input.height)?, window.output(input.width)?);
        let stored = stored_channels(level, outputs);
        let output = Plane::new(height, width, stored, border)?;
        let corners = window.corners(&input, &output);
        let run_len = window.kernel * input.channels;
        let gather = Gather {
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
        Ok(Self { level, window, panels, gather, input, output, relu, winograd: Default::default() })
    }

    /// Runs over a batch of images; with `accumulate` the output already holds the residual.
    pub fn run(
        &self,
        batch: usize,
        input: &[f32],
        output: &mut [f32],
        accumulate: bool,
        workspace: &mut WinogradWorkspace,
    ) {
        if !accumulate {
            for image in output.chunks_exact_mut(self.output.len()).take(batch) {
                self.output.clear_border(image);
            }
        }
        let whole_groups = self.input.channels.is_multiple_of(GROUP) && self.output.channels.is_multiple_of(GROUP);
        if whole_groups
            && self.window == (Window { kernel: 3, stride: 1, padding: 1 })
            && let Some(scheme) = best_scheme(&self.output, batch)
        {
            let winograd = self.winograd[scheme as usize].get_or_init(|| self.transformed(scheme));
            winograd.run(batch, input, output, accumulate, self.relu, workspace);
            return;
        }
        matmul(&mut Product {
            panels: &self.panels,
            gather: &self.gather,
            batch,
            input,
            input_stride: self.input.len(),
            output,
            output_stride: self.output.len(),
            accumulate,
            relu: self.relu,
        });
    }

    /// The same convolution in another form; made once, when first used.
    fn transformed(&self, scheme: Scheme) -> Winograd {
        let inputs = self.input.channels;
        let kernel = |out: usize, channel: usize| {
            std::array::from_fn(|at| f64::from(self.panels.weight(out, at * inputs + channel)))
        };
        Winograd::new(self.level, scheme, self.input, self.output, kernel, |out| self.panels.bias(out))
    }
}

/// Max pooling 3 x 3, stride 2, padding 1, of images that are not negative.
#[derive(Debug)]
pub struct MaxPool {
    level: Level,
    windows: Vec<[u32; 2]>,
    input: Plane,
    /// Shape of an output image.
    pub output: Plane,
}

impl MaxPool {
    /// Plans the pooling of images of a fixed shape, whose border must be at least 1.
    ///
    /// # Errors
    /// [`crate::error::Error::WeightFile`] if the sizes are impossible.
    pub fn new(level: Level, input: Plane, border: usize) -> Result<Self> {
        let window = Window { kernel: 3, stride: 2, padding: 1 };
        let output = Plane::new(window.output(input.height)?, window.output(input.width)?, input.channels, border)?;
        Ok(Self { level, windows: window.corners(&input, &output), input, output })
    }

    /// Runs over a batch of images.
    pub fn run(&self, batch: usize, input: &[f32], output: &mut [f32]) {
        let images = input.chunks_exact(self.input.len()).zip(output.chunks_exact_mut(self.output.len()));
        for (from, to) in images.take(batch) {
            self.output.clear_border(to);
            max_pool(self.level, &self.windows, self.input.channels, self.input.row_stride(), from, to);
        }
    }
}
