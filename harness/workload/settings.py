"""What a run is asked to do: every option of `bench run`, checked, as one value that can be saved and replayed."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import asdict, astuple, dataclass, fields
from pathlib import Path
from typing import Any

from shading_atlas_bench.harness.workload.presets import LINKED_LISTS, PRESETS
from shading_atlas_bench.harness.workload.views import ViewCell
from shading_atlas_bench.reports.store.columns import PICTURE_METRICS
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
METRIC_NAMES = (*PICTURE_METRICS, "stretch")
MOST_FRAMES = 1_000_000


class SettingsError(ValueError):
    """An option that cannot be used; the message is one sentence."""


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
    timeout: seconds for one pack.
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
    dump: bool = False
    metrics: tuple[str, ...] = METRIC_NAMES
    no_skip: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        strange = [name for name in self.metrics if name not in METRIC_NAMES]
        checks = [
            (
                bool(self.metrics) and not strange,
                f"--metrics has {', '.join(strange) or 'nothing'}: give some of {', '.join(METRIC_NAMES)}.",
            ),
            (bool(self.methods), "--method is empty: give all or a method's name."),
            (1 <= self.frames <= MOST_FRAMES, f"--frames is {self.frames}: give 1 to {MOST_FRAMES:,}."),
            (
                min(self.width, self.height) >= 16 and max(self.width, self.height) <= 8192,
                f"--size is {self.width}x{self.height}: give a width and height from 16 to 8192 pixels.",
            ),
            (
                min(self.atlas_width, self.atlas_height) >= 16 and max(self.atlas_width, self.atlas_height) <= 8192,
                f"--atlas is {self.atlas_width}x{self.atlas_height}: give a width and height from 16 to 8192 texels.",
            ),
            (
                self.samples_per_pixel is None or 0.01 <= self.samples_per_pixel <= 64,
                f"--samples is {self.samples_per_pixel}: give 0.01 to 64 shading samples per pixel.",
            ),
            (1 <= self.fov <= 179, f"--fov is {self.fov:g}: give 1 to 179 degrees."),
            (
                self.fov <= self.cell_fov <= 179,
                f"The cell's field of view is {self.cell_fov:g} degrees: give --fov ({self.fov:g}) or more, up to 179.",
            ),
            (self.cell_radius >= 0, f"The cell's radius is {self.cell_radius:g} m: give 0 or more."),
            (0.25 <= self.pvs_density <= 8, f"--pvs-density is {self.pvs_density:g}: give 0.25 to 8."),
            (0 <= self.latency <= 1000, f"--latency is {self.latency:g}: give 0 to 1000 milliseconds."),
            (
                0 < self.bandwidth < float("inf"),
                f"--bandwidth is {self.bandwidth:g}: give megabits per second above 0.",
            ),
            (
                self.reference_eye in EYES,
                f"--reference-eye is {self.reference_eye!r}: give one of {', '.join(EYES)}.",
            ),
            (self.codec in CODECS, f"--codec is {self.codec!r}: give one of {', '.join(CODECS)}."),
            (
                all(0 <= crf <= 51 for crf in (*self.crf, self.display_crf)),
                "--crf and --display-crf take whole numbers from 0 to 51.",
            ),
            (bool(self.crf), "--crf is empty: give at least one number."),
            (
                self.unit is None or 0 < self.unit < float("inf"),
                f"--unit is {self.unit}: give one of {', '.join(UNITS)}, or metres per unit above 0.",
            ),
            (
                self.decimate is None or 0 < self.decimate < 1,
                f"--decimate is {self.decimate}: give the share of triangles to keep, between 0 and 1.",
            ),
            (self.max_texture >= 1, f"--max-texture is {self.max_texture}: give at least 1 texel."),
            (0 <= self.seed < 2**32, f"--seed is {self.seed}: give a whole number from 0 to {2**32 - 1}."),
            (bool(self.scene), "--scene is empty: give a built-in scene or a file."),
            (self.repeat >= 1, f"--repeat is {self.repeat}: give at least 1."),
            (self.timeout > 0, f"--timeout is {self.timeout:g}: give seconds above 0."),
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
        lists = {name: tuple(value) for name, value in values.items() if isinstance(value, list)}
        try:
            return cls(**{**values, **lists})
        except TypeError as error:
            raise SettingsError(f"{source} has a setting of the wrong type: {error}.") from error


def settings_of(options: dict[str, Any], base: dict[str, Any] | None = None, source: str = "run") -> Settings:
    """The settings that options of `bench run` mean, by their names without dashes, over those of `base`.

    A preset among the options takes the place of `base`. Raises SettingsError; `source` says there where `base` is
    from.
    """
    given = dict(options)
    if "preset" in given:
        base, source = preset_settings(given.pop("preset")).to_json(), "preset"
    for name in [name for name in given if name in PARSED]:
        fields_set, parse = PARSED[name]
        given |= dict(zip(fields_set, parse(given.pop(name)), strict=True))
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
        content = json.loads(path.read_text(encoding="utf-8"))
        return Settings.from_json(content["settings"] | {"allow_outside": False}, str(path))
    except OSError as error:
        raise SettingsError(f"{path} cannot be read: {error.strerror}.") from error
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise SettingsError(f"{path} is not JSON: {error}.") from error
    except (KeyError, TypeError) as error:
        raise SettingsError(f"{path} has no 'settings': give the run.json of an earlier run.") from error


def parse_pair(text: str, separator: str, option: str, example: str) -> tuple[float, float]:
    """Two numbers like 960x540 or 0.1,90. Raises SettingsError, naming the option."""
    parts = text.lower().split(separator)
    try:
        first, second = (float(part) for part in parts)
    except ValueError as error:
        raise SettingsError(f"{option} is {text!r}: give two numbers like {example}.") from error
    return first, second


def parse_size(text: str, option: str) -> tuple[int, int]:
    """A size like 960x540 in whole numbers. Raises SettingsError, naming the option."""
    width, height = parse_pair(text, "x", option, "960x540")
    if width != int(width) or height != int(height):
        raise SettingsError(f"{option} is {text!r}: give whole numbers like 960x540.")
    return int(width), int(height)


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


def parse_crfs(text: str) -> tuple[int, ...]:
    """A comma-separated list of whole numbers. Raises SettingsError for other texts."""
    try:
        return tuple(int(part) for part in text.split(",") if part.strip())
    except ValueError as error:
        raise SettingsError(f"--crf is {text!r}: give whole numbers like 5,10,25,35.") from error


def parse_names(text: str) -> tuple[str, ...]:
    """A comma-separated list of names."""
    return tuple(part.strip() for part in text.split(",") if part.strip())


# Options that are not written as the setting is: the settings that each sets, and their values of what was written.
PARSED: dict[str, tuple[tuple[str, ...], Callable[[Any], tuple[Any, ...]]]] = {
    "method": (("methods",), lambda given: (tuple(given),)),
    "size": (("width", "height"), lambda text: parse_size(text, "--size")),
    "atlas": (("atlas_width", "atlas_height"), lambda text: parse_size(text, "--atlas")),
    "samples": (("samples_per_pixel",), lambda given: (given,)),
    "cell": (("cell_radius", "cell_fov"), lambda text: astuple(parse_cell(text))),
    "crf": (("crf",), lambda text: (parse_crfs(text),)),
    "unit": (("unit",), lambda given: (parse_unit(str(given)),)),
    "metrics": (("metrics",), lambda text: (parse_names(text),)),
    "no_skip": (("no_skip",), lambda given: (tuple(given),)),
}
