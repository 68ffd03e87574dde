"""A results store without a run: three methods, twelve frames, five codings each, with failures and skips."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from shading_atlas_bench.reports.store.results import Store

FRAMES = 12
CODINGS = (("h264", 5), ("h264", 10), ("h264", 25), ("h264", 35), ("none", None))
METHODS = {  # name to variant, milliseconds per frame, error
    "grid": ("cell=8", 5.0, 0.16),
    "sas": ("max_block=256,reuse=true,superblock=256", 11.0, 0.061),
    "bins": ("alpha=0.5,levels=6", 7.5, 0.082),
}
PLAN: dict[str, Any] = {
    "settings": {"scene": "hall", "frames": FRAMES, "crf": [5, 10, 25, 35], "seed": 0},
    "scene_hash": "5ce0e",
}
COMMON = {
    "scene": "hall", "scene_hash": "5ce0e", "path": "walk", "path_hash": "9a7b", "frame_rate": 60.0,
    "width": 320, "height": 180, "fov": 60.0, "cell_radius": 0.08, "cell_fov": 80.0, "latency": 50.0,
    "device": "cpu", "seed": 0, "atlas_width": 512, "atlas_height": 512,
}  # fmt: skip


def frame_rows(method: str, frame: int, slower: float = 1.0) -> list[dict]:
    """The rows of one frame; `grid` overflows in frame 7 and `bins` fails in frame 4."""
    if (method, frame) in (("grid", 7), ("bins", 4)):
        status, reason = ("overflow", "31 triangles found no cell") if method == "grid" else ("failed", "out of memory")
        return [COMMON | {"codec": c, "crf": q, "status": status, "reason": reason} for c, q in CODINGS]
    _, cost, error = METHODS[method]
    wave = 1 + 0.2 * math.sin(frame * 0.9) + 0.03 * frame
    rows = []
    for codec, crf in CODINGS:
        video = int(600_000 * (1 + error * 4) * wave * math.exp(-0.09 * crf)) if crf is not None else 512 * 512 * 3
        row = COMMON | {
            "codec": codec, "crf": crf, "status": "ok", "pvs_triangles": 24_000 + 40 * frame,
            "placed_triangles": 24_000 + 40 * frame, "samples": int(160_000 * wave), "fill": 0.6 * wave / 1.4,
            "pvs_ms": 120.0 + frame, "structs_ms": cost * wave * slower, "gather_ms": 18 * wave * slower,
            "server_ms": (cost + 18) * wave * slower, "client_ms": 14.0 + frame / 7, "encode_ms": 40.0,
            "decode_ms": 9.0, "wall_ms": 1.2 * (cost + 18) * wave * slower, "bytes_video": video,
            "bytes_metadata": 30_000, "bytes_geometry": 410_000, "bytes_total": video + 440_000,
            "compression_ratio": video / (3 * 512 * 512), "coherence": None if frame == 0 else 0.8 / wave,
            "peak_mb": 611.5,
        }  # fmt: skip
        if codec == "none" or crf == 25:
            loss = error * wave * (0.8 if codec == "none" else 1.0)
            row |= {
                "flip": loss, "dssim": loss / 3, "iwssim": 1 - loss / 2, "psnr": -20 * math.log10(loss),
                "delta_e": 20 * loss, "stretch_l2": 0.9 + loss, "stretch_linf": 2 + loss, "missing_px": 0.002 * wave,
                "holes_px": 0.0,
            }  # fmt: skip
        rows.append(row)
    return rows


def make_store(folder: Path, frames: int = FRAMES, slower: float = 1.0, order: int = 1) -> None:
    """Fill a new store; `order` -1 commits the frames backwards, which must change no file."""
    with Store(folder) as store:
        store.set_plan(PLAN)
        store.notes["device/name"] = "cpu-skylake"
        store.notes["device/version"] = "OpenCL 3.0 PoCL 7.1"
        store.notes["environment/machine"] = "x86_64, 2 cores"
        store.notes["environment/numpy"] = "2.4.1"
        store.notes["prepare_ms/sas"] = "412.0"
        store.notes["environment/date"] = "2030-01-02 03:04 UTC"
        store.notes["warning/noise"] = "Repeated timings spread by 14 %: other programs were running."
        store.notes["skipped/normal maps"] = "no material has a normal map"
        store.notes["skipped/slanted triangles"] = "no slanted triangle is in view <of any frame>"
        store.notes["scene/repair"] = "12 degenerate triangles were dropped."
        for method, (variant, cost, _) in METHODS.items():
            for frame in range(frames)[::order]:
                rows = frame_rows(method, frame, slower)
                failed = rows[0]["status"] != "ok"
                stages = [("pvs/draw", 120.0 + frame, 12)]
                if not failed:
                    stages += [
                        ("structs/size", cost * 0.4 * slower, 2), ("structs/place", cost * 0.6 * slower, 5),
                        ("gather/emit", 4.0 * slower, 1), ("gather/shade", 14.0 * slower, 3), ("client/draw", 14.0, 7),
                    ]  # fmt: skip
                statistics = {} if failed else {"blocks": 2000.0 + 30 * frame, "bias": float(frame // 5)}
                statistics |= {"reference_ms": 12.0}
                repeats = [(0, "server", 20.0), (1, "server", 21.0)]
                store.commit_frame(method, variant, frame, rows, stages, statistics, repeats)


def make_picture(seed: float, width: int = 320, height: int = 180) -> np.ndarray:
    """A picture with edges and gradients, uint8 (h, w, 3); equal seeds give equal pictures."""
    y, x = np.mgrid[0:height, 0:width]
    base = np.stack([x / width, y / height, 0.5 + 0.5 * np.sin(x / 9) * np.cos(y / 11)], axis=-1)
    noise = np.random.default_rng(int(10 * seed)).normal(0, 0.03 * seed, base.shape)
    return np.clip((base + noise) * 255, 0, 255).astype(np.uint8)


def alter(folder: Path, statement: str, *values: object) -> None:
    """Change a store as somebody would who wants it to be believed: its seal holds afterwards."""
    with Store(folder, must_exist=True) as store:
        connection = store._database._connection
        connection.execute(statement, values)
        connection.execute("UPDATE seal SET value = ?", (store._database._sum(),))
