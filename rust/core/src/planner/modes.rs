//! Reading modes and their probabilities from the predictor's output.

use super::PlannerConfig;
use crate::error::{Error, Result};

/// The modes' logits, which follow the latents of all modes.
fn logits<'a>(config: &PlannerConfig, row: &'a [f32]) -> &'a [f32] {
    &row[2 * config.modes * config.latent..][..if config.modes > 1 { config.modes } else { 0 }]
}

/// The most probable mode.
pub(super) fn best_mode(config: &PlannerConfig, row: &[f32]) -> usize {
    let mut best = 0;
    for (mode, &logit) in logits(config, row).iter().enumerate() {
        if logit > logits(config, row)[best] {
            best = mode;
        }
    }
    best
}

/// Probability of a mode.
pub(super) fn probability(config: &PlannerConfig, row: &[f32], mode: usize) -> Result<f64> {
    if config.modes == 1 {
        return Ok(1.0);
    }
    let all = logits(config, row);
    let belief = 1.0 / all.iter().map(|&other| (f64::from(other) - f64::from(all[mode])).exp()).sum::<f64>();
    if belief.is_nan() {
        return Err(Error::Value {
            what: "probability of a plan",
            found: belief.to_string(),
            expected: "a number; the weights overflow on this image",
        });
    }
    Ok(belief)
}
