//! Rows [R, C] in chunks, and sums over parts of them.

use rayon::prelude::*;
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

/// Rows of the longest chunk.
pub fn longest(part: &[Chunk]) -> usize {
    part.iter().map(|chunk| chunk.rows.len()).max().unwrap_or_default()
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

/// Adds f32 partial sums to f64 totals.
pub fn merge(total: &mut [f64], part: &[f32]) {
    for (total, part) in total.iter_mut().zip(part) {
        *total += f64::from(*part);
    }
}

/// Sums of f32 parts of this length in f64, in their order.
pub fn sums<'a>(parts: impl Iterator<Item = &'a [f32]>, len: usize) -> Vec<f64> {
    const AT_A_TIME: usize = 4096;
    let parts: Vec<&[f32]> = parts.collect();
    let mut total = vec![0.0; len];
    total.par_chunks_mut(AT_A_TIME).enumerate().for_each(|(i, total)| {
        let from = i * AT_A_TIME;
        parts.iter().for_each(|part| merge(total, &part[from..from + total.len()]));
    });
    total
}
