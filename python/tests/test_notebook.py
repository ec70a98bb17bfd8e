"""The notebook runs, and is kept without what it shows."""

import json

import pytest
from conftest import ROOT


def test_the_notebook_runs_and_holds_no_output(monkeypatch):
    matplotlib = pytest.importorskip("matplotlib")
    matplotlib.use("Agg")
    from matplotlib import pyplot

    shown = []
    monkeypatch.setattr(pyplot, "show", lambda: shown.append(pyplot.gcf()) or pyplot.close("all"))
    cells = [c for c in json.loads((ROOT / "python/examples/scan.ipynb").read_text())["cells"] if c["cell_type"] == "code"]
    assert all(c["outputs"] == [] and c["execution_count"] is None for c in cells)
    names = {}
    for cell in cells:
        exec(compile("".join(cell["source"]), "scan.ipynb", "exec"), names)
    assert len(shown) == 3
    assert (names["depth"] > 0).sum() > 1000 and len(names["cameras"]) >= 20
    curves = {e["policy"]: e["coverages"] for e in names["report"].episodes}
    assert curves["auto"][0] == curves["random-sphere"][0] and curves["auto"][-1] > 0.8
