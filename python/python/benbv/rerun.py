"""Sessions in the Rerun viewer; needs `pip install benbv[rerun]`.

    import rerun
    import benbv.rerun

    rerun.init("scan", spawn=True)
    benbv.rerun.log(session, session.next_view())
"""

from __future__ import annotations

import numpy as np
import rerun as rr

from .session import Session
from .view import View

GREY, YELLOW = (160, 170, 180), (255, 215, 0)


def log(
    session: Session, view: View | None = None, *, path: str = "benbv", recording: rr.RecordingStream | None = None
) -> None:
    """Logs the cloud of a session and, if given, what it answered: candidates from red to green by their score, those ruled out in
    grey, and the next view as a camera. All of it lies under `path`, world frame, metres.
    """
    points, _ = session.cloud()
    rr.log(f"{path}/cloud", rr.Points3D(points, colors=[GREY]), recording=recording)
    if view is None:
        return
    if view.candidates:
        allowed = [c.score for c in view.candidates if not c.objections]
        low, high = min(allowed, default=0.0), max(allowed, default=1.0)
        share = [(c.score - low) / max(high - low, 1e-12) for c in view.candidates]
        colors = [
            GREY if c.objections else (int(255 * (1 - s)), int(255 * s), 60) for c, s in zip(view.candidates, share)
        ]
        origins = np.array([c.position for c in view.candidates])
        vectors = np.array([0.15 * (c.target - c.position) for c in view.candidates])
        labels = ["; ".join(o.reason for o in c.objections) or f"{c.score:.3f}" for c in view.candidates]
        arrows = rr.Arrows3D(origins=origins, vectors=vectors, colors=colors, labels=labels, show_labels=False)
        rr.log(f"{path}/candidates", arrows, recording=recording)
    else:
        rr.log(f"{path}/candidates", rr.Clear(recursive=False), recording=recording)
    if view.next is None:
        rr.log(f"{path}/next", rr.Clear(recursive=True), recording=recording)
        return
    pose, camera = view.next.world_from_camera, session.config["camera"]
    rr.log(f"{path}/next", rr.Transform3D(translation=pose[:3, 3], mat3x3=pose[:3, :3]), recording=recording)
    focal = 0.5 * camera["height"] / np.tan(np.radians(camera["fov_y_deg"]) / 2)
    focal = float((camera.get("intrinsics") or [focal])[0])
    image = rr.Pinhole(
        focal_length=focal,
        width=camera["width"],
        height=camera["height"],
        camera_xyz=rr.ViewCoordinates.RDF,
        image_plane_distance=0.1 * view.next.working_distance,
        color=YELLOW,
    )
    rr.log(f"{path}/next", image, recording=recording)
