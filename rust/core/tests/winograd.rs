//! Winograd convolutions against the definition of a convolution, in f64.

use ocplanner_core::nn::activation_map::{ActivationMap, Window};
use ocplanner_core::nn::conv::{Conv, ConvWeights};
use ocplanner_core::nn::kernels::{Epilogue, GROUP, Level, Nonlinearity, Residual, Scheme, Storage};
use ocplanner_core::nn::winograd::{Winograd, WinogradWorkspace, best_scheme};
use proptest::prelude::*;

const SAME: Window = Window { kernel: 3, stride: 1, padding: 1 };

/// Repeatable numbers in [-1, 1].
fn numbers(count: usize, seed: u64) -> Vec<f32> {
    let mut state = seed.wrapping_mul(2).wrapping_add(1);
    let mut next = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / (1u64 << 23) as f32 - 1.0
    };
    (0..count).map(|_| next()).collect()
}

struct Case {
    input: ActivationMap,
    output: ActivationMap,
    weight: Vec<f32>,
    bias: Vec<f32>,
    images: Vec<f32>,
    residual: Vec<f32>,
}

impl Case {
    fn new(height: usize, width: usize, groups: (usize, usize), borders: (usize, usize), batch: usize) -> Self {
        let (inputs, outputs) = (groups.0 * GROUP, groups.1 * GROUP);
        let input = ActivationMap::new(height, width, inputs, borders.0).unwrap();
        let output = ActivationMap::new(height, width, outputs, borders.1).unwrap();
        let mut images = numbers(batch * input.len(), 1);
        for image in images.chunks_exact_mut(input.len()) {
            input.clear_border(image);
        }
        let mut residual = numbers(batch * output.len(), 2);
        for image in residual.chunks_exact_mut(output.len()) {
            output.clear_border(image);
        }
        let weight = numbers(outputs * inputs * 9, 3);
        Self { input, output, weight, bias: numbers(outputs, 4), images, residual }
    }

    /// Output number `channel` of pixel (`row`, `column`), from the definition.
    fn expected(&self, image: usize, row: usize, column: usize, channel: usize, epilogue: Epilogue) -> f64 {
        let from = &self.images[image * self.input.len()..][..self.input.len()];
        let mut sum = f64::from(self.bias[channel]);
        for at in 0..9 {
            let row = row + at / 3 + self.input.border - 1;
            let column = column + at % 3 + self.input.border - 1;
            let pixel = &from[row * self.input.row_stride() + column * self.input.channels..][..self.input.channels];
            for (k, &value) in pixel.iter().enumerate() {
                sum += f64::from(value) * f64::from(self.weight[(channel * self.input.channels + k) * 9 + at]);
            }
        }
        if epilogue.residual == Residual::FromOutput {
            sum += f64::from(self.residual[image * self.output.len() + self.offset(row, column) + channel]);
        }
        if epilogue.nonlinearity == Nonlinearity::Relu { sum.max(0.0) } else { sum }
    }

    fn offset(&self, row: usize, column: usize) -> usize {
        (row + self.output.border) * self.output.row_stride() + (column + self.output.border) * self.output.channels
    }

    /// Largest difference from the definition, and whether the border is untouched.
    fn check(&self, result: &[f32], batch: usize, epilogue: Epilogue) {
        let scale = (9.0 * self.input.channels as f64).sqrt();
        for image in 0..batch {
            for row in 0..self.output.height {
                for column in 0..self.output.width {
                    for channel in (0..self.output.channels).step_by(5) {
                        let wanted = self.expected(image, row, column, channel, epilogue);
                        let found = result[image * self.output.len() + self.offset(row, column) + channel];
                        let error = (f64::from(found) - wanted).abs();
                        assert!(
                            error < 3e-5 * scale,
                            "image {image}, pixel ({row}, {column}), channel {channel}: {found}, not {wanted}"
                        );
                    }
                }
            }
            let mut clean = result[image * self.output.len()..][..self.output.len()].to_vec();
            self.output.clear_border(&mut clean);
            assert_eq!(clean, result[image * self.output.len()..][..self.output.len()], "the border holds zeros");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn every_scheme_convolves(
        height in 1..12_usize,
        width in 1..12_usize,
        groups in (1..4_usize, 1..4_usize),
        borders in (1..3_usize, 0..3_usize),
        batch in 1..4_usize,
        scheme in prop::sample::select(&Scheme::ALL[..]),
        residual in prop::sample::select(&[Residual::None, Residual::FromOutput][..]),
        nonlinearity in prop::sample::select(&[Nonlinearity::None, Nonlinearity::Relu][..]),
    ) {
        let case = Case::new(height, width, groups, borders, batch);
        let kernel = |out: usize, channel: usize| {
            std::array::from_fn(|at| f64::from(case.weight[(out * case.input.channels + channel) * 9 + at]))
        };
        for level in Level::available() {
            let conv = Winograd::new(level, scheme, case.input, case.output, kernel, |out| case.bias[out]);
            let mut result = match residual {
                Residual::FromOutput => case.residual.clone(),
                Residual::None => vec![0.0; case.residual.len()],
            };
            let epilogue = Epilogue { residual, nonlinearity };
            conv.run(batch, &case.images, &mut result, epilogue, &mut WinogradWorkspace::default());
            case.check(&result, batch, epilogue);
        }
    }

    #[test]
    fn a_convolution_is_the_same_whatever_the_batch(side in 1..20_usize, batch in 1..40_usize) {
        let case = Case::new(side, side, (1, 2), (1, 1), batch);
        let weights = ConvWeights { weight: &case.weight, bias: &case.bias, inputs: case.input.channels, scale: 1.0 };
        let conv = Conv::new(Level::detect(), Storage::F32, weights, SAME, case.input, 1, Nonlinearity::Relu).unwrap();
        let mut result = vec![f32::NAN; case.residual.len()];
        conv.run(batch, &case.images, &mut result, Residual::None, &mut WinogradWorkspace::default());
        case.check(&result, batch, Epilogue { residual: Residual::None, nonlinearity: Nonlinearity::Relu });
    }
}

#[test]
fn larger_batches_afford_more_weights() {
    let map = ActivationMap::new(5, 5, 256, 1).unwrap();
    assert_eq!(best_scheme(&map, 1), None);
    assert_eq!(best_scheme(&map, 64), Some(Scheme::Five));
    let large = ActivationMap::new(19, 19, 64, 1).unwrap();
    assert_eq!(best_scheme(&large, 1), Some(Scheme::Four));
}
