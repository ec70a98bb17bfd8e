"""What is logged for the Rerun viewer; a stand-in where the viewer, 170 MB, is not installed."""

import importlib
import sys
import types

import numpy as np
import pytest

import benbv


@pytest.fixture
def logged(monkeypatch):
    """The module `benbv.rerun` and what it logs, by path."""
    entities = {}
    stand_in = types.ModuleType("rerun")
    for kind in ("Points3D", "Arrows3D", "Transform3D", "Pinhole", "Clear"):
        setattr(stand_in, kind, lambda *args, kind=kind, **words: (kind, args, words))
    stand_in.ViewCoordinates = types.SimpleNamespace(RDF="RDF")
    stand_in.RecordingStream = object
    stand_in.log = lambda path, entity, recording=None: entities.setdefault(path, []).append(entity)
    monkeypatch.setitem(sys.modules, "rerun", stand_in)
    monkeypatch.delitem(sys.modules, "benbv.rerun", raising=False)
    yield importlib.import_module("benbv.rerun"), entities
    sys.modules.pop("benbv.rerun", None)


def test_cloud_candidates_and_next_view_are_logged(sheet, logged):
    module, entities = logged
    session = benbv.Session(0.8)
    session.add_points(sheet, origin=(0.06, 0.06, 0.8))
    view = session.next_view()
    module.log(session, view)
    (_, (points,), _), = entities["benbv/cloud"]
    assert np.array_equal(points, session.cloud()[0])
    (kind, _, words), = entities["benbv/candidates"]
    assert kind == "Arrows3D" and len(words["origins"]) == len(words["colors"]) == len(view.candidates)
    transform, pinhole = entities["benbv/next"]
    assert np.array_equal(transform[2]["translation"], view.world_from_camera[:3, 3])
    assert type(pinhole[2]["focal_length"]) is float, "Rerun takes no scalars of numpy"
    assert pinhole[2]["focal_length"] == pytest.approx(360 / np.tan(np.radians(35))), "1280 x 720, 70 degrees"
    entities.clear()
    module.log(session, session.next_view(reachable=lambda pose: False), path="cell")
    (kind, _, _), = entities["cell/next"]
    assert kind == "Clear", "no view is left"
    entities.clear()
    module.log(session, benbv.View({**view.raw, "candidates": [], "next": None}, "no boundary"))
    assert [kind for kind, _, _ in entities["benbv/candidates"]] == ["Clear"], "those of the view before are gone"
