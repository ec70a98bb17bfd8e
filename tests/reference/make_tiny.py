"""Makes tests/data/benbv_tiny.pth and benbv_tiny_io.safetensors: a tiny network of PyTorch with non-trivial running
statistics, an input batch, and PyTorch's scores, loss, gradients, statistics and first optimizer step.

    python tests/reference/make_tiny.py tests/data

Needs: pip install torch numpy safetensors
"""

import sys

import torch
from safetensors.torch import save_file

from benbv_net import TINY, BenbvNet, position_weighted_loss

torch.manual_seed(7)
net = BenbvNet(**dict(TINY, dropout=0.0))
with torch.no_grad():
    for p in net.parameters():
        if p.dim() == 1:
            p.add_(0.2 * torch.randn_like(p))
b, n, k = 3, 50, 8
direction = torch.nn.functional.normalize(torch.randn(b, k, 3), dim=2)
cloud = torch.cat([0.1 * torch.randn(b, n, 3), torch.nn.functional.normalize(torch.randn(b, n, 3), dim=2)], 2)
candidates = torch.cat([0.1 * torch.randn(b, k, 3), direction], 2)
context = torch.cat([torch.rand(b, k, 1), torch.tensor([0.0, 2.0, 5.0]).reshape(b, 1, 1)], 1)
target = torch.rand(b, k)
net.train()
for _ in range(20):
    net(cloud + 0.02 * torch.randn_like(cloud), candidates, context)

state = {key: value.clone() for key, value in net.state_dict().items()}
torch.save(state, f"{sys.argv[1]}/benbv_tiny.pth")
io = dict(P=cloud, S=candidates, C=context, y=target)
net.eval()
with torch.no_grad():
    io["eval_output"] = net(cloud, candidates, context)
net.train()
optimizer = torch.optim.AdamW(net.parameters(), lr=1e-3, weight_decay=0.01)
output = net(cloud, candidates, context)
loss = position_weighted_loss(output, target)
loss.backward()
io["train_output"], io["train_loss"] = output.detach(), loss.detach().reshape(1)
for name, p in net.named_parameters():
    io[f"grad.{name}"] = p.grad.clone()
for name, value in net.state_dict().items():
    if "running" in name:
        io[f"after.{name}"] = value.clone()
optimizer.step()
for name, p in net.named_parameters():
    io[f"adamw1.{name}"] = p.detach().clone()
save_file({key: value.contiguous() for key, value in io.items()}, f"{sys.argv[1]}/benbv_tiny_io.safetensors")
