//! Implicit GEMM: the one matrix product behind convolutions and linear layers.
//!
//! The left matrix is never formed. Each of its rows belongs to one output pixel and is read from where it lies: `runs`
//! runs of `run_len` contiguous inputs, `run_stride` apart, which are the rows of a convolution's window in an NHWC map
//! stored with its border of zeros, or one whole row of a matrix. The right matrix, the weights, is packed in panels of
//! columns, each `[k][width]`, which stream through the cache once per tile of pixels.

use half::bf16;

use super::stored::Weight;
use super::vector::{Vector, prefetch};
use super::{Buffer, Epilogue, GROUP, Level, Storage, Stored, dispatch};

/// An implicit im2col: where the rows of the left matrix lie in one image of a batch, and where the results go.
#[derive(Debug, Clone)]
pub struct Im2col {
    /// Offset of each pixel's first input.
    pub input: Vec<u32>,
    /// Offset of each pixel's first output channel.
    pub output: Vec<u32>,
    /// Runs of contiguous inputs in a row.
    pub runs: usize,
    /// Numbers in a run.
    pub run_len: usize,
    /// Distance between the starts of two runs.
    pub run_stride: usize,
}

impl Im2col {
    /// One pixel whose input is `len` contiguous numbers: a linear layer.
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

/// One call of [`gemm`].
#[derive(Debug)]
pub struct Gemm<'a> {
    /// Weights and bias.
    pub panels: &'a Panels,
    /// Where the pixels lie.
    pub im2col: &'a Im2col,
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
    /// What follows the sums.
    pub epilogue: Epilogue,
}

/// Computes `output = [relu](weights * input + bias [+ output])` for every pixel of the batch.
///
/// # Panics
/// If the weights do not fit the window, or a pixel lies outside the slices: a fault of this crate, not of its input.
pub fn gemm(call: &mut Gemm<'_>) {
    let Gemm { panels, im2col, batch, .. } = *call;
    assert_eq!(im2col.runs * im2col.run_len, panels.inputs, "weights do not fit the window");
    assert_eq!(im2col.input.len(), im2col.output.len(), "one output for each input pixel");
    if batch == 0 || im2col.input.is_empty() {
        return;
    }
    assert!((batch - 1) * call.input_stride + im2col.input_extent() <= call.input.len(), "input too short");
    assert!(
        (batch - 1) * call.output_stride + im2col.output_extent(panels.outputs) <= call.output.len(),
        "output too short"
    );
    // SAFETY: the two extents above bound every offset that the loops form, and `panels` holds inputs * outputs weights.
    match &panels.values {
        Stored::F32(values) => {
            let mut job = Job::new(call, values.as_ptr());
            dispatch!(panels.level, all_tiles::<f32>, &mut Job<'_, f32>, &mut job);
        }
        Stored::Bf16(values) => {
            let mut job = Job::new(call, values.as_ptr());
            dispatch!(panels.level, all_tiles::<bf16>, &mut Job<'_, bf16>, &mut job);
        }
    }
}

/// Most pixels in a tile: their pointers and sums just fit in the registers.
const MOST: usize = 12;

/// Inputs in one turn of the innermost loop.
const UNROLL: usize = 8;

/// How far ahead weights are prefetched: unlike the hardware's prefetching, ours does not stop at the end of a page.
const PREFETCH_BYTES: usize = 8 << 10;

/// From this many bytes on, weights come from beyond the second-level cache. They are then read in as many streams as
/// there are runs, because the hardware fetches more at a time from several pages than from one.
const STREAMED_BYTES: usize = 1 << 20;

/// Inputs read from one stream before the next one's turn.
const STREAMED_STRETCH: usize = 2 * UNROLL;

/// Bytes of input that should stay in the second-level cache while every panel passes over them.
const BLOCK_BYTES: usize = 384 << 10;

struct Job<'a, W> {
    weights: *const W,
    bias: *const f32,
    inputs: usize,
    outputs: usize,
    width: usize,
    im2col: &'a Im2col,
    batch: usize,
    input: *const f32,
    input_stride: usize,
    output: *mut f32,
    output_stride: usize,
    epilogue: Epilogue,
}

impl<'a, W> Job<'a, W> {
    fn new(call: &mut Gemm<'a>, weights: *const W) -> Self {
        Self {
            weights,
            bias: call.panels.bias.as_ptr(),
            inputs: call.panels.inputs,
            outputs: call.panels.outputs,
            width: call.panels.width,
            im2col: call.im2col,
            batch: call.batch,
            input: call.input.as_ptr(),
            input_stride: call.input_stride,
            output: call.output.as_mut_ptr(),
            output_stride: call.output_stride,
            epilogue: call.epilogue,
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
    /// Inputs of one run that are read before the next run's turn.
    stretch: usize,
    epilogue: Epilogue,
}

#[inline(always)]
unsafe fn all_tiles<V: Vector, W: Weight>(job: &mut Job<'_, W>) {
    let pixels = job.im2col.input.len();
    let total = pixels * job.batch;
    let most = if V::LANES == 16 { MOST } else { 6 };
    let bytes_per_pixel = (job.input_stride * 4).div_ceil(pixels).max(1);
    let block = (BLOCK_BYTES / bytes_per_pixel).max(most);
    let from_memory = job.inputs * job.outputs * size_of::<W>() >= STREAMED_BYTES;
    let stretch = if from_memory { STREAMED_STRETCH } else { job.im2col.run_len };
    let mut block_start = 0;
    while block_start < total {
        let block_end = (block_start + block).min(total);
        // With tiles of equal size, no accumulators are wasted on a small remainder.
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
                        runs: job.im2col.runs,
                        run_len: job.im2col.run_len,
                        run_stride: job.im2col.run_stride,
                        stretch,
                        epilogue: job.epilogue,
                    };
                    let (mut image, mut pixel) = (start / pixels, start % pixels);
                    for slot in 0..end - start {
                        let from = image * job.input_stride + *job.im2col.input.get_unchecked(pixel) as usize;
                        let to = image * job.output_stride + *job.im2col.output.get_unchecked(pixel) as usize;
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

/// `ROWS` pixels by `VECTORS` registers of outputs. The inputs are dealt out over `SPLIT` sets of sums, which keeps
/// enough independent chains in flight.
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
                    // Written out: the compiler does not unroll a loop this long, and the sums would leave the registers.
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
                tile.epilogue.store(sum, to);
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
                // Panels one register wide belong to small layers, whose weights are in the cache.
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
