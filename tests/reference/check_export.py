"""Loads weights that the Rust program exported into PyTorch with strict=True and compares.

    cargo run --release -p train -- convert golden/a_net_state_f32.safetensors /tmp/export.safetensors
    python tests/reference/check_export.py /tmp/export.safetensors [original.safetensors [io.safetensors]]

With the original: floats must be equal bit for bit (or, for a half-precision export, after rounding). With an input
and output file (P, S, C, eval_output): the scores of both must agree.
Needs: pip install torch numpy safetensors
"""

import sys

import torch
from safetensors.torch import load_file

from benbv_net import PAPER, BenbvNet

exported = load_file(sys.argv[1])
net = BenbvNet(**PAPER)
half = any(t.dtype == torch.float16 for t in exported.values())
net.load_state_dict(exported, strict=True)
print(f"strict load: {len(exported)} keys, {'f16' if half else 'f32'}")
if len(sys.argv) > 2:
    original = load_file(sys.argv[2])
    assert set(original) == set(exported), set(original) ^ set(exported)
    for key, want in original.items():
        if key.endswith("num_batches_tracked"):
            continue
        got = exported[key]
        assert got.shape == want.shape, (key, got.shape, want.shape)
        assert torch.equal(got, want.to(got.dtype)), key
    print(f"equal to {sys.argv[2]} bit for bit" + (" after rounding to half precision" if half else ""))
if len(sys.argv) > 3:
    io = load_file(sys.argv[3])
    net.eval()
    with torch.no_grad():
        scores = net(io["P"], io["S"], io["C"])
    difference = (scores - io["eval_output"].squeeze(2)).abs().max().item()
    print(f"scores differ by at most {difference:.3e}")
    assert difference < (2e-2 if half else 1e-5)
print("ok")
