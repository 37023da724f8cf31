//! Direct convolution of bytes, for a stem of few channels: two neighbouring output pixels of eight channels share a
//! register.
//!
//! One pixel of eight channels would fill only half of a 16-lane register and leave half of its arithmetic idle. Inputs
//! are kept as pairs `(x[i], x[i + 6])`, which are what two windows of stride 2 over three colours read at the same place,
//! so one 64-bit broadcast serves both pixels. The rows of pairs behind one output row fit in the first-level cache.

use super::{Buffer, GROUP, Level};

/// Output channels.
pub const DIRECT_CHANNELS: usize = GROUP / 2;

/// Numbers of an input pixel.
const COLOURS: usize = 3;

/// Step between output pixels.
const STRIDE: usize = 2;

/// Numbers from the window of one pixel to that of the next.
const STEP: usize = STRIDE * COLOURS;

/// The packed weights.
#[derive(Debug)]
pub struct DirectConv {
    /// `[row][column][colour][channel][2]`, every weight twice.
    weights: Buffer,
    /// `[channel][2]`.
    bias: Buffer,
    kernel: usize,
}

/// One call: where the image lies and where the output goes.
#[derive(Debug)]
pub struct DirectConvCall<'a> {
    /// The bytes from the crop's first one on.
    pub image: &'a [u8],
    /// Bytes from one image row to the next.
    pub image_stride: usize,
    /// Rows and columns of the crop.
    pub crop: usize,
    /// Zeros assumed around the crop.
    pub padding: usize,
    /// The numbers from the first output pixel on, [`DIRECT_CHANNELS`] per pixel.
    pub output: &'a mut [f32],
    /// Numbers from one output row to the next.
    pub output_stride: usize,
    /// Rows and columns of the output.
    pub side: usize,
}

impl DirectConv {
    /// Whether this kernel can run such a convolution on this processor.
    #[must_use]
    pub fn applies(level: Level, stride: usize, outputs: usize, side: usize) -> bool {
        level.lanes() == GROUP && stride == STRIDE && outputs <= DIRECT_CHANNELS && side >= 2
    }

    /// Packs `weight(output, row, column, colour)` and `bias(output)` of a square kernel.
    #[must_use]
    pub fn pack(
        kernel: usize,
        outputs: usize,
        weight: impl Fn(usize, usize, usize, usize) -> f32,
        bias: impl Fn(usize) -> f32,
    ) -> Self {
        let mut weights = Buffer::zeros(kernel * kernel * COLOURS * GROUP);
        for (at, both) in weights.chunks_exact_mut(GROUP).enumerate() {
            let (row, column, colour) = (at / COLOURS / kernel, at / COLOURS % kernel, at % COLOURS);
            for output in 0..outputs {
                both[2 * output..2 * output + 2].fill(weight(output, row, column, colour));
            }
        }
        let mut twice = Buffer::zeros(GROUP);
        for output in 0..outputs {
            twice[2 * output..2 * output + 2].fill(bias(output));
        }
        Self { weights, bias: twice, kernel }
    }

    /// Convolves a crop of bytes, unscaled, and applies the rectifier.
    ///
    /// # Panics
    /// If the slices are too short: a fault of this crate, not of its input.
    pub fn run(&self, level: Level, call: &mut DirectConvCall<'_>, workspace: &mut Buffer) {
        let DirectConvCall { crop, padding, side, .. } = *call;
        assert!(Self::applies(level, STRIDE, DIRECT_CHANNELS, side), "this processor has no 16-lane registers");
        assert!((crop - 1) * call.image_stride + crop * COLOURS <= call.image.len(), "image too short");
        assert!((side - 1) * STRIDE + self.kernel <= crop + 2 * padding, "windows leave the padded crop");
        assert!((side - 1) * call.output_stride + side * DIRECT_CHANNELS <= call.output.len(), "output too short");
        let line = (crop + 2 * padding) * COLOURS;
        // Both are written and read in whole registers.
        workspace.grow((line + STEP).next_multiple_of(GROUP) + GROUP + self.kernel * pairs_len(line));
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the level says that the processor has the instructions, and the extents were checked above.
        unsafe {
            x86::all_rows(self, call, workspace);
        }
    }
}

/// Numbers in a row of pairs made from a line of `line` numbers.
const fn pairs_len(line: usize) -> usize {
    2 * line.next_multiple_of(GROUP)
}

#[cfg(target_arch = "x86_64")]
mod x86 {
    use std::arch::x86_64::*;

    use super::{Buffer, COLOURS, DIRECT_CHANNELS, DirectConv, DirectConvCall, GROUP, STEP, STRIDE, pairs_len};

    /// Most pairs in a tile.
    const MOST: usize = 10;

    #[target_feature(enable = "avx512f")]
    pub(super) unsafe fn all_rows(conv: &DirectConv, call: &mut DirectConvCall<'_>, workspace: &mut Buffer) {
        let DirectConvCall { crop, padding, side, .. } = *call;
        let len = pairs_len((crop + 2 * padding) * COLOURS);
        let (pairs, line) = workspace.split_at_mut(conv.kernel * len);
        line.fill(0.0);
        let mut ready = 0;
        for y in 0..side {
            // Rows are counted from the padding's first; the last `kernel` rows are kept.
            while ready < y * STRIDE + conv.kernel {
                let slot = &mut pairs[ready % conv.kernel * len..][..len];
                match ready.checked_sub(padding).filter(|&row| row < crop) {
                    Some(row) => {
                        let bytes = &call.image[row * call.image_stride..][..crop * COLOURS];
                        // SAFETY: this function needs the same instructions; `line` has STEP and a register to spare.
                        unsafe {
                            widen(bytes, &mut line[padding * COLOURS..][..crop * COLOURS]);
                            pair_up(line, slot);
                        }
                    }
                    None => slot.fill(0.0),
                }
                ready += 1;
            }
            let rows = (y * STRIDE..y * STRIDE + conv.kernel).map(|row| &pairs[row % conv.kernel * len..][..len]);
            let to = &mut call.output[y * call.output_stride..][..side * DIRECT_CHANNELS];
            // SAFETY: windows stay in the padded crop, as the caller has checked, and so do the pairs.
            unsafe { one_row(conv, rows, to) };
        }
    }

    #[target_feature(enable = "avx512f")]
    unsafe fn widen(bytes: &[u8], numbers: &mut [f32]) {
        let whole = bytes.len() / GROUP * GROUP;
        for at in (0..whole).step_by(GROUP) {
            unsafe {
                let sixteen = _mm512_cvtepu8_epi32(_mm_loadu_si128(bytes.as_ptr().add(at).cast()));
                _mm512_storeu_ps(numbers.as_mut_ptr().add(at), _mm512_cvtepi32_ps(sixteen));
            }
        }
        for (number, &byte) in numbers[whole..].iter_mut().zip(&bytes[whole..]) {
            *number = f32::from(byte);
        }
    }

    /// `slot[2 i] = line[i]`, `slot[2 i + 1] = line[i + STEP]`.
    #[target_feature(enable = "avx512f")]
    unsafe fn pair_up(line: &[f32], slot: &mut [f32]) {
        let low = _mm512_setr_epi32(0, 16, 1, 17, 2, 18, 3, 19, 4, 20, 5, 21, 6, 22, 7, 23);
        let high = _mm512_setr_epi32(8, 24, 9, 25, 10, 26, 11, 27, 12, 28, 13, 29, 14, 30, 15, 31);
        for at in (0..slot.len() / 2).step_by(GROUP) {
            unsafe {
                let here = _mm512_loadu_ps(line.as_ptr().add(at));
                let there = _mm512_loadu_ps(line.as_ptr().add(at + STEP));
                let to = slot.as_mut_ptr().add(2 * at);
                _mm512_storeu_ps(to, _mm512_permutex2var_ps(here, low, there));
                _mm512_storeu_ps(to.add(GROUP), _mm512_permutex2var_ps(here, high, there));
            }
        }
    }

    #[target_feature(enable = "avx512f")]
    unsafe fn one_row<'a>(conv: &DirectConv, rows: impl Iterator<Item = &'a [f32]> + Clone, output: &mut [f32]) {
        let pixels = output.len() / DIRECT_CHANNELS;
        let whole = pixels / 2;
        let tiles = whole.div_ceil(MOST);
        for tile in 0..tiles {
            let (start, end) = (tile * whole / tiles, (tile + 1) * whole / tiles);
            unsafe { some_pairs(conv, rows.clone(), 2 * start, end - start, output) };
        }
        if pixels % 2 == 1 {
            unsafe { some_pairs(conv, rows, pixels - 2, 1, output) };
        }
    }

    #[target_feature(enable = "avx512f")]
    unsafe fn some_pairs<'a>(
        conv: &DirectConv,
        rows: impl Iterator<Item = &'a [f32]>,
        pixel: usize,
        count: usize,
        output: &mut [f32],
    ) {
        macro_rules! sizes {
            ($($count:literal)*) => {
                match count {
                    $($count => unsafe { tile::<$count>(conv, rows, pixel, output.as_mut_ptr()) },)*
                    _ => unreachable!("tiles have 1 to {MOST} pairs"),
                }
            };
        }
        sizes!(1 2 3 4 5 6 7 8 9 10);
    }

    #[target_feature(enable = "avx512f")]
    unsafe fn tile<'a, const COUNT: usize>(
        conv: &DirectConv,
        rows: impl Iterator<Item = &'a [f32]>,
        pixel: usize,
        output: *mut f32,
    ) {
        unsafe {
            let mut sums = [_mm512_loadu_ps(conv.bias.as_ptr()); COUNT];
            let mut weights = conv.weights.as_ptr();
            for row in rows {
                let mut from = row.as_ptr().add(2 * STEP * pixel);
                for _ in 0..conv.kernel * COLOURS {
                    let weight = _mm512_loadu_ps(weights);
                    for pair in 0..COUNT {
                        let both = _mm512_set1_pd(from.add(4 * STEP * pair).cast::<f64>().read_unaligned());
                        sums[pair] = _mm512_fmadd_ps(_mm512_castpd_ps(both), weight, sums[pair]);
                    }
                    weights = weights.add(GROUP);
                    from = from.add(2);
                }
            }
            let apart = _mm512_setr_epi32(0, 2, 4, 6, 8, 10, 12, 14, 1, 3, 5, 7, 9, 11, 13, 15);
            for pair in 0..COUNT {
                let rectified = _mm512_max_ps(sums[pair], _mm512_setzero_ps());
                let to = output.add((pixel + 2 * pair) * DIRECT_CHANNELS);
                _mm512_storeu_ps(to, _mm512_permutexvar_ps(apart, rectified));
            }
        }
    }
}
