"""Next-best-view planning for 3D scanning: the planner, the simulator and the benchmark.

Lengths are metres, angles radians unless a name says otherwise. Poses are `world_from_camera`: 4 x 4 matrices that map
coordinates of the camera (+X right, +Y down, +Z forward) to the world. Arrays may have any strides, be read-only, and hold
floats or integers of any size; NaN in points and depths stands for no return.
"""

from ._benbv import VERSION as __version__
from ._benbv import PlanError, Scene, State
from .evaluation import Policy, Report, evaluate
from .files import Calibration, Cloud, read_arm, read_camera, read_cloud, read_depth, read_mesh, read_poses
from .session import ScanReport, Session
from .shards import Sample, Shards
from .simulate import Camera, Episode, chamfer, coverage, depth_to_points, hausdorff, look_at, overlap, scan
from .view import Candidate, Objection, Reached, Stop, TableStop, View

__all__ = [
    "Calibration",
    "Camera",
    "Candidate",
    "Cloud",
    "Episode",
    "Objection",
    "PlanError",
    "Policy",
    "Reached",
    "Report",
    "Sample",
    "ScanReport",
    "Scene",
    "Session",
    "Shards",
    "State",
    "Stop",
    "TableStop",
    "View",
    "__version__",
    "chamfer",
    "coverage",
    "depth_to_points",
    "evaluate",
    "hausdorff",
    "look_at",
    "overlap",
    "read_arm",
    "read_camera",
    "read_cloud",
    "read_depth",
    "read_mesh",
    "read_poses",
    "scan",
]
