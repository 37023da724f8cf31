//! Loading the layers after the encoder from a planner file.

use super::{Outputs, PlannerConfig};
use crate::error::Result;
use crate::model_file::ModelFile;
use crate::nn::kernels::{Level, Nonlinearity, Storage, padded};
use crate::nn::linear::Linear;
use crate::nn::lstm::{Decoder, DecoderWeights};

/// The predictor. Its weights stay f32 under either storage, because rounding them would move the latent most and save
/// little.
pub(super) fn load_predictor(
    level: Level,
    config: &PlannerConfig,
    feature_stride: usize,
    file: &mut ModelFile,
) -> Result<Vec<Linear>> {
    let logits = if config.modes > 1 { config.modes } else { 0 };
    let last = 2 * config.modes * config.latent + logits;
    let feature = config.encoder.feature;
    let mut layers = Vec::new();
    let mut inputs = feature * config.cameras.len();
    for (index, &outputs) in config.predictor.hidden.iter().chain([&last]).enumerate() {
        let weight = file.take(&format!("predictor.{index}.weight"), &[outputs, inputs])?;
        let bias = file.take(&format!("predictor.{index}.bias"), &[outputs])?;
        let hidden = index < config.predictor.hidden.len();
        let nonlinearity = if hidden { Nonlinearity::Relu } else { Nonlinearity::None };
        // The first layer reads the features of each camera with their padding.
        let (block, stride) = if index == 0 { (feature, feature_stride) } else { (inputs, padded(inputs)) };
        let row = inputs / block * stride;
        let at = |out: usize, k: usize| match k % stride {
            column if column < block => weight[out * inputs + k / stride * block + column],
            _ => 0.0,
        };
        layers.push(Linear::new(level, Storage::F32, outputs, row, at, &bias, nonlinearity));
        inputs = outputs;
    }
    Ok(layers)
}

/// The trajectory decoder.
pub(super) fn load_decoder(
    level: Level,
    storage: Storage,
    config: &PlannerConfig,
    file: &mut ModelFile,
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
