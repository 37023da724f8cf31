//! Winograd's transforms for 3 x 3 convolutions (Lavin and Gray, 2016), a register of channels at a time.
//!
//! A tile of `outputs + 2` pixels a side is transformed to as many numbers per channel; each is multiplied by one number of
//! the transformed kernel; and the transform of the products gives `outputs` pixels a side.

use super::vector::Vector;
use super::{Epilogue, GROUP, Level, dispatch};

/// A transform, by the number of output pixels along a tile's side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scheme {
    /// Two, from the points 0, 1, -1 and infinity.
    Two,
    /// Three: also 2.
    Three,
    /// Four: also -2.
    Four,
    /// Five: also 1/2.
    Five,
}

impl Scheme {
    /// Every scheme.
    pub const ALL: [Self; 4] = [Self::Two, Self::Three, Self::Four, Self::Five];

    /// Output pixels along a tile's side.
    #[must_use]
    pub const fn outputs(self) -> usize {
        match self {
            Self::Two => 2,
            Self::Three => 3,
            Self::Four => 4,
            Self::Five => 5,
        }
    }

    /// Input pixels along a tile's side.
    #[must_use]
    pub const fn side(self) -> usize {
        self.outputs() + 2
    }

    /// Products per tile and pair of channels.
    #[must_use]
    pub const fn positions(self) -> usize {
        self.side() * self.side()
    }

    /// The number at `position` of the transform of a kernel given row by row.
    #[must_use]
    pub fn kernel(self, kernel: &[f64; 9], position: usize) -> f64 {
        let row = |index: usize| match self {
            Self::Two => F2::KERNEL[index],
            Self::Three => F3::KERNEL[index],
            Self::Four => F4::KERNEL[index],
            Self::Five => F5::KERNEL[index],
        };
        let (left, right) = (row(position / self.side()), row(position % self.side()));
        (0..9).map(|at| left[at / 3] * kernel[at] * right[at % 3]).sum()
    }
}

/// One scheme in one dimension: `M` output and `T` input pixels.
///
/// With the kernel's matrix G these are d -> B^T d and m -> A^T m of Lavin and Gray, written out: the compiler does not
/// fold a loop over constant matrices. `sum!(d; 0: 4.0, 2: -5.0)` is 4 d[0] - 5 d[2].
trait Transform<const M: usize, const T: usize> {
    const KERNEL: [[f64; 3]; T];
    unsafe fn input<V: Vector>(d: [V; T]) -> [V; T];
    unsafe fn output<V: Vector>(m: [V; T]) -> [V; M];
}

macro_rules! sum {
    ($d:ident; $first:literal: $factor:literal $(, $index:literal: $other:literal)*) => {{
        let sum = $d[$first].mul(V::splat($factor));
        $(let sum = $d[$index].mul_add(V::splat($other), sum);)*
        sum
    }};
}

struct F2;
struct F3;
struct F4;
struct F5;

impl Transform<2, 4> for F2 {
    const KERNEL: [[f64; 3]; 4] = [[1.0, 0.0, 0.0], [0.5, 0.5, 0.5], [0.5, -0.5, 0.5], [0.0, 0.0, 1.0]];
    #[inline(always)]
    unsafe fn input<V: Vector>(d: [V; 4]) -> [V; 4] {
        unsafe { [d[0].sub(d[2]), d[1].add(d[2]), d[2].sub(d[1]), d[1].sub(d[3])] }
    }
    #[inline(always)]
    unsafe fn output<V: Vector>(m: [V; 4]) -> [V; 2] {
        unsafe { [m[0].add(m[1]).add(m[2]), m[1].sub(m[2]).sub(m[3])] }
    }
}

impl Transform<3, 5> for F3 {
    const KERNEL: [[f64; 3]; 5] = [
        [0.5, 0.0, 0.0],
        [-0.5, -0.5, -0.5],
        [-1.0 / 6.0, 1.0 / 6.0, -1.0 / 6.0],
        [1.0 / 6.0, 1.0 / 3.0, 2.0 / 3.0],
        [0.0, 0.0, 1.0],
    ];
    #[inline(always)]
    unsafe fn input<V: Vector>(d: [V; 5]) -> [V; 5] {
        unsafe {
            [
                sum!(d; 0: 2.0, 1: -1.0, 2: -2.0, 3: 1.0),
                sum!(d; 1: -2.0, 2: -1.0, 3: 1.0),
                sum!(d; 1: 2.0, 2: -3.0, 3: 1.0),
                d[3].sub(d[1]),
                sum!(d; 1: 2.0, 2: -1.0, 3: -2.0, 4: 1.0),
            ]
        }
    }
    #[inline(always)]
    unsafe fn output<V: Vector>(m: [V; 5]) -> [V; 3] {
        unsafe {
            let (even, odd) = (m[1].add(m[2]), m[1].sub(m[2]));
            let four = m[3].mul_add(V::splat(4.0), m[4]);
            [m[0].add(even).add(m[3]), m[3].mul_add(V::splat(2.0), odd), even.add(four)]
        }
    }
}

impl Transform<4, 6> for F4 {
    const KERNEL: [[f64; 3]; 6] = [
        [0.25, 0.0, 0.0],
        [-1.0 / 6.0, -1.0 / 6.0, -1.0 / 6.0],
        [-1.0 / 6.0, 1.0 / 6.0, -1.0 / 6.0],
        [1.0 / 24.0, 1.0 / 12.0, 1.0 / 6.0],
        [1.0 / 24.0, -1.0 / 12.0, 1.0 / 6.0],
        [0.0, 0.0, 1.0],
    ];
    #[inline(always)]
    unsafe fn input<V: Vector>(d: [V; 6]) -> [V; 6] {
        unsafe {
            let (even, odd) = (sum!(d; 4: 1.0, 2: -4.0), sum!(d; 3: 1.0, 1: -4.0));
            let (outer, inner) = (d[4].sub(d[2]), sum!(d; 3: 2.0, 1: -2.0));
            [
                sum!(d; 0: 4.0, 2: -5.0, 4: 1.0),
                even.add(odd),
                even.sub(odd),
                outer.add(inner),
                outer.sub(inner),
                sum!(d; 1: 4.0, 3: -5.0, 5: 1.0),
            ]
        }
    }
    #[inline(always)]
    unsafe fn output<V: Vector>(m: [V; 6]) -> [V; 4] {
        unsafe {
            let (one, minus) = (m[1].add(m[2]), m[1].sub(m[2]));
            let (two, difference) = (m[3].add(m[4]), m[3].sub(m[4]));
            [
                m[0].add(one).add(two),
                difference.mul_add(V::splat(2.0), minus),
                two.mul_add(V::splat(4.0), one),
                difference.mul_add(V::splat(8.0), minus).add(m[5]),
            ]
        }
    }
}

impl Transform<5, 7> for F5 {
    const KERNEL: [[f64; 3]; 7] = [
        [-0.5, 0.0, 0.0],
        [-1.0 / 3.0, -1.0 / 3.0, -1.0 / 3.0],
        [1.0 / 9.0, -1.0 / 9.0, 1.0 / 9.0],
        [1.0 / 36.0, 1.0 / 18.0, 1.0 / 9.0],
        [-1.0 / 60.0, 1.0 / 30.0, -1.0 / 15.0],
        [32.0 / 45.0, 16.0 / 45.0, 8.0 / 45.0],
        [0.0, 0.0, 1.0],
    ];
    #[inline(always)]
    unsafe fn input<V: Vector>(d: [V; 7]) -> [V; 7] {
        unsafe {
            [
                sum!(d; 0: -2.0, 1: 4.0, 2: 2.5, 3: -5.0, 4: -0.5, 5: 1.0),
                sum!(d; 1: 2.0, 2: -2.0, 3: -4.5, 4: 0.5, 5: 1.0),
                sum!(d; 1: -2.0, 2: 6.0, 3: -3.5, 4: -1.5, 5: 1.0),
                sum!(d; 1: 1.0, 2: -1.5, 3: -2.0, 4: 1.5, 5: 1.0),
                sum!(d; 1: -1.0, 2: 2.5, 4: -2.5, 5: 1.0),
                sum!(d; 1: 4.0, 3: -5.0, 5: 1.0),
                sum!(d; 1: -2.0, 2: 4.0, 3: 2.5, 4: -5.0, 5: -0.5, 6: 1.0),
            ]
        }
    }
    #[inline(always)]
    unsafe fn output<V: Vector>(m: [V; 7]) -> [V; 5] {
        unsafe {
            let (one, minus) = (m[1].add(m[2]), m[1].sub(m[2]));
            let (two, difference) = (m[3].add(m[4]), m[3].sub(m[4]));
            [
                m[0].add(one).add(two.add(m[5])),
                m[5].mul_add(V::splat(0.5), difference.mul_add(V::splat(2.0), minus)),
                m[5].mul_add(V::splat(0.25), two.mul_add(V::splat(4.0), one)),
                m[5].mul_add(V::splat(0.125), difference.mul_add(V::splat(8.0), minus)),
                m[5].mul_add(V::splat(0.0625), two.mul_add(V::splat(16.0), one)).add(m[6]),
            ]
        }
    }
}

/// The tiles of one image. Transformed numbers are `[position][tile][channel]`.
#[derive(Debug, Clone, Copy)]
pub struct Tiles {
    /// Which transform.
    pub scheme: Scheme,
    /// Rows of tiles.
    pub rows: usize,
    /// Columns of tiles.
    pub columns: usize,
    /// Channels, in whole groups.
    pub channels: usize,
    /// Pixel rows of the image: with one row of border on either side for inputs, without border for outputs.
    pub height: usize,
    /// Pixel columns, counted in the same way.
    pub width: usize,
    /// Distance between two pixel rows.
    pub row_stride: usize,
    /// Distance between the transformed numbers of two positions.
    pub position_stride: usize,
}

impl Tiles {
    fn check(&self, image: usize, transformed: usize) {
        assert_eq!(self.channels % GROUP, 0, "channels come in whole groups");
        assert!(self.width * self.channels <= self.row_stride, "pixel rows overlap");
        assert!((self.height - 1) * self.row_stride + self.width * self.channels <= image, "image too short");
        let last = (self.scheme.positions() - 1) * self.position_stride;
        assert!(last + self.rows * self.columns * self.channels <= transformed, "transformed numbers too short");
    }
}

/// Transforms the tiles of an image whose stored corner is the first tile's corner; pixels outside it are zero.
///
/// # Panics
/// If the slices are too short: a fault of this crate, not of its input.
pub fn transform_input(level: Level, tiles: Tiles, image: &[f32], transformed: &mut [f32]) {
    tiles.check(image.len(), transformed.len());
    let mut job = InputJob { tiles, image: image.as_ptr(), transformed: transformed.as_mut_ptr() };
    // SAFETY: the extents were checked above.
    dispatch!(level, input_tiles, &mut InputJob, &mut job);
}

/// Writes the pixels of an image from its transformed tiles, with one bias per channel.
///
/// # Panics
/// If the slices are too short: a fault of this crate, not of its input.
pub fn transform_output(
    level: Level,
    tiles: Tiles,
    transformed: &[f32],
    image: &mut [f32],
    bias: &[f32],
    epilogue: Epilogue,
) {
    tiles.check(image.len(), transformed.len());
    assert!(bias.len() >= tiles.channels, "one bias per channel");
    let mut job = OutputJob { tiles, image: image.as_mut_ptr(), transformed: transformed.as_ptr(), bias, epilogue };
    // SAFETY: the extents were checked above.
    dispatch!(level, output_tiles, &mut OutputJob<'_>, &mut job);
}

struct InputJob {
    tiles: Tiles,
    image: *const f32,
    transformed: *mut f32,
}

struct OutputJob<'a> {
    tiles: Tiles,
    image: *mut f32,
    transformed: *const f32,
    bias: &'a [f32],
    epilogue: Epilogue,
}

#[inline(always)]
unsafe fn input_tiles<V: Vector>(job: &mut InputJob) {
    unsafe {
        match job.tiles.scheme {
            Scheme::Two => input_of::<V, F2, 2, 4>(job),
            Scheme::Three => input_of::<V, F3, 3, 5>(job),
            Scheme::Four => input_of::<V, F4, 4, 6>(job),
            Scheme::Five => input_of::<V, F5, 5, 7>(job),
        }
    }
}

#[inline(always)]
unsafe fn output_tiles<V: Vector>(job: &mut OutputJob<'_>) {
    unsafe {
        match job.tiles.scheme {
            Scheme::Two => output_of::<V, F2, 2, 4>(job),
            Scheme::Three => output_of::<V, F3, 3, 5>(job),
            Scheme::Four => output_of::<V, F4, 4, 6>(job),
            Scheme::Five => output_of::<V, F5, 5, 7>(job),
        }
    }
}

#[inline(always)]
unsafe fn input_of<V: Vector, S: Transform<M, T>, const M: usize, const T: usize>(job: &mut InputJob) {
    let Tiles { rows, columns, channels, height, width, row_stride, position_stride, .. } = job.tiles;
    for tile in 0..rows * columns {
        let (top, left) = (tile / columns * M, tile % columns * M);
        let inside = top + T <= height && left + T <= width;
        for channel in (0..channels).step_by(V::LANES) {
            unsafe {
                let corner = job.image.wrapping_add(top * row_stride + left * channels + channel);
                let mut half = [[V::zero(); T]; T];
                for column in 0..T {
                    let mut pixels = [V::zero(); T];
                    for row in 0..T {
                        if inside || (top + row < height && left + column < width) {
                            pixels[row] = V::load(corner.wrapping_add(row * row_stride + column * channels));
                        }
                    }
                    half[column] = S::input(pixels);
                }
                for row in 0..T {
                    let mut line = [V::zero(); T];
                    for column in 0..T {
                        line[column] = half[column][row];
                    }
                    let line = S::input(line);
                    for column in 0..T {
                        let position = (row * T + column) * position_stride + tile * channels + channel;
                        line[column].store(job.transformed.add(position));
                    }
                }
            }
        }
    }
}

#[inline(always)]
unsafe fn output_of<V: Vector, S: Transform<M, T>, const M: usize, const T: usize>(job: &mut OutputJob<'_>) {
    let Tiles { rows, columns, channels, height, width, row_stride, position_stride, .. } = job.tiles;
    for tile in 0..rows * columns {
        let (top, left) = (tile / columns * M, tile % columns * M);
        for channel in (0..channels).step_by(V::LANES) {
            unsafe {
                let bias = V::load(job.bias.as_ptr().add(channel));
                let first = job.transformed.add(tile * channels + channel);
                let mut half = [[V::zero(); M]; T];
                for column in 0..T {
                    let mut numbers = [V::zero(); T];
                    for row in 0..T {
                        numbers[row] = V::load(first.add((row * T + column) * position_stride));
                    }
                    half[column] = S::output(numbers);
                }
                for row in 0..M {
                    let mut line = [V::zero(); T];
                    for column in 0..T {
                        line[column] = half[column][row];
                    }
                    let line = S::output(line);
                    for column in 0..M {
                        if top + row >= height || left + column >= width {
                            continue;
                        }
                        let to = job.image.add((top + row) * row_stride + (left + column) * channels + channel);
                        job.epilogue.store(line[column].add(bias), to);
                    }
                }
            }
        }
    }
}
