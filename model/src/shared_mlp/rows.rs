//! Passes over rows [rows, C] in plain f32, compiled for the CPU at hand, and the matrix products between them.

use std::ops::Range;

/// Rows per chunk: enough that the weights' packing inside a product costs little, few enough that a chunk's widest
/// buffer (1024 x 1024 floats) stays in a shared cache.
pub const CHUNK: usize = 1024;
/// Pieces that a pass is cut into. Fixed, so that sums are merged in the same order whatever the thread count.
const PARTS: usize = 16;

/// A run of rows of one sample.
#[derive(Clone, Debug, PartialEq)]
pub struct Chunk {
    pub sample: usize,
    pub rows: Range<usize>,
}

/// The chunks of `samples` times `points` rows in at most [`PARTS`] runs of about equal length.
pub fn parts(samples: usize, points: usize) -> Vec<Vec<Chunk>> {
    let per_sample = points.div_ceil(CHUNK).max(1);
    // With few samples, smaller chunks, so that every core has work.
    let pieces = if samples * per_sample < PARTS { per_sample.max(PARTS.div_ceil(samples)) } else { per_sample };
    let length = points.div_ceil(pieces).max(MIN_CHUNK).min(points.max(1));
    let chunks: Vec<_> = (0..samples)
        .flat_map(|sample| {
            let start = sample * points;
            (0..points)
                .step_by(length)
                .map(move |at| Chunk { sample, rows: start + at..start + points.min(at + length) })
        })
        .collect();
    if chunks.is_empty() {
        return Vec::new();
    }
    let per_part = chunks.len().div_ceil(PARTS);
    chunks.chunks(per_part).map(<[Chunk]>::to_vec).collect()
}

/// Fewest rows that are worth a separate chunk.
const MIN_CHUNK: usize = 128;

/// Cuts a buffer of rows into the parts' own pieces.
pub fn split<'a, T>(mut buffer: &'a mut [T], parts: &[Vec<Chunk>], columns: usize) -> Vec<&'a mut [T]> {
    let mut pieces = Vec::with_capacity(parts.len());
    for part in parts {
        let rows: usize = part.iter().map(|chunk| chunk.rows.len()).sum();
        let (piece, rest) = buffer.split_at_mut(rows * columns);
        pieces.push(piece);
        buffer = rest;
    }
    pieces
}

/// A matrix operand: its values and the steps between rows and between columns.
#[derive(Clone, Copy)]
pub struct Matrix<'a> {
    values: &'a [f32],
    rows: usize,
    columns: usize,
    row_step: usize,
    column_step: usize,
}

impl<'a> Matrix<'a> {
    /// Row-major.
    pub fn new(values: &'a [f32], rows: usize, columns: usize) -> Self {
        assert!(values.len() >= rows * columns, "{} values for {rows} x {columns}", values.len());
        Self { values, rows, columns, row_step: columns, column_step: 1 }
    }

    pub fn transposed(self) -> Self {
        Self { rows: self.columns, columns: self.rows, row_step: self.column_step, column_step: self.row_step, ..self }
    }

    pub fn rows(&self) -> usize {
        self.rows
    }

    pub fn width(&self) -> usize {
        self.columns
    }

    /// Some of the columns.
    pub fn columns(self, range: Range<usize>) -> Self {
        assert!(range.start <= range.end && range.end <= self.columns);
        Self { values: &self.values[range.start * self.column_step..], columns: range.len(), ..self }
    }
}

/// out = keep * out + factor * a b, single-threaded. `out` is row-major with `stride` values from row to row.
pub fn product(out: &mut [f32], stride: usize, keep: f32, factor: f32, a: Matrix, b: Matrix) {
    assert_eq!(a.columns, b.rows, "inner sizes");
    let (m, n, k) = (a.rows, b.columns, a.columns);
    if m == 0 || n == 0 {
        return;
    }
    assert!(stride >= n && out.len() >= (m - 1) * stride + n, "{} values for {m} x {n}", out.len());
    // SAFETY: all three matrices were checked to lie within their slices (`Matrix` by construction, `out` above),
    // and `out` is borrowed mutably, so it overlaps neither operand.
    unsafe {
        gemm::gemm(
            m,
            n,
            k,
            out.as_mut_ptr(),
            1,
            stride as isize,
            keep != 0.0,
            a.values.as_ptr(),
            a.column_step as isize,
            a.row_step as isize,
            b.values.as_ptr(),
            b.column_step as isize,
            b.row_step as isize,
            keep,
            factor,
            false,
            false,
            false,
            gemm::Parallelism::None,
        );
    }
}

/// Adds a'a to the upper blocks of `gram` [C, C]; [`mirror`] fills the rest.
pub fn add_gram(gram: &mut [f32], a: &[f32], rows: usize, columns: usize) {
    let all = Matrix::new(a, rows, columns);
    for start in (0..columns).step_by(GRAM_BLOCK) {
        let block = start..columns.min(start + GRAM_BLOCK);
        let left = all.columns(block).transposed();
        product(&mut gram[start * columns + start..], columns, 1.0, 1.0, left, all.columns(start..columns));
    }
}

const GRAM_BLOCK: usize = 64;

/// Copies the part above the diagonal below it.
pub fn mirror(gram: &mut [f32], columns: usize) {
    for i in 0..columns {
        for j in 0..i {
            gram[i * columns + j] = gram[j * columns + i];
        }
    }
}

fn vectorised<R>(pass: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(pass)
}

/// relu that keeps NaN, so that a diverged training shows.
#[inline(always)]
fn relu(x: f32) -> f32 {
    if x < 0.0 { 0.0 } else { x }
}

/// out = relu(h scale + shift); adds the columns' sums to `sums`.
pub fn activate(out: &mut [f32], h: &[f32], scale: &[f32], shift: &[f32], sums: &mut [f32]) {
    let columns = scale.len();
    vectorised(
        #[inline(always)]
        || {
            for (out, h) in out.chunks_exact_mut(columns).zip(h.chunks_exact(columns)) {
                let inputs = h.iter().zip(scale.iter().zip(shift));
                for ((out, sum), (h, (scale, shift))) in out.iter_mut().zip(sums.iter_mut()).zip(inputs) {
                    let a = relu(h * scale + shift);
                    *out = a;
                    *sum += a;
                }
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
        || {
            for row in rows.chunks_exact(sums.len()) {
                for (sum, x) in sums.iter_mut().zip(row) {
                    *sum += x;
                }
            }
        },
    );
}

/// Adds sums of (x - centre) and of its square per column.
pub fn deviations(rows: &[f32], centre: &[f32], first: &mut [f32], second: &mut [f32]) {
    vectorised(
        #[inline(always)]
        || {
            for row in rows.chunks_exact(centre.len()) {
                let sums = first.iter_mut().zip(second.iter_mut());
                for ((x, centre), (first, second)) in row.iter().zip(centre).zip(sums) {
                    let d = x - centre;
                    *first += d;
                    *second += d * d;
                }
            }
        },
    );
}

/// As [`deviations`], and per column the largest of sign x and its row, counted from `row`.
pub fn deviations_and_winners(
    rows: &[f32],
    centre: &[f32],
    sign: &[f32],
    row: u32,
    first: &mut [f32],
    second: &mut [f32],
    best: &mut [f32],
    winner: &mut [u32],
) {
    let columns = centre.len();
    let (sign, first, second) = (&sign[..columns], &mut first[..columns], &mut second[..columns]);
    let (best, winner) = (&mut best[..columns], &mut winner[..columns]);
    vectorised(
        #[inline(always)]
        || {
            for (values, row) in rows.chunks_exact(columns).zip(row..) {
                for j in 0..columns {
                    let x = values[j];
                    let d = x - centre[j];
                    first[j] += d;
                    second[j] += d * d;
                    let x = x * sign[j];
                    let wins = x > best[j];
                    best[j] = if wins { x } else { best[j] };
                    winner[j] = if wins { row } else { winner[j] };
                }
            }
        },
    );
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
    let (sum, product) = (&mut sum[..columns], &mut product[..columns]);
    vectorised(
        #[inline(always)]
        || {
            let rows = da.chunks_exact_mut(columns).zip(a.chunks_exact(columns)).zip(h.chunks_exact(columns));
            for ((da, a), h) in rows {
                for j in 0..columns {
                    let d = if a[j] > 0.0 { da[j] } else { 0.0 };
                    da[j] = d;
                    sum[j] += d;
                    product[j] += d * (h[j] - mean[j]);
                }
            }
        },
    );
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

/// Adds f32 partial sums to f64 totals.
pub fn merge(total: &mut [f64], part: &[f32]) {
    for (total, part) in total.iter_mut().zip(part) {
        *total += f64::from(*part);
    }
}
