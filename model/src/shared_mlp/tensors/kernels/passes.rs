//! The kernels. One unit walks down one column through a block of rows, so that neighbours read neighbouring numbers;
//! nothing is atomic, so sums come out the same every time.

use burn::cubecl;
use burn::cubecl::prelude::*;

/// Rows of a block.
pub const BLOCK: usize = 128;
/// Rows of a block whose winners are gathered in shared memory: 64 columns of it are 16 KB, the least that WebGPU promises.
pub const WINNERS_BLOCK: usize = 64;
/// Units of a cube that share that memory.
pub const WINNERS_UNITS: usize = 64;

/// Sums of x - centre and of its square: x [rows, width], centre [width] -> sums [2, blocks, width].
#[cube(launch_unchecked)]
pub fn sums<F: Float>(
    x: &[F],
    centre: &[f32],
    sums: &mut [f32],
    rows: u32,
    width: u32,
    blocks: u32,
    #[define(F)] _dtype: ElemType,
) {
    let (rows, width, blocks) = (rows as usize, width as usize, blocks as usize);
    let column = ABSOLUTE_POS % width;
    let block = ABSOLUTE_POS / width;
    if block >= blocks {
        terminate!();
    }
    let first = block * BLOCK;
    let end = min(first + BLOCK, rows);
    let centre = centre[column];
    let mut sum = f32::new(0.0);
    let mut squares = f32::new(0.0);
    for row in first..end {
        let d = f32::cast_from(x[row * width + column]) - centre;
        sum += d;
        squares += d * d;
    }
    sums[block * width + column] = sum;
    sums[(blocks + block) * width + column] = squares;
}

/// The same sums, the largest x sign of a block and its row within the sample, for blocks that end with their sample of
/// `n` rows: x [rows, width] -> sums [2, blocks, width], best and winner [blocks, width].
#[cube(launch_unchecked)]
pub fn largest<F: Float>(
    x: &[F],
    centre: &[f32],
    sign: &[f32],
    sums: &mut [f32],
    best: &mut [f32],
    winner: &mut [i32],
    n: u32,
    width: u32,
    blocks: u32,
    of_sample: u32,
    #[define(F)] _dtype: ElemType,
) {
    let (n, width, blocks, of_sample) = (n as usize, width as usize, blocks as usize, of_sample as usize);
    let column = ABSOLUTE_POS % width;
    let block = ABSOLUTE_POS / width;
    if block >= blocks {
        terminate!();
    }
    let sample = block / of_sample;
    let first = (block % of_sample) * BLOCK;
    let end = min(first + BLOCK, n);
    let centre = centre[column];
    let sign = sign[column];
    let mut sum = f32::new(0.0);
    let mut squares = f32::new(0.0);
    let mut most = f32::cast_from(x[(sample * n + first) * width + column]) * sign;
    let mut at = first;
    for row in first..end {
        let value = f32::cast_from(x[(sample * n + row) * width + column]);
        let d = value - centre;
        sum += d;
        squares += d * d;
        let signed = value * sign;
        if signed > most {
            most = signed;
            at = row;
        }
    }
    let out = block * width + column;
    sums[out] = sum;
    sums[blocks * width + out] = squares;
    best[out] = most;
    winner[out] = at as i32;
}

/// The largest of a sample's blocks, the first of equals: [samples * of_sample, width] -> [samples, width].
#[cube(launch_unchecked)]
pub fn largest_of_blocks(
    best: &[f32],
    winner: &[i32],
    most: &mut [f32],
    at: &mut [i32],
    samples: u32,
    width: u32,
    of_sample: u32,
) {
    let (samples, width, of_sample) = (samples as usize, width as usize, of_sample as usize);
    let column = ABSOLUTE_POS % width;
    let sample = ABSOLUTE_POS / width;
    if sample >= samples {
        terminate!();
    }
    let first = sample * of_sample * width + column;
    let mut value = best[first];
    let mut row = winner[first];
    for block in 1..of_sample {
        let other = best[first + block * width];
        if other > value {
            value = other;
            row = winner[first + block * width];
        }
    }
    most[sample * width + column] = value;
    at[sample * width + column] = row;
}

/// a = relu(h scale + shift) and its sums: h [rows, width], norm [2, width] -> a [rows, width], sums [blocks, width].
#[cube(launch_unchecked)]
pub fn activated(h: &[f32], norm: &[f32], a: &mut [f32], sums: &mut [f32], rows: u32, width: u32, blocks: u32) {
    let (rows, width, blocks) = (rows as usize, width as usize, blocks as usize);
    let column = ABSOLUTE_POS % width;
    let block = ABSOLUTE_POS / width;
    if block >= blocks {
        terminate!();
    }
    let first = block * BLOCK;
    let end = min(first + BLOCK, rows);
    let scale = norm[column];
    let shift = norm[width + column];
    let mut sum = f32::new(0.0);
    for row in first..end {
        let value = max(h[row * width + column] * scale + shift, f32::new(0.0));
        a[row * width + column] = value;
        sum += value;
    }
    sums[block * width + column] = sum;
}

/// Back through a ReLU: da and h [rows, width], norm (scale, shift, mean) [3, width] -> dy [rows, width], and the sums of dy and
/// of dy (h - mean), [2, blocks, width].
#[cube(launch_unchecked)]
pub fn through_relu(
    da: &[f32],
    h: &[f32],
    norm: &[f32],
    dy: &mut [f32],
    sums: &mut [f32],
    rows: u32,
    width: u32,
    blocks: u32,
) {
    let (rows, width, blocks) = (rows as usize, width as usize, blocks as usize);
    let column = ABSOLUTE_POS % width;
    let block = ABSOLUTE_POS / width;
    if block >= blocks {
        terminate!();
    }
    let first = block * BLOCK;
    let end = min(first + BLOCK, rows);
    let scale = norm[column];
    let shift = norm[width + column];
    let mean = norm[2 * width + column];
    let mut sum = f32::new(0.0);
    let mut product = f32::new(0.0);
    for row in first..end {
        let h = h[row * width + column];
        let mut value = da[row * width + column];
        if h * scale + shift <= f32::new(0.0) {
            value = f32::new(0.0);
        }
        dy[row * width + column] = value;
        sum += value;
        product += value * (h - mean);
    }
    sums[block * width + column] = sum;
    sums[(blocks + block) * width + column] = product;
}

/// The same for the last layer's da = constant - mixed + what flows to winners: mixed and h [samples * n, width], norm
/// (scale, shift, mean, constant) [4, width], s_dy and winner [samples, outputs], transposed [outputs, width].
#[cube(launch_unchecked)]
pub fn through_winners(
    mixed: &[f32],
    h: &[f32],
    norm: &[f32],
    s_dy: &[f32],
    winner: &[i32],
    transposed: &[f32],
    dy: &mut [f32],
    sums: &mut [f32],
    n: u32,
    width: u32,
    blocks: u32,
    of_sample: u32,
    outputs: u32,
    tiles: u32,
) {
    let (n, width, blocks) = (n as usize, width as usize, blocks as usize);
    let (of_sample, outputs, tiles) = (of_sample as usize, outputs as usize, tiles as usize);
    // A cube has the columns of a tile in one block; each unit owns a column of the shared memory, so none waits for another.
    let block = CUBE_POS / tiles;
    let column = (CUBE_POS % tiles) * WINNERS_UNITS + UNIT_POS as usize;
    let mut flows = Shared::<[f32]>::new_slice(WINNERS_BLOCK * WINNERS_UNITS);
    if block >= blocks || column >= width {
        terminate!();
    }
    let sample = block / of_sample;
    let first = (block % of_sample) * WINNERS_BLOCK;
    let end = min(first + WINNERS_BLOCK, n);
    for local in 0..end - first {
        flows[local * WINNERS_UNITS + UNIT_POS as usize] = f32::new(0.0);
    }
    for output in 0..outputs {
        let row = winner[sample * outputs + output] as usize;
        if row >= first && row < end {
            let at = (row - first) * WINNERS_UNITS + UNIT_POS as usize;
            let before = flows[at];
            flows[at] = before + s_dy[sample * outputs + output] * transposed[output * width + column];
        }
    }
    let scale = norm[column];
    let shift = norm[width + column];
    let mean = norm[2 * width + column];
    let constant = norm[3 * width + column];
    let mut sum = f32::new(0.0);
    let mut product = f32::new(0.0);
    for local in 0..end - first {
        let at = (sample * n + first + local) * width + column;
        let h = h[at];
        let mut value = constant - mixed[at] + flows[local * WINNERS_UNITS + UNIT_POS as usize];
        if h * scale + shift <= f32::new(0.0) {
            value = f32::new(0.0);
        }
        dy[at] = value;
        sum += value;
        product += value * (h - mean);
    }
    sums[block * width + column] = sum;
    sums[(blocks + block) * width + column] = product;
}

/// Sum over samples of s_dy times the winner's a: a [samples * n, width], s_dy and winner [samples, outputs] ->
/// [outputs, width].
#[cube(launch_unchecked)]
pub fn at_winners(
    a: &[f32],
    s_dy: &[f32],
    winner: &[i32],
    out: &mut [f32],
    samples: u32,
    n: u32,
    width: u32,
    outputs: u32,
) {
    let (samples, n, width, outputs) = (samples as usize, n as usize, width as usize, outputs as usize);
    let column = ABSOLUTE_POS % width;
    let output = ABSOLUTE_POS / width;
    if output >= outputs {
        terminate!();
    }
    let mut sum = f32::new(0.0);
    for sample in 0..samples {
        let row = sample * n + winner[sample * outputs + output] as usize;
        sum += s_dy[sample * outputs + output] * a[row * width + column];
    }
    out[output * width + column] = sum;
}
