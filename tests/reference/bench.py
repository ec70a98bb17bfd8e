"""Times the Rust network against PyTorch: same sizes, same number of threads, one run, taking turns.

    cargo build --release -p model --example bench
    python tests/reference/bench.py target/release/examples/bench [--threads 2] [--rounds 7] [--cases forward:1:4096 train:32:1024]

Both sides run in separate processes and do one forward pass (eval) or one training step (forward, loss, backward,
AdamW) whenever it is their turn, so that other load on the machine falls on both alike. Printed per case: wall and CPU
time (all threads), the best and the median, samples per second, peak memory, and the ratios.
Needs: pip install torch numpy safetensors
"""

import argparse
import os
import resource
import statistics
import subprocess
import sys
import time


def worker(mode, batch, points, threads):
    import torch

    sys.path.insert(0, os.path.dirname(__file__))
    from benbv_net import PAPER, BenbvNet, position_weighted_loss

    torch.set_num_threads(threads)
    torch.manual_seed(0)
    net = BenbvNet(**PAPER)
    cloud = torch.randn(batch, points, 6)
    candidates, context, target = torch.randn(batch, 20, 6), torch.rand(batch, 21, 1), torch.rand(batch, 20)
    optimizer = torch.optim.AdamW(net.parameters(), lr=1e-3, weight_decay=0.01)
    net.train(mode == "train")

    def once():
        if mode == "forward":
            with torch.inference_mode():
                return net(cloud, candidates, context).sum().item()
        loss = position_weighted_loss(net(cloud, candidates, context), target)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        return loss.item()

    for _ in sys.stdin:
        wall, cpu = time.perf_counter(), time.process_time()
        once()
        wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
        print(f"{wall} {cpu} {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024}", flush=True)


class Side:
    def __init__(self, command, env):
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=env)
        self.wall, self.cpu, self.memory = [], [], 0.0

    def turn(self, keep):
        self.process.stdin.write("go\n")
        self.process.stdin.flush()
        wall, cpu, memory = map(float, self.process.stdout.readline().split())
        if keep:
            self.wall.append(wall)
            self.cpu.append(cpu)
        self.memory = memory

    def end(self):
        self.process.stdin.close()
        self.process.wait()


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("rust")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--cases", nargs="+", default=["forward:1:4096", "train:32:1024", "train:32:4096"])
    args = parser.parse_args()
    env = dict(os.environ, RAYON_NUM_THREADS=str(args.threads), OMP_NUM_THREADS=str(args.threads))
    for case in args.cases:
        mode, batch, points = case.split(":")
        sides = {
            "rust": Side([args.rust, mode, batch, points], env),
            "torch": Side([sys.executable, __file__, "--worker", mode, batch, points, str(args.threads)], env),
        }
        for round_ in range(args.rounds + 2):  # Two rounds to warm up.
            for side in sides.values():
                side.turn(keep=round_ >= 2)
        for side in sides.values():
            side.end()
        print(f"{mode} B={batch} N={points}, {args.threads} threads, {args.rounds} rounds")
        for name, side in sides.items():
            best, median, cpu = min(side.wall), statistics.median(side.wall), statistics.median(side.cpu)
            print(
                f"  {name:5} wall best {best * 1e3:9.1f} ms, median {median * 1e3:9.1f} ms, CPU median {cpu * 1e3:9.1f} ms"
                f", best CPU {min(side.cpu) * 1e3:9.1f} ms, {int(batch) / best:7.2f} samples/s, peak {side.memory:7.0f} MiB"
            )
        rust, torch = sides["rust"], sides["torch"]
        pairs = statistics.median(t / r for r, t in zip(rust.wall, torch.wall))
        print(
            f"  torch / rust: wall best {min(torch.wall) / min(rust.wall):.2f}, wall median of pairs {pairs:.2f}"
            f", CPU median {statistics.median(torch.cpu) / statistics.median(rust.cpu):.2f}"
            f", best CPU {min(torch.cpu) / min(rust.cpu):.2f}; memory rust / torch {rust.memory / torch.memory:.2f}",
            flush=True,
        )


if __name__ == "__main__":
    if sys.argv[1] == "--worker":
        worker(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]), int(sys.argv[5]))
    else:
        main()
