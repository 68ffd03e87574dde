"""The parameters of SnakeBinning; every part of the method can be switched off or changed."""

from shading_atlas_bench.packers.interface import Parameter


class Parameters:
    """The values of PARAMETERS, by name."""

    shading_rate: float
    prediction_frames: int
    slicing: float
    logarithmic: bool
    enlarge: str
    mapping: str
    sink: int
    remap_interval: int
    superblock_height: int
    assignment: str
    orphans: str
    capacity: float
    shrink: float
    collapse: float
    hysteresis: bool
    freeze: float
    freeze_frames: int
    perspective: bool
    full_footprint: bool
    points: bool
    average_clear: bool


PARAMETERS = {
    "shading_rate": Parameter(
        0.7, (0.5, 0.7, 1.0), "factor on the height, and so on all lengths, of triangles", "texels per pixel", "5.2"
    ),
    "prediction_frames": Parameter(
        3, (0, 1, 3), "predicted client views whose largest footprint counts; 0 takes the server's view", "views", "3.1"
    ),
    "slicing": Parameter(
        0.05,
        (0.0, 0.05, 0.25),
        "share of the client's picture from which on a triangle that leaves it is cut along the frustum; 0 for never",
        "1",
        "3.1; number: ours",
    ),
    "logarithmic": Parameter(True, (False, True), "whether edges of height bins are spaced logarithmically", "", "5.1"),
    "enlarge": Parameter(
        "exact",
        ("exact", "paper"),
        "exact: slots hold all texels that lookups touch; paper: sides are moved out by half a texel, which leaves "
        "some of these texels unwritten",
        "",
        "paper: 3.2; exact: ours",
        published="paper",
    ),
    "mapping": Parameter(
        "off",
        ("off", "hierarchical", "exact"),
        "where sparse bins go: nowhere, to the sink that a hierarchy finds, or to the nearest sink",
        "",
        "exact: 3.4; hierarchical: 4; off: ours",
        published="exact",
    ),
    "sink": Parameter(16, (8, 16, 32), "a bin with more triangles attracts others: M", "triangles", "3.4"),
    "remap_interval": Parameter(
        60,
        (0, 30, 60),
        "frames after which all bins are mapped anew; 0 for only at resets",
        "frames",
        "3.4; number: ours",
    ),
    "superblock_height": Parameter(
        0, (0, 512, 1024), "height of superblocks; 0 chooses one for the atlas", "texels", "3.5"
    ),
    "assignment": Parameter(
        "best",
        ("best", "first", "next"),
        "the superblock of a strip: the one in which it wastes least, or the first that has room; next: so too, but an "
        "orphan has only the one that an orphan before it got new, as algorithm 2 is printed",
        "",
        "first: 3.5; next: algorithm 2; best: ours",
        published="first",
    ),
    "orphans": Parameter(
        "widest",
        ("widest", "found"),
        "the order in which strips without a superblock get one: the widest slots first, or as algorithm 2 comes upon "
        "them; in a full atlas the highest slots come first either way, because they set the heights of its bands",
        "",
        "found: algorithm 2; widest: ours",
        published="found",
    ),
    "capacity": Parameter(0.3, (0.0, 0.3), "room that a strip gets beyond what it needs", "1", "3.6"),
    "shrink": Parameter(
        0.5, (0.0, 0.5), "a strip that uses less than this share of its room gives up the rest", "1", "3.6"
    ),
    "collapse": Parameter(
        0.25,
        (0.0, 0.25, 0.5),
        "a superblock with less than this share of its highest use is emptied: T",
        "1",
        "3.5; number, and that it is relative to the highest: ours",
    ),
    "hysteresis": Parameter(
        True, (False, True), "whether a triangle within 30 bins of height and 5 of each angle keeps its bin", "", "3.6"
    ),
    "freeze": Parameter(
        0.05,
        (0.0, 0.05),
        "new triangles' share of all area in the atlas, since strips were last made, below which nothing moves",
        "1",
        "3.6",
    ),
    "freeze_frames": Parameter(8, (4, 8, 16), "frames in a row that may be frozen", "frames", "ours"),
    "perspective": Parameter(
        True,
        (False, True),
        "whether samples are placed perspective-correct",
        "",
        "3.7; Tessellated Shading Streaming 5",
    ),
    "full_footprint": Parameter(
        False,
        (False, True),
        "whether triangles are enlarged to their slot's largest footprint; without, only texels that lookups touch are "
        "shaded",
        "",
        "true: 3.8; false: ours",
        published=True,
    ),
    "points": Parameter(
        True,
        (True, False),
        "whether triangles shorter than two texels take one where texels are short: under a sample budget, and from "
        "the second step of filling a full atlas on",
        "",
        "true: ours",
        published=False,
    ),
    "average_clear": Parameter(
        False,
        (False, True),
        "whether what is left of a strip is cleared with its average colour; the suite replaces the colours of texels "
        "without an owner before video coding, for every method alike, so this costs time and changes no byte",
        "",
        "3.8",
        published=True,
    ),
}
