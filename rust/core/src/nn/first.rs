//! The first layer: a convolution of the cropped bytes of an image.

use super::conv::{Conv, ConvWeights, Plane, Window};
use super::kernels::{Buffer, Level, PAIRED, Pairs, PairsCall, Storage, widen};
use super::winograd::WinogradWorkspace;
use crate::error::Result;

/// Colours of a pixel.
pub const COLOURS: usize = 3;

/// A convolution with bias and rectifier of the centre of (size, size, 3) bytes, in 0..=255.
#[derive(Debug)]
pub struct First {
    level: Level,
    crop: usize,
    kind: Kind,
    /// Shape of an output image.
    pub output: Plane,
}

#[derive(Debug)]
enum Kind {
    /// Through a copy of the crop in f32, with its border.
    Staged { pixels: Plane, conv: Box<Conv> },
    /// Straight from the bytes.
    Paired { pairs: Pairs, window: Window },
}

/// Memory of a first layer, reused between calls.
#[derive(Debug, Default)]
pub struct FirstWorkspace {
    pixels: Buffer,
}

impl First {
    /// Packs the weights for crops of a fixed side; the output has a border.
    ///
    /// # Errors
    /// [`crate::error::Error::WeightFile`] if the sizes are impossible.
    pub fn new(
        level: Level,
        storage: Storage,
        weights: ConvWeights<'_>,
        window: Window,
        crop: usize,
        border: usize,
    ) -> Result<Self> {
        let outputs = weights.bias.len();
        let side = window.output(crop)?;
        if Pairs::fit(level, window.stride, outputs, side) {
            let output = Plane::new(side, side, PAIRED, border)?;
            let weight = |out, row, column, colour| weights.at(window.kernel, out, row, column, colour);
            let pairs = Pairs::pack(window.kernel, outputs, weight, |out| weights.bias[out]);
            return Ok(Self { level, crop, kind: Kind::Paired { pairs, window }, output });
        }
        let pixels = Plane::new(crop, crop, COLOURS, window.padding)?;
        let conv = Box::new(Conv::new(level, storage, weights, window, pixels, border, true)?);
        Ok(Self { level, crop, output: conv.output, kind: Kind::Staged { pixels, conv } })
    }

    /// Runs on one image.
    pub fn run(
        &self,
        image: &[u8],
        size: usize,
        output: &mut [f32],
        workspace: &mut FirstWorkspace,
        winograd: &mut WinogradWorkspace,
    ) {
        let (stride, inset) = (size * COLOURS, (size - self.crop) / 2);
        let image = &image[inset * (stride + COLOURS)..];
        match &self.kind {
            Kind::Staged { pixels, conv } => {
                self.stage(pixels, image, stride, &mut workspace.pixels);
                conv.run(1, &workspace.pixels, output, false, winograd);
            }
            Kind::Paired { pairs, window } => {
                let plane = &self.output;
                plane.clear_border(output);
                let mut call = PairsCall {
                    image,
                    image_stride: stride,
                    crop: self.crop,
                    padding: window.padding,
                    output: &mut output[plane.border * (plane.row_stride() + plane.channels)..],
                    output_stride: plane.row_stride(),
                    side: plane.width,
                };
                pairs.run(self.level, &mut call, &mut workspace.pixels);
            }
        }
    }

    /// Copies the crop into a bordered f32 plane.
    fn stage(&self, plane: &Plane, image: &[u8], stride: usize, pixels: &mut Buffer) {
        pixels.grow(plane.len());
        plane.clear_border(pixels);
        for row in 0..self.crop {
            let start = (row + plane.border) * plane.row_stride() + plane.border * COLOURS;
            let bytes = &image[row * stride..][..self.crop * COLOURS];
            widen(self.level, bytes, &mut pixels[start..start + self.crop * COLOURS]);
        }
    }
}
