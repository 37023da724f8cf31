//! Linear layers of the predictors and encoders.
#![allow(missing_docs, reason = "criterion's macros write undocumented functions")]

use criterion::{Criterion, Throughput, criterion_group, criterion_main};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use ocplanner_benches::{noise, on_every_level};
use ocplanner_core::nn::kernels::{Buffer, Nonlinearity, Storage, padded};
use ocplanner_core::nn::linear::Linear;

/// Name, inputs, outputs.
const SHAPES: [(&str, usize, usize); 4] = [
    ("cpu predictor 256 x 256", 256, 256),
    ("robomimic predictor 1024 x 1024", 1024, 1024),
    ("cpu encoder's last 3200 x 64", 3200, 64),
    ("head 256 x 9", 256, 9),
];

fn linears(criterion: &mut Criterion) {
    for (name, inputs, outputs) in SHAPES {
        let (weight, bias) = (noise(outputs * inputs), noise(outputs));
        on_every_level(criterion, name, |group, level| {
            for (label, storage, rows) in
                [("1 row", Storage::F32, 1), ("1 row bf16", Storage::Bf16, 1), ("64 rows", Storage::F32, 64)]
            {
                let at = |out: usize, k: usize| if k < inputs { weight[out * inputs + k] } else { 0.0 };
                let linear = Linear::new(level, storage, outputs, padded(inputs), at, &bias, Nonlinearity::Relu);
                let input = noise(rows * padded(inputs));
                let mut output = Buffer::zeros(rows * linear.outputs());
                group.throughput(Throughput::Elements((rows * inputs * outputs) as u64));
                group.bench_function(label, |bench| {
                    bench.iter(|| linear.run(rows, &input, padded(inputs), &mut output, linear.outputs()));
                });
            }
        });
    }
}

/// The library that our own kernel must beat: the same products by faer, on one thread, without bias and rectifier.
fn faer_products(criterion: &mut Criterion) {
    let mut group = criterion.benchmark_group("faer");
    for (name, inputs, outputs) in SHAPES {
        let weight = Mat::<f32>::from_fn(inputs, outputs, |i, j| ((i * 31 + j * 17) % 97) as f32 / 97.0);
        for rows in [1, 64] {
            let input = Mat::<f32>::from_fn(rows, inputs, |i, j| ((i * 13 + j * 29) % 89) as f32 / 89.0);
            let mut output = Mat::<f32>::zeros(rows, outputs);
            group.throughput(Throughput::Elements((rows * inputs * outputs) as u64));
            group.bench_function(format!("{name}, {rows} rows"), |bench| {
                bench.iter(|| matmul(&mut output, Accum::Replace, &input, &weight, 1.0, Par::Seq));
            });
        }
    }
    group.finish();
}

criterion_group!(benches, linears, faer_products);
criterion_main!(benches);
