"""A picture of the node's markers, from the messages alone: what RViz would show of them."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from mpl_toolkits.mplot3d.art3d import Line3DCollection

POINTS, LINE_LIST = 8, 5


def draw(markers, path):
    figure = plt.figure(figsize=(8, 5.2), dpi=100, facecolor="#20242b")
    axes = figure.add_axes([0, 0, 1, 1], projection="3d", facecolor="#20242b")
    everything = []
    for marker in markers:
        points = np.array([[p.x, p.y, p.z] for p in marker.points])
        everything.append(points)
        one = (marker.color.r, marker.color.g, marker.color.b)
        if marker.type == POINTS:
            axes.scatter(*points.T, s=2 if marker.ns == "cloud" else 6, color=one, depthshade=False, linewidths=0)
        elif marker.type == LINE_LIST:
            colors = [(c.r, c.g, c.b) for c in marker.colors][::2] or [one]
            width = 2.5 if marker.ns == "next_view" else 0.7
            axes.add_collection3d(Line3DCollection(points.reshape(-1, 2, 3), colors=colors, linewidths=width))
    low, high = np.vstack(everything).min(0), np.vstack(everything).max(0)
    middle, half = (low + high) / 2, 0.36 * (high - low).max()
    for set_limits, m in zip((axes.set_xlim, axes.set_ylim, axes.set_zlim), middle):
        set_limits(m - half, m + half)
    axes.set_box_aspect((1, 1, 1))
    axes.view_init(elev=18, azim=-35)
    axes.set_axis_off()
    figure.savefig(path, facecolor=figure.get_facecolor())
