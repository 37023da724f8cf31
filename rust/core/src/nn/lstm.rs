//! The trajectory decoder: an LSTM that reads the same latent at every step, then a linear head.

use super::kernels::{Buffer, Level, LstmStep, Nonlinearity, Storage, Stored, lstm_step, padded, tanh_in_place};
use super::linear::Linear;

/// Decodes latents to any number of steps of `outputs` numbers each.
#[derive(Debug)]
pub struct Decoder {
    level: Level,
    start: Linear,
    from_latent: Linear,
    recurrent: Stored,
    head: Linear,
    hidden: usize,
}

/// Weights of a decoder in torch's layouts.
#[derive(Debug, Clone, Copy)]
pub struct DecoderWeights<'a> {
    /// (2 hidden, latent) and (2 hidden,): the first state, h then c.
    pub start: (&'a [f32], &'a [f32]),
    /// (4 hidden, latent), gates in the order i, f, g, o.
    pub from_latent: &'a [f32],
    /// (4 hidden, hidden).
    pub recurrent: &'a [f32],
    /// (4 hidden,).
    pub bias: &'a [f32],
    /// (outputs, hidden) and (outputs,).
    pub head: (&'a [f32], &'a [f32]),
    /// Latent numbers.
    pub latent: usize,
    /// Units.
    pub hidden: usize,
}

/// Memory of a decoder, reused between calls.
#[derive(Debug, Default)]
pub struct DecoderWorkspace {
    first: Buffer,
    constant: Buffer,
    states: Buffer,
    cells: Buffer,
    outputs: Buffer,
}

impl Decoder {
    /// Packs the weights. The head's stay f32 under either storage.
    #[must_use]
    pub fn new(level: Level, storage: Storage, weights: &DecoderWeights<'_>) -> Self {
        let DecoderWeights { latent, hidden, .. } = *weights;
        let (stored, lanes) = (padded(hidden), level.lanes());
        let place = |column: usize| {
            // Stored order is [unit block][gate][lane].
            let (block, gate, lane) = (column / (4 * lanes), column / lanes % 4, column % lanes);
            (gate, block * lanes + lane)
        };
        let gate_row = |column: usize| {
            let (gate, unit) = place(column);
            (unit < hidden).then_some(gate * hidden + unit)
        };
        let state_row = |column: usize| (column % stored < hidden).then(|| column / stored * hidden + column % stored);
        let at = |matrix: &[f32], row: Option<usize>, column: usize, columns: usize| match row {
            Some(row) if column < columns => matrix[row * columns + column],
            _ => 0.0,
        };
        let start_bias: Vec<f32> =
            (0..2 * stored).map(|i| state_row(i).map_or(0.0, |row| weights.start.1[row])).collect();
        let start = Linear::new(
            level,
            storage,
            2 * stored,
            padded(latent),
            |out, k| at(weights.start.0, state_row(out), k, latent),
            &start_bias,
            Nonlinearity::None,
        );
        let gate_bias: Vec<f32> = (0..4 * stored).map(|i| gate_row(i).map_or(0.0, |row| weights.bias[row])).collect();
        let from_latent = Linear::new(
            level,
            storage,
            4 * stored,
            padded(latent),
            |out, k| at(weights.from_latent, gate_row(out), k, latent),
            &gate_bias,
            Nonlinearity::None,
        );
        let mut recurrent = Buffer::zeros(4 * stored * stored);
        for (index, slot) in recurrent.iter_mut().enumerate() {
            let (block, k, rest) = (index / (4 * lanes * stored), index / (4 * lanes) % stored, index % (4 * lanes));
            *slot = at(weights.recurrent, gate_row(block * 4 * lanes + rest), k, hidden);
        }
        let head = Linear::new(
            level,
            Storage::F32,
            weights.head.1.len(),
            stored,
            |out, k| at(weights.head.0, Some(out), k, hidden),
            weights.head.1,
            Nonlinearity::None,
        );
        Self { level, start, from_latent, recurrent: Stored::new(storage, recurrent), head, hidden: stored }
    }

    /// Numbers between two steps of a decoded row.
    #[must_use]
    pub fn step_stride(&self) -> usize {
        self.head.outputs()
    }

    /// Decodes the first steps of rows of latents (padded, `latent_stride` apart) to `[row][step][step_stride]`.
    pub fn run<'a>(
        &self,
        rows: usize,
        steps: usize,
        latents: &[f32],
        latent_stride: usize,
        workspace: &'a mut DecoderWorkspace,
    ) -> &'a [f32] {
        let hidden = self.hidden;
        let stride = (steps + 1) * hidden;
        let outputs = rows * steps * self.step_stride();
        workspace.first.grow(rows * 2 * hidden);
        workspace.constant.grow(rows * 4 * hidden);
        workspace.states.grow(rows * stride);
        workspace.cells.grow(rows * hidden);
        workspace.outputs.grow(outputs);
        self.start.run(rows, latents, latent_stride, &mut workspace.first, 2 * hidden);
        self.from_latent.run(rows, latents, latent_stride, &mut workspace.constant, 4 * hidden);
        tanh_in_place(self.level, &mut workspace.first[..rows * 2 * hidden]);
        for (row, first) in workspace.first.chunks_exact(2 * hidden).take(rows).enumerate() {
            workspace.states[row * stride..row * stride + hidden].copy_from_slice(&first[..hidden]);
            workspace.cells[row * hidden..(row + 1) * hidden].copy_from_slice(&first[hidden..]);
        }
        for step in 0..steps {
            lstm_step(
                self.level,
                &mut LstmStep {
                    weights: &self.recurrent,
                    hidden,
                    rows,
                    constant: &workspace.constant,
                    states: &mut workspace.states,
                    stride,
                    from: step * hidden,
                    to: (step + 1) * hidden,
                    cells: &mut workspace.cells,
                    backwards: step % 2 == 1,
                },
            );
        }
        for row in 0..rows {
            let states = &workspace.states[row * stride + hidden..(row + 1) * stride];
            let to = &mut workspace.outputs[row * steps * self.step_stride()..];
            self.head.run(steps, states, hidden, to, self.step_stride());
        }
        &workspace.outputs[..outputs]
    }
}
