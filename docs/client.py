"""A client of `infer --serve --http 127.0.0.1:8350`; needs nothing but Python 3.8. Run: python3 client.py URL"""

import base64
import http.client
import json
import struct
import sys
import time
import urllib.error
import urllib.request
import uuid


class Planner:
    """One session: one object. Lengths are metres, poses world_from_camera."""

    def __init__(self, url="http://127.0.0.1:8350", **config):
        self.url = url
        self.session = self._ask("POST", "/sessions", {"config": config})["session"]

    def add_points(self, points, origin=None):
        """points: [(x, y, z), ...]; origin: where the camera was, if known."""
        packed = b"".join(struct.pack("<3f", *p) for p in points)
        scan = {"points_base64": base64.b64encode(packed).decode()}
        if origin is not None:
            scan["from"] = list(origin)
        return self._ask("POST", f"/sessions/{self.session}/scans", scan)

    def add_depth(self, png, intrinsics, world_from_camera, misses="unknown"):
        """png: bytes of a 16-bit depth image in mm; intrinsics: fx, fy, cx, cy; world_from_camera: 4 x 4."""
        image = base64.b64encode(png).decode()
        depth = dict(png_base64=image, intrinsics=intrinsics, world_from_camera=world_from_camera, misses=misses)
        return self._ask("POST", f"/sessions/{self.session}/scans", {"depth": depth})

    def next_view(self, **changes):
        return self._ask("POST", f"/sessions/{self.session}/next", changes)

    def undo(self):
        return self._ask("POST", f"/sessions/{self.session}/undo", {})

    def reset(self):
        return self._ask("POST", f"/sessions/{self.session}/reset", {})

    def export(self):
        return self._ask("GET", f"/sessions/{self.session}/export")

    def close(self):
        return self._ask("DELETE", f"/sessions/{self.session}")

    def _ask(self, method, path, body=None):
        data = None if body is None else json.dumps(body).encode()
        # With a key, a request whose answer was lost can be sent again without being done twice.
        headers = {"Content-Type": "application/json", "Idempotency-Key": uuid.uuid4().hex}
        request = urllib.request.Request(self.url + path, data, headers, method=method)
        for attempts_left in (2, 1, 0):
            try:
                with urllib.request.urlopen(request, timeout=150) as answer:
                    return json.load(answer)
            except urllib.error.HTTPError as error:
                if error.code != 503 or attempts_left == 0:
                    raise RuntimeError(json.load(error)["error"]["message"]) from None
            except (urllib.error.URLError, http.client.HTTPException, ConnectionError):
                if attempts_left == 0:
                    raise
            time.sleep(1)


if __name__ == "__main__":
    planner = Planner(*sys.argv[1:2], working_distance_m=0.8)
    sheet = [(0.004 * i, 0.004 * j, 0.0) for i in range(30) for j in range(30)]
    print(planner.add_points(sheet, origin=(0.06, 0.06, 0.8)))
    answer = planner.next_view()
    print("next view:", json.dumps(answer["next"]["world_from_camera"]["matrix"]))
    print("expected gain:", answer["stop"]["expected_gain"])
    planner.close()
