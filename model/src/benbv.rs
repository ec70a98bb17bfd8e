//! BENBV-Net (docs/method.md, 'Network, layer by layer').

use crate::blocks::{self, EncoderBn, EncoderLn, LinearBn, LinearLn, ResBlock, SelfAttention};
use crate::config::BenbvNetConfig;
use crate::shared_mlp;
use burn::module::Module;
use burn::nn::{Dropout, DropoutConfig, LayerNorm, Linear, Relu};
use burn::tensor::activation::sigmoid;
use burn::tensor::{Bool, Device, Int, Tensor, TensorData};

/// A batch for the network; made by [`encode`](crate::encode) alone.
#[derive(Clone, Debug)]
pub struct NetInput {
    /// Positions of the clouds, [B, N, 3].
    pub points: Tensor<3>,
    /// Normals of the clouds, [B, N, 3].
    pub normals: Tensor<3>,
    /// Candidates' targets, [B, K, 3].
    pub targets: Tensor<3>,
    /// Candidates' unit directions from target to camera, [B, K, 3].
    pub directions: Tensor<3>,
    /// Density at the targets, divided by the largest of the sample, [B, K].
    pub density: Tensor<2>,
    /// Number of scans done minus one, [B, 1].
    pub view_order: Tensor<2>,
    /// Past cameras; none where no sample knows any.
    pub past: Option<PastCameras>,
    /// Real candidates per sample, 1..=K, the first ones of its row; the rest is padding.
    pub counts: Vec<usize>,
}

/// Where a batch was scanned from.
#[derive(Clone, Debug)]
pub struct PastCameras {
    /// Beside each candidate: the unit vector from its target to the past camera minus that to its own position,
    /// [B, K, V, 3]. Samples with fewer cameras repeat theirs, which changes no maximum.
    pub offsets: Tensor<4>,
    /// 1 for samples whose past cameras are known, else 0, [B, 1].
    pub known: Tensor<2>,
}

impl PastCameras {
    fn on(self, device: &Device) -> Self {
        Self { offsets: self.offsets.to_device(device), known: self.known.to_device(device) }
    }
}

impl NetInput {
    /// [B, N, K].
    pub fn dims(&self) -> [usize; 3] {
        let [b, n, _] = self.points.dims();
        let [_, k, _] = self.targets.dims();
        [b, n, k]
    }

    /// 1 for real candidates, 0 for padding, [B, K].
    pub fn mask(&self) -> Tensor<2> {
        let [b, _, k] = self.dims();
        let mask = self.counts.iter().flat_map(|&c| (0..k).map(move |i| f32::from(u8::from(i < c)))).collect();
        Tensor::from_data(TensorData::new(mask, [b, k]), &self.points.device().inner())
    }

    /// On this device; an autodiff device is not needed for inputs, plain tensors count as constants.
    pub fn to_device(self, device: &Device) -> Self {
        Self {
            points: self.points.to_device(device),
            normals: self.normals.to_device(device),
            targets: self.targets.to_device(device),
            directions: self.directions.to_device(device),
            density: self.density.to_device(device),
            view_order: self.view_order.to_device(device),
            past: self.past.map(|past| past.on(device)),
            counts: self.counts,
        }
    }
}

/// The network. Fields bear the published names, so that weights load without renaming.
#[derive(Module, Debug)]
pub struct BenbvNet {
    pos_feat: Vec<LinearBn>,
    normal_feat: Vec<LinearBn>,
    global_fusion: LinearLn,
    feat_pos: EncoderBn,
    feat_normal: EncoderBn,
    feat_density: EncoderLn,
    feat_view: EncoderLn,
    /// Not in the published network; empty there.
    past_feat: Vec<LinearBn>,
    dv_fusion: LinearLn,
    main_branch: (LinearBn, ResBlock, LinearBn, ResBlock, LinearBn, ResBlock),
    pre_attention: LinearLn,
    self_attention: SelfAttention,
    norm1: LayerNorm,
    score_head: (Linear, LayerNorm, Relu, Dropout, Linear),
}

impl BenbvNetConfig {
    /// A network with fresh weights. Draws from the device's generator lazily: seed it first
    /// (`device.seed`), and call `materialize()` before other draws.
    ///
    /// # Panics
    ///
    /// If [`BenbvNetConfig::validate`] does not hold.
    pub fn init(&self, device: &Device) -> BenbvNet {
        if let Err(reason) = self.validate() {
            panic!("impossible network: {reason}");
        }
        let linear = |i, o| blocks::linear(i, o, device);
        let linear_bn = |i, o| (linear(i, o), blocks::batch_norm_layer(o, device));
        let linear_ln = |i, o| (linear(i, o), blocks::layer_norm(o, device));
        let global = self.global_width();
        let context = self.context_widths[1];
        let [t0, t1, t2] = self.trunk_widths;
        BenbvNet {
            pos_feat: blocks::shared_mlp(3, &self.position_widths, device),
            normal_feat: blocks::shared_mlp(3, &self.normal_widths, device),
            global_fusion: linear_ln(global, global),
            feat_pos: blocks::encoder_bn(3, self.boundary_widths, device),
            feat_normal: blocks::encoder_bn(3, self.boundary_widths, device),
            feat_density: blocks::encoder_ln(1, self.context_widths, device),
            feat_view: blocks::encoder_ln(1, self.context_widths, device),
            past_feat: blocks::shared_mlp(3, &self.past_widths, device),
            dv_fusion: linear_ln(2 * context, context),
            main_branch: (
                linear_bn(global + self.candidate_width(), t0),
                ResBlock::new(t0, device),
                linear_bn(t0, t1),
                ResBlock::new(t1, device),
                linear_bn(t1, t2),
                ResBlock::new(t2, device),
            ),
            pre_attention: linear_ln(t2 + context, self.attention_width),
            self_attention: SelfAttention::new(self.attention_width, self.heads, device),
            norm1: blocks::layer_norm(self.attention_width, device),
            score_head: (
                linear(self.attention_width, self.head_width),
                blocks::layer_norm(self.head_width, device),
                Relu,
                DropoutConfig::new(self.dropout).init(),
                linear(self.head_width, 1),
            ),
        }
    }
}

impl BenbvNet {
    /// Scores in (0, 1), [B, K]; 0 at padding. Real candidates' scores (and, in training, the batch statistics)
    /// do not depend on the padding.
    ///
    /// Trains (batch statistics, dropout) where the weights are on an autodiff device and
    /// [`Module::train`] is on: for planning and validation use `net.valid()`.
    ///
    /// # Panics
    ///
    /// If the shapes of the input disagree with each other.
    pub fn forward(&self, input: NetInput) -> Tensor<2> {
        let [b, _, k] = input.dims();
        assert_eq!(input.counts.len(), b, "one count of candidates per sample");
        // Inputs stay plain tensors: constants to the graph.
        let device = self.norm1.gamma.device().inner();
        let rows = PackedRows::new(&input.counts, k, &device);
        let input = input.to_device(&device);

        let global = self.global_feature(input.points, input.normals); // [B, G]
        let pack = |x: Tensor<3>| rows.pack(x.reshape([b * k, 3])); // [B, K, 3] -> [R, 3], R real candidates
        let mut boundary = vec![
            blocks::encode_bn(&self.feat_pos, pack(input.targets)),
            blocks::encode_bn(&self.feat_normal, pack(input.directions)),
        ];
        if !self.past_feat.is_empty() {
            boundary.push(self.past_feature(input.past, &rows, boundary[0].dims()[0]));
        }
        let boundary = Tensor::cat(boundary, 1); // [R, 2W + P]
        let trunk = self.trunk(global, boundary, &rows); // [R, T]
        let [_, t] = trunk.dims();
        let trunk = rows.unpack(trunk).reshape([b, k, t]); // [B, K, T]

        let density = blocks::encode_ln(&self.feat_density, input.density.reshape([b, k, 1])); // [B, K, V]
        let order = blocks::encode_ln(&self.feat_view, input.view_order.reshape([b, 1, 1])); // [B, 1, V]
        let [_, _, v] = order.dims();
        let context = Tensor::cat(vec![density, order.expand([b, k, v])], 2); // [B, K, 2V]
        let context = blocks::linear_ln_relu(&self.dv_fusion.0, &self.dv_fusion.1, context); // [B, K, V]

        let x = Tensor::cat(vec![trunk, context], 2); // [B, K, T+V]
        let x = blocks::linear_ln_relu(&self.pre_attention.0, &self.pre_attention.1, x); // [B, K, E]
        let x = self.norm1.forward(self.self_attention.forward(x, rows.padding())); // [B, K, E]
        let head = &self.score_head;
        let x = head.3.forward(blocks::linear_ln_relu(&head.0, &head.1, x)); // [B, K, H]
        let scores = sigmoid(head.4.forward(x)).reshape([b, k]); // [B, K]
        match rows.padding() {
            Some(padding) => scores.mask_fill(padding, 0.0),
            None => scores,
        }
    }

    /// Shared MLPs over positions and normals, maximum over points, fusion: [B, N, 3] twice -> [B, G].
    fn global_feature(&self, points: Tensor<3>, normals: Tensor<3>) -> Tensor<2> {
        let positions = shared_mlp::shared_mlp_max(&self.pos_feat, points); // [B, Gp]
        let normals = shared_mlp::shared_mlp_max(&self.normal_feat, normals); // [B, Gn]
        let both = Tensor::cat(vec![positions, normals], 1); // [B, G]
        blocks::linear_ln_relu(&self.global_fusion.0, &self.global_fusion.1, both)
    }

    /// Shared MLP over a candidate's past cameras and the maximum over them: [B, K, V, 3] -> [R, P]; 0 where they are
    /// not known.
    fn past_feature(&self, past: Option<PastCameras>, rows: &PackedRows, r: usize) -> Tensor<2> {
        let Some(PastCameras { offsets, known }) = past else {
            let width = self.past_feat.last().map_or(0, |(linear, _)| linear.weight.dims()[1]);
            return Tensor::zeros([r, width], &self.norm1.gamma.device().inner());
        };
        let [b, k, v, _] = offsets.dims();
        let offsets = rows.pack(offsets.reshape([b * k, 3 * v])).reshape([r, v, 3]);
        shared_mlp::shared_mlp_max(&self.past_feat, offsets) * rows.per_candidate(known)
    }

    /// The three stages of the trunk on concat(global, boundary): -> [R, T]. The first layer's product with the
    /// global feature is the same for all candidates of a sample, so it is taken once per sample.
    fn trunk(&self, global: Tensor<2>, boundary: Tensor<2>, rows: &PackedRows) -> Tensor<2> {
        let (first, res0, second, res1, third, res2) = &self.main_branch;
        let ([_, g], [_, w]) = (global.dims(), boundary.dims());
        let weight = first.0.weight.val(); // [G+2W+P, T0]
        let shared = global.matmul(weight.clone().narrow(0, 0, g)); // [B, T0]
        let shared = match &first.0.bias {
            Some(bias) => shared + bias.val().unsqueeze::<2>(),
            None => shared,
        };
        let own = boundary.matmul(weight.narrow(0, g, w)); // [R, T0]
        let x = own + rows.per_candidate(shared); // [R, T0]
        let x = burn::tensor::activation::relu(blocks::batch_norm(&first.1, x));
        let x = res0.forward(x); // [R, T0]
        let x = res1.forward(blocks::linear_bn_relu(second, x)); // [R, T1]
        res2.forward(blocks::linear_bn_relu(third, x)) // [R, T2]
    }
}

/// Which rows of a [B*K, C] table are real candidates. Layers with batch norm see only those, so that padding
/// changes no statistics. Without padding nothing is moved.
struct PackedRows {
    samples: usize,
    width: usize,
    padded: Option<Padded>,
}

struct Padded {
    /// Row of the table for each packed row, [R].
    real: Tensor<1, Int>,
    /// Packed row for each row of the table, [B*K]; padding repeats its sample's first.
    slot: Tensor<1, Int>,
    /// Sample of each packed row, [R].
    sample: Tensor<1, Int>,
    /// True at padding, [B, K].
    padding: Tensor<2, Bool>,
}

impl PackedRows {
    fn new(counts: &[usize], k: usize, device: &Device) -> Self {
        assert!(counts.iter().all(|&c| (1..=k).contains(&c)), "candidates per sample {counts:?}, expected 1..={k}");
        let samples = counts.len();
        let padded = counts.iter().any(|&c| c != k).then(|| {
            let (mut real, mut slot, mut sample) = (Vec::new(), Vec::new(), Vec::new());
            let mut padding = Vec::with_capacity(samples * k);
            for (b, &count) in counts.iter().enumerate() {
                let first = real.len() as i32;
                for i in 0..k {
                    slot.push(first + if i < count { i as i32 } else { 0 });
                    padding.push(i >= count);
                    if i < count {
                        real.push((b * k + i) as i32);
                        sample.push(b as i32);
                    }
                }
            }
            let ints = |v: Vec<i32>| Tensor::<1, Int>::from_ints(v.as_slice(), device);
            Padded {
                real: ints(real),
                slot: ints(slot),
                sample: ints(sample),
                padding: Tensor::from_data(TensorData::new(padding, [samples, k]), device),
            }
        });
        Self { samples, width: k, padded }
    }

    /// [B*K, C] -> [R, C].
    fn pack(&self, table: Tensor<2>) -> Tensor<2> {
        match &self.padded {
            Some(p) => table.select(0, p.real.clone()),
            None => table,
        }
    }

    /// [R, C] -> [B*K, C].
    fn unpack(&self, rows: Tensor<2>) -> Tensor<2> {
        match &self.padded {
            Some(p) => rows.select(0, p.slot.clone()),
            None => rows,
        }
    }

    /// [B, C] -> [R, C]: each sample's row for all its candidates.
    fn per_candidate(&self, x: Tensor<2>) -> Tensor<2> {
        let [b, c] = x.dims();
        match &self.padded {
            Some(p) => x.select(0, p.sample.clone()),
            None => {
                let (k, samples) = (self.width, self.samples);
                x.reshape([b, 1, c]).expand([samples, k, c]).reshape([samples * k, c])
            }
        }
    }

    fn padding(&self) -> Option<Tensor<2, Bool>> {
        self.padded.as_ref().map(|p| p.padding.clone())
    }
}
