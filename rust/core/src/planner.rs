//! A planner's forward pass: uint8 images to the object's future poses in metres.

mod config;
mod layers;
mod modes;

use std::sync::{Mutex, PoisonError};

pub use config::{DecoderConfig, Normaliser, Outputs, PlannerConfig, PredictorConfig};
use layers::{load_decoder, load_predictor};
use modes::{best_mode, probability};

use crate::error::{Error, Result};
use crate::nn::encoder::{Encoder, EncoderWorkspace};
use crate::nn::kernels::{Buffer, Level, Storage, padded};
use crate::nn::linear::Linear;
use crate::nn::lstm::{Decoder, DecoderWorkspace};
use crate::pose::rotation_from_6d;
use crate::weights::WeightFile;

/// Images that go through the network together.
const CHUNK: usize = 64;

/// Threads that one call starts at most, whatever it is asked for.
const MOST_THREADS: usize = 256;

/// Which plans to decode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Modes {
    /// The most probable one of each image.
    Best,
    /// All, in the network's order.
    All,
}

/// Plans of a batch.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Plans {
    /// (batch, modes, horizon, 3) positions, metres.
    pub position: Vec<f64>,
    /// (batch, modes, horizon, 3, 3) rotations, row-major; empty for a planner of positions.
    pub rotation: Vec<f64>,
    /// (batch, modes) probabilities.
    pub probability: Vec<f64>,
}

/// A loaded planner. Safe to share between threads, which then plan at the same time.
#[derive(Debug)]
pub struct Planner {
    config: PlannerConfig,
    config_json: String,
    encoders: Vec<Encoder>,
    predictor: Vec<Linear>,
    decoder: Decoder,
    idle: Mutex<Vec<Workspace>>,
}

/// Memory of one thread's forward pass.
#[derive(Debug, Default)]
struct Workspace {
    encoder: EncoderWorkspace,
    rows: [Buffer; 2],
    latents: Buffer,
    chosen: Vec<usize>,
    decoder: DecoderWorkspace,
}

/// Where one thread writes its part of the plans.
struct Part<'a> {
    position: &'a mut [f64],
    rotation: &'a mut [f64],
    probability: &'a mut [f64],
}

impl Planner {
    /// Loads a planner from the bytes of its file.
    ///
    /// # Errors
    /// [`Error::WeightFile`] if the file is damaged, or is not a planner.
    pub fn load(bytes: &[u8], storage: Storage, level: Level) -> Result<Self> {
        let mut file = WeightFile::parse(bytes, "planner")?;
        let config: PlannerConfig = file.config()?;
        config.check()?;
        let config_json = file.config_json();
        let encoders = config
            .cameras
            .iter()
            .map(|camera| Encoder::load(level, storage, &config.encoder, camera, config.crop, &mut file))
            .collect::<Result<Vec<_>>>()?;
        let predictor = load_predictor(level, &config, encoders[0].feature_stride(), &mut file)?;
        let decoder = load_decoder(level, storage, &config, &mut file)?;
        file.finish()?;
        Ok(Self { config, config_json, encoders, predictor, decoder, idle: Mutex::new(Vec::new()) })
    }

    /// The part of the configuration that the engine uses.
    #[must_use]
    pub fn config(&self) -> &PlannerConfig {
        &self.config
    }

    /// The whole configuration as JSON text.
    #[must_use]
    pub fn config_json(&self) -> &str {
        &self.config_json
    }

    /// Numbers in a batch of one camera's images.
    #[must_use]
    pub fn image_len(&self) -> usize {
        self.config.image_size * self.config.image_size * 3
    }

    /// Plans for a batch. `images` has one slice per camera, in the configuration's order, of
    /// (batch, `image_size`, `image_size`, 3) uint8 upright RGB.
    ///
    /// With `threads` > 1 the batch is dealt out; the plans do not depend on it.
    ///
    /// # Errors
    /// [`Error::Shape`] if a slice has another length; [`Error::Value`] if the network's numbers overflow or are no
    /// rotation.
    pub fn plan(&self, images: &[&[u8]], batch: usize, modes: Modes, threads: usize, plans: &mut Plans) -> Result<()> {
        self.plan_steps(images, batch, modes, self.config.horizon, threads, plans)
    }

    /// As [`Planner::plan`], but only the first `horizon` steps of each plan, for that much less decoding.
    ///
    /// # Errors
    /// As [`Planner::plan`]; [`Error::Value`] if `horizon` is zero or beyond the planner's own.
    pub fn plan_steps(
        &self,
        images: &[&[u8]],
        batch: usize,
        modes: Modes,
        horizon: usize,
        threads: usize,
        plans: &mut Plans,
    ) -> Result<()> {
        self.check_images(images, batch)?;
        if !(1..=self.config.horizon).contains(&horizon) {
            let found = format!("{horizon} of {} steps", self.config.horizon);
            return Err(Error::Value {
                what: "steps of a plan",
                found,
                expected: "between 1 and the planner's horizon",
            });
        }
        let per_image = match modes {
            Modes::Best => 1,
            Modes::All => self.config.modes,
        };
        let steps = per_image * horizon;
        let rotation = match self.config.outputs {
            Outputs::Pose => 9 * steps,
            Outputs::Position => 0,
        };
        plans.position.resize(batch * steps * 3, 0.0);
        plans.rotation.resize(batch * rotation, 0.0);
        plans.probability.resize(batch * per_image, 0.0);
        let mut whole =
            Part { position: &mut plans.position, rotation: &mut plans.rotation, probability: &mut plans.probability };
        let size = self.image_len();
        self.deal(batch, threads, |work| {
            let (position, rest) = std::mem::take(&mut whole.position).split_at_mut(work.len() * steps * 3);
            whole.position = rest;
            let (rotation, rest) = std::mem::take(&mut whole.rotation).split_at_mut(work.len() * rotation);
            whole.rotation = rest;
            let (probability, rest) = std::mem::take(&mut whole.probability).split_at_mut(work.len() * per_image);
            whole.probability = rest;
            let images: Vec<&[u8]> = images.iter().map(|all| &all[work.start * size..work.end * size]).collect();
            let mut part = Part { position, rotation, probability };
            move |workspace: &mut Workspace| self.plan_part(&images, work.len(), modes, horizon, workspace, &mut part)
        })
    }

    /// Latent means of the most probable mode of each image, (batch, latent) to `latents`.
    ///
    /// # Errors
    /// As [`Planner::plan`].
    pub fn encode(&self, images: &[&[u8]], batch: usize, threads: usize, latents: &mut Vec<f32>) -> Result<()> {
        self.check_images(images, batch)?;
        let latent = self.config.latent;
        latents.resize(batch * latent, 0.0);
        let mut whole = latents.as_mut_slice();
        let size = self.image_len();
        self.deal(batch, threads, |work| {
            let (part, rest) = std::mem::take(&mut whole).split_at_mut(work.len() * latent);
            whole = rest;
            let images: Vec<&[u8]> = images.iter().map(|all| &all[work.start * size..work.end * size]).collect();
            move |workspace: &mut Workspace| {
                for (index, rows) in part.chunks_mut(CHUNK * latent).enumerate() {
                    let count = rows.len() / latent;
                    let start = index * CHUNK;
                    self.predict(&images, start, count, workspace);
                    let (predicted, stride) = self.prediction(workspace);
                    for (row, to) in rows.chunks_exact_mut(latent).enumerate() {
                        let row = &predicted[row * stride..(row + 1) * stride];
                        let mode = best_mode(&self.config, row);
                        to.copy_from_slice(&row[2 * mode * latent..][..latent]);
                    }
                }
                Ok(())
            }
        })
    }

    /// Whether there is one slice of `batch` images per camera.
    ///
    /// # Errors
    /// [`Error::Shape`] if not.
    pub(crate) fn check_images(&self, images: &[&[u8]], batch: usize) -> Result<()> {
        if images.len() != self.encoders.len() {
            return Err(Error::Shape {
                what: "images",
                found: vec![images.len()],
                expected: format!("one array for each of {:?}", self.config.cameras),
            });
        }
        let wanted = batch.checked_mul(self.image_len());
        for (image, camera) in images.iter().zip(&self.config.cameras) {
            if Some(image.len()) != wanted {
                let size = self.config.image_size;
                return Err(Error::Shape {
                    what: "images",
                    found: vec![image.len()],
                    expected: format!("{batch} x {size} x {size} x 3 numbers for {camera}"),
                });
            }
        }
        Ok(())
    }

    /// Cuts a batch into one range per thread, makes the work of each in order, and runs them with a workspace each.
    fn deal<W>(&self, batch: usize, threads: usize, mut make: impl FnMut(std::ops::Range<usize>) -> W) -> Result<()>
    where
        W: FnOnce(&mut Workspace) -> Result<()> + Send,
    {
        let parts = threads.clamp(1, MOST_THREADS).min(batch.max(1));
        let range = |part: usize| part * batch / parts..(part + 1) * batch / parts;
        let run = |work: W| {
            let mut workspace = self.lock().pop().unwrap_or_default();
            let result = work(&mut workspace);
            self.lock().push(workspace);
            result
        };
        let first = make(range(0));
        if parts == 1 {
            return run(first);
        }
        let others: Vec<W> = (1..parts).map(|part| make(range(part))).collect();
        std::thread::scope(|scope| {
            let handles: Vec<_> = others.into_iter().map(|work| scope.spawn(|| run(work))).collect();
            let mut result = run(first);
            for handle in handles {
                let other = handle.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
                result = result.and(other);
            }
            result
        })
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Vec<Workspace>> {
        // A workspace holds no state between calls, so a panic elsewhere cannot have spoilt the list.
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs encoders and predictor on images `start..start + count`.
    fn predict(&self, images: &[&[u8]], start: usize, count: usize, workspace: &mut Workspace) {
        let size = self.image_len();
        let feature = self.encoders[0].feature_stride();
        let stride = feature * self.encoders.len();
        let Workspace { encoder, rows, .. } = workspace;
        rows[0].grow(count * stride);
        for (index, (camera, images)) in self.encoders.iter().zip(images).enumerate() {
            let images = &images[start * size..(start + count) * size];
            camera.run(count, images, self.config.image_size, encoder, &mut rows[0][index * feature..], stride);
        }
        let mut input_stride = stride;
        for (index, layer) in self.predictor.iter().enumerate() {
            let (first, second) = rows.split_at_mut(1);
            let (from, to) = if index % 2 == 0 { (&first[0], &mut second[0]) } else { (&second[0], &mut first[0]) };
            to.grow(count * layer.outputs());
            layer.run(count, from, input_stride, to, layer.outputs());
            input_stride = layer.outputs();
        }
    }

    /// The predictor's output rows and their distance.
    fn prediction<'a>(&self, workspace: &'a Workspace) -> (&'a [f32], usize) {
        let last = &self.predictor[self.predictor.len() - 1];
        (&workspace.rows[self.predictor.len() % 2], last.outputs())
    }

    fn plan_part(
        &self,
        images: &[&[u8]],
        batch: usize,
        modes: Modes,
        horizon: usize,
        workspace: &mut Workspace,
        part: &mut Part<'_>,
    ) -> Result<()> {
        let config = &self.config;
        let per_image = part.probability.len().checked_div(batch).unwrap_or(1);
        let latent_stride = padded(config.latent);
        for start in (0..batch).step_by(CHUNK) {
            let count = CHUNK.min(batch - start);
            self.predict(images, start, count, workspace);
            let (mut latents, mut chosen) =
                (std::mem::take(&mut workspace.latents), std::mem::take(&mut workspace.chosen));
            latents.grow(count * per_image * latent_stride);
            chosen.clear();
            let (predicted, stride) = self.prediction(workspace);
            for row in 0..count {
                let row = &predicted[row * stride..(row + 1) * stride];
                match modes {
                    Modes::Best => chosen.push(best_mode(config, row)),
                    Modes::All => chosen.extend(0..config.modes),
                }
                let image_modes = &chosen[chosen.len() - per_image..];
                for (slot, &mode) in image_modes.iter().enumerate() {
                    let at = (chosen.len() - per_image + slot) * latent_stride;
                    latents[at..at + config.latent].copy_from_slice(&row[2 * mode * config.latent..][..config.latent]);
                    latents[at + config.latent..at + latent_stride].fill(0.0);
                    part.probability[start * per_image + chosen.len() - per_image + slot] =
                        probability(config, row, mode)?;
                }
            }
            let decoded = self.decoder.run(chosen.len(), horizon, &latents, latent_stride, &mut workspace.decoder);
            let first_step = start * per_image * horizon;
            let result = self.write_steps(decoded, first_step, part);
            (workspace.latents, workspace.chosen) = (latents, chosen);
            result?;
        }
        Ok(())
    }

    /// Turns decoded numbers into metres and rotations.
    fn write_steps(&self, decoded: &[f32], first_step: usize, part: &mut Part<'_>) -> Result<()> {
        let Normaliser { mean, std } = &self.config.normaliser;
        for (index, step) in decoded.chunks_exact(self.decoder.step_stride()).enumerate() {
            let at = first_step + index;
            for axis in 0..3 {
                let metres = f64::from(step[axis]) * std[axis] + mean[axis];
                if !metres.is_finite() {
                    return Err(Error::Value {
                        what: "planned position",
                        found: metres.to_string(),
                        expected: "finite: the weights overflow on this image",
                    });
                }
                part.position[3 * at + axis] = metres;
            }
            if self.config.outputs == Outputs::Pose {
                let rot6d = std::array::from_fn(|i| f64::from(step[3 + i]));
                let rotation = rotation_from_6d(&rot6d)?;
                part.rotation[9 * at..9 * at + 9].copy_from_slice(rotation.as_flattened());
            }
        }
        Ok(())
    }
}
