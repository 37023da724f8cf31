//! The one product behind convolutions and linear layers: gathered input rows times prepacked weights.
//!
//! An output "pixel" reads `runs` stretches of `run_len` contiguous inputs, `run_stride` apart: the rows of a convolution's
//! window in an NHWC image with its border of zeros stored, or one whole row of a matrix. Weights are packed in panels of
//! columns, each `[k][width]`, so that they stream through the cache once per tile of pixels.

use half::bf16;

use super::stored::Weight;
use super::vector::{Vector, prefetch};
use super::{Buffer, GROUP, Level, Storage, Stored, dispatch};

/// Where each output pixel reads and writes, in one image of a batch.
#[derive(Debug, Clone)]
pub struct Gather {
    /// Offset of the first input of each pixel.
    pub input: Vec<u32>,
    /// Offset of the first output channel of each pixel.
    pub output: Vec<u32>,
    /// Stretches of contiguous inputs.
    pub runs: usize,
    /// Numbers in a stretch.
    pub run_len: usize,
    /// Distance between the starts of two stretches.
    pub run_stride: usize,
}

impl Gather {
    /// One pixel whose input is a row of `len` numbers: a linear layer.
    #[must_use]
    pub fn row(len: usize) -> Self {
        Self { input: vec![0], output: vec![0], runs: 1, run_len: len, run_stride: 0 }
    }

    fn input_extent(&self) -> usize {
        let reach = (self.runs - 1) * self.run_stride + self.run_len;
        self.input.iter().max().map_or(0, |&last| last as usize + reach)
    }

    fn output_extent(&self, width: usize) -> usize {
        self.output.iter().max().map_or(0, |&last| last as usize + width)
    }
}

/// A weight matrix in panels, with its bias.
#[derive(Debug, Clone)]
pub struct Panels {
    values: Stored,
    bias: Buffer,
    inputs: usize,
    outputs: usize,
    width: usize,
    level: Level,
}

impl Panels {
    /// Packs `weight(output, input)` and `bias(output)`; the outputs are padded with zeros to `stored`.
    #[must_use]
    pub fn pack(
        level: Level,
        storage: Storage,
        (outputs, stored): (usize, usize),
        inputs: usize,
        weight: impl Fn(usize, usize) -> f32,
        bias: impl Fn(usize) -> f32,
    ) -> Self {
        let width = if level.lanes() == 16 { 2 * GROUP } else { GROUP };
        let mut values = Buffer::zeros(stored * inputs);
        let mut position = 0;
        for first in (0..stored).step_by(width) {
            let panel = width.min(stored - first);
            for input in 0..inputs {
                for output in first..first + panel {
                    if output < outputs {
                        values[position] = weight(output, input);
                    }
                    position += 1;
                }
            }
        }
        let mut padded_bias = Buffer::zeros(stored);
        for (output, slot) in padded_bias.iter_mut().enumerate().take(outputs) {
            *slot = bias(output);
        }
        Self { values: Stored::new(storage, values), bias: padded_bias, inputs, outputs: stored, width, level }
    }

    /// Number of outputs, padding included.
    #[must_use]
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// One weight, as stored.
    ///
    /// # Panics
    /// If there is no such weight.
    #[must_use]
    pub fn weight(&self, output: usize, input: usize) -> f32 {
        assert!(output < self.outputs && input < self.inputs, "no such weight");
        let first = output / self.width * self.width;
        let panel = self.width.min(self.outputs - first);
        self.values.at(first * self.inputs + input * panel + output - first)
    }

    /// One output's bias.
    #[must_use]
    pub fn bias(&self, output: usize) -> f32 {
        self.bias[output]
    }
}

/// One call of [`matmul`].
#[derive(Debug)]
pub struct Product<'a> {
    /// Weights and bias.
    pub panels: &'a Panels,
    /// Where the pixels lie.
    pub gather: &'a Gather,
    /// Images, or rows, in the batch.
    pub batch: usize,
    /// The batch's inputs.
    pub input: &'a [f32],
    /// Distance between the inputs of two images.
    pub input_stride: usize,
    /// The batch's outputs.
    pub output: &'a mut [f32],
    /// Distance between the outputs of two images.
    pub output_stride: usize,
    /// Add to what the output holds, before the rectifier: a residual connection.
    pub accumulate: bool,
    /// Replace negative results by zero.
    pub relu: bool,
}

/// Computes `output = [relu](weights * input + bias [+ output])` for every pixel of the batch.
///
/// # Panics
/// If the weights do not fit the gather, or a pixel lies outside the slices: a fault of this crate, not of its input.
pub fn matmul(product: &mut Product<'_>) {
    let Product { panels, gather, batch, .. } = *product;
    assert_eq!(gather.runs * gather.run_len, panels.inputs, "weights do not fit the window");
    assert_eq!(gather.input.len(), gather.output.len(), "one output for each input pixel");
    if batch == 0 || gather.input.is_empty() {
        return;
    }
    assert!((batch - 1) * product.input_stride + gather.input_extent() <= product.input.len(), "input too short");
    assert!(
        (batch - 1) * product.output_stride + gather.output_extent(panels.outputs) <= product.output.len(),
        "output too short"
    );
    // SAFETY: the two extents above bound every offset that the loops form, and `panels` holds inputs * outputs weights.
    match &panels.values {
        Stored::F32(values) => {
            let mut job = Job::new(product, values.as_ptr());
            dispatch!(panels.level, all_tiles::<f32>, &mut Job<'_, f32>, &mut job);
        }
        Stored::Bf16(values) => {
            let mut job = Job::new(product, values.as_ptr());
            dispatch!(panels.level, all_tiles::<bf16>, &mut Job<'_, bf16>, &mut job);
        }
    }
}

/// Most pixels in a tile: their pointers and sums just fit the registers.
const MOST: usize = 12;

/// Inputs in one turn of the innermost loop.
const UNROLL: usize = 8;

/// How far ahead weights are asked for: hardware prefetching ends at a page, ours does not.
const PREFETCH_BYTES: usize = 8 << 10;

/// Bytes of weights that come from beyond the second-level cache. They are read in as many streams as there are runs,
/// since the hardware fetches more at a time from several pages than from one.
const STREAMED_BYTES: usize = 1 << 20;

/// Inputs of one stream before it is the next one's turn.
const STREAMED_STRETCH: usize = 2 * UNROLL;

/// Bytes of input that should stay in the second-level cache while all panels pass over them.
const BLOCK_BYTES: usize = 384 << 10;

struct Job<'a, W> {
    weights: *const W,
    bias: *const f32,
    inputs: usize,
    outputs: usize,
    width: usize,
    gather: &'a Gather,
    batch: usize,
    input: *const f32,
    input_stride: usize,
    output: *mut f32,
    output_stride: usize,
    accumulate: bool,
    relu: bool,
}

impl<'a, W> Job<'a, W> {
    fn new(product: &mut Product<'a>, weights: *const W) -> Self {
        Self {
            weights,
            bias: product.panels.bias.as_ptr(),
            inputs: product.panels.inputs,
            outputs: product.panels.outputs,
            width: product.panels.width,
            gather: product.gather,
            batch: product.batch,
            input: product.input.as_ptr(),
            input_stride: product.input_stride,
            output: product.output.as_mut_ptr(),
            output_stride: product.output_stride,
            accumulate: product.accumulate,
            relu: product.relu,
        }
    }
}

/// The pointers of one tile.
struct Tile<W> {
    input: [*const f32; MOST],
    output: [*mut f32; MOST],
    weights: *const W,
    bias: *const f32,
    runs: usize,
    run_len: usize,
    run_stride: usize,
    /// Inputs of one run between two of the next.
    stretch: usize,
    accumulate: bool,
    relu: bool,
}

#[inline(always)]
unsafe fn all_tiles<V: Vector, W: Weight>(job: &mut Job<'_, W>) {
    let pixels = job.gather.input.len();
    let total = pixels * job.batch;
    let most = if V::LANES == 16 { MOST } else { 6 };
    let bytes_per_pixel = (job.input_stride * 4).div_ceil(pixels).max(1);
    let block = (BLOCK_BYTES / bytes_per_pixel).max(most);
    let from_memory = job.inputs * job.outputs * size_of::<W>() >= STREAMED_BYTES;
    let stretch = if from_memory { STREAMED_STRETCH } else { job.gather.run_len };
    let mut block_start = 0;
    while block_start < total {
        let block_end = (block_start + block).min(total);
        // Tiles of equal size waste no accumulators on a small rest.
        let tiles = (block_end - block_start).div_ceil(most);
        let mut first_output = 0;
        while first_output < job.outputs {
            let panel = job.width.min(job.outputs - first_output);
            for index in 0..tiles {
                let start = block_start + index * (block_end - block_start) / tiles;
                let end = block_start + (index + 1) * (block_end - block_start) / tiles;
                unsafe {
                    let mut tile = Tile {
                        input: [std::ptr::null(); MOST],
                        output: [std::ptr::null_mut(); MOST],
                        weights: job.weights.add(first_output * job.inputs),
                        bias: job.bias.add(first_output),
                        runs: job.gather.runs,
                        run_len: job.gather.run_len,
                        run_stride: job.gather.run_stride,
                        stretch,
                        accumulate: job.accumulate,
                        relu: job.relu,
                    };
                    let (mut image, mut pixel) = (start / pixels, start % pixels);
                    for slot in 0..end - start {
                        let from = image * job.input_stride + *job.gather.input.get_unchecked(pixel) as usize;
                        let to = image * job.output_stride + *job.gather.output.get_unchecked(pixel) as usize;
                        tile.input[slot] = job.input.add(from);
                        tile.output[slot] = job.output.add(to + first_output);
                        pixel += 1;
                        if pixel == pixels {
                            (image, pixel) = (image + 1, 0);
                        }
                    }
                    one_tile::<V, W>(&tile, end - start, panel / V::LANES);
                }
            }
            first_output += panel;
        }
        block_start = block_end;
    }
}

#[inline(always)]
unsafe fn one_tile<V: Vector, W: Weight>(tile: &Tile<W>, rows: usize, vectors: usize) {
    macro_rules! sizes {
        ($vectors:literal: $($rows:literal / $split:literal),*) => {
            match rows {
                $($rows => unsafe { product_tile::<V, W, $rows, $vectors, $split>(tile) },)*
                _ => unreachable!("tiles have at most {MOST} rows"),
            }
        };
    }
    if V::LANES == 16 {
        match vectors {
            1 => sizes!(1: 1/8, 2/4, 3/2, 4/2, 5/1, 6/1, 7/1, 8/1, 9/1, 10/1, 11/1, 12/1),
            _ => sizes!(2: 1/8, 2/4, 3/2, 4/1, 5/1, 6/1, 7/1, 8/1, 9/1, 10/1, 11/1, 12/1),
        }
    } else {
        match vectors {
            1 => sizes!(1: 1/8, 2/4, 3/2, 4/2, 5/2, 6/2),
            _ => sizes!(2: 1/4, 2/2, 3/1, 4/1, 5/1, 6/1),
        }
    }
}

/// `ROWS` pixels by `VECTORS` registers of outputs, the inputs dealt out over `SPLIT` sets of sums so that enough
/// independent chains are in flight.
#[inline(always)]
unsafe fn product_tile<V: Vector, W: Weight, const ROWS: usize, const VECTORS: usize, const SPLIT: usize>(
    tile: &Tile<W>,
) {
    unsafe {
        let mut sums = [[[V::zero(); VECTORS]; ROWS]; SPLIT];
        for row in 0..ROWS {
            for vector in 0..VECTORS {
                sums[0][row][vector] = V::load(tile.bias.add(vector * V::LANES));
            }
        }
        let input: [*const f32; ROWS] = std::array::from_fn(|row| tile.input[row]);
        let mut first = 0;
        while first < tile.run_len {
            let end = (first + tile.stretch).min(tile.run_len);
            for run in 0..tile.runs {
                let start = run * tile.run_stride;
                let mut weights = tile.weights.add((run * tile.run_len + first) * VECTORS * V::LANES);
                let mut k = first;
                macro_rules! unrolled {
                    ($($next:literal)*) => {$(
                        let columns = weights.add($next * VECTORS * V::LANES);
                        step::<V, W, ROWS, VECTORS>(&mut sums[$next % SPLIT], &input, start + k + $next, columns);
                    )*};
                }
                while k + UNROLL <= end {
                    // Written out: a loop of this length is not unrolled, and then the sums leave the registers.
                    unrolled!(0 1 2 3 4 5 6 7);
                    weights = weights.add(UNROLL * VECTORS * V::LANES);
                    k += UNROLL;
                }
                while k < end {
                    step::<V, W, ROWS, VECTORS>(&mut sums[0], &input, start + k, weights);
                    weights = weights.add(VECTORS * V::LANES);
                    k += 1;
                }
            }
            first = end;
        }
        for row in 0..ROWS {
            for vector in 0..VECTORS {
                let to = tile.output[row].add(vector * V::LANES);
                let mut sum = sums[0][row][vector];
                // Not a slice of `sums`: its address would force the sums out of the registers.
                for split in 1..SPLIT {
                    sum = sum.add(sums[split][row][vector]);
                }
                if tile.accumulate {
                    sum = sum.add(V::load(to));
                }
                if tile.relu {
                    sum = sum.max(V::zero());
                }
                sum.store(to);
            }
        }
    }
}

#[inline(always)]
unsafe fn step<V: Vector, W: Weight, const ROWS: usize, const VECTORS: usize>(
    sums: &mut [[V; VECTORS]; ROWS],
    input: &[*const f32; ROWS],
    k: usize,
    weights: *const W,
) {
    unsafe {
        let mut columns = [V::zero(); VECTORS];
        for vector in 0..VECTORS {
            let column = weights.add(vector * V::LANES);
            columns[vector] = W::load::<V>(column);
            if VECTORS > 1 {
                // Panels of one register are small layers, whose weights are in the cache.
                prefetch(column.wrapping_byte_add(PREFETCH_BYTES));
            }
        }
        for row in 0..ROWS {
            let value = V::splat(*input[row].add(k));
            for vector in 0..VECTORS {
                sums[row][vector] = value.mul_add(columns[vector], sums[row][vector]);
            }
        }
    }
}
