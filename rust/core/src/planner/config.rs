//! The part of a planner's configuration that the engine reads.

use serde::Deserialize;

use crate::error::Result;
use crate::model_file::fault;
use crate::nn::encoder::EncoderConfig;

/// The part of a planner's configuration that the engine reads; the file holds more.
#[derive(Debug, Clone, Deserialize)]
pub struct PlannerConfig {
    /// Steps of a plan.
    pub horizon: usize,
    /// Whether it plans poses or positions only.
    pub outputs: Outputs,
    /// Camera names, in the order of the network's inputs.
    pub cameras: Vec<String>,
    /// Side of the square images, pixels.
    pub image_size: usize,
    /// Side of the centre crop that the network sees.
    pub crop: usize,
    /// Statistics that positions were normalised by.
    pub normaliser: Normaliser,
    /// Length of the latent.
    pub latent: usize,
    /// Plans that the predictor proposes.
    #[serde(default = "one")]
    pub modes: usize,
    /// The image encoder.
    pub encoder: EncoderConfig,
    /// The latent predictor.
    pub predictor: PredictorConfig,
    /// The trajectory decoder.
    pub decoder: DecoderConfig,
}

fn one() -> usize {
    1
}

/// What a plan consists of.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Outputs {
    /// Positions and rotations.
    Pose,
    /// Positions.
    Position,
}

/// Mean and standard deviation of the training positions, metres.
#[derive(Debug, Clone, Copy, Deserialize)]
pub struct Normaliser {
    /// Mean.
    pub mean: [f64; 3],
    /// Standard deviation.
    pub std: [f64; 3],
}

/// Sizes of the predictor.
#[derive(Debug, Clone, Deserialize)]
pub struct PredictorConfig {
    /// Hidden layers.
    pub hidden: Vec<usize>,
}

/// Sizes of the decoder.
#[derive(Debug, Clone, Deserialize)]
pub struct DecoderConfig {
    /// LSTM units.
    pub hidden: usize,
}

impl PlannerConfig {
    /// Checks that the sizes are possible, and small enough not to exhaust the memory.
    pub(super) fn check(&self) -> Result<()> {
        const LARGEST: usize = 1 << 16;
        // A few bytes of a file must not make the engine allocate gigabytes.
        const LARGEST_IMAGE: usize = 1024;
        const LARGEST_DECODING: usize = 1 << 22;
        let sizes = [
            ("horizon", self.horizon),
            ("latent", self.latent),
            ("modes", self.modes),
            ("encoder.feature", self.encoder.feature),
            ("decoder.hidden", self.decoder.hidden),
        ];
        let hidden = self.predictor.hidden.iter().map(|&size| ("predictor.hidden", size));
        let channels = self.encoder.channels.iter().map(|&size| ("encoder.channels", size));
        for (name, size) in sizes.into_iter().chain(hidden).chain(channels) {
            if !(1..=LARGEST).contains(&size) {
                return Err(fault(format!("configuration: {name} is {size}, expected 1 to {LARGEST}")));
            }
        }
        for (name, size) in [("image_size", self.image_size), ("crop", self.crop)] {
            if !(1..=LARGEST_IMAGE).contains(&size) {
                return Err(fault(format!("configuration: {name} is {size}, expected 1 to {LARGEST_IMAGE}")));
            }
        }
        let decoding = [self.horizon, self.modes, self.decoder.hidden].iter().product::<usize>();
        if decoding > LARGEST_DECODING {
            return Err(fault(format!(
                "configuration: horizon x modes x decoder.hidden is {decoding}, expected at most {LARGEST_DECODING}"
            )));
        }
        if self.crop > self.image_size {
            return Err(fault(format!(
                "configuration: crop {} is larger than image_size {}",
                self.crop, self.image_size
            )));
        }
        if self.cameras.is_empty() {
            return Err(fault("configuration: cameras is empty".to_owned()));
        }
        let Normaliser { mean, std } = &self.normaliser;
        if !(mean.iter().all(|x| x.is_finite()) && std.iter().all(|x| x.is_finite() && *x > 0.0)) {
            return Err(fault(format!(
                "configuration: normaliser has mean {mean:?} and std {std:?}, expected finite means and positive std"
            )));
        }
        Ok(())
    }
}
