//! Passes over the columns of rows [R, C] in plain f32, compiled for the CPU at hand.

use std::array::from_fn;

fn vectorised<R>(pass: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(pass)
}

/// relu that keeps NaN, so that a diverged training shows.
#[inline(always)]
fn relu(x: f32) -> f32 {
    if x < 0.0 { 0.0 } else { x }
}

/// Rows that are added to a column's sums at a time, so that these stay in registers.
const TOGETHER: usize = 8;

/// The rows of a block of [`TOGETHER`]; `None` of a shorter one, at the end.
#[inline(always)]
fn rows_of(block: &[f32], columns: usize) -> Option<[&[f32]; TOGETHER]> {
    (block.len() == TOGETHER * columns).then(|| from_fn(|i| &block[i * columns..][..columns]))
}

/// out = relu(h scale + shift); adds the columns' sums to `sums`.
pub fn activate(out: &mut [f32], h: &[f32], scale: &[f32], shift: &[f32], sums: &mut [f32]) {
    let columns = scale.len();
    vectorised(
        #[inline(always)]
        || {
            for (out, h) in out.chunks_mut(TOGETHER * columns).zip(h.chunks(TOGETHER * columns)) {
                for (out, h) in out.chunks_exact_mut(columns).zip(h.chunks_exact(columns)) {
                    for ((out, h), (scale, shift)) in out.iter_mut().zip(h).zip(scale.iter().zip(shift)) {
                        *out = relu(h * scale + shift);
                    }
                }
                add_block(sums, out);
            }
        },
    );
}

/// rows = relu(rows + shift).
pub fn shift_relu(rows: &mut [f32], shift: &[f32]) {
    vectorised(
        #[inline(always)]
        || {
            for row in rows.chunks_exact_mut(shift.len()) {
                for (x, shift) in row.iter_mut().zip(shift) {
                    *x = relu(*x + shift);
                }
            }
        },
    );
}

/// best = max(best, rows) per column.
pub fn running_max(best: &mut [f32], rows: &[f32]) {
    vectorised(
        #[inline(always)]
        || {
            for row in rows.chunks_exact(best.len()) {
                for (best, x) in best.iter_mut().zip(row) {
                    *best = if *x > *best { *x } else { *best };
                }
            }
        },
    );
}

/// Adds the columns' sums.
pub fn column_sums(sums: &mut [f32], rows: &[f32]) {
    vectorised(
        #[inline(always)]
        || rows.chunks(TOGETHER * sums.len()).for_each(|block| add_block(sums, block)),
    );
}

#[inline(always)]
fn add_block(sums: &mut [f32], block: &[f32]) {
    let columns = sums.len();
    match rows_of(block, columns) {
        Some(rows) => add_rows(sums, rows),
        None => block.chunks_exact(columns).for_each(|row| add_rows(sums, [row])),
    }
}

#[inline(always)]
fn add_rows<const N: usize>(sums: &mut [f32], rows: [&[f32]; N]) {
    let columns = sums.len();
    let rows = rows.map(|row| &row[..columns]);
    for j in 0..columns {
        let mut sum = sums[j];
        for row in rows {
            sum += row[j];
        }
        sums[j] = sum;
    }
}

/// Adds sums of (x - centre) and of its square per column.
pub fn deviations(rows: &[f32], centre: &[f32], first: &mut [f32], second: &mut [f32]) {
    let columns = centre.len();
    vectorised(
        #[inline(always)]
        || {
            for block in rows.chunks(TOGETHER * columns) {
                match rows_of(block, columns) {
                    Some(rows) => add_deviations(rows, centre, first, second),
                    None => block.chunks_exact(columns).for_each(|row| add_deviations([row], centre, first, second)),
                }
            }
        },
    );
}

#[inline(always)]
fn add_deviations<const N: usize>(rows: [&[f32]; N], centre: &[f32], first: &mut [f32], second: &mut [f32]) {
    let columns = centre.len();
    let rows = rows.map(|row| &row[..columns]);
    let (first, second) = (&mut first[..columns], &mut second[..columns]);
    for j in 0..columns {
        let (mut sum, mut squares) = (first[j], second[j]);
        for row in rows {
            let d = row[j] - centre[j];
            sum += d;
            squares += d * d;
        }
        (first[j], second[j]) = (sum, squares);
    }
}

/// The largest of sign x per column, and its row.
pub struct Winners<'a> {
    pub sign: &'a [f32],
    pub best: &'a mut [f32],
    pub row: &'a mut [u32],
}

/// As [`deviations`], and the winners among these rows, counted from `row`.
pub fn deviations_and_winners(
    rows: &[f32],
    row: u32,
    centre: &[f32],
    first: &mut [f32],
    second: &mut [f32],
    winners: &mut Winners,
) {
    let columns = centre.len();
    vectorised(
        #[inline(always)]
        || {
            for (block, row) in rows.chunks(TOGETHER * columns).zip((row..).step_by(TOGETHER)) {
                match rows_of(block, columns) {
                    Some(rows) => {
                        add_deviations(rows, centre, first, second);
                        win(rows, row, winners);
                    }
                    None => block.chunks_exact(columns).zip(row..).for_each(|(values, row)| {
                        add_deviations([values], centre, first, second);
                        win([values], row, winners);
                    }),
                }
            }
        },
    );
}

#[inline(always)]
fn win<const N: usize>(rows: [&[f32]; N], from: u32, winners: &mut Winners) {
    let columns = winners.best.len();
    let rows = rows.map(|row| &row[..columns]);
    let (sign, best, winner) = (&winners.sign[..columns], &mut winners.best[..columns], &mut winners.row[..columns]);
    for j in 0..columns {
        let (mut most, mut at) = (best[j], winner[j]);
        for (row, values) in (from..).zip(rows) {
            let x = values[j] * sign[j];
            let wins = x > most;
            most = if wins { x } else { most };
            at = if wins { row } else { at };
        }
        (best[j], winner[j]) = (most, at);
    }
}

/// dy becomes dh = s (dy - m1 - xhat m2), with xhat = (h - mean) / deviation: factors per column prepared as
/// dh = s dy - p - q h.
pub fn normalisation_backward(dy: &mut [f32], h: &[f32], s: &[f32], p: &[f32], q: &[f32]) {
    let columns = s.len();
    let (p, q) = (&p[..columns], &q[..columns]);
    vectorised(
        #[inline(always)]
        || {
            for (dy, h) in dy.chunks_exact_mut(columns).zip(h.chunks_exact(columns)) {
                for j in 0..columns {
                    dy[j] = s[j] * dy[j] - p[j] - q[j] * h[j];
                }
            }
        },
    );
}

/// Clears da where the activation is off, and adds per column the sums of da and of da (h - mean).
pub fn mask_and_sum(da: &mut [f32], a: &[f32], h: &[f32], mean: &[f32], sum: &mut [f32], product: &mut [f32]) {
    let columns = mean.len();
    vectorised(
        #[inline(always)]
        || {
            let size = TOGETHER * columns;
            for ((da, a), h) in da.chunks_mut(size).zip(a.chunks(size)).zip(h.chunks(size)) {
                for (da, a) in da.iter_mut().zip(a) {
                    *da = if *a > 0.0 { *da } else { 0.0 };
                }
                match (rows_of(da, columns), rows_of(h, columns)) {
                    (Some(da), Some(h)) => add_products(da, h, mean, sum, product),
                    _ => da
                        .chunks_exact(columns)
                        .zip(h.chunks_exact(columns))
                        .for_each(|(da, h)| add_products([da], [h], mean, sum, product)),
                }
            }
        },
    );
}

#[inline(always)]
fn add_products<const N: usize>(da: [&[f32]; N], h: [&[f32]; N], mean: &[f32], sum: &mut [f32], product: &mut [f32]) {
    let columns = mean.len();
    let (da, h) = (da.map(|row| &row[..columns]), h.map(|row| &row[..columns]));
    let (sum, product) = (&mut sum[..columns], &mut product[..columns]);
    for j in 0..columns {
        let (mut all, mut weighted) = (sum[j], product[j]);
        for (da, h) in da.iter().zip(h) {
            all += da[j];
            weighted += da[j] * (h[j] - mean[j]);
        }
        (sum[j], product[j]) = (all, weighted);
    }
}

/// row += factor x.
pub fn add_scaled(row: &mut [f32], factor: f32, x: &[f32]) {
    vectorised(
        #[inline(always)]
        || {
            for (row, x) in row.iter_mut().zip(x) {
                *row += factor * x;
            }
        },
    );
}
