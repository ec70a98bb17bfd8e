"""A plain PyTorch training loop, to set beside `train`: same network, batch, points, threads and data sizes.

    cargo build --release -p train --example loop_rate
    RAYON_NUM_THREADS=2 target/release/examples/loop_rate 32 1024 12
    python tests/reference/train_loop.py 32 1024 12 [--threads 2] [--workers 1]

Clouds of 5,000 points are resampled to N, rotated and batched by a DataLoader of one worker process (0: in line);
forward, position-weighted loss, backward, AdamW. Prints samples per second by wall time and CPU seconds per sample
(loop and worker).
Needs: pip install torch numpy safetensors
"""

import argparse
import os
import resource
import sys
import time

import numpy as np
import torch
from torch.utils.data import DataLoader, Dataset

sys.path.insert(0, os.path.dirname(__file__))
from benbv_net import PAPER, BenbvNet, position_weighted_loss  # noqa: E402


class Decisions(Dataset):
    def __init__(self, count, points):
        rng = np.random.default_rng(0)
        normals = rng.standard_normal((count, 5000, 3)).astype(np.float32)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        self.clouds = np.concatenate([0.1 * normals, normals], axis=-1)
        self.points = points

    def __len__(self):
        return len(self.clouds)

    def __getitem__(self, index):
        rng = np.random.default_rng(index)
        cloud = self.clouds[index]
        cloud = cloud[rng.choice(len(cloud), self.points, replace=False)]
        q, _ = np.linalg.qr(rng.standard_normal((3, 3)))
        q = q.astype(np.float32)
        cloud = np.concatenate([cloud[:, :3] @ q, cloud[:, 3:] @ q], axis=1)
        candidates = cloud[:20].copy()
        context = np.concatenate([np.full((20, 1), 0.9), np.full((1, 1), index % 15)]).astype(np.float32)
        return cloud, candidates, context, np.linspace(0, 0.95, 20, dtype=np.float32)


def cpu_seconds():
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in usage)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("batch", type=int)
    parser.add_argument("points", type=int)
    parser.add_argument("steps", type=int)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--workers", type=int, default=1)
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    torch.manual_seed(0)
    net = BenbvNet(**PAPER)
    net.train()
    optimizer = torch.optim.AdamW(net.parameters(), lr=1e-3, weight_decay=0.01)
    data = Decisions(args.batch * (args.steps + 1), args.points)
    loader = DataLoader(data, batch_size=args.batch, shuffle=True, num_workers=args.workers)
    wall = cpu = None
    done = 0
    for cloud, candidates, context, target in loader:
        if wall is None:  # The first batch warms up.
            net(cloud, candidates, context)
            wall, cpu = time.perf_counter(), cpu_seconds()
            continue
        prediction = net(cloud, candidates, context).reshape(target.shape)
        loss = position_weighted_loss(prediction, target)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        done += len(target)
        loss.item()
    wall, cpu = time.perf_counter() - wall, cpu_seconds() - cpu
    print(f"torch loop: {done / wall:.1f} samples/s, {1e3 * cpu / done:.3f} ms CPU a sample", flush=True)


if __name__ == "__main__":
    main()
