"""What a run is asked to do: every option of `bench run`, checked, as one value that can be saved and replayed."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import asdict, astuple, dataclass, fields
from pathlib import Path
from typing import Any

from shading_atlas_bench.errors import BenchError
from shading_atlas_bench.harness.workload.presets import LINKED_LISTS, PRESETS
from shading_atlas_bench.harness.workload.views import ViewCell
from shading_atlas_bench.reports.store.columns import PICTURE_METRICS
from shading_atlas_bench.reports.store.data import DataError, as_kind, read_json
from shading_atlas_bench.reports.store.records import RunFile
from shading_atlas_bench.scenes.raw import MAX_TEXTURE
from shading_atlas_bench.scenes.units import UNITS

# Table 1 of the SnakeBinning paper, and the default: enough for 50 ms of walking at 1 m/s and of looking around.
CELLS = {
    "default": ViewCell(0.08, 80),
    "pvs1": ViewCell(0.10, 90),
    "pvs2": ViewCell(0.20, 125),
    "pvs3": ViewCell(0.30, 160),
}
CODECS = ("h264", "jpeg", "none")
EYES = ("client", "server")
COMMA = re.compile(r",(?![^\[]*\])")  # not in brackets
METRIC_NAMES = (*PICTURE_METRICS, "stretch")
LONGEST = 1_000_000  # seconds that anything may take: eleven days


class SettingsError(BenchError, ValueError):
    """An option that cannot be used; the message is one sentence."""


@dataclass(frozen=True)
class Range:
    """The numbers that an option takes: finite ones from `low` to `high`, of a unit."""

    option: str
    low: float
    high: float
    unit: str = ""

    def check(self, value: float) -> None:
        """Raise SettingsError for a number outside, and for what is none."""
        if not self.low <= value <= self.high:
            given = f"{value:g}" if isinstance(value, float) else str(value)
            wanted = f"{self.low:,} to {self.high:,} {self.unit}".rstrip()
            raise SettingsError(f"{self.option} is {given}: give {wanted}.")


RANGES = {  # of settings; those that are None are not given
    "frames": Range("--frames", 1, 1_000_000),
    "samples_per_pixel": Range("--samples", 0.01, 64, "shading samples per pixel"),
    "fov": Range("--fov", 1, 179, "degrees"),
    "cell_radius": Range("--cell's radius", 0, 1000, "metres"),
    "cell_fov": Range("--cell's field of view", 1, 179, "degrees"),
    "pvs_density": Range("--pvs-density", 0.25, 8),
    "latency": Range("--latency", 0, 1000, "milliseconds"),
    "bandwidth": Range("--bandwidth", 0.001, 1_000_000, "megabits per second"),
    "unit": Range("--unit", 1e-6, 1_000_000, f"metres per unit, or one of {', '.join(UNITS)}"),
    "max_texture": Range("--max-texture", 1, 65_536, "texels"),
    "display_crf": Range("--display-crf", 0, 51),
    "seed": Range("--seed", 0, 2**32 - 1),
    "repeat": Range("--repeat", 1, 10_000),
    "timeout": Range("--timeout", 0.001, LONGEST, "seconds"),
    "memory": Range("--memory", 1_000_000, 10**15, "bytes"),
}
RATE = Range("--crf", 0, 51)


@dataclass(frozen=True)
class Settings:
    """One run. Lengths are metres, angles degrees, times milliseconds unless said otherwise.

    fov: the client's horizontal field of view. cell_radius, cell_fov: the view cell.
    opaque: whether see-through materials are made opaque. max_texture: texels of a side that textures are reduced to.
    allow_outside: whether a scene may name files outside of its folder; it is what a user allows, so files of settings
        do not say it.
    samples_per_pixel: shading samples per pixel of the client's picture for every method with an atlas; None for its
        own rule.
    pvs_density: pixels of the PVS views per client pixel, along each axis; one view is denser for tiny triangles.
    timeout: seconds for one pack. memory: bytes that a run may take; None for most of the machine's.
    bandwidth: of the network, in Mbit/s. reference_eye: whose eye the reference is shaded for, "client" or "server".
    metrics: those of METRIC_NAMES to compute. no_skip: skips that are forced off (skips.py).
    """

    methods: tuple[str, ...] = ("all",)
    scene: str = "hall"
    unit: float | None = None
    detail: int | None = None
    repair: bool = False
    decimate: float | None = None
    opaque: bool = False
    max_texture: int = MAX_TEXTURE
    allow_outside: bool = False
    path: str = "walk"
    head_motion: str | None = None
    frames: int = 12
    width: int = 960
    height: int = 540
    fov: float = 60.0
    atlas_width: int = 2048
    atlas_height: int = 2048
    samples_per_pixel: float | None = None
    cell_radius: float = CELLS["default"].radius
    cell_fov: float = CELLS["default"].fov
    pvs_density: float = 2.0
    latency: float = 50.0
    bandwidth: float = 100.0
    reference_eye: str = "client"
    codec: str = "h264"
    crf: tuple[int, ...] = (5, 10, 25, 35)
    display_crf: int = 25
    device: str | None = None
    seed: int = 0
    repeat: int = 1
    timeout: float = 60.0
    memory: int | None = None
    dump: bool = False
    metrics: tuple[str, ...] = METRIC_NAMES
    no_skip: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, allowed in RANGES.items():
            value = getattr(self, name)
            if value is not None:
                allowed.check(value)
        for rate in self.crf:
            RATE.check(rate)
        strange = [name for name in self.metrics if name not in METRIC_NAMES]
        checks = [
            (
                bool(self.metrics) and not strange,
                f"--metrics has {', '.join(strange) or 'nothing'}: give some of {', '.join(METRIC_NAMES)}.",
            ),
            *(
                (
                    min(width, height) >= 16 and max(width, height) <= 8192,
                    f"{option} is {width}x{height}: give a width and height from 16 to 8192 {unit}.",
                )
                for option, width, height, unit in (
                    ("--size", self.width, self.height, "pixels"),
                    ("--atlas", self.atlas_width, self.atlas_height, "texels"),
                )
            ),
            (bool(self.methods), "--method is empty: give all or a method's name."),
            (
                self.fov <= self.cell_fov,
                f"The cell's field of view is {self.cell_fov:g} degrees: give --fov ({self.fov:g}) or more, up to 179.",
            ),
            (
                self.reference_eye in EYES,
                f"--reference-eye is {self.reference_eye!r}: give one of {', '.join(EYES)}.",
            ),
            (self.codec in CODECS, f"--codec is {self.codec!r}: give one of {', '.join(CODECS)}."),
            (bool(self.crf), "--crf is empty: give at least one number."),
            (
                self.decimate is None or 0 < self.decimate < 1,
                f"--decimate is {self.decimate}: give the share of triangles to keep, between 0 and 1.",
            ),
            (bool(self.scene), "--scene is empty: give a built-in scene or a file."),
            ("\0" not in f"{self.scene}{self.path}{self.head_motion}", "No name of a file has a zero in it."),
        ]
        for fine, sentence in checks:
            if not fine:
                raise SettingsError(sentence)

    @property
    def crfs(self) -> tuple[int, ...]:
        """The CRFs to encode, ascending, the displayed one among them; none unless the codec is H.264."""
        return tuple(sorted({*self.crf, self.display_crf})) if self.codec == "h264" else ()

    def to_json(self) -> dict[str, Any]:
        """As plain JSON values, by field name."""
        values: dict[str, Any] = json.loads(json.dumps(asdict(self)))
        return values

    @classmethod
    def from_json(cls, values: dict[str, Any], source: str) -> Settings:
        """The inverse of `to_json`; `source` names the file in errors.

        Raises SettingsError for unknown names and for values that do not fit.
        """
        known = {field.name: field for field in fields(cls)}
        unknown = sorted(set(values) - set(known))
        if unknown:
            raise SettingsError(f"{source} has the unknown setting {unknown[0]!r}; known are {', '.join(known)}.")
        try:
            return as_kind(values, cls, source)
        except DataError as error:
            raise SettingsError(str(error)) from error


def settings_of(options: dict[str, Any], base: dict[str, Any] | None = None, source: str = "run") -> Settings:
    """The settings that options of `bench run` mean, by their names without dashes, over those of `base`.

    A preset among the options takes the place of `base`. Raises SettingsError; `source` says there where `base` is
    from.
    """
    given = dict(options)
    if "preset" in given:
        base, source = preset_settings(str(given.pop("preset"))).to_json(), "preset"
    for name in [name for name in given if name in PARSED]:
        fields_set, kind, parse = PARSED[name]
        try:
            written = as_kind(given.pop(name), kind, f"--{name.replace('_', '-')}")
        except DataError as error:
            raise SettingsError(str(error)) from error
        given |= dict(zip(fields_set, parse(written), strict=True))
    codec = given.get("codec", (base or {}).get("codec", Settings.codec))
    if codec != "h264" and ({"crf", "display_crf"} & set(given)):
        raise SettingsError(f"--crf and --display-crf are for --codec h264, not {codec}: leave them out.")
    return Settings.from_json((base or {}) | given, source)


def preset_settings(name: str) -> Settings:
    """What a paper's own experiment asks for. Raises SettingsError for an unknown one, and for one that is no run."""
    if name not in PRESETS:
        raise SettingsError(f"There is no preset {name!r}. Known: {', '.join(PRESETS)}.")
    if name == LINKED_LISTS:
        raise SettingsError(f"The preset {name} is an experiment of its own, not settings: only bench run takes it.")
    return settings_of(PRESETS[name].options, source="preset")


def read_settings(path: Path) -> Settings:
    """The settings saved in a run.json, but for what its user allows. Raises SettingsError if it cannot be read."""
    try:
        saved = read_json(path, RunFile)["settings"] | {"allow_outside": False}
        return Settings.from_json(saved, str(path))
    except DataError as error:
        raise SettingsError(f"{error} Give the run.json of an earlier run.") from error


def parse_pair(text: str, separator: str, option: str, example: str) -> tuple[float, float]:
    """Two numbers like 960x540 or 0.1,90. Raises SettingsError, naming the option."""
    parts = text.lower().split(separator)
    try:
        first, second = (float(part) for part in parts)
    except ValueError as error:
        raise SettingsError(f"{option} is {text!r}: give two numbers like {example}.") from error
    if not (math.isfinite(first) and math.isfinite(second)):
        raise SettingsError(f"{option} is {text!r}: give two finite numbers like {example}.")
    return first, second


def parse_size(text: str, option: str, example: str, *, square: bool = False) -> tuple[int, int]:
    """A size like 960x540 in whole numbers. square: one number means both. Raises SettingsError, naming the option."""
    if square and "x" not in text.lower():
        text = f"{text}x{text}"
    width, height = parse_pair(text, "x", option, example)
    if width != int(width) or height != int(height):
        raise SettingsError(f"{option} is {text!r}: give whole numbers like {example}.")
    return int(width), int(height)


def parse_methods(texts: Sequence[str]) -> tuple[str, ...]:
    """What `--method` names: one each, or several with commas between. Those in brackets, and in a file's name, are no
    such commas."""
    return tuple(part for text in texts for part in ([text] if _names_a_file(text) else COMMA.split(text)))


def _names_a_file(text: str) -> bool:
    """Whether all of it is `path/to/file.py:Class`, for a file that there is."""
    try:
        return Path(text.partition("[")[0].rpartition(":")[0]).is_file()
    except (OSError, ValueError):
        return False


def parse_cell(text: str) -> ViewCell:
    """A preset's name, or RADIUS,FOV in metres and degrees. Raises SettingsError for other texts."""
    if text in CELLS:
        return CELLS[text]
    if "," not in text:
        raise SettingsError(f"--cell is {text!r}: give RADIUS,FOV like 0.1,90, or one of {', '.join(CELLS)}.")
    return ViewCell(*parse_pair(text, ",", "--cell", "0.1,90"))


def parse_unit(text: str) -> float:
    """Metres per unit, from the name of a unit or a number. Raises SettingsError for other texts."""
    if text.strip() in UNITS:
        return UNITS[text.strip()]
    try:
        return float(text)
    except ValueError as error:
        raise SettingsError(
            f"--unit is {text!r}: give one of {', '.join(UNITS)}, or metres per unit above 0."
        ) from error


def parse_memory(text: str) -> int:
    """Bytes, from a number with M or G behind it. Raises SettingsError for other texts."""
    found = re.fullmatch(r"\s*(\d{1,9}(?:\.\d{1,9})?)\s*([MG])B?\s*", text, re.IGNORECASE)
    if not found:
        raise SettingsError(f"--memory is {text!r}: give a number of megabytes or gigabytes like 500M or 4G.")
    return round(float(found[1]) * {"M": 1e6, "G": 1e9}[found[2].upper()])


def parse_crfs(text: str) -> tuple[int, ...]:
    """A comma-separated list of whole numbers. Raises SettingsError for other texts."""
    try:
        return tuple(int(part) for part in text.split(",") if part.strip())
    except ValueError as error:
        raise SettingsError(f"--crf is {text!r}: give whole numbers like 5,10,25,35.") from error


def parse_names(text: str) -> tuple[str, ...]:
    """A comma-separated list of names."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


# Options that are not written as the setting is: the settings that each sets, the type of what is written, and their
# values of it.
PARSED: dict[str, tuple[tuple[str, ...], Any, Callable[[Any], tuple[Any, ...]]]] = {
    "method": (("methods",), list[str], lambda given: (parse_methods(given),)),
    "size": (("width", "height"), str, lambda text: parse_size(text, "--size", "960x540")),
    "atlas": (
        ("atlas_width", "atlas_height"),
        str,
        lambda text: parse_size(text, "--atlas", "2048x1024 or 2048", square=True),
    ),
    "samples": (("samples_per_pixel",), float, lambda given: (given,)),
    "cell": (("cell_radius", "cell_fov"), str, lambda text: astuple(parse_cell(text))),
    "crf": (("crf",), str, lambda text: (parse_crfs(text),)),
    "unit": (("unit",), str | float, lambda given: (parse_unit(str(given)),)),
    "memory": (("memory",), str | int, lambda given: (given if isinstance(given, int) else parse_memory(given),)),
    "metrics": (("metrics",), str, lambda text: (parse_names(text),)),
    "no_skip": (("no_skip",), list[str], lambda given: (tuple(given),)),
}
