//! One step of an LSTM with interleaved gates: each block of units is stored `[k][gate][lane]`.

use half::bf16;

use super::stored::Weight;
use super::vector::Vector;
use super::{GROUP, Level, Stored, dispatch};

/// One step for a batch of rows.
#[derive(Debug)]
pub struct LstmStep<'a> {
    /// Recurrent weights, `[unit block][hidden][4][lanes]`, gates in the order i, f, g, o.
    pub weights: &'a Stored,
    /// Units, in whole groups.
    pub hidden: usize,
    /// Rows in the batch.
    pub rows: usize,
    /// The part of the gates that does not depend on the state, `[row][unit block][4][lanes]`.
    pub constant: &'a [f32],
    /// Hidden states; row `r` of this step starts at `r * stride + from`, and of the next at `r * stride + to`.
    pub states: &'a mut [f32],
    /// Distance between two rows of `states`.
    pub stride: usize,
    /// Offset of the state that is read.
    pub from: usize,
    /// Offset of the state that is written.
    pub to: usize,
    /// Cell states, `[row][hidden]`.
    pub cells: &'a mut [f32],
    /// Whether the unit blocks run from the last to the first. A step that begins where the previous one ended finds those
    /// weights in the cache.
    pub backwards: bool,
}

/// Advances every row by one step.
///
/// # Panics
/// If the slices do not fit each other: a fault of this crate, not of its input.
pub fn lstm_step(level: Level, step: &mut LstmStep<'_>) {
    let LstmStep { hidden, rows, stride, from, to, .. } = *step;
    assert_eq!(hidden % GROUP, 0, "units come in whole groups");
    assert_eq!(step.weights.len(), 4 * hidden * hidden, "recurrent weights");
    assert!(step.constant.len() >= 4 * rows * hidden && step.cells.len() >= rows * hidden, "rows");
    assert!(from + hidden <= to || to + hidden <= from, "the states overlap");
    assert!(rows == 0 || (rows - 1) * stride + from.max(to) + hidden <= step.states.len(), "states too short");
    // SAFETY: the extents were checked above.
    match step.weights {
        Stored::F32(_) => dispatch!(level, all_rows::<f32>, &mut LstmStep<'_>, step),
        Stored::Bf16(_) => dispatch!(level, all_rows::<bf16>, &mut LstmStep<'_>, step),
    }
}

#[inline(always)]
unsafe fn all_rows<V: Vector, W: Weight>(step: &mut LstmStep<'_>) {
    let weights: *const W = match step.weights {
        Stored::F32(values) => values.as_ptr().cast(),
        Stored::Bf16(values) => values.as_ptr().cast(),
    };
    let most = if V::LANES == 16 { 6 } else { 2 };
    let blocks = step.hidden / V::LANES;
    for turn in 0..blocks {
        let block = if step.backwards { blocks - 1 - turn } else { turn };
        let tiles = step.rows.div_ceil(most);
        for tile in 0..tiles {
            let start = tile * step.rows / tiles;
            let count = (tile + 1) * step.rows / tiles - start;
            unsafe {
                match count {
                    1 => some_rows::<V, W, 1, 4>(step, weights, block, start),
                    2 => some_rows::<V, W, 2, 1>(step, weights, block, start),
                    3 => some_rows::<V, W, 3, 1>(step, weights, block, start),
                    4 => some_rows::<V, W, 4, 1>(step, weights, block, start),
                    5 => some_rows::<V, W, 5, 1>(step, weights, block, start),
                    _ => some_rows::<V, W, 6, 1>(step, weights, block, start),
                }
            }
        }
    }
}

#[inline(always)]
unsafe fn some_rows<V: Vector, W: Weight, const ROWS: usize, const SPLIT: usize>(
    step: &mut LstmStep<'_>,
    weights: *const W,
    block: usize,
    start: usize,
) {
    let gate_width = 4 * V::LANES;
    unsafe {
        let mut gates = [[[V::zero(); 4]; ROWS]; SPLIT];
        for row in 0..ROWS {
            let constant = step.constant.as_ptr().add((start + row) * 4 * step.hidden + block * gate_width);
            for gate in 0..4 {
                gates[0][row][gate] = V::load(constant.add(gate * V::LANES));
            }
        }
        let states = step.states.as_mut_ptr();
        let read: [*const f32; ROWS] =
            std::array::from_fn(|row| states.add((start + row) * step.stride + step.from).cast_const());
        let mut weights = weights.add(block * step.hidden * gate_width);
        let mut k = 0;
        // `hidden` is a multiple of 16, hence of SPLIT.
        while k < step.hidden {
            for split in 0..SPLIT {
                let columns: [V; 4] = std::array::from_fn(|gate| W::load(weights.add(gate * V::LANES)));
                for row in 0..ROWS {
                    let value = V::splat(*read[row].add(k + split));
                    for gate in 0..4 {
                        gates[split][row][gate] = value.mul_add(columns[gate], gates[split][row][gate]);
                    }
                }
                weights = weights.add(gate_width);
            }
            k += SPLIT;
        }
        for row in 0..ROWS {
            let mut sums = gates[0][row];
            // Not a slice of `gates`: its address would force the sums out of the registers.
            for split in 1..SPLIT {
                for gate in 0..4 {
                    sums[gate] = sums[gate].add(gates[split][row][gate]);
                }
            }
            let cell = step.cells.as_mut_ptr().add((start + row) * step.hidden + block * V::LANES);
            let kept = sums[1].sigmoid().mul(V::load(cell));
            let next = sums[0].sigmoid().mul_add(sums[2].tanh(), kept);
            next.store(cell);
            let to = states.add((start + row) * step.stride + step.to + block * V::LANES);
            sums[3].sigmoid().mul(next.tanh()).store(to);
        }
    }
}
