"""The views that lists belong to."""

from __future__ import annotations

from shading_atlas_bench.packers.interface import Frame, View


def list_views(frame: Frame) -> tuple[View, ...]:
    """The cell's views. One alone is widened by less than two pixels so that its pixels are the client's when the
    client has not moved; not without a predicted client view."""
    server = frame.server
    if len(frame.cell_views) > 1 or not frame.predicted:
        return frame.cell_views
    client = frame.predicted[0]
    width = client.width + 2 * max(0, -(-(server.width - client.width) // 2))
    height = client.height + 2 * max(0, -(-(server.height - client.height) // 2))
    projection = server.projection.copy()
    projection[0, 0] = client.projection[0, 0] * client.width / width
    projection[1, 1] = client.projection[1, 1] * client.height / height
    return (View(server.view, projection, width, height),)
