//! Kernels without weights: max pooling, spatial softmax and element-wise functions.

use super::vector::Vector;
use super::{GROUP, Level, dispatch};

/// Max pooling over a 3 x 3 window, stride 2, of an NHWC map stored with a border of zeros. The inputs must not be
/// negative, so that the border never wins.
///
/// `windows` lists, for each output pixel, the offset of the window's first input and the offset of the output.
///
/// # Panics
/// If a window lies outside the slices: a fault of this crate, not of its input.
pub fn max_pool(
    level: Level,
    windows: &[[u32; 2]],
    channels: usize,
    row_stride: usize,
    input: &[f32],
    output: &mut [f32],
) {
    assert_eq!(channels % GROUP, 0, "channels come in whole groups");
    for &[from, to] in windows {
        assert!(from as usize + 2 * row_stride + 3 * channels <= input.len(), "window outside the input");
        assert!(to as usize + channels <= output.len(), "pixel outside the output");
    }
    let mut job = MaxPool { windows, channels, row_stride, input: input.as_ptr(), output: output.as_mut_ptr() };
    // SAFETY: all windows were checked above.
    dispatch!(level, max_pool_windows, &mut MaxPool<'_>, &mut job);
}

struct MaxPool<'a> {
    windows: &'a [[u32; 2]],
    channels: usize,
    row_stride: usize,
    input: *const f32,
    output: *mut f32,
}

#[inline(always)]
unsafe fn max_pool_windows<V: Vector>(job: &mut MaxPool<'_>) {
    for &[from, to] in job.windows {
        for channel in (0..job.channels).step_by(V::LANES) {
            unsafe {
                let corner = job.input.add(from as usize + channel);
                let mut largest = V::load(corner);
                for row in 0..3 {
                    for column in 0..3 {
                        largest = largest.max(V::load(corner.add(row * job.row_stride + column * job.channels)));
                    }
                }
                largest.store(job.output.add(to as usize + channel));
            }
        }
    }
}

/// Softmax over each channel's pixels, then the expected pixel position in [-1, 1].
///
/// `logits` is (pixels, channels) with channels in whole registers, and `positions` holds each pixel's (x, y). `output`
/// receives x0, y0, x1, y1, ... of the first `keypoints` channels.
///
/// # Panics
/// If the slices do not fit each other: a fault of this crate, not of its input.
pub fn spatial_softmax(
    level: Level,
    logits: &[f32],
    positions: &[[f32; 2]],
    temperature: f32,
    keypoints: usize,
    output: &mut [f32],
) {
    let pixels = positions.len();
    assert!(pixels > 0 && logits.len().is_multiple_of(pixels), "one logit per pixel and channel");
    let channels = logits.len() / pixels;
    assert!(channels.is_multiple_of(level.lanes()) && keypoints <= channels, "channels come in whole registers");
    assert!(output.len() >= 2 * keypoints, "output too short");
    let mut job = Softmax { logits, positions, scale: 1.0 / temperature, channels, keypoints, output };
    // SAFETY: `logits` holds pixels * channels numbers, as checked above.
    dispatch!(level, softmax_channels, &mut Softmax<'_>, &mut job);
}

struct Softmax<'a> {
    logits: &'a [f32],
    positions: &'a [[f32; 2]],
    scale: f32,
    channels: usize,
    keypoints: usize,
    output: &'a mut [f32],
}

#[inline(always)]
unsafe fn softmax_channels<V: Vector>(job: &mut Softmax<'_>) {
    for first in (0..job.channels).step_by(V::LANES) {
        let mut expected = [[0.0_f32; GROUP]; 2];
        unsafe {
            let column = job.logits.as_ptr().add(first);
            let mut largest = V::load(column);
            for pixel in 1..job.positions.len() {
                largest = largest.max(V::load(column.add(pixel * job.channels)));
            }
            let (mut total, mut x, mut y) = (V::zero(), V::zero(), V::zero());
            for (pixel, position) in job.positions.iter().enumerate() {
                let logit = V::load(column.add(pixel * job.channels));
                let weight = logit.sub(largest).mul(V::splat(job.scale)).exp();
                total = total.add(weight);
                x = weight.mul_add(V::splat(position[0]), x);
                y = weight.mul_add(V::splat(position[1]), y);
            }
            x.div(total).store(expected[0].as_mut_ptr());
            y.div(total).store(expected[1].as_mut_ptr());
        }
        for lane in 0..V::LANES.min(job.keypoints.saturating_sub(first)) {
            job.output[2 * (first + lane)] = expected[0][lane];
            job.output[2 * (first + lane) + 1] = expected[1][lane];
        }
    }
}

/// Converts bytes to f32.
///
/// # Panics
/// If the slices differ in length: a fault of this crate, not of its input.
pub fn widen(level: Level, bytes: &[u8], numbers: &mut [f32]) {
    assert_eq!(bytes.len(), numbers.len(), "one number for each byte");
    let mut job = (bytes, numbers);
    // SAFETY: the loop stays inside the slices.
    dispatch!(level, widen_all, &mut (&[u8], &mut [f32]), &mut job);
}

/// Left to the compiler, which vectorises for the instruction set enabled here.
#[inline(always)]
unsafe fn widen_all<V: Vector>(job: &mut (&[u8], &mut [f32])) {
    for (number, &byte) in job.1.iter_mut().zip(job.0) {
        *number = f32::from(byte);
    }
}

/// Replaces each number by its hyperbolic tangent.
pub fn tanh_in_place(level: Level, values: &mut [f32]) {
    let mut values = values;
    // SAFETY: the loop stays inside the slice.
    dispatch!(level, tanh_all, &mut &mut [f32], &mut values);
}

#[inline(always)]
unsafe fn tanh_all<V: Vector>(values: &mut &mut [f32]) {
    for chunk in values.chunks_mut(V::LANES) {
        let mut lanes = [0.0_f32; GROUP];
        lanes[..chunk.len()].copy_from_slice(chunk);
        unsafe { V::load(lanes.as_ptr()).tanh().store(lanes.as_mut_ptr()) };
        chunk.copy_from_slice(&lanes[..chunk.len()]);
    }
}
