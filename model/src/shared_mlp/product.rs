//! Matrix products in plain f32.

use std::ops::Range;

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
