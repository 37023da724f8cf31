//! A planner's forward pass: from uint8 images to the object's future poses in metres.

mod config;
mod layers;
mod modes;

use std::sync::{Mutex, PoisonError};

pub use config::{DecoderConfig, Normaliser, Outputs, PlannerConfig, PredictorConfig};
use layers::{load_decoder, load_predictor};
use modes::{best_mode, probability};

use crate::error::{Error, Result};
use crate::model_file::ModelFile;
use crate::nn::encoder::{Encoder, EncoderWorkspace};
use crate::nn::kernels::{Buffer, Level, Storage, padded};
use crate::nn::linear::Linear;
use crate::nn::lstm::{Decoder, DecoderWorkspace};
use crate::pose::rotation_from_6d;

/// Images that go through the network together.
const CHUNK: usize = 64;

/// The most threads that one call starts, whatever it is asked for.
const MOST_THREADS: usize = 256;

/// Which plans to decode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Modes {
    /// The most probable one for each image.
    Best,
    /// All, in the network's order.
    All,
}

/// Plans of a batch.
#[derive(Debug, Clone, PartialEq)]
pub struct Plans {
    /// (batch, modes, steps, 3) positions, metres.
    pub position: Vec<f64>,
    /// (batch, modes, steps, 3, 3) rotations, row-major; empty if the planner plans positions only.
    pub rotation: Vec<f64>,
    /// (batch, modes) probabilities.
    pub probability: Vec<f64>,
}

/// A loaded planner. Threads may share it and plan at the same time.
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

/// The part of the plans that one thread writes.
struct Part<'a> {
    position: &'a mut [f64],
    rotation: &'a mut [f64],
    probability: &'a mut [f64],
}

impl Planner {
    /// Loads a planner from the bytes of its file.
    ///
    /// # Errors
    /// [`Error::ModelFile`] if the file is damaged or is not a planner.
    pub fn load(bytes: &[u8], storage: Storage, level: Level) -> Result<Self> {
        let mut file = ModelFile::parse(bytes, "planner")?;
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

    /// The configuration, as far as the engine uses it.
    #[must_use]
    pub fn config(&self) -> &PlannerConfig {
        &self.config
    }

    /// The whole configuration as JSON text.
    #[must_use]
    pub fn config_json(&self) -> &str {
        &self.config_json
    }

    /// Numbers in one image.
    #[must_use]
    pub fn image_len(&self) -> usize {
        self.config.image_size * self.config.image_size * 3
    }

    /// Plans for a batch, decoding the first `steps` of each plan only.
    ///
    /// `images` has one slice per camera, in the configuration's order, of (batch, `image_size`, `image_size`, 3) uint8
    /// upright RGB. The batch is dealt out to the threads; the plans depend on their number only by rounding, because
    /// convolutions take another form for another size of batch.
    ///
    /// # Errors
    /// [`Error::Shape`] if a slice has another length. [`Error::Value`] if `steps` is zero or beyond the planner's horizon,
    /// or if the network's numbers overflow or give no rotation.
    pub fn plan(&self, images: &[&[u8]], batch: usize, modes: Modes, steps: usize, threads: usize) -> Result<Plans> {
        self.check_images(images, batch)?;
        if !(1..=self.config.horizon).contains(&steps) {
            let found = format!("{steps} with a horizon of {}", self.config.horizon);
            return Err(Error::Value { what: "steps of a plan", found, expected: "between 1 and the horizon" });
        }
        let per_image = match modes {
            Modes::Best => 1,
            Modes::All => self.config.modes,
        };
        let position = 3 * per_image * steps;
        let rotation = match self.config.outputs {
            Outputs::Pose => 3 * position,
            Outputs::Position => 0,
        };
        let mut plans = Plans {
            position: vec![0.0; batch * position],
            rotation: vec![0.0; batch * rotation],
            probability: vec![0.0; batch * per_image],
        };
        let mut whole =
            Part { position: &mut plans.position, rotation: &mut plans.rotation, probability: &mut plans.probability };
        let size = self.image_len();
        self.deal(batch, threads, |work| {
            let (position, rest) = std::mem::take(&mut whole.position).split_at_mut(work.len() * position);
            whole.position = rest;
            let (rotation, rest) = std::mem::take(&mut whole.rotation).split_at_mut(work.len() * rotation);
            whole.rotation = rest;
            let (probability, rest) = std::mem::take(&mut whole.probability).split_at_mut(work.len() * per_image);
            whole.probability = rest;
            let images: Vec<&[u8]> = images.iter().map(|all| &all[work.start * size..work.end * size]).collect();
            let mut part = Part { position, rotation, probability };
            move |workspace: &mut Workspace| self.plan_part(&images, work.len(), modes, steps, workspace, &mut part)
        })?;
        Ok(plans)
    }

    /// Latent means of each image's most probable mode, (batch, latent).
    ///
    /// # Errors
    /// [`Error::Shape`] if a slice of images has another length.
    pub fn encode(&self, images: &[&[u8]], batch: usize, threads: usize) -> Result<Vec<f32>> {
        self.check_images(images, batch)?;
        let latent = self.config.latent;
        let mut latents = vec![0.0; batch * latent];
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
        })?;
        Ok(latents)
    }

    /// Checks that there is one slice of `batch` images per camera.
    ///
    /// # Errors
    /// [`Error::Shape`] if there is not.
    fn check_images(&self, images: &[&[u8]], batch: usize) -> Result<()> {
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

    /// Cuts a batch into one range per thread, makes each range's work in order, and runs each with its own workspace.
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
        // A workspace holds no state between calls, so a panic elsewhere cannot have corrupted the list.
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Runs the encoders and the predictor on images `start..start + count`.
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

    /// The predictor's output rows and the distance between them.
    fn prediction<'a>(&self, workspace: &'a Workspace) -> (&'a [f32], usize) {
        let last = &self.predictor[self.predictor.len() - 1];
        (&workspace.rows[self.predictor.len() % 2], last.outputs())
    }

    fn plan_part(
        &self,
        images: &[&[u8]],
        batch: usize,
        modes: Modes,
        steps: usize,
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
            let decoded = self.decoder.run(chosen.len(), steps, &latents, latent_stride, &mut workspace.decoder);
            let first_step = start * per_image * steps;
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
                        expected: "a finite number; the weights overflow on this image",
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
