"""The thesis' own experiment (`bench run --preset ppll-2014`): its tables A.1 and A.2 and figures 6.1 to 6.3 made anew.

Bunny, dragon and buddha, half transparent, turn by 5 degrees per frame in one view, which is the server's and the
client's. Published numbers stand beside ours; sizes and times are compared as ratios.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from statistics import fmean, median
from typing import Any

import numpy as np

from shading_atlas_bench.harness.console import make_console
from shading_atlas_bench.harness.errors import InputError
from shading_atlas_bench.harness.experiments.ppll_2014_report import write_report
from shading_atlas_bench.harness.measure.codecs import pack_lz4
from shading_atlas_bench.harness.run.folder import make_folder
from shading_atlas_bench.harness.workload.cache_key import drawn_hash
from shading_atlas_bench.harness.workload.methods import find_methods
from shading_atlas_bench.harness.workload.settings import Settings, settings_of
from shading_atlas_bench.harness.workload.upload import upload_scene
from shading_atlas_bench.harness.workload.views import Pose, client_view
from shading_atlas_bench.kernels.cache import cache_root
from shading_atlas_bench.kernels.device import Device
from shading_atlas_bench.kernels.fragments.blend import blend_lists
from shading_atlas_bench.packers.interface import Decoded, Frame, Image, ServerScene
from shading_atlas_bench.packers.ppll import PerPixelLinkedLists
from shading_atlas_bench.packers.ppll.kernels.lists import Lists
from shading_atlas_bench.packers.ppll.wire import decode
from shading_atlas_bench.reports.store.csv_files import replace_file, text_cell
from shading_atlas_bench.scenes.features import content_digest, find_features
from shading_atlas_bench.scenes.load import load_scene, real_scenes
from shading_atlas_bench.scenes.model import Scene
from shading_atlas_bench.scenes.paths import make_path

MODELS = {
    "bunny": "stanford_bunny/bunny.ply",
    "dragon": "stanford_dragon/dragon_100k.obj",
    "buddha": "stanford_buddha/buddha_54k.obj",
}
SIZES = ((1024, 768), (1280, 720), (1600, 900))
MODES = ("depth-limited", "difference", "bilateral")
LAYERS = 6  # beyond which the thesis saw no difference (6.1)
MOST_LAYERS = 10  # of figure 6.2
ALPHA = 0.5
FOV = 45.0
ENCODING = ("blend", "difference", "transform", "match", "hold")  # stages beyond building and limiting
NETWORK = 125e6  # bytes per second of the thesis' gigabit network
FRAMES = 12
TAKEN = ("method", "frames", "size", "device")  # options of bench run that change the experiment
SET = ("mode", "layers", "layout", "preblend")  # parameters that its modes set, or that not all of them can have

Row = dict[str, Any]
Group = tuple[str, str, int, int]  # mode, model, width and height


@dataclass(frozen=True)
class Experiment:
    """What is asked for: frames per model, picture sizes, a device's name or None, and parameters of ppll beside those
    that the modes set."""

    frames: int = FRAMES
    sizes: tuple[tuple[int, int], ...] = SIZES
    device: str | None = None
    parameters: Mapping[str, Any] = field(default_factory=dict)


def run_experiment(wanted: Experiment, out: Path) -> None:
    """Write frames.csv, layers.csv, table_a1.csv, table_a2.csv and report.html into `out`.

    Raises InputError if that cannot be a folder.
    """
    make_folder(out)
    device, console = Device.open(wanted.device), make_console(stderr=True)
    note = stand_ins()
    if note:
        console.print(note)
    frames: list[Row] = []
    layers: list[Row] = []
    for name in MODELS:
        scene = upload_scene(device, half_transparent(name))
        for size in wanted.sizes:
            console.print(f"{name} at {size[0]}x{size[1]} ...")
            for mode in MODES:
                frames += measure(scene, name, mode, size, wanted)
            layers += bad_pixels(scene, name, size)
    tables = {"frames": frames, "layers": layers, "table_a1": sizes_table(frames), "table_a2": times_table(frames)}
    for table, rows in tables.items():
        replace_file(out / f"{table}.csv", as_csv(rows))
    write_report(out, tables, note)
    console.print(f"{out}/report.html  " + "  ".join(f"{table}.csv" for table in tables))


def show_experiment(wanted: Experiment, out: Path) -> None:
    """Print what `run_experiment` would measure; runs no kernel."""
    device, console = Device.open(wanted.device), make_console()
    sizes = ", ".join(f"{width}x{height}" for width, height in wanted.sizes)
    console.print(f"models {', '.join(MODELS)}; sizes {sizes}; modes {', '.join(MODES)}; frames each: {wanted.frames}")
    if note := stand_ins():
        console.print(note)
    console.print(f"device {device.name}")
    console.print(f"{len(MODELS) * len(wanted.sizes) * len(MODES) * wanted.frames} frames; results in {out}")


def model_file(name: str) -> Path | None:
    """A model's file in the folder of real scenes (BENCH_SCENES); None where it is not there."""
    folder = real_scenes()
    return folder / MODELS[name] if folder and (folder / MODELS[name]).is_file() else None


def stand_ins() -> str:
    """A sentence about the models that are not there; nothing if all are."""
    missing = [name for name in MODELS if model_file(name) is None]
    if not missing:
        return ""
    remedy = "let BENCH_SCENES name the folder that has these models"
    return f"Shells stand in for {', '.join(missing)}: published numbers are of other surfaces; {remedy}."


def half_transparent(name: str) -> Scene:
    """A model, else the shells of another seed for each, alpha 0.5."""
    file, seed = model_file(name), list(MODELS).index(name)
    scene = load_scene(str(file or "shells"), seed=seed, cache=cache_root() / "scenes")
    materials = [
        replace(m, base_colour=(*m.base_colour[:3], ALPHA), alpha_mode="blend", double_sided=True)
        for m in scene.materials
    ]
    scene = replace(scene, materials=materials, lights=[replace(light, shadows=False) for light in scene.lights])
    scene.features = find_features(scene)
    scene.content_hash = content_digest(scene)
    return scene


def model_hashes() -> dict[str, str]:
    """A hash of everything that is drawn of each model, by its name. Raises SceneError."""
    return {name: drawn_hash(half_transparent(name)) for name in MODELS}


def views(scene: ServerScene, size: tuple[int, int], frames: int) -> Iterator[Frame]:
    """The turntable's frames: one view for server and client, and all triangles."""
    path = make_path(scene.host, "turntable", frames)
    low, high = scene.host.bounds
    near = 1e-3 * float(np.linalg.norm(high - low, axis=-1))
    pvs = np.arange(scene.host.triangle_count, dtype=np.int32)
    uploaded = scene.device.upload(pvs)
    for index in range(path.frames):
        pose = Pose(path.positions[index], path.orientations[index])
        view = client_view(pose, FOV, *size, near)
        yield Frame(index, scene, view, 0.0, FOV, pvs, uploaded, (), *size)


def measure(scene: ServerScene, name: str, mode: str, size: tuple[int, int], wanted: Experiment) -> Iterator[Row]:
    """One row per frame of a mode: sizes in both layouts, times, fragments, and how the display's picture differs.

    Raises InputError for parameters out of range.
    """
    chosen: dict[str, Any] = {"mode": mode, "layers": LAYERS if mode == "depth-limited" else 0}
    chosen |= {"merge": "paper" if mode == "bilateral" else "exact", **wanted.parameters}
    packer, other = PerPixelLinkedLists(**chosen), PerPixelLinkedLists(**chosen | {"layout": "shuffled"})
    scene = packer.scene_shaded(scene)
    display = packer.client(scene.shipped)
    for each in (packer, other):
        try:
            each.prepare(scene)
        except ValueError as error:  # a parameter out of range
            raise InputError(str(error)) from error
    for frame in views(scene, size, wanted.frames):
        with scene.device.record() as record:
            payload = packer.pack(frame)
        shuffled = other.pack(frame)
        with scene.device.record() as opaque:
            view = frame.server
            scene.rasteriser.draw(view.view, view.projection, view.width, view.height)
        with scene.device.record() as merging:
            display.receive(Decoded({}, payload.blobs, b"", payload.lists))
            image = display.draw(frame.server)
        statistics = payload.statistics
        header = int(statistics["header_bytes"])
        compressed = [len(pack_lz4(each.lists)["lists"]) for each in (payload, shuffled)]
        yield {
            "model": name,
            "mode": mode,
            "width": size[0],
            "height": size[1],
            "frame": frame.index,
            "fragments_built": statistics["fragments_built"],
            "fragments_sent": statistics["fragments_sent"],
            "fragments_deleted": statistics["fragments_deleted"],
            "pixels_covered": size[0] * size[1] - statistics["pixels_of_0_layers"],
            "raw_bytes": payload.raw_bytes,
            "list_bytes": payload.raw_bytes - header,
            "padded_bytes": statistics["padded_bytes"],
            "padded_list_bytes": statistics["padded_bytes"] - header,
            "padded_list_lz4_bytes": lz4_padded(payload.lists["lists"][header:], mode),
            "lz4_bytes": compressed[0],
            "lz4_shuffled_bytes": compressed[1],
            "opaque_ms": opaque.total("raster"),
            "building_ms": record.total("structs/build"),
            "encoding_ms": sum(record.total(f"structs/{stage}") for stage in ENCODING),
            "server_ms": record.total("structs") + record.total("gather"),
            "client_ms": sum(merging.milliseconds.values()),
            "network_ms": compressed[0] / NETWORK * 1000,
            "bad_pixels": _bad(frame, image),
        }


def lz4_padded(fragments: bytes, mode: str) -> int:
    """Bytes that LZ4 leaves of fragments of the published layout, padded to 16 or 32 bytes (table 2.1)."""
    words = 6 if mode == "bilateral" else 3
    rows = np.frombuffer(fragments, "<u4").reshape(-1, words)
    return len(pack_lz4({"lists": np.pad(rows, ((0, 0), (0, words // 3))).tobytes()})["lists"])


def _bad(frame: Frame, image: Image) -> float:
    """Share of pixels where the display's picture differs from the full lists', by more than rounding."""
    full = PerPixelLinkedLists(mode="full")
    full.prepare(frame.scene)
    client = full.client(frame.scene.shipped)
    complete = full.pack(frame)
    client.receive(Decoded({}, complete.blobs, b"", complete.lists))
    expected = client.draw(frame.server).rgb.get().astype(int)
    return float((np.abs(image.rgb.get() - expected).max(axis=-1) > 1).mean())


def bad_pixels(scene: ServerScene, name: str, size: tuple[int, int]) -> Iterator[Row]:
    """Figure 6.2: share of the first frame's pixels that a limit to so many layers changes."""
    device = scene.device
    frame = next(views(scene, size, 1))
    pictures = {}
    for layers in (*range(1, MOST_LAYERS + 1), 0):
        packer = PerPixelLinkedLists(mode="depth-limited" if layers else "full", layers=layers, opacity=2.0)
        packer.prepare(scene)
        payload = packer.pack(frame)
        (message,) = decode(payload.blobs["head"], payload.lists["lists"])
        lists = Lists.upload(device, *size, *message.nodes[0])
        picture = device.zeros((lists.pixels, 4), np.uint8)
        blend_lists(device, lists.pixels, lists.offsets, lists.rows, lists.words, picture, picture, "blend")
        pictures[layers] = picture.get().astype(int)
    for layers in range(1, MOST_LAYERS + 1):
        bad = (np.abs(pictures[layers] - pictures[0]).max(axis=-1) > 1).mean()
        yield {"model": name, "width": size[0], "height": size[1], "layers": layers, "bad_pixels": float(bad)}


# Table A.1: KiB uncompressed and compressed; by mode and model, at 1024x768, 1280x720, 1600x900.
PUBLISHED_SIZES = {
    ("depth-limited", "bunny"): ((3660, 2569), (3217, 2057), (5027, 3203)),
    ("depth-limited", "dragon"): ((3745, 2503), (3291, 2214), (5143, 3398)),
    ("depth-limited", "buddha"): ((3441, 2292), (3025, 2002), (4726, 3099)),
    ("difference", "bunny"): ((7318, 2096), (6432, 1649), (10049, 2935)),
    ("difference", "dragon"): ((7039, 1859), (6187, 1594), (9667, 2702)),
    ("difference", "buddha"): ((7663, 2264), (6735, 1988), (10523, 3051)),
    ("bilateral", "bunny"): ((7328, 2115), (6440, 2598), (10063, 2799)),
    ("bilateral", "dragon"): ((7849, 2327), (6897, 2792), (10777, 3038)),
    ("bilateral", "buddha"): ((7190, 2202), (6319, 2635), (9874, 2875)),
}
# Table A.2: milliseconds of sending, and frames per second.
PUBLISHED_TIMES = {
    ("depth-limited", "bunny"): ((52, 5.8), (145, 5.7), (63, 3.8)),
    ("depth-limited", "dragon"): ((60, 4.5), (98, 5.1), (63, 4.0)),
    ("depth-limited", "buddha"): ((110, 5.6), (111, 5.7), (82, 4.6)),
    ("difference", "bunny"): ((69, 5.0), (88, 4.8), (96, 3.7)),
    ("difference", "dragon"): ((111, 4.3), (68, 5.0), (135, 3.2)),
    ("difference", "buddha"): ((95, 4.5), (85, 4.8), (119, 3.6)),
    ("bilateral", "bunny"): ((111, 2.1), (196, 1.9), (145, 1.7)),
    ("bilateral", "dragon"): ((145, 1.9), (105, 2.2), (151, 1.5)),
    ("bilateral", "buddha"): ((112, 2.1), (118, 2.3), (131, 1.7)),
}


def grouped(frames: list[Row]) -> dict[Group, list[Row]]:
    """Rows by group, in order; the first frame, which sends everything, only where alone."""
    groups: dict[Group, list[Row]] = {}
    for row in frames:
        groups.setdefault((row["mode"], row["model"], row["width"], row["height"]), []).append(row)
    return {key: rows[1:] or rows for key, rows in groups.items()}


def sizes_table(frames: list[Row]) -> list[Row]:
    """Table A.1: mean KiB per frame, and what share of them LZ4 leaves, beside the published share."""
    table = []
    for (mode, model, width, height), rows in grouped(frames).items():
        plain, padded = (fmean(row[name] for row in rows) / 1024 for name in ("raw_bytes", "padded_bytes"))
        packed, shuffled = (fmean(row[name] for row in rows) / 1024 for name in ("lz4_bytes", "lz4_shuffled_bytes"))
        size = (width, height)
        published = PUBLISHED_SIZES[mode, model][SIZES.index(size)] if size in SIZES else None
        table.append(
            {
                "mode": mode,
                "model": model,
                "size": f"{width}x{height}",
                "uncompressed_kib": plain,
                "padded_kib": padded,
                "lz4_kib": packed,
                "lz4_shuffled_kib": shuffled,
                "ratio": packed / plain,
                "ratio_shuffled": shuffled / plain,
                "ratio_published": published and published[1] / published[0],
                "sent_of_built": sum(row["fragments_sent"] for row in rows)
                / sum(row["fragments_built"] for row in rows),
                "bad_pixels": fmean(row["bad_pixels"] for row in rows),
            }
        )
    return table


def times_table(frames: list[Row]) -> list[Row]:
    """Table A.2: sending at 1 Gbit/s, and frames per second of rendering, sending and displaying one after the other;
    both also over the depth-limited mode's of the same model and size, as the published ones. Last the time of building
    over that of drawing the same triangles opaque, layers per covered pixel, and the time of encoding over building."""
    groups = grouped(frames)

    def sending(key: Group) -> float:
        return fmean(row["network_ms"] for row in groups[key])

    def rate(key: Group) -> float:
        return 1000 / fmean(row["server_ms"] + row["network_ms"] + row["client_ms"] for row in groups[key])

    table = []
    for key in groups:
        mode, model, width, height = key
        first = ("depth-limited", model, width, height)
        row = {
            "mode": mode,
            "model": model,
            "size": f"{width}x{height}",
            "sending_ms": sending(key),
            "frames_per_second": rate(key),
            "sending_ratio": sending(key) / sending(first),
            "rate_ratio": rate(key) / rate(first),
            "sending_ratio_published": None,
            "rate_ratio_published": None,
            "building_over_opaque": _median(groups[key], "building_ms", "opaque_ms"),
            "layers": _median(groups[key], "fragments_built", "pixels_covered"),
            "encoding_over_building": _median(groups[key], "encoding_ms", "building_ms") or None,  # none to do
        }
        if (width, height) in SIZES:
            at = SIZES.index((width, height))
            ours, base = PUBLISHED_TIMES[mode, model][at], PUBLISHED_TIMES["depth-limited", model][at]
            row |= {"sending_ratio_published": ours[0] / base[0], "rate_ratio_published": ours[1] / base[1]}
        table.append(row)
    return table


def _median(rows: list[Row], name: str, over: str) -> float:
    return float(median(row[name] / row[over] for row in rows))


def as_csv(rows: list[Row]) -> str:
    """CSV with a header; missing values are empty."""
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: text_cell(value) if isinstance(value, str) else value for name, value in row.items()})
    return text.getvalue()


def experiment_of(options: dict[str, Any]) -> Experiment:
    """What the preset means with the options given beside it, by their names without dashes; `out` and `dry_run` are no
    part of it. Raises InputError for those that it does not take, and SettingsError for values that cannot be used."""
    strange = [f"--{name.replace('_', '-')}" for name in options if name not in ("preset", *TAKEN)]
    if strange:
        raise InputError(
            "The preset ppll-2014 takes --method ppll[...], --frames, --size, --device, --out and --dry-run only, not "
            f"{', '.join(strange)}."
        )
    wanted = settings_of({"frames": FRAMES, **{name: options[name] for name in TAKEN if name in options}})
    sizes = ((wanted.width, wanted.height),) if "size" in options else SIZES
    return Experiment(wanted.frames, sizes, wanted.device, _parameters(wanted) if "method" in options else {})


def _parameters(wanted: Settings) -> dict[str, Any]:
    """What `--method ppll[...]` changes. Raises InputError for another method, and for parameters of SET."""
    refusal = InputError(f"The preset ppll-2014 takes one --method ppll[...], without {', '.join(SET)}.")
    packers = find_methods(wanted)
    if len(packers) != 1 or not isinstance(packers[0], PerPixelLinkedLists):
        raise refusal
    plain, packer = PerPixelLinkedLists(), packers[0]
    changed = {name: getattr(packer, name) for name in plain.parameters}
    changed = {name: value for name, value in changed.items() if value != getattr(plain, name)}
    if set(SET) & set(changed):
        raise refusal
    return changed
