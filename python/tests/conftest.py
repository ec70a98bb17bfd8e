"""What the tests share: the repository's samples and programs."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import benbv

ROOT = Path(__file__).parents[2]
SAMPLES = ROOT / "samples"
DATA = ROOT.parent / "shared" / "data" / "scans"


def programs() -> Path:
    """Where the programs are that were built together with the wheel."""
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    return Path(os.environ.get("BENBV_PROGRAMS", target / "debug"))


def program(name: str, *arguments: Any) -> str:
    """What a program prints."""
    path = programs() / name
    if not path.exists():
        pytest.skip(f"{path} is not built (cargo build --workspace --bins)")
    done = subprocess.run([path, *map(str, arguments)], capture_output=True, text=True, check=False, cwd=ROOT)
    assert done.returncode in (0, 3), done.stderr
    return done.stdout


def infer(*arguments: Any) -> dict[str, Any]:
    """What `infer --json` answers."""
    answer: dict[str, Any] = json.loads(program("infer", "--json", *arguments))
    return answer


@pytest.fixture(scope="session")
def ball() -> benbv.Scene:
    """A ball with lobes, 0.2 m across."""
    rings, sectors = 40, 60
    polar, azimuth = np.meshgrid(np.linspace(0, np.pi, rings + 1), np.arange(sectors) * 2 * np.pi / sectors, indexing="ij")
    radius = 1 + 0.35 * np.sin(polar) * np.cos(5 * azimuth)
    directions = np.stack([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), 1.3 * np.cos(polar)], -1)
    vertices = (radius[..., None] * directions).reshape(-1, 3)
    faces = []
    for ring in range(rings):
        for sector in range(sectors):
            a, b = ring * sectors + sector, ring * sectors + (sector + 1) % sectors
            faces += [(a, a + sectors, b + sectors), (a, b + sectors, b)]
    return benbv.Scene(vertices, np.array(faces)).normalized(0.2)


@pytest.fixture
def sheet() -> np.ndarray[Any, np.dtype[np.float64]]:
    """900 points of a square."""
    x, y = np.meshgrid(np.arange(30) * 0.004, np.arange(30) * 0.004)
    return np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3)
