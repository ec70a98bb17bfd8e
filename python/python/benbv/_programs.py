"""The four programs, as the scripts `benbv-datagen`, `benbv-train`, `benbv-infer` and `benbv-evaluate`."""

import os
import signal
import sys

from . import _benbv


def _run(name: str) -> None:
    # Python would raise it only once the program has ended.
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    # What is printed goes where the process began to print; Python holds nothing back.
    sys.stdout.flush()
    raise SystemExit(_benbv.run_program(name, [name, *map(os.fspath, sys.argv[1:])]))


def datagen() -> None:
    """Simulated scans and training samples."""
    _run("datagen")


def train() -> None:
    """Training of the network."""
    _run("train")


def infer() -> None:
    """The next view of a scan."""
    _run("infer")


def evaluate() -> None:
    """Policies against each other."""
    _run("evaluate")
