//! Shapes: of a stored activation map, and of the window that a convolution or pooling slides over it.

use super::kernels::Im2col;
use crate::error::Result;
use crate::model_file::fault;

/// The most numbers an activation map of one image may hold (256 MiB): far more than any real planner needs, and few
/// enough that a hostile file cannot exhaust the memory and that offsets fit in 31 bits.
const MOST_NUMBERS: usize = 1 << 26;

/// Shape of one image's activation map as stored: NHWC with a border of zeros.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ActivationMap {
    /// Rows without the border.
    pub height: usize,
    /// Columns without the border.
    pub width: usize,
    /// Numbers stored per pixel.
    pub channels: usize,
    /// Width of the border on every side, pixels.
    pub border: usize,
}

impl ActivationMap {
    /// A shape whose offsets can be represented.
    ///
    /// # Errors
    /// [`crate::error::Error::ModelFile`] if the map is empty or too large.
    pub fn new(height: usize, width: usize, channels: usize, border: usize) -> Result<Self> {
        let map = Self { height, width, channels, border };
        let size = (height + 2 * border).checked_mul(width + 2 * border).and_then(|n| n.checked_mul(channels));
        match size {
            Some(1..MOST_NUMBERS) if height > 0 && width > 0 => Ok(map),
            _ => Err(fault(format!("an activation map of {height} x {width} x {channels} is empty or too large"))),
        }
    }

    /// Numbers in a stored row.
    #[must_use]
    pub fn row_stride(&self) -> usize {
        (self.width + 2 * self.border) * self.channels
    }

    /// Numbers in a stored map.
    #[must_use]
    pub fn len(&self) -> usize {
        (self.height + 2 * self.border) * self.row_stride()
    }

    /// Whether the map has no pixels; never true of one made by [`ActivationMap::new`].
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Offset of the first pixel inside the border.
    #[must_use]
    pub fn inside(&self) -> usize {
        self.border * (self.row_stride() + self.channels)
    }

    /// Offset of a pixel, counted from the stored corner: (0, 0) is in the border if there is one.
    fn stored(&self, row: usize, column: usize) -> u32 {
        u32::try_from(row * self.row_stride() + column * self.channels).unwrap_or(u32::MAX)
    }

    /// One window over the whole map without its border: the rows that a fully connected layer reads.
    #[must_use]
    pub fn whole(&self) -> Im2col {
        Im2col {
            input: vec![self.stored(self.border, self.border)],
            output: vec![0],
            runs: self.height,
            run_len: self.width * self.channels,
            run_stride: self.row_stride(),
        }
    }

    /// Writes zeros into the border of one stored map.
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

/// Kernel size, stride and zero padding of a convolution or pooling.
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
    /// [`crate::error::Error::ModelFile`] if the kernel is larger than the padded input.
    pub fn output(&self, length: usize) -> Result<usize> {
        (length + 2 * self.padding)
            .checked_sub(self.kernel)
            .map(|rest| rest / self.stride + 1)
            .ok_or_else(|| fault(format!("an image side of {length} is smaller than the {} kernel", self.kernel)))
    }

    /// The stored corner of each output pixel's window, and the stored offset of the pixel itself, in reading order.
    #[must_use]
    pub fn corners(&self, input: &ActivationMap, output: &ActivationMap) -> Vec<[u32; 2]> {
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
