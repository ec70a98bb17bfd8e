//! Our own kernels for GPUs, each one pass over the rows of a slice. With burn's operations the widest layer's product was
//! read and written ten times, and what flows back to the winners was added up one row after the other.
//!
//! `None` where a tensor is on another backend. With fusion on, burn registers each as an operation of its own
//! (`backend_extension`).

mod passes;

use burn::backend::cubecl::dtype_to_storage_type;
#[cfg(feature = "fused")]
use burn::backend::fusion::custom::TensorSpec;
use burn::backend::tensor::{FloatTensor, IntTensor};
use burn::backend::wgpu::{CubeBackend, CubeTensor};
use burn::backend::{Backend, Cube, TensorMetadata, backend_extension};
use burn::cubecl::prelude::*;
use burn::cubecl::{calculate_cube_count_elemwise, std::tensor as strided};
use burn::tensor::{DType, Int, Shape, Tensor};
use passes::{BLOCK, WINNERS_BLOCK, WINNERS_UNITS};

/// Sums of x - centre and of its square: [rows, C] and [1, C] -> [2, C].
pub fn sums(x: &Tensor<2>, centre: &Tensor<2>) -> Option<Tensor<2>> {
    let sums = Cube::point_sums(on_cube(x)?, on_cube(centre)?);
    Some(total(Tensor::from_primitive::<Cube>(sums)))
}

/// Of x [samples * n, C] these sums, [2, C], and the largest x sign of each sample with its point, [samples, C].
pub fn largest(
    x: &Tensor<2>,
    centre: &Tensor<2>,
    sign: &Tensor<2>,
    n: usize,
) -> Option<(Tensor<2>, Tensor<2>, Tensor<2, Int>)> {
    let (sums, best, winner) = Cube::point_largest(on_cube(x)?, on_cube(centre)?, on_cube(sign)?, n);
    let best = Tensor::from_primitive::<Cube>(best);
    Some((total(Tensor::from_primitive::<Cube>(sums)), best, Tensor::from_primitive::<Cube>(winner)))
}

/// a = relu(h scale + shift), [rows, C], and its column sums, [1, C]; norm is scale over shift, [2, C].
pub fn activated(h: &Tensor<2>, norm: &Tensor<2>) -> Option<(Tensor<2>, Tensor<2>)> {
    let (a, sums) = Cube::point_activated(on_cube(h)?, on_cube(norm)?);
    Some((Tensor::from_primitive::<Cube>(a), Tensor::<2>::from_primitive::<Cube>(sums).sum_dim(0)))
}

/// dy = da where the ReLU of h is on, [rows, C], and the sums of dy and of dy (h - mean), [2, C]; norm is scale, shift and
/// mean, [3, C].
pub fn through_relu(da: &Tensor<2>, h: &Tensor<2>, norm: &Tensor<2>) -> Option<(Tensor<2>, Tensor<2>)> {
    let (dy, sums) = Cube::point_through_relu(on_cube(da)?, on_cube(h)?, on_cube(norm)?);
    Some((Tensor::from_primitive::<Cube>(dy), total(Tensor::from_primitive::<Cube>(sums))))
}

/// The same for da = constant - mixed, plus s_dy [samples, C] times the row of `transposed` [C, K] at each winner
/// [samples, C]; norm is scale, shift, mean and constant, [4, K].
pub fn through_winners(
    mixed: &Tensor<2>,
    h: &Tensor<2>,
    norm: &Tensor<2>,
    s_dy: &Tensor<2>,
    winner: &Tensor<2, Int>,
    transposed: &Tensor<2>,
) -> Option<(Tensor<2>, Tensor<2>)> {
    let winner = winner.clone().try_into_primitive::<Cube>().ok()?;
    let (mixed, h, norm) = (on_cube(mixed)?, on_cube(h)?, on_cube(norm)?);
    let (dy, sums) = Cube::point_through_winners(mixed, h, norm, on_cube(s_dy)?, winner, on_cube(transposed)?);
    Some((Tensor::from_primitive::<Cube>(dy), total(Tensor::from_primitive::<Cube>(sums))))
}

/// Sum over samples of s_dy times the row of a [samples * n, K] at each winner: [C, K].
pub fn at_winners(a: &Tensor<2>, s_dy: &Tensor<2>, winner: &Tensor<2, Int>) -> Option<Tensor<2>> {
    let winner = winner.clone().try_into_primitive::<Cube>().ok()?;
    Some(Tensor::from_primitive::<Cube>(Cube::point_at_winners(on_cube(a)?, on_cube(s_dy)?, winner)))
}

fn on_cube(tensor: &Tensor<2>) -> Option<FloatTensor<Cube>> {
    tensor.clone().try_into_primitive::<Cube>().ok()
}

/// [2, blocks, C] -> [2, C].
fn total(sums: Tensor<3>) -> Tensor<2> {
    sums.sum_dim(1).squeeze_dim(1)
}

/// See the functions above, which call these; sums are per block.
#[backend_extension(Cube, Fusion: cfg(feature = "fused"))]
trait PointKernels: Backend {
    #[fusion(meta = |x, _| sums_of(x, BLOCK))]
    fn point_sums(x: FloatTensor<Self>, centre: FloatTensor<Self>) -> FloatTensor<Self>;

    #[fusion(meta = largest_of)]
    fn point_largest(
        x: FloatTensor<Self>,
        centre: FloatTensor<Self>,
        sign: FloatTensor<Self>,
        n: usize,
    ) -> (FloatTensor<Self>, FloatTensor<Self>, IntTensor<Self>);

    #[fusion(meta = |h, _| (h.clone(), spec([h.shape[0].div_ceil(BLOCK), h.shape[1]])))]
    fn point_activated(h: FloatTensor<Self>, norm: FloatTensor<Self>) -> (FloatTensor<Self>, FloatTensor<Self>);

    #[fusion(meta = |da, _, _| (da.clone(), sums_of(da, BLOCK)))]
    fn point_through_relu(
        da: FloatTensor<Self>,
        h: FloatTensor<Self>,
        norm: FloatTensor<Self>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>);

    #[fusion(meta = through_winners_of)]
    fn point_through_winners(
        mixed: FloatTensor<Self>,
        h: FloatTensor<Self>,
        norm: FloatTensor<Self>,
        s_dy: FloatTensor<Self>,
        winner: IntTensor<Self>,
        transposed: FloatTensor<Self>,
    ) -> (FloatTensor<Self>, FloatTensor<Self>);

    #[fusion(meta = |a, s_dy, _| spec([s_dy.shape[1], a.shape[1]]))]
    fn point_at_winners(a: FloatTensor<Self>, s_dy: FloatTensor<Self>, winner: IntTensor<Self>) -> FloatTensor<Self>;
}

#[cfg(feature = "fused")]
fn spec<const D: usize>(shape: [usize; D]) -> TensorSpec {
    TensorSpec::new(Shape::from(shape), DType::F32)
}

#[cfg(feature = "fused")]
fn sums_of(x: &TensorSpec, block: usize) -> TensorSpec {
    spec([2, x.shape[0].div_ceil(block), x.shape[1]])
}

#[cfg(feature = "fused")]
fn largest_of(x: &TensorSpec, _: &TensorSpec, _: &TensorSpec, n: &usize) -> (TensorSpec, TensorSpec, TensorSpec) {
    let (samples, width) = (x.shape[0] / n, x.shape[1]);
    let best = spec([samples, width]);
    let winner = TensorSpec::new(best.shape.clone(), DType::I32);
    (spec([2, samples * n.div_ceil(BLOCK), width]), best, winner)
}

#[cfg(feature = "fused")]
fn through_winners_of(
    mixed: &TensorSpec,
    _: &TensorSpec,
    _: &TensorSpec,
    s_dy: &TensorSpec,
    _: &TensorSpec,
    _: &TensorSpec,
) -> (TensorSpec, TensorSpec) {
    let samples = s_dy.shape[0];
    let of_sample = (mixed.shape[0] / samples).div_ceil(WINNERS_BLOCK);
    (mixed.clone(), spec([2, samples * of_sample, mixed.shape[1]]))
}

impl PointKernels for CubeBackend {
    fn point_sums(x: CubeTensor, centre: CubeTensor) -> CubeTensor {
        let (x, centre) = (dense(x), dense(centre));
        let [rows, width] = sides(&x);
        let blocks = rows.div_ceil(BLOCK);
        let sums = empty(&x, [2, blocks, width], DType::F32);
        let (client, dtype) = (x.client.clone(), dtype_to_storage_type(x.dtype));
        let (count, units) = grid(&client, blocks * width);
        // SAFETY: every index is below rows * width or 2 * blocks * width, the lengths of the buffers.
        unsafe {
            passes::sums::launch_unchecked(
                &client,
                count,
                units,
                x.into_buffer_arg(),
                centre.into_buffer_arg(),
                sums.clone().into_buffer_arg(),
                rows as u32,
                width as u32,
                blocks as u32,
                dtype,
            );
        }
        sums
    }

    fn point_largest(
        x: CubeTensor,
        centre: CubeTensor,
        sign: CubeTensor,
        n: usize,
    ) -> (CubeTensor, CubeTensor, CubeTensor) {
        let (x, centre, sign) = (dense(x), dense(centre), dense(sign));
        let [rows, width] = sides(&x);
        let (samples, of_sample) = (rows / n, n.div_ceil(BLOCK));
        let blocks = samples * of_sample;
        let sums = empty(&x, [2, blocks, width], DType::F32);
        let (best, winner) = (empty(&x, [blocks, width], DType::F32), empty(&x, [blocks, width], DType::I32));
        let (client, dtype) = (x.client.clone(), dtype_to_storage_type(x.dtype));
        let (count, units) = grid(&client, blocks * width);
        // SAFETY: every index is below rows * width of x, 2 * blocks * width of the sums or blocks * width of the rest.
        unsafe {
            passes::largest::launch_unchecked(
                &client,
                count,
                units,
                x.into_buffer_arg(),
                centre.into_buffer_arg(),
                sign.into_buffer_arg(),
                sums.clone().into_buffer_arg(),
                best.clone().into_buffer_arg(),
                winner.clone().into_buffer_arg(),
                n as u32,
                width as u32,
                blocks as u32,
                of_sample as u32,
                dtype,
            );
        }
        if of_sample == 1 {
            return (sums, best, winner);
        }
        let (most, at) = (empty(&best, [samples, width], DType::F32), empty(&best, [samples, width], DType::I32));
        let (count, units) = grid(&client, samples * width);
        // SAFETY: every index is below blocks * width of the inputs or samples * width of the outputs.
        unsafe {
            passes::largest_of_blocks::launch_unchecked(
                &client,
                count,
                units,
                best.into_buffer_arg(),
                winner.into_buffer_arg(),
                most.clone().into_buffer_arg(),
                at.clone().into_buffer_arg(),
                samples as u32,
                width as u32,
                of_sample as u32,
            );
        }
        (sums, most, at)
    }

    fn point_activated(h: CubeTensor, norm: CubeTensor) -> (CubeTensor, CubeTensor) {
        let (h, norm) = (dense(h), dense(norm));
        let [rows, width] = sides(&h);
        let blocks = rows.div_ceil(BLOCK);
        let (a, sums) = (empty(&h, [rows, width], DType::F32), empty(&h, [blocks, width], DType::F32));
        let client = h.client.clone();
        let (count, units) = grid(&client, blocks * width);
        // SAFETY: every index is below rows * width, 2 * width of the norm or blocks * width of the sums.
        unsafe {
            passes::activated::launch_unchecked(
                &client,
                count,
                units,
                h.into_buffer_arg(),
                norm.into_buffer_arg(),
                a.clone().into_buffer_arg(),
                sums.clone().into_buffer_arg(),
                rows as u32,
                width as u32,
                blocks as u32,
            );
        }
        (a, sums)
    }

    fn point_through_relu(da: CubeTensor, h: CubeTensor, norm: CubeTensor) -> (CubeTensor, CubeTensor) {
        let (da, h, norm) = (dense(da), dense(h), dense(norm));
        let [rows, width] = sides(&h);
        let blocks = rows.div_ceil(BLOCK);
        let (dy, sums) = (empty(&h, [rows, width], DType::F32), empty(&h, [2, blocks, width], DType::F32));
        let client = h.client.clone();
        let (count, units) = grid(&client, blocks * width);
        // SAFETY: every index is below rows * width, 3 * width of the norm or 2 * blocks * width of the sums.
        unsafe {
            passes::through_relu::launch_unchecked(
                &client,
                count,
                units,
                da.into_buffer_arg(),
                h.into_buffer_arg(),
                norm.into_buffer_arg(),
                dy.clone().into_buffer_arg(),
                sums.clone().into_buffer_arg(),
                rows as u32,
                width as u32,
                blocks as u32,
            );
        }
        (dy, sums)
    }

    fn point_through_winners(
        mixed: CubeTensor,
        h: CubeTensor,
        norm: CubeTensor,
        s_dy: CubeTensor,
        winner: CubeTensor,
        transposed: CubeTensor,
    ) -> (CubeTensor, CubeTensor) {
        let (mixed, h, norm) = (dense(mixed), dense(h), dense(norm));
        let (s_dy, winner, transposed) = (dense(s_dy), dense(winner), dense(transposed));
        let ([rows, width], [samples, outputs]) = (sides(&h), sides(&s_dy));
        let n = rows / samples;
        let of_sample = n.div_ceil(WINNERS_BLOCK);
        let (blocks, tiles) = (samples * of_sample, width.div_ceil(WINNERS_UNITS));
        let (dy, sums) = (empty(&h, [rows, width], DType::F32), empty(&h, [2, blocks, width], DType::F32));
        let client = h.client.clone();
        let units = CubeDim::new_1d(WINNERS_UNITS as u32);
        let count = calculate_cube_count_elemwise(&client, blocks * tiles * WINNERS_UNITS, units);
        // SAFETY: winners are points of their samples, so every index is below the length of its buffer.
        unsafe {
            passes::through_winners::launch_unchecked(
                &client,
                count,
                units,
                mixed.into_buffer_arg(),
                h.into_buffer_arg(),
                norm.into_buffer_arg(),
                s_dy.into_buffer_arg(),
                winner.into_buffer_arg(),
                transposed.into_buffer_arg(),
                dy.clone().into_buffer_arg(),
                sums.clone().into_buffer_arg(),
                n as u32,
                width as u32,
                blocks as u32,
                of_sample as u32,
                outputs as u32,
                tiles as u32,
            );
        }
        (dy, sums)
    }

    fn point_at_winners(a: CubeTensor, s_dy: CubeTensor, winner: CubeTensor) -> CubeTensor {
        let (a, s_dy, winner) = (dense(a), dense(s_dy), dense(winner));
        let ([rows, width], [samples, outputs]) = (sides(&a), sides(&s_dy));
        let out = empty(&a, [outputs, width], DType::F32);
        let client = a.client.clone();
        let (count, units) = grid(&client, outputs * width);
        // SAFETY: winners are points of their samples, so every index is below the length of its buffer.
        unsafe {
            passes::at_winners::launch_unchecked(
                &client,
                count,
                units,
                a.into_buffer_arg(),
                s_dy.into_buffer_arg(),
                winner.into_buffer_arg(),
                out.clone().into_buffer_arg(),
                samples as u32,
                (rows / samples) as u32,
                width as u32,
                outputs as u32,
            );
        }
        out
    }
}

/// Cubes and units for this many numbers.
fn grid(client: &Client, numbers: usize) -> (CubeCount, CubeDim) {
    let units = CubeDim::new(client, numbers);
    (calculate_cube_count_elemwise(client, numbers, units), units)
}

fn sides(tensor: &CubeTensor) -> [usize; 2] {
    let shape = tensor.shape();
    [shape[0], shape[1]]
}

fn empty<const D: usize>(like: &CubeTensor, shape: [usize; D], dtype: DType) -> CubeTensor {
    let bytes = shape.iter().product::<usize>() * dtype.size();
    let handle = like.client.empty(bytes);
    CubeTensor::new_contiguous(like.client.clone(), like.device.clone(), Shape::from(shape), handle, dtype)
}

/// Row after row without gaps, as the kernels read.
fn dense(tensor: CubeTensor) -> CubeTensor {
    if tensor.is_contiguous() {
        return tensor;
    }
    let (client, device, dtype) = (tensor.client.clone(), tensor.device.clone(), tensor.dtype);
    let out = strided::into_contiguous(&client, tensor.binding(), dtype_to_storage_type(dtype));
    CubeTensor::new(client, out.handle, *out.metadata, device, dtype)
}
