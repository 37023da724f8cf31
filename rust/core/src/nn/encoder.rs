//! The image encoder of one camera: cropped uint8 pixels to a feature row.

use serde::Deserialize;

use super::activation_map::{ActivationMap, Window};
use super::conv::{Conv, ConvWeights, MaxPool};
use super::kernels::{Buffer, Level, Nonlinearity, Residual, Storage, padded, spatial_softmax};
use super::linear::Linear;
use super::stem::{COLOURS, Stem, StemWorkspace};
use super::winograd::WinogradWorkspace;
use crate::error::Result;
use crate::model_file::{ModelFile, fault};

/// The encoder's part of a planner's configuration.
#[derive(Debug, Clone, Deserialize)]
pub struct EncoderConfig {
    /// Which trunk.
    #[serde(rename = "type")]
    pub trunk: Trunk,
    /// Channels of each convolution of the small trunk.
    #[serde(default)]
    pub channels: Vec<usize>,
    /// How the last activation map becomes a row of numbers.
    pub pool: Pool,
    /// Keypoints of the spatial softmax.
    #[serde(default)]
    pub keypoints: usize,
    /// Temperature of the spatial softmax.
    #[serde(default = "one")]
    pub temperature: f32,
    /// Length of the feature row.
    pub feature: usize,
    /// Whether a ReLU follows the last layer.
    #[serde(default)]
    pub feature_relu: bool,
}

fn one() -> f32 {
    1.0
}

/// Convolution trunks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Trunk {
    /// 3 x 3 convolutions of stride 2.
    Small,
    /// torchvision's ResNet-18 without pooling and classifier.
    Resnet18,
}

/// What follows the trunk.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Pool {
    /// Expected position of each keypoint's activation.
    SpatialSoftmax,
    /// The whole activation map.
    Flatten,
}

/// Three buffers suffice for every trunk: a block's input, its middle and its shortcut.
const SLOTS: usize = 3;

/// Memory of an encoder, reused between calls.
#[derive(Debug, Default)]
pub struct EncoderWorkspace {
    stem: StemWorkspace,
    early: [Buffer; SLOTS],
    late: [Buffer; SLOTS],
    positions: Buffer,
    winograd: WinogradWorkspace,
}

#[derive(Debug)]
enum Step {
    Conv { conv: Box<Conv>, from: usize, to: usize, residual: Residual },
    MaxPool { pool: MaxPool, from: usize, to: usize },
}

/// Encoder of one camera.
#[derive(Debug)]
pub struct Encoder {
    level: Level,
    stem: Stem,
    /// The layers with large maps. Images pass through them one by one, so that the maps stay in the cache.
    early: Vec<Step>,
    /// The layers with many weights. The whole batch passes through them together.
    late: Vec<Step>,
    /// The slot and shape of the map between the two.
    between: (usize, ActivationMap),
    last: usize,
    map: ActivationMap,
    keypoints: Option<Keypoints>,
    fully_connected: Linear,
}

#[derive(Debug)]
struct Keypoints {
    conv: Conv,
    count: usize,
    temperature: f32,
    positions: Vec<[f32; 2]>,
}

/// Takes the tensors of one camera out of a model file and plans the steps.
struct Builder<'a> {
    level: Level,
    storage: Storage,
    file: &'a mut ModelFile,
    prefix: String,
}

impl Builder<'_> {
    fn conv(
        &mut self,
        name: &str,
        channels: (usize, usize),
        window: Window,
        input: ActivationMap,
        border: usize,
        nonlinearity: Nonlinearity,
    ) -> Result<Conv> {
        let (weight, bias) = self.take(name, channels, window)?;
        let weights = ConvWeights { weight: &weight, bias: &bias, inputs: channels.0, scale: 1.0 };
        Conv::new(self.level, self.storage, weights, window, input, border, nonlinearity)
    }

    /// The convolution that reads the bytes, which training divides by 255.
    fn stem(&mut self, name: &str, outputs: usize, window: Window, crop: usize, border: usize) -> Result<Stem> {
        let (weight, bias) = self.take(name, (COLOURS, outputs), window)?;
        let weights = ConvWeights { weight: &weight, bias: &bias, inputs: COLOURS, scale: 1.0 / 255.0 };
        Stem::new(self.level, self.storage, weights, window, crop, border)
    }

    fn take(&mut self, name: &str, (inputs, outputs): (usize, usize), window: Window) -> Result<(Vec<f32>, Vec<f32>)> {
        let shape = [outputs, inputs, window.kernel, window.kernel];
        let weight = self.file.take(&format!("{}.{name}.weight", self.prefix), &shape)?;
        let bias = self.file.take(&format!("{}.{name}.bias", self.prefix), &[outputs])?;
        Ok((weight, bias))
    }
}

impl Encoder {
    /// Takes the tensors `encoder.<camera>.*` for images cropped to `crop` x `crop`.
    ///
    /// # Errors
    /// [`crate::error::Error::ModelFile`] if the configuration is impossible or tensors do not fit it.
    pub fn load(
        level: Level,
        storage: Storage,
        config: &EncoderConfig,
        camera: &str,
        crop: usize,
        file: &mut ModelFile,
    ) -> Result<Self> {
        let mut build = Builder { level, storage, file, prefix: format!("encoder.{camera}") };
        let TrunkPlan { stem, early, between, late, last: (last, map) } = match config.trunk {
            Trunk::Small => small(&mut build, config, crop)?,
            Trunk::Resnet18 => resnet18(&mut build, crop)?,
        };
        let channels = match config.trunk {
            Trunk::Small => config.channels[config.channels.len() - 1],
            Trunk::Resnet18 => 512,
        };
        let keypoints = match config.pool {
            Pool::Flatten => None,
            Pool::SpatialSoftmax => Some(keypoints(&mut build, config, channels, map)?),
        };
        let (area, stored) = (map.height * map.width, map.channels);
        let columns = keypoints.as_ref().map_or(area * channels, |keypoints| 2 * keypoints.count);
        let weight = build.file.take(&format!("{}.fc.weight", build.prefix), &[config.feature, columns])?;
        let bias = build.file.take(&format!("{}.fc.bias", build.prefix), &[config.feature])?;
        let nonlinearity = if config.feature_relu { Nonlinearity::Relu } else { Nonlinearity::None };
        let fully_connected = if keypoints.is_some() {
            let at = |out: usize, k: usize| if k < columns { weight[out * columns + k] } else { 0.0 };
            Linear::new(level, storage, config.feature, padded(columns), at, &bias, nonlinearity)
        } else {
            // The file's order is (channel, row, column), ours (row, column, channel).
            let at = |out: usize, k: usize| match k % stored {
                channel if channel < channels => weight[out * columns + channel * area + k / stored],
                _ => 0.0,
            };
            Linear::over_map(level, storage, config.feature, &map, at, &bias, nonlinearity)
        };
        Ok(Self { level, stem, early, late, between, last, map, keypoints, fully_connected })
    }

    /// Length of a feature row, padding included.
    #[must_use]
    pub fn feature_stride(&self) -> usize {
        self.fully_connected.outputs()
    }

    /// Encodes a batch of (size, size, 3) images, cropped at the centre, to rows of `output`.
    pub fn run(
        &self,
        batch: usize,
        images: &[u8],
        size: usize,
        workspace: &mut EncoderWorkspace,
        output: &mut [f32],
        output_stride: usize,
    ) {
        let EncoderWorkspace { stem, early, late, winograd, .. } = workspace;
        let (between, map) = self.between;
        let map = map.len();
        late[between].grow(batch * map);
        early[0].grow(self.stem.output.len());
        for (index, image) in images.chunks_exact(size * size * COLOURS).take(batch).enumerate() {
            self.stem.run(image, size, &mut early[0], stem, winograd);
            run_steps(&self.early, 1, early, winograd);
            late[between][index * map..][..map].copy_from_slice(&early[between][..map]);
        }
        run_steps(&self.late, batch, late, winograd);
        let map = &workspace.late[self.last];
        let Some(keypoints) = &self.keypoints else {
            self.fully_connected.run(batch, map, self.map.len(), output, output_stride);
            return;
        };
        let logits_len = keypoints.conv.output.len();
        let row = padded(2 * keypoints.count);
        let spare = (self.last + 1) % SLOTS;
        workspace.late[spare].grow(batch * logits_len);
        workspace.positions.grow(batch * row);
        let Ok([map, logits]) = workspace.late.get_disjoint_mut([self.last, spare]) else {
            unreachable!("two different slots")
        };
        keypoints.conv.run(batch, map, logits, Residual::None, &mut workspace.winograd);
        let rows = logits.chunks_exact(logits_len).zip(workspace.positions.chunks_exact_mut(row));
        for (logits, positions) in rows.take(batch) {
            positions[2 * keypoints.count..].fill(0.0);
            spatial_softmax(
                self.level,
                logits,
                &keypoints.positions,
                keypoints.temperature,
                keypoints.count,
                positions,
            );
        }
        self.fully_connected.run(batch, &workspace.positions, row, output, output_stride);
    }
}

/// Runs the layers over a batch in the slots, which hold the input.
fn run_steps(steps: &[Step], batch: usize, slots: &mut [Buffer; SLOTS], winograd: &mut WinogradWorkspace) {
    for step in steps {
        let (from, to, len) = match step {
            Step::Conv { conv, from, to, .. } => (*from, *to, conv.output.len()),
            Step::MaxPool { pool, from, to } => (*from, *to, pool.output.len()),
        };
        slots[to].grow(batch * len);
        let Ok([from, to]) = slots.get_disjoint_mut([from, to]) else {
            unreachable!("a step reads and writes different slots")
        };
        match step {
            Step::Conv { conv, residual, .. } => conv.run(batch, from, to, *residual, winograd),
            Step::MaxPool { pool, .. } => pool.run(batch, from, to),
        }
    }
}

/// The layers of a trunk, and the slots and shapes in which the early and the late ones leave their output.
struct TrunkPlan {
    stem: Stem,
    early: Vec<Step>,
    between: (usize, ActivationMap),
    late: Vec<Step>,
    last: (usize, ActivationMap),
}

fn small(build: &mut Builder<'_>, config: &EncoderConfig, crop: usize) -> Result<TrunkPlan> {
    if config.channels.is_empty() {
        return Err(fault("encoder: channels is empty".to_owned()));
    }
    let window = Window { kernel: 3, stride: 2, padding: 1 };
    let border = |index: usize| usize::from(index + 1 < config.channels.len());
    let stem = build.stem("conv.0", config.channels[0], window, crop, border(0))?;
    let mut map = stem.output;
    let mut steps = Vec::new();
    for (index, pair) in config.channels.windows(2).enumerate() {
        let conv = build.conv(
            &format!("conv.{}", index + 1),
            (pair[0], pair[1]),
            window,
            map,
            border(index + 1),
            Nonlinearity::Relu,
        )?;
        map = conv.output;
        steps.push(Step::Conv { conv: Box::new(conv), from: index % 2, to: (index + 1) % 2, residual: Residual::None });
    }
    let last = (steps.len() % 2, map);
    Ok(TrunkPlan { stem, early: steps, between: last, late: Vec::new(), last })
}

/// The last layer of ResNet-18 whose activation maps are larger than its weights.
const LAST_EARLY_LAYER: usize = 2;

fn resnet18(build: &mut Builder<'_>, crop: usize) -> Result<TrunkPlan> {
    let same = Window { kernel: 3, stride: 1, padding: 1 };
    let stem = build.stem("stem", 64, Window { kernel: 7, stride: 2, padding: 3 }, crop, 1)?;
    let pool = MaxPool::new(build.level, stem.output, 1)?;
    let mut map = pool.output;
    let mut steps = vec![Step::MaxPool { pool, from: 0, to: 1 }];
    // The slot that holds the block's input.
    let mut here = 1;
    let mut inputs = 64;
    let mut early = Vec::new();
    let mut between = (here, map);
    for (layer, outputs) in [(1, 64), (2, 128), (3, 256), (4, 512)] {
        for block in 0..2 {
            let name = format!("layer{layer}.{block}");
            let (middle, other) = ((here + 1) % SLOTS, (here + 2) % SLOTS);
            let shrinks = block == 0 && layer > 1;
            let stride = if shrinks { 2 } else { 1 };
            let conv1 = build.conv(
                &format!("{name}.conv1"),
                (inputs, outputs),
                Window { stride, ..same },
                map,
                1,
                Nonlinearity::Relu,
            )?;
            let conv2 =
                build.conv(&format!("{name}.conv2"), (outputs, outputs), same, conv1.output, 1, Nonlinearity::Relu)?;
            let shortcut = if shrinks {
                let window = Window { kernel: 1, stride: 2, padding: 0 };
                let conv =
                    build.conv(&format!("{name}.downsample"), (inputs, outputs), window, map, 1, Nonlinearity::None)?;
                Some(Step::Conv { conv: Box::new(conv), from: here, to: other, residual: Residual::None })
            } else {
                None
            };
            map = conv2.output;
            steps.push(Step::Conv { conv: Box::new(conv1), from: here, to: middle, residual: Residual::None });
            if let Some(shortcut) = shortcut {
                steps.push(shortcut);
                here = other;
            }
            steps.push(Step::Conv { conv: Box::new(conv2), from: middle, to: here, residual: Residual::FromOutput });
            inputs = outputs;
        }
        if layer == LAST_EARLY_LAYER {
            (early, between) = (std::mem::take(&mut steps), (here, map));
        }
    }
    Ok(TrunkPlan { stem, early, between, late: steps, last: (here, map) })
}

fn keypoints(
    build: &mut Builder<'_>,
    config: &EncoderConfig,
    channels: usize,
    map: ActivationMap,
) -> Result<Keypoints> {
    if config.keypoints == 0 || !(config.temperature.is_finite() && config.temperature > 0.0) {
        return Err(fault(format!("encoder: {} keypoints at temperature {}", config.keypoints, config.temperature)));
    }
    let window = Window { kernel: 1, stride: 1, padding: 0 };
    let conv = build.conv("keypoints", (channels, config.keypoints), window, map, 0, Nonlinearity::None)?;
    let along = |index: usize, length: usize| {
        if length == 1 { -1.0 } else { (2.0 * index as f64 / (length as f64 - 1.0) - 1.0) as f32 }
    };
    let pixels = (0..map.height).flat_map(|y| (0..map.width).map(move |x| (y, x)));
    let positions = pixels.map(|(y, x)| [along(x, map.width), along(y, map.height)]).collect();
    Ok(Keypoints { conv, count: config.keypoints, temperature: config.temperature, positions })
}
