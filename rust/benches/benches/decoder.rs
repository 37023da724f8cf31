//! The LSTM decoder, whole plans and a single step.
#![allow(missing_docs, reason = "criterion's macros write undocumented functions")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use ocplanner_benches::{noise, on_every_level};
use ocplanner_core::nn::kernels::{Storage, padded};
use ocplanner_core::nn::lstm::{Decoder, DecoderWeights, DecoderWorkspace};

const LATENT: usize = 32;
const OUTPUTS: usize = 9;

fn decoders(criterion: &mut Criterion) {
    for hidden in [128, 256, 400] {
        let scaled = |len: usize| -> Vec<f32> { noise(len).iter().map(|x| x / (hidden as f32).sqrt()).collect() };
        let (start, from_latent) = (scaled(2 * hidden * LATENT), scaled(4 * hidden * LATENT));
        let (recurrent, head) = (scaled(4 * hidden * hidden), scaled(OUTPUTS * hidden));
        let (start_bias, bias, head_bias) = (scaled(2 * hidden), scaled(4 * hidden), scaled(OUTPUTS));
        let weights = DecoderWeights {
            start: (&start, &start_bias),
            from_latent: &from_latent,
            recurrent: &recurrent,
            bias: &bias,
            head: (&head, &head_bias),
            latent: LATENT,
            hidden,
        };
        on_every_level(criterion, &format!("decoder {hidden}"), |group, level| {
            let decoder = Decoder::new(level, Storage::F32, &weights);
            let mut workspace = DecoderWorkspace::default();
            for (label, rows, steps) in [
                ("1 row, 1 step", 1, 1),
                ("1 row, 20 steps", 1, 20),
                ("1 row, 50 steps", 1, 50),
                ("16 rows, 20 steps", 16, 20),
            ] {
                let latents = noise(rows * padded(LATENT));
                group.bench_function(label, |bench| {
                    bench.iter(|| black_box(decoder.run(rows, steps, &latents, padded(LATENT), &mut workspace)[0]));
                });
            }
        });
    }
}

criterion_group!(benches, decoders);
criterion_main!(benches);
