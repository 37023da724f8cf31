//! The stem, an encoder's first layer: a convolution of an image's cropped bytes.

use super::activation_map::{ActivationMap, Window};
use super::conv::{Conv, ConvWeights};
use super::kernels::{
    Buffer, DIRECT_CHANNELS, DirectConv, DirectConvCall, Level, Nonlinearity, Residual, Storage, widen,
};
use super::winograd::WinogradWorkspace;
use crate::error::Result;

/// Colours of a pixel.
pub const COLOURS: usize = 3;

/// A convolution with bias and rectifier of the centre crop of (size, size, 3) bytes, in 0..=255.
#[derive(Debug)]
pub struct Stem {
    level: Level,
    crop: usize,
    kind: Kind,
    /// Shape of one output map.
    pub output: ActivationMap,
}

#[derive(Debug)]
enum Kind {
    /// Implicit GEMM over a copy of the crop in f32, with a border.
    ImplicitGemm { pixels: ActivationMap, conv: Box<Conv> },
    /// Straight from the bytes.
    Direct { conv: DirectConv, window: Window },
}

/// Memory of a stem, reused between calls.
#[derive(Debug, Default)]
pub struct StemWorkspace {
    pixels: Buffer,
}

impl Stem {
    /// Packs the weights for crops of a fixed side; the output map gets a border.
    ///
    /// # Errors
    /// [`crate::error::Error::ModelFile`] if the sizes are impossible.
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
        if DirectConv::applies(level, window.stride, outputs, side) {
            let output = ActivationMap::new(side, side, DIRECT_CHANNELS, border)?;
            let weight = |out, row, column, colour| weights.at(window.kernel, out, row, column, colour);
            let conv = DirectConv::pack(window.kernel, outputs, weight, |out| weights.bias[out]);
            return Ok(Self { level, crop, kind: Kind::Direct { conv, window }, output });
        }
        let pixels = ActivationMap::new(crop, crop, COLOURS, window.padding)?;
        let conv = Box::new(Conv::new(level, storage, weights, window, pixels, border, Nonlinearity::Relu)?);
        Ok(Self { level, crop, output: conv.output, kind: Kind::ImplicitGemm { pixels, conv } })
    }

    /// Runs on one image.
    pub fn run(
        &self,
        image: &[u8],
        size: usize,
        output: &mut [f32],
        workspace: &mut StemWorkspace,
        winograd: &mut WinogradWorkspace,
    ) {
        let (stride, inset) = (size * COLOURS, (size - self.crop) / 2);
        let image = &image[inset * (stride + COLOURS)..];
        match &self.kind {
            Kind::ImplicitGemm { pixels, conv } => {
                self.widen_crop(pixels, image, stride, &mut workspace.pixels);
                conv.run(1, &workspace.pixels, output, Residual::None, winograd);
            }
            Kind::Direct { conv, window } => {
                let map = &self.output;
                map.clear_border(output);
                let mut call = DirectConvCall {
                    image,
                    image_stride: stride,
                    crop: self.crop,
                    padding: window.padding,
                    output: &mut output[map.inside()..],
                    output_stride: map.row_stride(),
                    side: map.width,
                };
                conv.run(self.level, &mut call, &mut workspace.pixels);
            }
        }
    }

    /// Copies the crop into a bordered f32 map.
    fn widen_crop(&self, map: &ActivationMap, image: &[u8], stride: usize, pixels: &mut Buffer) {
        pixels.grow(map.len());
        map.clear_border(pixels);
        for row in 0..self.crop {
            let start = map.inside() + row * map.row_stride();
            let bytes = &image[row * stride..][..self.crop * COLOURS];
            widen(self.level, bytes, &mut pixels[start..start + self.crop * COLOURS]);
        }
    }
}
