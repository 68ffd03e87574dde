"""Every column of the CSV files: its name, unit, meaning, and which direction is better.

COLUMNS.md is written from this file by `python -m shading_atlas_bench.reports.store.columns`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

STATUSES = ("ok", "skipped", "overflow", "invalid", "timeout", "failed")
STRESS_STATUSES = ("ok", "overflow", "refused", "inaccurate", "nondeterministic", "invalid", "failed", "timeout")
# Frames with numbers: where triangles found no place the picture shows it, so its numbers are fair.
MEASURED_STATUSES = ("ok", "overflow")
# Of two pictures; each is also the name of its column.
PICTURE_METRICS = ("flip", "dssim", "iwssim", "psnr", "delta_e")
RATE_METRICS = ("flip", "psnr")  # of every rate that is encoded, not of the displayed one only
KINDS = ("key", "setting", "status", "time", "count", "size", "quality")
MEASURED = ("time", "count", "size", "quality")
DOCUMENT = Path(__file__).parents[1] / "COLUMNS.md"


@dataclass(frozen=True)
class Column:
    """One column. kind: one of KINDS; type: of its values; better: "lower", "higher" or "" where neither is."""

    name: str
    unit: str
    meaning: str
    kind: str
    type: type
    better: str = ""

    def __post_init__(self) -> None:
        if self.kind not in KINDS or self.better not in ("", "lower", "higher"):
            raise ValueError(f"The column {self.name!r} has an unknown kind or direction.")


def _time(name: str, meaning: str) -> Column:
    return Column(name, "ms", meaning, "time", float, "lower")


def _quality(name: str, unit: str, better: str, meaning: str) -> Column:
    return Column(name, unit, meaning, "quality", float, better)


FRAME_COLUMNS: tuple[Column, ...] = (
    Column("scene", "", "name or file of the scene", "key", str),
    Column("scene_hash", "", "hash of the scene's content, after repair and decimation", "setting", str),
    Column("path", "", "camera path", "setting", str),
    Column("path_hash", "", "hash of all poses of the camera path and of the head motion", "key", str),
    Column(
        "frame_rate", "1/s", "mean pace of the path over the frames of the run; empty for one frame", "setting", float
    ),
    Column("method", "", "packer", "key", str),
    Column("variant", "", "all parameters of the packer and their values", "key", str),
    Column("codec", "", "how planes travel: h264, jpeg, or none for lossless", "key", str),
    Column("crf", "", "constant rate factor of H.264, lower is finer; empty for other codecs", "key", int),
    Column("frame", "", "frame of the path, from 0", "key", int),
    Column("status", "", f"one of {', '.join(STATUSES)}", "status", str),
    Column("reason", "", "why the status is not ok", "status", str),
    Column("width", "px", "width of the client's picture", "setting", int),
    Column("height", "px", "height of the client's picture", "setting", int),
    Column("fov", "degrees", "horizontal field of view of the client", "setting", float),
    Column("cell_radius", "m", "radius of the view cell", "setting", float),
    Column("cell_fov", "degrees", "horizontal field of view of the view cell", "setting", float),
    Column("latency", "ms", "time from the server's pose to the display", "setting", float),
    Column("reference_eye", "", "whose eye the reference is shaded for: client or server", "setting", str),
    Column("bandwidth", "Mbit/s", "of the network that network_ms is for", "setting", float),
    Column("device", "", "OpenCL device", "setting", str),
    Column("seed", "", "seed of scene, head motion and methods", "setting", int),
    Column("pvs_triangles", "triangles", "triangles in the potentially visible set", "count", int),
    Column("placed_triangles", "triangles", "of these, triangles that got a place", "count", int, "higher"),
    Column(
        "samples",
        "samples",
        "shading samples computed, counted by the harness: of lists, the fragments held",
        "count",
        int,
        "lower",
    ),
    Column("sample_budget", "samples", "what --samples asks for; empty without it, and of lists", "setting", int),
    Column("atlas_width", "texels", "width of the atlas; empty for a method without one", "setting", int),
    Column("atlas_height", "texels", "height of the atlas; empty for a method without one", "setting", int),
    _quality("fill", "0..1", "higher", "share of the atlas' texels that a triangle owns"),
    _time("pvs_ms", "device time of finding the potentially visible set; measured when it was found, kept with it"),
    _time("structs_ms", "device time of building structures: sizes, places, lookups"),
    _time("gather_ms", "device time of computing the shading samples"),
    _time("server_ms", "device time of all launches that pack the frame: structs_ms + gather_ms where they are valid"),
    _time("serialise_ms", "host time of packing: wall_ms - server_ms, what it chooses, copies, writes and waits for"),
    _time(
        "fill_ms",
        "host time of reading the planes back, and for a video codec of filling the texels that no triangle owns",
    ),
    _time("encode_ms", "processor time, of one core, of encoding planes, metadata and geometry"),
    _time("network_ms", "bytes_total at the network's bandwidth"),
    _time("decode_ms", "processor time, of one core, of decoding planes, metadata and geometry"),
    _time("receive_ms", "host time of the client's taking the decoded payload, without its device's"),
    _time("draw_host_ms", "host time of the client's drawing the novel view, without its device's"),
    _time("client_ms", "device time of the client: taking the payload and drawing the novel view"),
    _time(
        "frame_ms",
        "the frame from the start of packing to the picture: clocks around packing, filling, coding and drawing, each "
        "as a whole, and network_ms; wall_ms + fill_ms + encode_ms + network_ms + decode_ms + receive_ms + "
        "draw_host_ms + client_ms make it up within 5 %",
    ),
    _time("wall_ms", "host time of packing the frame, from start to end: server_ms + serialise_ms"),
    Column("bytes_total", "bytes", "bytes_video + bytes_alpha + bytes_metadata + bytes_geometry", "size", int, "lower"),
    Column("bytes_video", "bytes", "encoded planes, or fragment lists after LZ4", "size", int, "lower"),
    Column(
        "bytes_alpha",
        "bytes",
        "encoded plane of opacities; empty where no material needs one, and for lists",
        "size",
        int,
        "lower",
    ),
    Column("bytes_metadata", "bytes", "metadata after LZ4", "size", int, "lower"),
    Column("bytes_geometry", "bytes", "geometry of the potentially visible set after LZ4", "size", int, "lower"),
    Column(
        "compression_ratio",
        "",
        "bytes_video / (3 * atlas_width * atlas_height), or / (4 per pixel + 12 or 24 per fragment) for lists",
        "size",
        float,
        "lower",
    ),
    _quality("flip", "0..1", "lower", "mean FLIP error of the client's picture against the reference"),
    _quality(
        "view_dependence",
        "0..1",
        "lower",
        "mean FLIP between the reference shaded for the server's eye and for the client's: how much the picture "
        "depends on the view, which every method loses by shading for the server's; empty without the metric flip",
    ),
    _quality("dssim", "0..1", "lower", "(1 - SSIM) / 2 against the reference"),
    _quality("iwssim", "0..1", "higher", "information-weighted SSIM against the reference"),
    _quality("psnr", "dB", "higher", "peak signal-to-noise ratio against the reference; empty for equal pictures"),
    _quality("delta_e", "", "lower", "mean CIEDE2000 colour difference against the reference"),
    _quality(
        "stretch_l2", "px/texel", "lower", "root mean square stretch of the atlas on screen; undersampled above 1"
    ),
    _quality(
        "stretch_linf",
        "px/texel",
        "lower",
        "largest stretch of the atlas on screen; both are of the nearest triangle with any opacity in a pixel, and "
        "empty where no pixel can be measured",
    ),
    _quality("coherence", "0..1", "higher", "share of owned texels with the same owner as in the frame before"),
    _quality("coherence_bytes", "0..1", "higher", "share of the atlas' bytes unchanged since the frame before"),
    _quality(
        "missing_px",
        "0..1",
        "lower",
        "share of the novel view's pixels whose triangle, the nearest with any opacity, is not in the visible set",
    ),
    _quality(
        "holes_px",
        "0..1",
        "lower",
        "share of the novel view's pixels with a surface in the reference, and none or a false one on the client",
    ),
    Column("peak_mb", "MB", "peak memory of the process (1 MB is 10^6 bytes)", "size", float, "lower"),
    Column("skipped", "", "what was left out because nothing needs it, separated by semicolons", "status", str),
)

FRAME_KEY = tuple(column.name for column in FRAME_COLUMNS if column.kind == "key")
MEASURES = tuple(column for column in FRAME_COLUMNS if column.kind in MEASURED)
BY_NAME = {column.name: column for column in FRAME_COLUMNS}
# The frame that begins every stream: its client has nothing yet, so that all is sent, and its planes are keyframes.
KEYFRAME = 0
SENT = tuple(column.name for column in MEASURES if column.unit == "bytes")
# Sizes and what follows from them: statistics are over the frames after the keyframe, which has a column of its own.
KEYFRAME_APART = (*SENT, "compression_ratio", "network_ms")

_PLACE = tuple(BY_NAME[name] for name in ("scene", "path_hash", "method", "variant", "frame"))

STAGE_COLUMNS: tuple[Column, ...] = (
    *_PLACE,
    Column("stage", "", "name of the stage; the part before the slash is its group", "key", str),
    Column("ms", "ms", "device time of all launches of the stage in this frame", "time", float, "lower"),
    Column("launches", "", "kernel launches of the stage in this frame", "count", int),
)

STATISTIC_COLUMNS: tuple[Column, ...] = (
    *_PLACE,
    Column("name", "", "what the method reports beyond the common columns", "key", str),
    Column("value", "", "its value, in the unit the method documents", "count", float),
)

SWEEP_CODINGS = ("displayed", "lossless")
SWEEP_STATUSES = (*STATUSES, "unfinished")
FRONT = "all: on the Pareto front of all contenders; method: only on its own; no: on neither; empty: not a point"


def _front(name: str, cost: str) -> Column:
    return Column(f"pareto_{name}", "", f"front of FLIP over {cost}. {FRONT}", "status", str)


def statistic_columns(measure: Column, middle_of: str = "") -> tuple[Column, ...]:
    """The columns of a measure in a summary; csv_files.measure_statistics has their values.

    middle_of: what median and interval are over, where that is not the frames.
    """
    apart = measure.name in KEYFRAME_APART
    frames = "the frames after the keyframe" if apart else "all frames, the first among them"
    name, own = measure.name, replace(measure, type=float)

    def column(suffix: str, meaning: str, like: Column = own) -> Column:
        return replace(like, name=f"{name}_{suffix}", meaning=meaning)

    columns = [
        column("median", f"median of {name} over {middle_of or frames}"),
        column("low", f"lower end of its 95 % interval for {name}"),
        column("high", f"upper end of its 95 % interval for {name}"),
        column("mean", f"mean of {name} over {frames}"),
        column("max", f"largest {name} of {frames}", measure),
    ]
    if apart:
        columns.append(column("key", f"{name} of the keyframe", measure))
    if name in SENT:
        rate = replace(own, unit="kbit/s")
        columns += [
            column("total", f"sum of {name} over all frames, the keyframe among them; empty if one failed", measure),
            column("kbit_s", f"{name}_mean at the path's pace: * 8 * frame_rate / 1000", rate),
        ]
    return tuple(columns)


SWEEP_SETTINGS = (
    "scene", "path", "width", "height", "fov", "cell_radius", "cell_fov", "pvs_density", "latency", "atlas_width",
    "atlas_height", "samples_per_pixel", "seed",
)  # fmt: skip
_SETTINGS_OF_SWEEPS = BY_NAME | {
    "samples_per_pixel": Column(
        "samples_per_pixel", "", "shading samples per pixel asked for; empty without --samples", "setting", float
    ),
    "pvs_density": Column("pvs_density", "", "density of the PVS views over the client's", "setting", float),
}
MEASURES_OF_SWEEPS = BY_NAME | {
    "atlas_mb": Column(
        "atlas_mb",
        "MB",
        "memory of the atlas at 4 bytes per texel, or of a method's lists before compression (1 MB is 10^6 bytes)",
        "size",
        float,
        "lower",
    )
}
SWEEP_MEASURES = ("server_ms", "samples", "bytes_total", "atlas_mb", *PICTURE_METRICS, "stretch_l2")
SWEEP_COLUMNS: tuple[Column, ...] = (
    BY_NAME["method"],
    BY_NAME["variant"],
    Column("contender", "", "the method as it was given: what it is called without what was varied", "key", str),
    Column("varied", "", "what was varied in this cell, as NAME=VALUE", "key", str),
    Column("coding", "", f"{' or '.join(SWEEP_CODINGS)}: what the client drew from", "key", str),
    BY_NAME["codec"],
    BY_NAME["crf"],
    Column("status", "", f"the worst of its frames: {', '.join(SWEEP_STATUSES)}", "status", str),
    BY_NAME["reason"],
    *(replace(_SETTINGS_OF_SWEEPS[name], kind="setting") for name in SWEEP_SETTINGS),
    Column("frames", "frames", "frames of the cell", "count", int),
    Column("frames_ok", "frames", "frames with status ok", "count", int, "higher"),
    *(
        column
        for name in SWEEP_MEASURES
        for column in statistic_columns(
            MEASURES_OF_SWEEPS[name], "the passes through the frames" if name == "server_ms" else ""
        )
    ),
    Column("repetitions", "", "passes through the frames that were timed", "count", int),
    Column(
        "stop",
        "",
        "why no more passes were timed: precise (the interval is narrow enough), repetitions or budget (as many or as "
        "long as allowed), not timed (with --workers), failed, timeout; or unfinished",
        "status",
        str,
    ),
    Column("comparable", "", "yes, or no where cells ran side by side, so that times do not compare", "status", str),
    _front("time", "server time"),
    _front("samples", "samples"),
    _front("bytes", "bytes sent per frame"),
    _front("memory", "memory of the atlas"),
)


STRESS_COLUMNS: tuple[Column, ...] = (
    Column("method", "", "packer, or raster: the forward rendering", "key", str),
    Column("variant", "", "all parameters of the packer and their values", "key", str),
    Column("test", "", "test of the catalogue", "key", str),
    Column("step", "", "place of the magnitude in the test, from 0 (mild)", "key", int),
    Column("magnitude", "", "how hard it is, in `unit`", "setting", float),
    Column("unit", "", "unit of the magnitude", "setting", str),
    Column("status", "", f"one of {', '.join(STRESS_STATUSES)}", "status", str),
    Column("reason", "", "what is wrong or was left out, and where", "status", str),
    Column("passed", "", "1 where the method did what can be done, 0 where it broke", "status", int, "higher"),
    Column(
        "error",
        "0..1",
        "mean FLIP of the last frame's client picture (without a lossy codec) against a float64 "
        "rendering; of masked and blended surfaces against the forward rendering",
        "quality",
        float,
        "lower",
    ),
    Column("growth", "", "error over the error at the first magnitude of the test", "quality", float, "lower"),
    Column(
        "wrong_px",
        "0..1",
        "share of pixels that show another triangle than in float64 and rounding does not "
        "explain; empty with triangles left out, and for a method whose client knows no triangles",
        "quality",
        float,
        "lower",
    ),
    Column(
        "holes_px",
        "0..1",
        "share of pixels that are empty well inside what float64 shows; empty with triangles left out",
        "quality",
        float,
        "lower",
    ),
    Column("samples", "samples", "shading samples of the last frame", "count", int),
    Column("unplaced", "triangles", "triangles of the last frame that got no place, each with a reason", "count", int),
    Column(
        "seconds",
        "s",
        "host time of the trial: packing all frames three times, checking and drawing",
        "time",
        float,
        "lower",
    ),
)

CLAIM_KINDS = ("ordering", "share", "ratio", "trend", "absolute")
CLAIM_VERDICTS = ("confirmed", "not confirmed", "undecided", "not measured", "not measurable")
CLAIM_COLUMNS: tuple[Column, ...] = (
    Column("id", "", "the claim", "key", str),
    Column("run", "", "where it was measured: names of runs, those compared joined by a slash", "key", str),
    Column("size", "pixels", "of the client's picture there, as 1920x1080", "setting", str),
    Column("paper", "", "short name of the paper", "setting", str),
    Column("source", "", "table, figure or section of the paper", "setting", str),
    Column("methods", "", "packers that it is about", "setting", str),
    Column("kind", "", f"one of {', '.join(CLAIM_KINDS)}", "setting", str),
    Column("claim", "", "what the paper says, in other words", "setting", str),
    Column("published", "", "its numbers", "setting", str),
    Column("measured", "", "median over the frames of the value that the rule is about", "count", float),
    Column("low", "", "lower end of its 95 % interval", "count", float),
    Column("high", "", "upper end of its 95 % interval", "count", float),
    Column("frames", "frames", "values that the median is over", "count", int),
    Column("rule", "", "what the value must be", "setting", str),
    Column("verdict", "", f"one of {', '.join(CLAIM_VERDICTS)}", "status", str),
    Column("reason", "", "why this verdict", "status", str),
    Column("why", "", "why this run and this rule stand for the claim", "setting", str),
)
CAUSE_VERDICTS = ("holds", "refuted", "undecided", "not measured", "untested")
CAUSE_COLUMNS: tuple[Column, ...] = (
    Column("id", "", "the cause", "key", str),
    Column("claim", "", "id of the claim for which it is the cause", "key", str),
    Column("run", "", "the run of that claim's row", "key", str),
    Column("cause", "", "why the claim may fail there", "setting", str),
    Column("test", "", "how an experiment removes the cause; empty where none can", "setting", str),
    Column("tested_in", "", "runs of the experiment: those compared joined by a slash", "setting", str),
    Column("size", "pixels", "of the client's picture there, as 1920x1080", "setting", str),
    Column("methods", "", "methods of the experiment", "setting", str),
    Column("measured", "", "the claim's value there: median over the frames", "count", float),
    Column("low", "", "lower end of its 95 % interval", "count", float),
    Column("high", "", "upper end of its 95 % interval", "count", float),
    Column("frames", "frames", "values that the median is over", "count", int),
    Column("rule", "", "what the value must be if this is the cause", "setting", str),
    Column("verdict", "", f"one of {', '.join(CAUSE_VERDICTS)}", "status", str),
    Column("reason", "", "why this verdict", "status", str),
)


SKIP_COLUMNS: tuple[Column, ...] = (
    Column("skip", "", "name, as for --no-skip", "key", str),
    Column("what", "", "what it leaves out", "setting", str),
    Column("applies", "", "1 where it applied in the frames measured", "status", int),
    Column("reason", "", "why it applied, or why not", "status", str),
    Column("parts", "", "parts of a frame's work that it shortens", "setting", str),
    Column("with_ms", "ms", "time of these parts per frame, all methods together", "time", float, "lower"),
    Column("without_ms", "ms", "the same with the skip forced off", "time", float),
    Column("saved_ms", "ms", "the difference; below 0 where it is lost in noise", "time", float, "higher"),
)


def _kernel_error(name: str, unit: str, meaning: str) -> Column:
    return Column(name, unit, f"{meaning}; over all real numbers of the stage", "quality", float, "lower")


KERNEL_COLUMNS: tuple[Column, ...] = (
    Column("kernel", "", "folder/file.function below kernels/", "key", str),
    Column("case", "", "the stage it was measured and checked in", "key", str),
    Column("input", "", "typical, or adversarial: what the stage finds hardest", "key", str),
    Column("variant", "", "how freely it was allowed to round: default, contracted or relaxed", "key", str),
    Column("items", "items", "what the kernel processed in one run", "count", float),
    Column("items_formula", "", "how items are counted", "setting", str),
    Column("ms", "ms", "median device time of one run", "time", float, "lower"),
    Column("items_per_s", "1/s", "items over ms", "time", float, "higher"),
    Column("bytes", "bytes", "that it must read and write at least, each once", "size", float),
    Column("bytes_formula", "", "how bytes are counted", "setting", str),
    Column("copy_share", "0..1", "bytes per second over the device's when copying", "time", float, "higher"),
    Column("flops", "", "additions and multiplications; empty where they are not its work", "count", float),
    Column("flops_formula", "", "how they are counted", "setting", str),
    Column("arithmetic_share", "0..1", "flops per second over the device's", "time", float, "higher"),
    Column("values", "", "real numbers compared with the twin", "count", int),
    _kernel_error("max_error", "", "largest difference from the float64 twin"),
    _kernel_error("mean_error", "", "mean difference"),
    _kernel_error("p999_error", "", "99.9 percentile of the difference"),
    _kernel_error("max_ulp", "ULP", "largest difference in units of the last place of float32"),
    _kernel_error("mean_ulp", "ULP", "mean difference in such units"),
    _kernel_error("p999_ulp", "ULP", "99.9 percentile in such units"),
    Column("broken", "", "values that are NaN or an infinity in only one of kernel and twin", "quality", int, "lower"),
    Column("whole_values", "", "whole numbers compared with the twin", "count", int),
    Column("misassigned", "", "of these, how many differ from the twin, rounded", "quality", int, "lower"),
)  # fmt: skip


def summary_columns() -> tuple[Column, ...]:
    """Columns of summary.csv: the key without the frame, settings, counts of frames, and the statistics of measures."""
    carried = tuple(column for column in FRAME_COLUMNS if column.kind in ("key", "setting") and column.name != "frame")
    counts = (
        Column("frames", "frames", "frames of this key", "count", int),
        Column("frames_ok", "frames", "frames with status ok", "count", int, "higher"),
        Column("frames_overflow", "frames", "frames with status overflow", "count", int, "lower"),
        Column("frames_skipped", "frames", "frames skipped with a reason", "count", int),
        Column("frames_failed", "frames", "frames with status invalid, timeout or failed", "count", int, "lower"),
    )
    return (*carried, *counts, *(statistic for measure in MEASURES for statistic in statistic_columns(measure)))


def _of_runs() -> tuple[tuple[str, str, tuple[Column, ...]], ...]:
    """Name, description and columns of the files of `bench run`."""
    return (
        (
            "frames.csv",
            "One row per scene, path, method, variant, codec, CRF and frame, sorted by that key. An empty cell is a "
            "value that does not exist (of a rate that was not displayed all qualities but FLIP and PSNR, the PSNR of "
            "equal pictures) or "
            "was not reached; it never stands for zero. A row that is not ok says why in `reason`. With `--repeat`, "
            "times are medians over the repetitions, and every repetition is kept in the table `repeats` of "
            "results.sqlite. Device time is measured by the device's own events, and nothing else runs meanwhile; host "
            "time by a clock on the host; processor time by that of the thread that codes, because others code "
            "beside it.",
            FRAME_COLUMNS,
        ),
        (
            "summary.csv",
            "One row per key without the frame. Statistics are over the frames with status ok or overflow: what an "
            "overflow leaves out shows as errors and holes in the picture, so its numbers are fair. The keyframe is "
            "the first frame of the path: the client has nothing yet, so all geometry and metadata are sent, and every "
            "plane as a picture of its own. It is in the statistics of times, counts and qualities, but not in those "
            "of sizes and of what follows from them (the compression ratio, the network's time): there it has the "
            "column `_key`, and only `_total` counts it. One frame alone has no others, so these cells are empty. The "
            "interval is the distribution-free one for a median: the closest pair of order statistics, equally far "
            "from both ends, that covers the median with a probability of at least 95 %. Fewer than 6 values have no "
            "such pair, so the cells are empty. It takes frames as independent, which neighbouring frames of a path "
            "are not: read it as the spread along this path.",
            summary_columns(),
        ),
        ("stages.csv", "One row per frame and stage of a method's kernels.", STAGE_COLUMNS),
        (
            "statistics.csv",
            "One row per frame and number that is in no common column: what the method's README explains, and of the "
            "harness `metrics_ms` (host time of all picture metrics), `reference_ms` (device time of the reference), "
            "`rates_ms` (host time of drawing and judging the rates that are not displayed), `metrics_over_work` "
            "(metrics_ms over the time of drawing the reference, packing, and drawing on the clients), `others_share` "
            "(of the machine's cores, that other programs took meanwhile), "
            "`checks_ms` (host time of checking what the method says of the frame), "
            "`structs_share` (structs_ms over server_ms), `reference_shading_ns` (device time per covered "
            "pixel of the shading kernel in the reference), `gather_over_shading` (gather_ms per sample over that) and "
            "`unwritten_lookups` (of the texels that the lookups of the validity check touch, the share that is "
            "missing, for a method that declares to leave some unwritten).",
            STATISTIC_COLUMNS,
        ),
    )


def _of_commands() -> tuple[tuple[str, str, tuple[Column, ...]], ...]:
    """The same of other commands."""
    return (
        (
            "stress.csv",
            "One row per method, test and magnitude of `bench stress`. `refused`: loading said in a sentence why the "
            "input cannot be used; `inaccurate`: valid, but another picture than a float64 rendering's, or, where the "
            "test must not change the picture, than the first magnitude's; `nondeterministic`: other bytes when packed "
            "again or with other work-groups; the others as in frames.csv.",
            STRESS_COLUMNS,
        ),
        (
            "sweep.csv",
            "Of `bench sweep`: one row per cell of the grid and coding, in the order of the grid. A cell whose status "
            "is overflow has numbers but is on no front; one that failed or is invalid has none. The server time of a "
            "pass is the median over the frames; its median and interval are over the passes, and the interval is that "
            "of summary.csv, so it needs 6 of them. Its mean and largest value are over the frames, each the median of "
            "its passes. Statistics of all else are those of summary.csv, the same in every run; `pareto_bytes` goes "
            "by the mean.",
            SWEEP_COLUMNS,
        ),
        (
            "skips.csv",
            "Of `bench run --explain`: one row per skip. Times with and without are medians of rounds in turn in one "
            "process: device time of the visible set, the reference and packing, host time of metrics.",
            SKIP_COLUMNS,
        ),
        (
            "kernels.csv",
            "One row per kernel, input and build variant of `bench kernels`. Times are of the kernel, errors of the "
            "stage it belongs to, and compare real numbers and whole ones apart. A kernel that one of the inputs does "
            "not need has no time there. An ULP is that of the expected value, but of at least 2^-10 of the largest "
            "value of its array: what cancels to nothing has no digits of its own.",
            KERNEL_COLUMNS,
        ),
        (
            "claims.csv",
            "Of `bench claims`: one row per claim and place where it was measured, in the order of the claims. The "
            "interval is that of summary.csv over the claim's value in each frame (for a ratio, of both in the same "
            "frame). Confirmed and not confirmed are intervals wholly inside and outside the rule; all others are "
            "undecided. Not measured says why a run has no value, not measurable why no run here can have one.",
            CLAIM_COLUMNS,
        ),
        (
            "causes.csv",
            "Of `bench claims`: one row per claim, place and cause for which the claim may fail there. An experiment "
            "removes the cause, and its rule must then hold: if it does the cause holds, else it is refuted.",
            CAUSE_COLUMNS,
        ),
    )


def document() -> str:
    """The text of COLUMNS.md."""
    parts = [
        "# Columns of the CSV files",
        "The files are UTF-8 with a header line, commas and line feeds; numbers have as many digits as it takes to "
        "read back the same value, and line breaks in texts are spaces. A text that begins with `=`, `+`, `-`, `@`, a "
        "tab or a carriage return, after any number of apostrophes, has one apostrophe more before it, so that no "
        "spreadsheet takes it for a formula; without that apostrophe it is the text as it was. `better` says which "
        "direction is better, where one is.",
    ]
    for name, about, columns in (*_of_runs(), *_of_commands()):
        parts += [f"## {name}", about, _table(columns)]
    return "\n\n".join(parts) + "\n"


def _table(columns: tuple[Column, ...]) -> str:
    lines = ["| column | unit | meaning | kind | better |", "| --- | --- | --- | --- | --- |"]
    lines += [f"| {c.name} | {c.unit} | {c.meaning} | {c.kind} | {c.better} |" for c in columns]
    return "\n".join(lines)


if __name__ == "__main__":
    DOCUMENT.write_text(document(), encoding="utf-8")
