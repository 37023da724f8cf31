//! 3 x 3 convolutions of stride 1 through Winograd's transforms: fewer multiplications, more weights.

use super::activation_map::ActivationMap;
use super::kernels::{
    Buffer, Epilogue, GROUP, Gemm, Im2col, Level, Panels, Scheme, Storage, Tiles, gemm, transform_input,
    transform_output,
};

/// Transformed numbers that should stay in the second-level cache.
const BLOCK_BYTES: usize = 512 << 10;

/// Memory of a Winograd convolution, reused between calls.
#[derive(Debug, Default)]
pub struct WinogradWorkspace {
    inputs: Buffer,
    outputs: Buffer,
}

/// A convolution's kernels, transformed.
#[derive(Debug)]
pub struct Winograd {
    level: Level,
    scheme: Scheme,
    products: Vec<Panels>,
    bias: Buffer,
    im2col: Im2col,
    input: ActivationMap,
    output: ActivationMap,
}

/// How many products take as long as fetching one weight from memory, with the transforms' share on top. Measured.
const PRODUCTS_PER_WEIGHT: isize = 16;

/// The scheme that saves the most on a batch, if any does: the products saved must outweigh the additional weights, which
/// are fetched once per batch.
#[must_use]
pub fn best_scheme(output: &ActivationMap, batch: usize) -> Option<Scheme> {
    let direct = 9 * output.height * output.width;
    let gain = |scheme: &Scheme| {
        let products = tiles(*scheme, output) * scheme.positions();
        let saved = (direct as isize - products as isize) * batch as isize;
        saved - PRODUCTS_PER_WEIGHT * (scheme.positions() as isize - 9)
    };
    Scheme::ALL.into_iter().filter(|scheme| gain(scheme) > 0).max_by_key(gain)
}

fn tiles(scheme: Scheme, output: &ActivationMap) -> usize {
    output.height.div_ceil(scheme.outputs()) * output.width.div_ceil(scheme.outputs())
}

/// Distance between the transformed numbers of two positions: one cache line more than they need, because positions a
/// power of two apart would evict each other from the cache.
const fn stride(rows: usize, channels: usize) -> usize {
    rows * channels + GROUP
}

impl Winograd {
    /// Transforms `kernel(output, input)`, nine numbers row by row, for input maps whose border is at least 1.
    #[must_use]
    pub fn new(
        level: Level,
        scheme: Scheme,
        input: ActivationMap,
        output: ActivationMap,
        kernel: impl Fn(usize, usize) -> [f64; 9],
        bias: impl Fn(usize) -> f32,
    ) -> Self {
        let (inputs, outputs) = (input.channels, output.channels);
        let kernels: Vec<[f64; 9]> = (0..outputs * inputs).map(|at| kernel(at / inputs, at % inputs)).collect();
        let products = (0..scheme.positions())
            .map(|position| {
                let weight = |out: usize, k: usize| scheme.kernel(&kernels[out * inputs + k], position) as f32;
                Panels::pack(level, Storage::F32, (outputs, outputs), inputs, weight, |_| 0.0)
            })
            .collect();
        let mut biases = Buffer::zeros(outputs);
        for (out, slot) in biases.iter_mut().enumerate() {
            *slot = bias(out);
        }
        Self { level, scheme, products, bias: biases, im2col: Im2col::row(inputs), input, output }
    }

    /// Runs over a batch; the output's border must hold zeros already.
    pub fn run(
        &self,
        batch: usize,
        input: &[f32],
        output: &mut [f32],
        epilogue: Epilogue,
        workspace: &mut WinogradWorkspace,
    ) {
        let (positions, tiles) = (self.scheme.positions(), tiles(self.scheme, &self.output));
        let (inputs, outputs) = (self.input.channels, self.output.channels);
        let per_image = positions * tiles * (inputs + outputs) * size_of::<f32>();
        // Fetching the weights again for each block must not cost more than the transformed numbers.
        let weights = positions * inputs * outputs * size_of::<f32>();
        let block = (BLOCK_BYTES.max(weights) / per_image).clamp(1, batch.max(1));
        workspace.inputs.grow(positions * stride(block * tiles, inputs));
        workspace.outputs.grow(positions * stride(block * tiles, outputs));
        for start in (0..batch).step_by(block) {
            let count = block.min(batch - start);
            let rows = count * tiles;
            self.transform_inputs(start, count, input, &mut workspace.inputs);
            for (position, panels) in self.products.iter().enumerate() {
                gemm(&mut Gemm {
                    panels,
                    im2col: &self.im2col,
                    batch: rows,
                    input: &workspace.inputs[position * stride(rows, inputs)..],
                    input_stride: inputs,
                    output: &mut workspace.outputs[position * stride(rows, outputs)..],
                    output_stride: outputs,
                    epilogue: Epilogue::NONE,
                });
            }
            self.transform_outputs(start, count, &workspace.outputs, output, epilogue);
        }
    }

    fn transform_inputs(&self, start: usize, count: usize, images: &[f32], transformed: &mut [f32]) {
        let map = &self.input;
        let tiles = self.tiles_of(map, 1, count);
        let corner = (map.border - 1) * (map.row_stride() + map.channels);
        let per_image = tiles.rows * tiles.columns * tiles.channels;
        for (index, image) in images.chunks_exact(map.len()).skip(start).take(count).enumerate() {
            transform_input(self.level, tiles, &image[corner..], &mut transformed[index * per_image..]);
        }
    }

    fn transform_outputs(
        &self,
        start: usize,
        count: usize,
        transformed: &[f32],
        images: &mut [f32],
        epilogue: Epilogue,
    ) {
        let map = &self.output;
        let tiles = self.tiles_of(map, 0, count);
        let corner = map.inside();
        let per_image = tiles.rows * tiles.columns * tiles.channels;
        for (index, image) in images.chunks_exact_mut(map.len()).skip(start).take(count).enumerate() {
            let transformed = &transformed[index * per_image..];
            transform_output(self.level, tiles, transformed, &mut image[corner..], &self.bias, epilogue);
        }
    }

    /// The tiles of each map in a block of `count`, including `margin` pixels of the map's border.
    fn tiles_of(&self, map: &ActivationMap, margin: usize, count: usize) -> Tiles {
        let side = self.scheme.outputs();
        Tiles {
            scheme: self.scheme,
            rows: self.output.height.div_ceil(side),
            columns: self.output.width.div_ceil(side),
            channels: map.channels,
            height: map.height + 2 * margin,
            width: map.width + 2 * margin,
            row_stride: map.row_stride(),
            position_stride: stride(count * tiles(self.scheme, &self.output), map.channels),
        }
    }
}
