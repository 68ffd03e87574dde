"""The tables and figures of the documents: what each is measured by, and which columns it prints.

Sizes, frames and repetitions are such that all of them together, but for the claims and what is set beside published
numbers, take about an hour and a half on two cores.
"""

from __future__ import annotations

from collections.abc import Sequence

from shading_atlas_bench.reports.analysis.claims import DEFAULT_FILE, read_claims
from shading_atlas_bench.reports.documents import digests, published
from shading_atlas_bench.reports.documents.figure import draw_samples, draw_sweep
from shading_atlas_bench.reports.documents.kept import ROWS, Column, Part, Source

METHODS = ("ppll", "sas", "snakebinning", "tss")
ATLAS_METHODS = " ".join(f"--method {name}" for name in METHODS[1:])
SPONZA, CLASSROOM, VIKING = "sponza_crytek/scene.glb", "classroom/scene.glb", "viking_village/scene.glb"
BISTRO = "bistro_exterior/scene.glb"
STREET = "--path reports/paths/viking_street.txt"


def _words(heading: str, form: str) -> Column:
    return Column(heading, (form,), left=True)


def _numbers(**headings_of_forms: str) -> tuple[Column, ...]:
    """Columns by the name of their field; each value is `HEADING: FORMAT`."""
    found = []
    for name, text in headings_of_forms.items():
        heading, _, form = text.rpartition(": ")
        found.append(Column(heading, (f"{{{name}:{form}}}",)))
    return tuple(found)


SWEEP_TIMES = ("server_ms_median", "server_ms_low", "server_ms_high", "repetitions")
SWEEP = {
    "cells": Part(
        ("method", "varied"),
        (
            _words("method", "{method}"),
            _words("varied", "{varied}"),
            Column(
                "server ms",
                ("{server_ms_median:.0f} ({server_ms_low:.0f} to {server_ms_high:.0f})", "{server_ms_median:.0f}"),
            ),
            *_numbers(samples="samples: ,.0f", kbytes="kB/frame: ,.0f", atlas_mb="MB: .1f"),
            *_numbers(flip="FLIP, CRF 25: .4f", flip_lossless="FLIP, lossless: .4f", coherence="coherence: .3f"),
        ),
        SWEEP_TIMES,
        draw_sweep,
    ),
    "winners": Part(
        ("coding", "cost"),
        (_words("pictures", "{coding}"), _words("over", "{cost}"), _words("lowest FLIP error", "{says}")),
    ),
}


def _sweep(name: str, scene: str, vary: str) -> Source:
    command = f"bench sweep --scene {scene} --size 480x270 --frames 6 {vary} --repetitions 8 --budget 8"
    return Source(f"sweep-{name}", (command,), digests.sweep_parts, SWEEP)


def _commands(pattern: str, scenes: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(pattern.format(scene=scene) for scene in scenes)


FINE = "--vary atlas=512,1024,2048 --vary shading_rate=0.35,0.5,0.7,1.0"
COARSE = "--vary atlas=1024,2048 --vary shading_rate=0.5,1.0"
SEE_THROUGH = (
    "shells", "gltf_AlphaBlendModeTest/AlphaBlendModeTest.glb", "gltf_GlassVaseFlowers/GlassVaseFlowers.glb",
    "glass_of_water/scene.glb", "living_room/scene.glb", "staircase/scene.glb", SPONZA, "village",
)  # fmt: skip
TRANSPARENCY = Source(
    "transparency",
    tuple(
        f"bench run {ATLAS_METHODS} --scene {scene}{opaque} --size 480x270 --frames 2 --crf 25 --metrics flip"
        for scene in SEE_THROUGH
        for opaque in ("", " --opaque")
    ),
    digests.transparency_parts,
    {
        ROWS: Part(
            ("scene", "method"),
            (
                _words("scene", "{scene}"),
                _words("method", "{method}"),
                *_numbers(flip="FLIP: .4f", opaque="opaque: .4f", ratio="ratio: .2f"),
                *_numbers(flip_coded="FLIP, CRF 25: .4f", opaque_coded="opaque: .4f", ratio_coded="ratio: .2f"),
                *_numbers(samples="samples: .2f", bytes_alpha="alpha bytes: ,.0f"),
            ),
        )
    },
)
SWITCHES = {
    ROWS: Part(
        ("settings", "variant"),
        (
            _words("settings", "{settings}"),
            _words("switched", "{variant}"),
            *_numbers(samples="samples: ,.0f", fill="fill: .2f", atlas_full="full: .0%", coherence="coherence: .3f"),
            *_numbers(
                rebuilt="rebuilt frames: d", triangles_moved="triangles moved: ,.0f", moved_frozen="frozen: ,.0f"
            ),
            *_numbers(bytes_total="bytes: ,.0f", bytes_rebuilt="rebuilt: ,.0f", bytes_frozen="frozen: ,.0f"),
            *_numbers(bytes_metadata="metadata: ,.0f", flip="FLIP: .4f", dssim="DSSIM: .4f"),
        ),
    )
}


def _switches(name: str, scene: str) -> Source:
    """SnakeBinning at both settings, each with one switch flipped at a time; other methods as they are at both."""
    commands = []
    for settings, switches in digests.SETTINGS.items():
        end = "@published" * (settings == "published")
        methods = [f"snakebinning{end}", *(f"snakebinning{end}[{value}]" for value in switches.values())]
        chosen = " ".join(f"--method '{method}'" for method in [*methods, f"sas{end}", f"tss{end}"])
        commands.append(
            f"bench run --scene {scene} --frames 24 --size 480x270 --atlas 2048x2048 --crf 25 --metrics flip,dssim "
            f"{chosen}"
        )
    return Source(f"switches-{name}", tuple(commands), digests.switch_parts, SWITCHES)


def _mapping_command(scene: str, options: str, packings: Sequence[str], freezing: Sequence[str]) -> str:
    """In atlases in which all packings have room at the first step, with superblocks of the same height."""
    pairs = [f"{packing},mapping={mapping}" for packing in packings for mapping in ("off", "exact")]
    chosen = (f"{pair},freeze={freeze},superblock_height=512" for freeze in freezing for pair in pairs)
    methods = " ".join(f"--method 'snakebinning[{variant}]'" for variant in chosen)
    return f"bench run --scene {scene} --cell pvs1 {options} --metrics flip {methods}"


BOTH = tuple(f"assignment={a},orphans={o}" for a in ("best", "first") for o in ("widest", "found"))
PRINTED = ("assignment=next,orphans=found",)  # algorithm 2
PACKED = tuple(_words(head, f"{{{name}}}") for head, name in (
    ("scene", "scene"), ("client", "size"), ("`assignment`", "assignment"), ("`orphans`", "orphans"),
))  # fmt: skip
MAPPED_SCENES = ("hall", "village", "shells", SPONZA, BISTRO, VIKING)
MAPPING = Source(
    "snakebinning-mapping",
    (
        *(
            _mapping_command(scene, f"--size 480x270 --atlas 4096x{lines} --frames 3 --codec none", packings, ("0",))
            for scene in MAPPED_SCENES
            for lines, packings in ((2048, BOTH), (4096, PRINTED))
        ),
        *(
            _mapping_command(scene, "--size 960x540 --atlas 4096x4096 --frames 3 --codec none", BOTH, ("0",))
            for scene in ("hall", SPONZA)
        ),
        *(
            _mapping_command(
                scene, "--size 480x270 --atlas 4096x2048 --frames 6 --crf 25", (BOTH[0], BOTH[-1]), ("0", "0.05")
            )
            for scene in ("hall", "village", SPONZA, VIKING)
        ),
    ),
    digests.mapping_parts,
    {
        ROWS: Part(
            ("scene", "size", "assignment", "orphans"),
            (
                *PACKED,
                *_numbers(superblocks_off="texels without mapping: ,.0f", superblocks="with: ,.0f"),
                *_numbers(superblocks_freed="freed: .0%", strips_freed="of strips: .0%"),
                *_numbers(bins_after_mapping_freed="bins mapped: .0%", triangles_moved_ratio="moved: .2f"),
                *_numbers(flip_ratio="FLIP: .3f"),
            ),
        ),
        "costs": Part(
            ("scene", "size", "assignment", "orphans"),
            (
                *PACKED,
                *_numbers(triangles_moved_off="moved without mapping: ,.0f", triangles_moved="with: ,.0f"),
                *_numbers(bytes_off="bytes without: ,.0f", bytes="with: ,.0f"),
                *_numbers(
                    triangles_moved_off_frozen="frozen, moved without: ,.0f", triangles_moved_frozen="with: ,.0f"
                ),
                *_numbers(bytes_off_frozen="bytes without: ,.0f", bytes_frozen="with: ,.0f"),
                *_numbers(flip_off="FLIP without: .4f", flip="with: .4f"),
            ),
        ),
    },
)
STRATEGY_COLUMNS = (
    *_numbers(samples="samples: ,.0f", oversampling_share="slanted: .0%", oversampling_outside_share="outside: .0%"),
    *_numbers(gather_over_shading="sample / pixel: .2f", dssim="DSSIM: .4f", flip="FLIP: .4f"),
    *_numbers(bytes_total="bytes: ,.0f"),
)
STRATEGIES = Source(
    "tss-strategies",
    _commands(
        "bench run --scene {scene} --frames 4 --size 480x270 --atlas 4096x2048 --crf 25 --metrics flip,dssim "
        "--method 'tss[strategy=lpacking]' --method 'tss[strategy=oversampling]' --method tss",
        ("hall", "village"),
    ),
    digests.strategy_parts,
    {
        ROWS: Part(
            ("scene", "strategy"),
            (_words("scene", "{scene}"), _words("strategy", "{strategy}"), *STRATEGY_COLUMNS),
            ("gather_over_shading",),
        )
    },
)
THRESHOLDS = " ".join(f"--method 'tss[slanted={value}]'" for value in (3.0, 5.0, 8.0, 10.0, 12.0))
SLANTED = Source(
    "tss-slanted",
    (
        *_commands(
            "bench run --scene {scene} --frames 2 --size 960x540 --atlas 4096x4096 --crf 25 --metrics flip "
            f"{THRESHOLDS}",
            ("hall", "village", SPONZA, CLASSROOM, BISTRO),
        ),
        f"bench run --scene {VIKING} {STREET} --frames 2 --size 1920x1080 --atlas 8192x4096 --crf 25 --metrics flip "
        f"{THRESHOLDS}",
    ),
    digests.strategy_parts,
    {
        ROWS: Part(
            ("scene", "slanted"),
            (
                _words("scene", "{scene}"),
                _words("client", "{size}"),
                _words("`slanted`", "{slanted}"),
                *_numbers(oversampling_share="slanted: .0%", slanted_of_larger="above a texel: .0%"),
                *_numbers(lpacking_samples="L-packing samples: ,.0f", oversampling_inside="Oversampling inside: ,.0f"),
                *_numbers(oversampling_outside="outside: ,.0f", flip_lossless="FLIP, lossless: .4f"),
                *_numbers(bytes_total="bytes at CRF 25: ,.0f"),
            ),
            ("gather_over_shading",),
        )
    },
)
SPEED = Source(
    "speed",
    _commands(
        f"bench run --scene {{scene}} --frames 12 --size 480x270 --crf 25 --metrics flip {ATLAS_METHODS}",
        ("hall", "village", SPONZA, CLASSROOM, "staircase/scene.glb"),
    ),
    digests.speed_parts,
    {
        ROWS: Part(
            ("scene", "method"),
            (
                _words("scene", "{scene}"),
                _words("method", "{method}"),
                *_numbers(structs_share="structures: .1%", gather_over_shading="sample / pixel: .2f"),
            ),
            ("structs_share", "gather_over_shading"),
        )
    },
)
THESIS = Source(
    "ppll-2014",
    ("bench run --preset ppll-2014 --frames 6 --size 1024x768",),
    digests.thesis_parts,
    {
        ROWS: Part(
            ("mode", "model"),
            (
                _words("mode", "{mode}"),
                _words("model", "{model}"),
                *_numbers(ratio="LZ4 leaves: .1%", ratio_published="published: .1%", ratio_shuffled="shuffled: .1%"),
                *_numbers(sent_of_built="fragments sent: .1%", bad_pixels="bad pixels: .2%"),
                *_numbers(
                    building_over_opaque="building / opaque: .2f", encoding_over_building="encoding / building: .2f"
                ),
            ),
            ("building_over_opaque", "encoding_over_building"),
        ),
        "layers": Part(("model", "layers")),
    },
    scenes=("stanford_bunny/bunny.ply", "stanford_dragon/dragon_100k.obj", "stanford_buddha/buddha_54k.obj"),
)
LIMITED = Source(
    "ppll-limited",
    tuple(
        f"bench run --method ppll --method 'ppll[mode=full]' --scene {scene} --size {size} --frames 3 --metrics flip"
        for scene in ("hall", "village")
        for size in ("480x270", "960x540")
    ),
    digests.limit_parts,
    {
        ROWS: Part(
            ("scene", "size"),
            (
                _words("scene", "{scene}"),
                _words("client", "{size}"),
                *_numbers(bytes_total_full="bytes, full: ,.0f", bytes_total_ratio="limited / full: .2f"),
                *_numbers(flip_full="FLIP, full: .4f", flip="limited: .4f"),
                *_numbers(holes_px_full="holes, full: .2%", holes_px="limited: .2%"),
                *_numbers(server_ratio="server time, limited / full: .2f"),
            ),
            ("server_ratio",),
        )
    },
    quick=True,
)


def _full_atlas(name: str, scene: str) -> Source:
    pattern = f"bench run {ATLAS_METHODS} --scene {scene} --size 480x270 --atlas {{size}} --frames 2 --codec none"
    commands = tuple(f"{pattern.format(size=f'{side}x{side}')} --metrics flip" for side in (256, 512, 1024, 2048, 4096))
    columns = _numbers(placed="placed: .1%", samples="samples: ,.0f", flip="FLIP: .4f")
    part = Part(("atlas", "method"), (_words("atlas", "{atlas}"), _words("method", "{method}"), *columns))
    return Source(f"full-atlas-{name}", commands, digests.full_atlas_parts, {ROWS: part})


PUBLISHED_SCENES = {  # scene to its path, atlas, and the samples per pixel that SnakeBinning has in its cells
    "hall": ("", "8192x8192", (4.18, 5.63, 6.0)),
    VIKING: (f" {STREET}", "8192x4096", (5.54, 6.97, 7.07)),
    "village": ("", "8192x4096", (5.54, 6.97, 7.07)),
    SPONZA: ("", "8192x4096", (5.54, 6.97, 7.07)),
}
AT_BOTH = " ".join(f"--method {name}{end}" for end in ("", "@published") for name in METHODS[1:])
PUBLISHED_COLUMNS = (
    _words("", "{quantity}"),
    _words("scene", "{scene}"),
    _words("published", "{published}"),
    _words("as published", "{as_published}"),
    _words("default", "{default}"),
    _words("equal samples", "{equal}"),
    _words("causes", "{claims}"),
)
PUBLISHED = Source(
    "published",
    tuple(
        f"bench run {methods} --scene {scene}{path} --cell {cell} --size 1920x1080 --atlas {atlas} --frames 3{asked} "
        "--codec none --metrics flip,dssim,iwssim"
        for scene, (path, atlas, samples) in PUBLISHED_SCENES.items()
        for cell, number in zip(published.CELLS, samples, strict=True)
        for methods, asked in ((AT_BOTH, ""), (ATLAS_METHODS, f" --samples {number}"))
    ),
    published.published_parts,
    {
        "cells": Part(("paper", "quantity", "scene", "cell")),
        "snakebinning-2021": Part(("quantity", "scene"), PUBLISHED_COLUMNS),
        "tss-2019": Part(("quantity", "scene"), PUBLISHED_COLUMNS),
    },
)
CAUSES = Source(
    "published-causes",
    tuple(
        f"bench run --method snakebinning@published --method 'snakebinning@published[shading_rate=1.0]' "
        f"--scene {scene} --cell {cell} --size 1920x1080 --atlas 8192x8192 --frames 3 --codec none --metrics psnr"
        for scene in (
            f"hall --detail {published.TRIANGLES['RL']}",
            f"{VIKING} {STREET}",
            f"village --detail {published.TRIANGLES['VV']}",
        )
        for cell in published.CELLS
    ),
    published.cause_parts,
    {
        ROWS: Part(
            ("scene", "cell"),
            (
                _words("scene", "{scene}"),
                _words("cell", "{cell}"),
                *_numbers(triangles="visible triangles: ,.0f", triangles_ratio="over published: .2f"),
                Column("samples", ("{samples:,.0f}{samples_full}",)),
                *_numbers(samples_ratio="over published: .2f"),
                Column("at rate 1", ("{samples_rate_1:,.0f}{samples_rate_1_full}",)),
                *_numbers(samples_rate_1_ratio="over published: .2f"),
            ),
        )
    },
)
EQUAL = Source(
    "equal-samples",
    tuple(
        f"bench sweep {ATLAS_METHODS} --scene {scene} --size 480x270 --atlas 4096x4096 --frames 3 "
        "--vary samples=0.25,0.5,1,2,4,8,16 --repetitions 1"
        for scene in ("hall", "village", SPONZA, f"{VIKING} {STREET}")
    ),
    digests.equal_parts,
    {
        ROWS: Part(
            ("scene", "asked"),
            (
                _words("scene", "{scene}"),
                *_numbers(asked="samples / pixel: g"),
                *_numbers(flip_sas="FLIP: sas: .4f", flip_snakebinning="snakebinning: .4f", flip_tss="tss: .4f"),
                *_numbers(coded_sas="CRF 25: sas: .4f", coded_snakebinning="snakebinning: .4f", coded_tss="tss: .4f"),
                *_numbers(kbytes_sas="kB: sas: ,.0f", kbytes_snakebinning="snakebinning: ,.0f", kbytes_tss="tss: ,.0f"),
                _words("samples off by", "{off}"),
            ),
            figure=draw_samples,
        )
    },
)
TEXELS = Source(
    "sas-texels",
    tuple(
        f"bench run --method sas --scene {scene} --size 960x540 --atlas {side}x{side} --frames 3 --codec none "
        "--metrics flip"
        for scene, sides in (("hall", (2048,)), ("village", (2048, 4096)), (VIKING, (2048, 4096)))
        for side in sides
    ),
    digests.texel_parts,
    {
        ROWS: Part(
            ("scene", "atlas"),
            (
                _words("scene", "{scene}"),
                _words("atlas", "{atlas}"),
                *_numbers(bias="bias: .3f", placed_triangles="placed triangles: ,.0f"),
                *_numbers(triangles_without_texel="without a texel: ,.0f", samples="samples: ,.0f", flip="FLIP: .4f"),
            ),
        )
    },
)
SETS = Source(
    "visible-sets",
    tuple(
        f"bench run --method sas --scene {scene} --size {size} --pvs-density {density} --frames 3 --codec none "
        "--metrics flip"
        for scene, size in (("hall", "960x540"), (BISTRO, "960x540"), (VIKING, "960x540"), (VIKING, "480x270"))
        for density in (1, 2, 4)
    ),
    digests.set_parts,
    {
        ROWS: Part(
            ("scene", "size", "density"),
            (
                _words("scene", "{scene}"),
                _words("client", "{size}"),
                *_numbers(density="`--pvs-density`: .0f", pvs_triangles="triangles: ,.0f", missing_px="missing: .3%"),
                *_numbers(flip="FLIP of SAS: .4f", time="time over that of 2: .2f"),
            ),
            ("time",),
        )
    },
)
RESETS = Source(
    "resets",
    ("bench run --scene village --method sas --size 160x90 --atlas 512x512 --crf 25 --frames 110 --metrics flip",),
    digests.reset_parts,
    {
        ROWS: Part(
            ("frames",),
            (
                *_numbers(frames="frames: d", median="median kB: .1f", mean="kB/frame: .1f", kbit_s="kbit/s: ,.0f"),
                Column("largest kB", ("{max:.1f} (frame {largest})",)),
                *_numbers(key="keyframe kB: .1f"),
            ),
        )
    },
)
STRESS = Source(
    "stress",
    ("bench stress --quick",),
    digests.stress_parts,
    {
        ROWS: Part(
            ("test",),
            (
                _words("test", "{test}"),
                _words("from .. to", "{span}"),
                *(_words(name, f"{{{name}}}") for name in ("raster", *METHODS)),
            ),
        ),
        "errors": Part(("test", "label")),
        "facts": Part(("name",)),
    },
)
KERNELS = Source(
    "kernels",
    ("bench kernels --repeat 3",),
    digests.kernel_parts,
    {
        "variants": Part(
            ("variant",),
            (
                _words("variant", "`{variant}`"),
                *_numbers(time="time over the default's: .2f", stages="stages and inputs: d"),
                *_numbers(worse="errs clearly more in: d", better="clearly less in: d"),
            ),
            ("time", "worse", "better"),  # other compilers contract and relax other expressions
        ),
        "broken": Part(
            ("case",),
            (_words("stage", "`{case}`"), _words("default", "{default}"), _words("relaxed", "{relaxed}")),
            ("relaxed",),
        ),
        "errors": Part(("case", "input")),
        "roofs": Part(("kernel",), machine=("share",)),
        "facts": Part(("name",)),
    },
)
WHY_NOT = Part(
    ("id", "line"),
    (
        _words("claim", "{claim}"),
        _words("published", "{published}"),
        _words("measured", "{measured}"),
        _words("cause", "{cause}"),
        _words("tested how", "{how}"),
        _words("measured then", "{then}"),
        _words("verdict", "{verdict}"),
    ),
)
CLAIMS = Source(
    "claims",
    ("bench claims",),
    digests.claim_parts,
    {
        ROWS: Part(
            ("id",),
            (
                _words("claim", "{claim} `{id}`"),
                _words("source", "{source}"),
                _words("published", "{published}"),
                _words("must be", "{rule}"),
                _words("measured here", "{measured}"),
            ),
        ),
        "values": Part(("id", "run")),
        "counts": Part(("verdict", "timed")),
        "sets": Part(("run",)),
    }
    | {f"why-{method}": WHY_NOT for method in METHODS},
    scenes=tuple(
        sorted({name for run in read_claims(DEFAULT_FILE).runs.values() if "/" in (name := str(run.get("scene", "")))})
    )
    + THESIS.scenes,
)
SOURCES: dict[str, Source] = {
    source.name: source
    for source in (
        _sweep("hall", "hall", FINE),
        _sweep("village", "village", COARSE),
        _sweep("sponza", SPONZA, COARSE),
        _sweep("classroom", CLASSROOM, COARSE),
        TRANSPARENCY,
        STRESS,
        KERNELS,
        _switches("hall", "hall"),
        _switches("sponza", SPONZA),
        MAPPING,
        STRATEGIES,
        SLANTED,
        SPEED,
        LIMITED,
        _full_atlas("hall", "hall --detail 1000000"),
        _full_atlas("viking", VIKING),
        EQUAL,
        PUBLISHED,
        CAUSES,
        TEXELS,
        SETS,
        THESIS,
        RESETS,
        CLAIMS,
    )
}
