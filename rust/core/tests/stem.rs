//! The stem against the definition of a convolution, in f64, on every instruction set.

use ocplanner_core::nn::activation_map::Window;
use ocplanner_core::nn::conv::ConvWeights;
use ocplanner_core::nn::kernels::{Buffer, Level, Storage};
use ocplanner_core::nn::stem::{COLOURS, Stem, StemWorkspace};
use ocplanner_core::nn::winograd::WinogradWorkspace;
use proptest::prelude::*;

struct Case {
    size: usize,
    crop: usize,
    outputs: usize,
    window: Window,
    border: usize,
    image: Vec<u8>,
    weight: Vec<f32>,
    bias: Vec<f32>,
}

impl Case {
    fn expected(&self, y: usize, x: usize, output: usize) -> f64 {
        let Window { kernel, stride, padding } = self.window;
        let inset = (self.size - self.crop) / 2;
        let mut sum = f64::from(self.bias[output]);
        for row in 0..kernel {
            for column in 0..kernel {
                let (Some(from), Some(across)) =
                    ((y * stride + row).checked_sub(padding), (x * stride + column).checked_sub(padding))
                else {
                    continue;
                };
                if from >= self.crop || across >= self.crop {
                    continue;
                }
                for colour in 0..COLOURS {
                    let pixel = self.image[((from + inset) * self.size + across + inset) * COLOURS + colour];
                    let weight = self.weight[((output * COLOURS + colour) * kernel + row) * kernel + column];
                    sum += f64::from(pixel) / 255.0 * f64::from(weight);
                }
            }
        }
        sum.max(0.0)
    }

    fn check(&self, level: Level) {
        let weights = ConvWeights { weight: &self.weight, bias: &self.bias, inputs: COLOURS, scale: 1.0 / 255.0 };
        let stem = Stem::new(level, Storage::F32, weights, self.window, self.crop, self.border).unwrap();
        let map = stem.output;
        let mut output = Buffer::zeros(map.len());
        output.fill(f32::NAN);
        let (mut workspace, mut winograd) = (StemWorkspace::default(), WinogradWorkspace::default());
        // Twice: the second time the workspace is not fresh.
        for _ in 0..2 {
            stem.run(&self.image, self.size, &mut output, &mut workspace, &mut winograd);
        }
        for (at, pixel) in output.chunks_exact(map.channels).enumerate() {
            let stored_width = map.width + 2 * map.border;
            let (row, column) = (at / stored_width, at % stored_width);
            let inside = |place: usize, side: usize| (map.border..map.border + side).contains(&place);
            if !inside(row, map.height) || !inside(column, map.width) {
                assert!(pixel.iter().all(|&number| number == 0.0), "border at ({row}, {column}): {pixel:?}");
                continue;
            }
            for (channel, &found) in pixel.iter().enumerate() {
                let (y, x) = (row - map.border, column - map.border);
                let wanted = if channel < self.outputs { self.expected(y, x, channel) } else { 0.0 };
                let error = (f64::from(found) - wanted).abs();
                assert!(error < 1e-5, "{}, ({y}, {x}), channel {channel}: {found}, not {wanted}", level.name());
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn it_is_the_convolution_of_the_crop(
        crop in 2_usize..60,
        around in 0_usize..9,
        outputs in 1_usize..20,
        (kernel, padding) in prop_oneof![Just((3, 1)), Just((7, 3)), Just((2, 0))],
        stride in 1_usize..4,
        border in 0_usize..2,
        seed in any::<u64>(),
    ) {
        let size = crop + around;
        let mut state = seed | 1;
        let mut next = move || {
            state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            state >> 40
        };
        let image = (0..size * size * COLOURS).map(|_| next() as u8).collect();
        let mut numbers = |count: usize| -> Vec<f32> {
            (0..count).map(|_| (next() as f32 / (1_u64 << 23) as f32 - 1.0) / kernel as f32).collect()
        };
        let weight = numbers(outputs * COLOURS * kernel * kernel);
        let bias = numbers(outputs);
        let window = Window { kernel, stride, padding };
        let case = Case { size, crop, outputs, window, border, image, weight, bias };
        for level in Level::available() {
            case.check(level);
        }
    }
}
