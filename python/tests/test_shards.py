"""Training samples: as they lie on disk."""

import pickle
import re
import sys
import types

import numpy as np
import pytest
from conftest import ROOT, program

import benbv


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data") / "set"
    sets = ["episode.num_views=2", "episode.image.width=320", "episode.image.height=180", "episode.image.fov_y_deg=20"]
    words = [word for s in sets for word in ("--set", s)]
    program("datagen", "--objects", 3, "--out", folder, *words, "--set", "surface_samples=6000")
    return folder


def test_samples_are_those_of_the_files(data):
    load_file = pytest.importorskip("safetensors.numpy").load_file
    shards = benbv.Shards(data)
    files = sorted(data.glob("shards/**/*.safetensors"))
    assert len(files) == 3 and len(shards) == sum(len(benbv.Shards(f)) for f in files) == 6
    for path in files:
        raw, part = load_file(path), benbv.Shards(path)
        for i, sample in enumerate(part):
            rows = slice(int(raw["point_offsets"][i]), int(raw["point_offsets"][i + 1]))
            np.testing.assert_array_equal(sample["points"], raw["points"][rows])
            np.testing.assert_array_equal(sample["normals"], raw["normals"][rows])
            first = int(raw["num_candidates"][:i].sum())
            rows = slice(first, first + int(raw["num_candidates"][i]))
            for name in ("candidates", "density", "scores", "coverage", "overlap"):
                np.testing.assert_array_equal(sample[name], raw[name][rows], err_msg=name)
            assert sample["scan_index"] == raw["scan_index"][i] == i
            assert sample["current_coverage"] == raw["current_coverage"][i]
            cameras = raw["cameras"][int(raw["num_cameras"][:i].sum()) :][: raw["num_cameras"][i]]
            np.testing.assert_allclose(sample["cameras"][:, :3, 3], cameras[:, 4:])
            assert sample["points"].dtype == np.float32


def test_a_sequence_as_others(data):
    shards = benbv.Shards(data)
    np.testing.assert_array_equal(shards[-1]["scores"], shards[len(shards) - 1]["scores"])
    assert [s["object"] for s in shards[1:5:2]] == [shards[1]["object"], shards[3]["object"]]
    for index in (6, -7):
        with pytest.raises(IndexError, match=f"sample {index} of 6"):
            shards[index]
    again = pickle.loads(pickle.dumps(shards))
    np.testing.assert_array_equal(again[2]["points"], shards[2]["points"])
    parts = [benbv.Shards(data, split) for split in ("train", "validation", "test")]
    assert sum(map(len, parts)) == 6
    with pytest.raises(ValueError, match='split: "all", expected "train", "validation" or "test"'):
        benbv.Shards(data, "all")
    with pytest.raises(FileNotFoundError, match="manifest.json"):
        benbv.Shards(data / "shards")


def test_damage_is_told(data, tmp_path):
    path = next(data.glob("shards/**/*.safetensors"))
    bytes_ = bytearray(path.read_bytes())
    bytes_[-5] ^= 1
    broken = tmp_path / "broken.safetensors"
    broken.write_bytes(bytes_)
    with pytest.raises(ValueError, match="broken.safetensors.*damaged"):
        benbv.Shards(broken)


def test_the_reader_in_the_documentation(data):
    pytest.importorskip("safetensors")
    text = (ROOT / "docs/formats.md").read_text()
    (code,) = re.findall(r"```python\n(.*?)```", text, re.S)
    assert len(code.strip().splitlines()) == 5
    path = next(data.glob("shards/**/*.safetensors"))
    names = {"path": path}
    exec(code, names)
    expected = benbv.Shards(path)
    assert len(names["clouds"]) == len(expected)
    for cloud, scores, sample in zip(names["clouds"], names["scores"], expected):
        np.testing.assert_array_equal(cloud, sample["points"])
        np.testing.assert_array_equal(scores, sample["scores"])


def test_tensors_for_torch(data, monkeypatch):
    """PyTorch is too large to install for this: what is asked of it stands in."""
    torch = types.ModuleType("torch")
    torch.float32 = np.float32
    torch.as_tensor = lambda value, dtype: np.asarray(value, dtype)
    utils, sets = types.ModuleType("torch.utils"), types.ModuleType("torch.utils.data")
    sets.Dataset = object
    for name, module in (("torch", torch), ("torch.utils", utils), ("torch.utils.data", sets)):
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.delitem(sys.modules, "benbv.torch", raising=False)
    from benbv.torch import ShardDataset

    samples = ShardDataset(data, points=64)
    assert len(samples) == 6
    assert samples[0]["points"].shape == samples[0]["normals"].shape == (64, 3)
    assert samples[0]["scores"].dtype == np.float32 and isinstance(samples[0]["object"], str)
    assert len(ShardDataset(data)[5]["points"]) == len(benbv.Shards(data)[5]["points"])
    monkeypatch.delitem(sys.modules, "benbv.torch")
