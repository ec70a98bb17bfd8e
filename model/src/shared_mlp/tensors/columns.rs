//! What the operation does with the columns of a slice beside products: by kernels of its own on GPUs ([`super::kernels`]),
//! by burn's operations on other backends, where tests compare the two.

use super::forward::Normalised;
#[cfg(feature = "wgpu")]
use super::kernels;
use burn::tensor::activation::relu;
use burn::tensor::{DType, IndexingUpdateOp, Int, Tensor};

/// Sums of x - centre and of its square: [rows, C] and [1, C] -> [2, C].
pub fn sums(x: &Tensor<2>, centre: &Tensor<2>) -> Tensor<2> {
    #[cfg(feature = "wgpu")]
    if let Some(sums) = kernels::sums(x, centre) {
        return sums;
    }
    let d = x.clone().cast(DType::F32) - centre.clone();
    Tensor::cat(vec![d.clone().sum_dim(0), (d.clone() * d).sum_dim(0)], 0)
}

/// Of a slice's products [samples * n, C].
pub struct Largest {
    /// As [`sums`] gives them.
    pub sums: Tensor<2>,
    /// The largest product times the sign, [samples, C].
    pub best: Tensor<2>,
    /// Its point, [samples, C].
    pub winner: Tensor<2, Int>,
}

/// Sums and largest products in one pass.
pub fn largest(x: &Tensor<2>, centre: &Tensor<2>, sign: &Tensor<2>, n: usize) -> Largest {
    #[cfg(feature = "wgpu")]
    if let Some((sums, best, winner)) = kernels::largest(x, centre, sign, n) {
        return Largest { sums, best, winner };
    }
    let [rows, width] = x.dims();
    let signed = (x.clone().cast(DType::F32) * sign.clone()).reshape([rows / n, n, width]);
    let (best, winner) = signed.max_dim_with_indices(1);
    Largest { sums: sums(x, centre), best: best.squeeze_dim(1), winner: winner.squeeze_dim(1) }
}

/// relu(norm(h)), [rows, C], and its column sums, [1, C].
pub fn activated(h: &Tensor<2>, norm: &Normalised) -> (Tensor<2>, Tensor<2>) {
    #[cfg(feature = "wgpu")]
    if let Some(found) = kernels::activated(h, &stacked([&norm.scale, &norm.shift])) {
        return found;
    }
    let a = relu(h.clone() * norm.scale.clone() + norm.shift.clone());
    (a.clone(), a.sum_dim(0))
}

/// What flows on through a ReLU, dy [rows, C], and the sums of dy and of dy (h - mean), [2, C].
pub fn through_relu(da: Tensor<2>, h: &Tensor<2>, norm: &Normalised) -> (Tensor<2>, Tensor<2>) {
    #[cfg(feature = "wgpu")]
    if let Some(found) = kernels::through_relu(&da, h, &stacked([&norm.scale, &norm.shift, &norm.mean])) {
        return found;
    }
    let off = (h.clone() * norm.scale.clone() + norm.shift.clone()).lower_equal_scalar(0.0);
    let dy = da.mask_fill(off, 0.0);
    let product = (dy.clone() * (h.clone() - norm.mean.clone())).sum_dim(0);
    (dy.clone(), Tensor::cat(vec![dy.sum_dim(0), product], 0))
}

/// What flows into winners beside the constant and the product: s dy and winner [samples, C], weights transposed [C, K].
#[derive(Clone, Copy)]
pub struct Winners<'a> {
    pub s_dy: &'a Tensor<2>,
    pub winner: &'a Tensor<2, Int>,
    pub transposed: &'a Tensor<2>,
}

/// [`through_relu`] of da = constant - mixed + what flows into winners.
pub fn through_winners(
    mixed: Tensor<2>,
    constant: &Tensor<2>,
    winners: Winners,
    h: &Tensor<2>,
    norm: &Normalised,
) -> (Tensor<2>, Tensor<2>) {
    let Winners { s_dy, winner, transposed } = winners;
    #[cfg(feature = "wgpu")]
    {
        let norm = stacked([&norm.scale, &norm.shift, &norm.mean, constant]);
        if let Some(found) = kernels::through_winners(&mixed, h, &norm, s_dy, winner, transposed) {
            return found;
        }
    }
    let ([rows, k], [samples, c]) = (mixed.dims(), winner.dims());
    let flows = transposed.clone().unsqueeze::<3>().expand([samples, c, k]).reshape([samples * c, k]);
    let flows = flows * s_dy.clone().reshape([samples * c, 1]);
    let at = rows_of(winner, rows / samples).reshape([samples * c, 1]).expand([samples * c, k]);
    through_relu((constant.clone() - mixed).scatter(0, at, flows, IndexingUpdateOp::Add), h, norm)
}

/// Sum over samples of s dy times the winner's a: a [samples * n, K] -> [C, K].
pub fn at_winners(a: &Tensor<2>, s_dy: &Tensor<2>, winner: &Tensor<2, Int>) -> Tensor<2> {
    #[cfg(feature = "wgpu")]
    if let Some(sum) = kernels::at_winners(a, s_dy, winner) {
        return sum;
    }
    let ([rows, k], [samples, c]) = (a.dims(), winner.dims());
    let of_winners = a.clone().select(0, rows_of(winner, rows / samples)) * s_dy.clone().reshape([samples * c, 1]);
    of_winners.reshape([samples, c, k]).sum_dim(0).squeeze_dim(0)
}

/// Rows of a slice that hold these points of its samples: [samples, C] -> [samples * C].
fn rows_of(winner: &Tensor<2, Int>, n: usize) -> Tensor<1, Int> {
    let [samples, c] = winner.dims();
    let first = Tensor::<1, Int>::arange(0..samples as i64, &winner.device()).reshape([samples, 1]) * n as i64;
    (winner.clone() + first).reshape([samples * c])
}

#[cfg(feature = "wgpu")]
fn stacked<const N: usize>(rows: [&Tensor<2>; N]) -> Tensor<2> {
    Tensor::cat(rows.map(Tensor::clone).to_vec(), 0)
}
