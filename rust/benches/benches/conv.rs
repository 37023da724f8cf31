//! Convolutions of the encoders' shapes, for 76-pixel crops.
#![allow(missing_docs, reason = "criterion's macros write undocumented functions")]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use ocplanner_benches::{noise, on_every_level};
use ocplanner_core::nn::activation_map::{ActivationMap, Window};
use ocplanner_core::nn::conv::{Conv, ConvWeights};
use ocplanner_core::nn::kernels::{Buffer, Nonlinearity, Residual, Storage, padded};
use ocplanner_core::nn::winograd::WinogradWorkspace;

/// Name, side of the input, channels in and out, kernel, stride.
const SHAPES: [(&str, usize, usize, usize, usize, usize); 11] = [
    ("resnet18 stem", 76, 3, 64, 7, 2),
    ("resnet18 layer1", 19, 64, 64, 3, 1),
    ("resnet18 layer2 first", 19, 64, 128, 3, 2),
    ("resnet18 layer2", 10, 128, 128, 3, 1),
    ("resnet18 layer3", 5, 256, 256, 3, 1),
    ("resnet18 layer4 first", 5, 256, 512, 3, 2),
    ("resnet18 layer4", 3, 512, 512, 3, 1),
    ("resnet18 keypoints", 3, 512, 32, 1, 1),
    ("cpu conv 1", 38, 8, 16, 3, 2),
    ("cpu conv 2", 19, 16, 32, 3, 2),
    ("cpu conv 3", 10, 32, 64, 3, 2),
];

fn convolutions(criterion: &mut Criterion) {
    for (name, side, inputs, outputs, kernel, stride) in SHAPES {
        let window = Window { kernel, stride, padding: kernel / 2 };
        let channels = if inputs < 16 { inputs } else { padded(inputs) };
        let map = ActivationMap::new(side, side, channels, kernel / 2).expect("a possible shape");
        let (weight, bias) = (noise(outputs * inputs * kernel * kernel), noise(outputs));
        let weights = ConvWeights { weight: &weight, bias: &bias, inputs, scale: 1.0 };
        on_every_level(criterion, name, |group, level| {
            for (label, storage, batch) in
                [("batch 1", Storage::F32, 1), ("batch 1 bf16", Storage::Bf16, 1), ("batch 16", Storage::F32, 16)]
            {
                let conv =
                    Conv::new(level, storage, weights, window, map, 1, Nonlinearity::Relu).expect("a possible shape");
                let input = noise(batch * map.len());
                let mut output = Buffer::zeros(batch * conv.output.len());
                let products = batch * conv.output.height * conv.output.width * weight.len();
                group.throughput(Throughput::Elements(products as u64));
                let mut workspace = WinogradWorkspace::default();
                group.bench_function(label, |bench| {
                    bench.iter(|| conv.run(batch, &input, &mut output, Residual::None, &mut workspace));
                });
            }
        });
    }
}

criterion_group!(benches, convolutions);
criterion_main!(benches);
