"""Pictures of a run: where they lie in its folder, and how they get into the report.

`pictures/reference/frame_0000.png` is the reference of a frame; `pictures/FOLDER/frame_0000_NAME.png` are those of one
method and variant, NAME being client, flip, atlas, alpha or anything else. `pictures/pictures.json` says whose each
FOLDER is: {FOLDER: {"method": ..., "variant": ...}}.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import TypedDict

import numpy as np

from shading_atlas_bench.arithmetic.arrays import Bytes
from shading_atlas_bench.reports.store.data import DataError, read_file, read_json, regular_size
from shading_atlas_bench.reports.store.database import StoreError
from shading_atlas_bench.reports.store.names import folder_name

FOLDER, LIST = "pictures", "pictures.json"
REFERENCE = "reference"
MOST_PIXELS = 16384 * 16384  # of a picture, as harness/measure/returned.py lets in
MOST_BYTES = 4 * MOST_PIXELS + 1_000_000  # of its file, which PNG can make a little larger than its pixels
EMBED_BYTES = 3_000_000  # base64 adds a third, and Plotly takes 1.9 MB, so a report stays below 6 MB
ATLAS_SIDE = 1024
LONGEST_SIDE = 16383  # of WebP
QUALITY, EFFORT = 70, 1  # of WebP, for what is not embedded as it is; more effort takes twice as long for a tenth less
MOST_FRAMES = 3
WORKERS = 2  # threads that code pictures
FIRST = ("client", "flip", "atlas")
WHOLE = ("client", "flip")  # not reduced: others are as large as an atlas

PNG_END = b"IEND\xaeB`\x82"  # the last chunk of every PNG file

_NAME = re.compile(r"frame_(\d{1,9})_(\w+)\.png")
_FOLDER = re.compile(r"\w[\w.-]*")
_REFERENCE = re.compile(r"frame_(\d{1,9})\.png")


@dataclass(frozen=True)
class Pictures:
    """Files by frame. methods: by (method, variant), then frame, then name of the picture."""

    references: dict[int, Path]
    methods: dict[tuple[str, str], dict[int, dict[str, Path]]]

    def frames(self) -> list[int]:
        """All frames that have a picture of some method."""
        return sorted({frame for frames in self.methods.values() for frame in frames})


class Owner(TypedDict):
    """Whose pictures are in a folder."""

    method: str
    variant: str


class FrameUrls(TypedDict):
    """Pictures of a frame as data URLs. methods: by label, then name of the picture."""

    frame: int
    reference: str | None
    methods: dict[str, dict[str, str]]


class Embedded(TypedDict):
    """What the report's viewer shows. exact: whether pictures, but for atlases, are embedded as they are."""

    exact: bool
    frames: list[FrameUrls]


def find_pictures(folder: Path) -> Pictures:
    """The whole pictures in `folder`/pictures: none where there is no such folder, and none that a kill cut off.

    Raises StoreError if the list of folders is broken, or names what lies elsewhere.
    """
    references: dict[int, Path] = {}
    for path in _whole_pictures(folder, REFERENCE):
        if match := _REFERENCE.fullmatch(path.name):
            references[int(match[1])] = path
    methods: dict[tuple[str, str], dict[int, dict[str, Path]]] = {}
    for name, owner in _known(folder).items():
        if name != folder_name(**owner):
            raise StoreError(
                f"{folder / FOLDER / LIST} says that {name} has the pictures of {owner['method']}[{owner['variant']}], "
                "which are in another folder: run the same command again, or remove the entry."
            )
        frames = methods.setdefault((owner["method"], owner["variant"]), {})
        for path in _whole_pictures(folder, name):
            if match := _NAME.fullmatch(path.name):
                frames.setdefault(int(match[1]), {})[match[2]] = path
    return Pictures(references, methods)


def _whole_pictures(folder: Path, name: str) -> list[Path]:
    """The whole pictures in a folder of the run's pictures. Raises StoreError for one that is not right there, is no
    regular file or too large."""
    own = folder.resolve() / FOLDER
    if not _FOLDER.fullmatch(name):
        raise StoreError(f"{own / LIST} names {name!r}, which is no folder beside it: remove the entry.")
    found = []
    try:
        for path in sorted((own / name).glob("*.png")):
            if path.resolve().parent != own / name:
                raise StoreError(f"{path} leads out of the run's own pictures, to {path.resolve()}: remove it.")
            if regular_size(path) <= MOST_BYTES and _ends_as_png(path):
                found.append(path)
    except (DataError, OSError) as error:
        raise StoreError(f"{own / name} has something else than pictures of the run: {error}") from error
    return found


def _ends_as_png(path: Path) -> bool:
    with open(path, "rb") as file:
        file.seek(max(0, path.stat().st_size - len(PNG_END)))
        return file.read(len(PNG_END)) == PNG_END


def _known(folder: Path) -> dict[str, Owner]:
    file = folder / FOLDER / LIST
    if not file.exists():
        return {}
    try:
        return read_json(file, dict[str, Owner])
    except DataError as error:
        raise StoreError(f"{error} Run the same command again, or remove the file.") from error


def embed(pictures: Pictures, frames: Iterable[int], labels: dict[tuple[str, str], str]) -> Embedded:
    """The pictures of the first of `frames` that fit, but at least of one, as data URLs, for the report's viewer.

    Pictures are embedded as they are if those of all frames fit, else all as WebP; atlases and methods' own pictures
    always as WebP, reduced to ATLAS_SIDE.
    """
    frames = list(frames)
    exact = sum(path.stat().st_size for frame in frames for path in _exact_files(pictures, frame)) <= EMBED_BYTES
    chosen: list[FrameUrls] = []
    size = 0
    for frame in frames:
        entry, cost = _embed_frame(pictures, frame, labels, exact)
        size += cost
        if chosen and size > EMBED_BYTES:
            break
        chosen.append(entry)
    return {"exact": exact, "frames": sorted(chosen, key=lambda entry: entry["frame"])}


def _exact_files(pictures: Pictures, frame: int) -> list[Path]:
    """The files of a frame that may be embedded as they are."""
    references = [pictures.references[frame]] if frame in pictures.references else []
    by_method = [by_frame.get(frame, {}) for by_frame in pictures.methods.values()]
    return references + [path for files in by_method for name, path in files.items() if name in WHOLE]


def _embed_frame(
    pictures: Pictures, frame: int, labels: dict[tuple[str, str], str], exact: bool
) -> tuple[FrameUrls, int]:
    """One frame for the viewer, and how many bytes its pictures have."""
    reference = pictures.references.get(frame)
    seen = None if reference is None else _data_url(reference, exact)
    entry: FrameUrls = {"frame": frame, "reference": seen, "methods": {}}
    asked = []
    for key, label in labels.items():
        files = pictures.methods.get(key, {}).get(frame, {})
        names = [name for name in FIRST if name in files] + sorted(set(files) - set(FIRST))
        asked += [(label, name, files[name]) for name in names]
    with ThreadPoolExecutor(WORKERS) as pool:
        coded = [
            pool.submit(_data_url, path, exact and name in WHOLE, None if name in WHOLE else ATLAS_SIDE)
            for _, name, path in asked
        ]
        for (label, name, _), url in zip(asked, coded, strict=True):
            entry["methods"].setdefault(label, {})[name] = url.result()
    urls = [seen or "", *(url for layers in entry["methods"].values() for url in layers.values())]
    return entry, sum(len(url) * 3 // 4 for url in urls)


def _data_url(path: Path, exact: bool, side: int | None = None) -> str:
    data, kind = (read_file(path, MOST_BYTES), "png") if exact else (_webp(path, side), "webp")
    return f"data:image/{kind};base64,{base64.b64encode(data).decode()}"


def _webp(path: Path, side: int | None) -> bytes:
    """The picture as WebP, a third of JPEG's bytes for as much time, with no side longer than `side`.

    Raises StoreError for what is no picture, or has more than MOST_PIXELS.
    """
    from av import CodecContext, VideoFrame

    frame = VideoFrame.from_ndarray(np.ascontiguousarray(_pixels(path)), "rgb24")
    shrunk = min(1.0, min(side or LONGEST_SIDE, LONGEST_SIDE) / max(frame.width, frame.height))
    width, height = (max(1, round(length * shrunk)) for length in (frame.width, frame.height))
    frame = frame.reformat(width, height, "yuv420p", dst_colorspace="ITU601", interpolation="AREA", threads=1)
    encoder = CodecContext.create("libwebp", "w")
    encoder.width, encoder.height, encoder.pix_fmt = width, height, "yuv420p"
    encoder.time_base, encoder.thread_count = Fraction(1), 1
    encoder.options = {"quality": str(QUALITY), "compression_level": str(EFFORT)}
    return b"".join(bytes(packet) for packet in [*encoder.encode(frame), *encoder.encode(None)])


def _pixels(path: Path) -> Bytes:
    """The red, green and blue of a picture. Raises StoreError where it has none, or too many."""
    from OpenImageIO import UINT8, ImageInput, geterror

    source = ImageInput.open(str(path))
    if source is None:
        raise _unusable(path, geterror())
    spec = source.spec()
    if spec.width * spec.height > MOST_PIXELS or spec.nchannels < 3:
        raise _unusable(path, f"it has {spec.width}x{spec.height} pixels of {spec.nchannels} channels")
    channels = source.read_image(UINT8)
    if channels is None:
        raise _unusable(path, source.geterror())
    source.close()
    pixels: Bytes = channels[..., :3]
    return pixels


def _unusable(path: Path, why: str) -> StoreError:
    return StoreError(f"{path} cannot be embedded in the report: {why.strip().rstrip('.')}. Remove it, or run again.")
