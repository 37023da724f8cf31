//! Taking the layers after the encoder out of a planner file.

use super::{Outputs, PlannerConfig};
use crate::error::Result;
use crate::nn::kernels::{Level, Storage, padded};
use crate::nn::linear::Linear;
use crate::nn::lstm::{Decoder, DecoderWeights};
use crate::weights::WeightFile;

/// The predictor's weights are f32 whatever the storage: rounding them would move the latent most for its saving.
pub(super) fn load_predictor(
    level: Level,
    config: &PlannerConfig,
    feature_stride: usize,
    file: &mut WeightFile,
) -> Result<Vec<Linear>> {
    let logits = if config.modes > 1 { config.modes } else { 0 };
    let last = 2 * config.modes * config.latent + logits;
    let feature = config.encoder.feature;
    let mut layers = Vec::new();
    let mut inputs = feature * config.cameras.len();
    for (index, &outputs) in config.predictor.hidden.iter().chain([&last]).enumerate() {
        let weight = file.take(&format!("predictor.{index}.weight"), &[outputs, inputs])?;
        let bias = file.take(&format!("predictor.{index}.bias"), &[outputs])?;
        let relu = index < config.predictor.hidden.len();
        // The first layer reads the features of each camera with their padding.
        let (block, stride) = if index == 0 { (feature, feature_stride) } else { (inputs, padded(inputs)) };
        let row = inputs / block * stride;
        let at = |out: usize, k: usize| match k % stride {
            column if column < block => weight[out * inputs + k / stride * block + column],
            _ => 0.0,
        };
        layers.push(Linear::new(level, Storage::F32, outputs, row, at, &bias, relu));
        inputs = outputs;
    }
    Ok(layers)
}

/// The decoder of trajectories.
pub(super) fn load_decoder(
    level: Level,
    storage: Storage,
    config: &PlannerConfig,
    file: &mut WeightFile,
) -> Result<Decoder> {
    let (latent, hidden) = (config.latent, config.decoder.hidden);
    let outputs = match config.outputs {
        Outputs::Pose => 9,
        Outputs::Position => 3,
    };
    let start =
        (file.take("decoder.init.weight", &[2 * hidden, latent])?, file.take("decoder.init.bias", &[2 * hidden])?);
    let from_latent = file.take("decoder.lstm.weight_ih", &[4 * hidden, latent])?;
    let recurrent = file.take("decoder.lstm.weight_hh", &[4 * hidden, hidden])?;
    let bias = file.take("decoder.lstm.bias", &[4 * hidden])?;
    let head = (file.take("decoder.head.weight", &[outputs, hidden])?, file.take("decoder.head.bias", &[outputs])?);
    let weights = DecoderWeights {
        start: (&start.0, &start.1),
        from_latent: &from_latent,
        recurrent: &recurrent,
        bias: &bias,
        head: (&head.0, &head.1),
        latent,
        hidden,
    };
    Ok(Decoder::new(level, storage, &weights))
}
