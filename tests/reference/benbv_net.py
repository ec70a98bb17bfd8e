"""BENBV-Net in PyTorch, written from its description: layers, names and order of the published state dictionary.

Imported by the scripts beside it, which check and time the Rust implementation against PyTorch.
Needs: pip install torch numpy safetensors
"""

import torch
from torch import nn

PAPER = dict(
    position_widths=[64, 128, 256, 512, 1024],
    normal_widths=[64, 128, 256, 512],
    boundary_widths=[64, 128],
    context_widths=[32, 128],
    trunk_widths=[512, 256, 128],
    attention_width=256,
    heads=4,
    head_width=64,
    dropout=0.1,
)
# `BenbvNetConfig::tiny` of the Rust crate.
TINY = dict(
    position_widths=[8, 16, 24],
    normal_widths=[8, 16],
    boundary_widths=[8, 8],
    context_widths=[4, 8],
    trunk_widths=[16, 16, 8],
    attention_width=16,
    heads=4,
    head_width=8,
    dropout=0.1,
)


def shared_mlp(widths):
    layers, inputs = [], 3
    for width in widths:
        layers.append(nn.Sequential(nn.Conv1d(inputs, width, 1), nn.BatchNorm1d(width), nn.ReLU()))
        inputs = width
    return nn.Sequential(*layers)


def encoder(inputs, widths, norm):
    a, b = widths
    return nn.Sequential(nn.Linear(inputs, a), norm(a), nn.ReLU(), nn.Linear(a, b), norm(b), nn.ReLU())


class ResBlock(nn.Module):
    def __init__(self, width):
        super().__init__()
        self.net = nn.Sequential(
            nn.Linear(width, width), nn.LayerNorm(width), nn.ReLU(), nn.Linear(width, width), nn.LayerNorm(width)
        )

    def forward(self, x):
        return x + self.net(x)


class BenbvNet(nn.Module):
    def __init__(self, position_widths, normal_widths, boundary_widths, context_widths, trunk_widths,
                 attention_width, heads, head_width, dropout):
        super().__init__()
        g = position_widths[-1] + normal_widths[-1]
        c = context_widths[1]
        t0, t1, t2 = trunk_widths
        self.pos_feat = shared_mlp(position_widths)
        self.normal_feat = shared_mlp(normal_widths)
        self.global_fusion = nn.Sequential(nn.Linear(g, g), nn.LayerNorm(g), nn.ReLU())
        self.feat_pos = encoder(3, boundary_widths, nn.BatchNorm1d)
        self.feat_normal = encoder(3, boundary_widths, nn.BatchNorm1d)
        self.feat_density = encoder(1, context_widths, nn.LayerNorm)
        self.feat_view = encoder(1, context_widths, nn.LayerNorm)
        self.dv_fusion = nn.Sequential(nn.Linear(2 * c, c), nn.LayerNorm(c), nn.ReLU())
        stage = lambda i, o: nn.Sequential(nn.Linear(i, o), nn.BatchNorm1d(o), nn.ReLU())
        self.main_branch = nn.Sequential(
            stage(g + 2 * boundary_widths[1], t0), ResBlock(t0), stage(t0, t1), ResBlock(t1), stage(t1, t2), ResBlock(t2)
        )
        self.pre_attention = nn.Sequential(nn.Linear(t2 + c, attention_width), nn.LayerNorm(attention_width), nn.ReLU())
        self.self_attention = nn.MultiheadAttention(attention_width, heads, batch_first=True)
        self.norm1 = nn.LayerNorm(attention_width)
        self.score_head = nn.Sequential(
            nn.Linear(attention_width, head_width), nn.LayerNorm(head_width), nn.ReLU(), nn.Dropout(dropout),
            nn.Linear(head_width, 1),
        )

    def forward(self, cloud, candidates, context):
        """cloud [B,N,6], candidates [B,K,6], context [B,K+1,1] (densities, then view order) -> [B,K]."""
        b, k, _ = candidates.shape
        p = self.pos_feat(cloud[..., :3].transpose(1, 2)).max(2).values
        n = self.normal_feat(cloud[..., 3:].transpose(1, 2)).max(2).values
        g = self.global_fusion(torch.cat([p, n], 1)).unsqueeze(1).expand(b, k, -1).reshape(b * k, -1)
        rows = candidates.reshape(b * k, 6)
        x = self.main_branch(torch.cat([g, self.feat_pos(rows[:, :3]), self.feat_normal(rows[:, 3:])], 1))
        density = self.feat_density(context[:, :k].reshape(b * k, 1))
        order = self.feat_view(context[:, k:].expand(b, k, 1).reshape(b * k, 1))
        v = self.dv_fusion(torch.cat([density, order], 1))
        x = self.pre_attention(torch.cat([x, v], 1)).reshape(b, k, -1)
        x = self.norm1(self.self_attention(x, x, x, need_weights=False)[0])
        return torch.sigmoid(self.score_head(x)).squeeze(2)


def position_weighted_loss(prediction, target):
    k = prediction.shape[1]
    position = 19 * torch.arange(k, dtype=prediction.dtype) / max(k - 1, 1)
    return 5 * ((((position - 12) / 10) ** 2 + 0.3) * (prediction - target) ** 2).mean()
