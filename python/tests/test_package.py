"""The package as a whole: what it says of itself, its stubs, its programs."""

import ast
import inspect
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from conftest import ROOT, program

import benbv
from benbv import _benbv, _programs


def test_the_stubs_name_what_there_is():
    tree = ast.parse(Path(inspect.getfile(benbv)).with_name("_benbv.pyi").read_text())
    told = {}
    for node in tree.body:
        if isinstance(node, ast.FunctionDef):
            told[node.name] = None
        elif isinstance(node, ast.ClassDef):
            told[node.name] = {m.name for m in node.body if isinstance(m, ast.FunctionDef)} - {"__new__", "__len__"}
        elif isinstance(node, ast.AnnAssign):
            told[node.target.id] = None
    there = {name for name in dir(_benbv) if not name.startswith("_")}
    assert there == set(told)
    for name, methods in told.items():
        if methods is not None and name != "PlanError":
            assert {m for m in dir(getattr(_benbv, name)) if not m.startswith("_")} == methods, name


def test_everything_public_has_help():
    for name in benbv.__all__:
        thing = getattr(benbv, name)
        assert name == "Sample" or (inspect.getdoc(thing) or "").strip(), name
    for cls in (benbv.Session, benbv.Episode, benbv.View, benbv.State, benbv.Scene, benbv.Candidate):
        for name, member in inspect.getmembers(cls):
            if not name.startswith("_") and (callable(member) or inspect.isdatadescriptor(member)):
                assert (inspect.getdoc(member) or "").strip(), f"{cls.__name__}.{name}"


def test_importing_loads_nothing_heavy():
    code = "import sys, benbv; print(*[m for m in ('torch', 'gymnasium', 'matplotlib') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""


def test_programs_are_installed_with_the_package(tmp_path):
    script = Path(sys.executable).with_name("benbv-infer")
    if not script.exists():
        pytest.skip("not installed from a wheel")

    def run(*words):
        return subprocess.run([script, *words], capture_output=True, text=True, check=False, cwd=tmp_path)

    scan = ROOT / "samples/scan1.ply"
    assert run("--scan", scan, "--json").stdout == program("infer", "--scan", scan, "--json")
    assert run("--scan", "nowhere.ply").returncode == 1
    wrong = run("--scn")
    assert wrong.returncode == 2 and "--scan" in wrong.stderr
    for name in ("datagen", "train", "evaluate"):
        words = [script.with_name(f"benbv-{name}"), "--version"]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        assert done.stdout.startswith(f"{name} 0.1.0")


def test_ctrl_c_ends_a_program_as_it_ends_one_without_python(monkeypatch):
    handlers = []

    def run(name, words):
        handlers.append(signal.getsignal(signal.SIGINT))
        return 0

    monkeypatch.setattr(_benbv, "run_program", run)
    before = signal.getsignal(signal.SIGINT)
    try:
        # Of processes in the background, shells have it ignored, and so it stays.
        for handler in (signal.default_int_handler, signal.SIG_IGN):
            signal.signal(signal.SIGINT, handler)
            with pytest.raises(SystemExit):
                _programs.infer()
    finally:
        signal.signal(signal.SIGINT, before)
    assert handlers == [signal.SIG_DFL, signal.SIG_IGN]
