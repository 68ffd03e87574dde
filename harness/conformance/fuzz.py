"""Fuzzing: random soups of triangles, cameras, sets and parameters, into everything a trial checks.

Hypothesis finds what goes wrong. It is made smaller here, because what hypothesis makes of it depends on the order of
Python's sets, which is another one in every run. It can be kept as a file and tried again.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from shading_atlas_bench.arithmetic.functions import sin
from shading_atlas_bench.harness.conformance.trial import Stage, TrialCase, TrialResult, try_method
from shading_atlas_bench.harness.errors import told
from shading_atlas_bench.harness.watch.watchdog import PackTimeoutError, time_limit
from shading_atlas_bench.harness.workload.views import Pose, ViewCell, from_rotation_vector
from shading_atlas_bench.scenes.model import Light, Material, Scene
from shading_atlas_bench.scenes.quaternions import multiply

if TYPE_CHECKING:
    from hypothesis.strategies import SearchStrategy

    from shading_atlas_bench.kernels.device import Device
    from shading_atlas_bench.packers.interface import Packer

SIZE = (48, 27)
ATLASES = ((128, 128), (256, 64), (64, 37), (16, 16))
VIEWS = (60.0, 90.0, 20.0, 1.0, 150.0, 179.0)
MOST_TRIANGLES, MOST_FRAMES = 8, 2
MATERIALS = [Material(double_sided=True), Material(base_colour=(0.3, 0.5, 0.9, 1.0))]
LAMP = Light("point", (6.0, 6.0, 6.0), (0.0, 2.0, 1.0))
# Where corners meet: the eye, its planes, the near plane, and far away.
SPECIAL = (0.0, 1.0, -1.0, 0.02, -0.02, 1e-7, 0.5, -2.0, 100.0, -1e6)


@dataclass(frozen=True)
class Soup:
    """One case of the fuzzing, as plain values.

    corners: triangles of three points. sided: per triangle, 1 where seen from the front only. eye, yaw and pitch
    (degrees), fov: the camera's, the same in all frames. sets: the triangles of each frame. parameters: of the packer.
    """

    corners: list[list[list[float]]]
    sided: list[int]
    eye: list[float]
    yaw: float
    pitch: float
    fov: float
    atlas: list[int]
    sets: list[list[int]]
    parameters: dict[str, Any]

    def plain(self) -> Soup:
        """The same for another packer: with its default parameters."""
        return replace(self, parameters={})

    def smaller(self, parameters: Mapping[str, Any]) -> Iterator[Soup]:
        """Soups with a frame or a triangle fewer, straight ones, and that with these parameters."""
        if len(self.sets) > 1:
            for k in range(len(self.sets)):
                yield replace(self, sets=self.sets[:k] + self.sets[k + 1 :])
        if len(self.corners) > 1:
            for k in range(len(self.corners)):
                sets = [[t - (t > k) for t in chosen if t != k] for chosen in self.sets]
                corners, sided = self.corners[:k] + self.corners[k + 1 :], self.sided[:k] + self.sided[k + 1 :]
                yield replace(self, corners=corners, sided=sided, sets=sets)
        for straight in (
            replace(self, parameters=dict(parameters)),
            replace(self, eye=[0.0, 0.0, 0.0]),
            replace(self, yaw=0.0),
            replace(self, pitch=0.0),
            replace(self, fov=VIEWS[0]),
        ):
            if straight != self:
                yield straight

    def case(self) -> TrialCase:
        """As a case; positions are float32 and nothing is cleaned."""
        corners = np.array(self.corners, np.float32).reshape(-1, 3)
        positions, indices = np.unique(corners, axis=0, return_inverse=True)
        up = np.tile(np.array([0, 1, 0], np.float32), (len(positions), 1))
        colours = np.ones((len(positions), 4), np.float32)
        colours[:, :3] = 0.5 + 0.4 * sin(3 * positions)
        uvs = np.zeros((len(positions), 2), np.float32)
        scene = Scene("soup", positions, indices.reshape(-1, 3).astype(np.int32), up, uvs, colours,
                      np.array(self.sided, np.int32), MATERIALS, lights=[LAMP])  # fmt: skip
        yaw, pitch = (from_rotation_vector(np.radians(turn)) for turn in ([0, self.yaw, 0], [self.pitch, 0, 0]))
        pose = Pose(np.array(self.eye), multiply(yaw, pitch))
        sets = tuple(np.array(sorted(chosen), np.int32) for chosen in self.sets)
        cell = ViewCell(0.08, min(179.0, self.fov + min(20.0, self.fov / 3)))
        width, height = self.atlas
        return TrialCase(
            scene, (pose,) * len(sets), fov=self.fov, cell=cell, size=SIZE, atlas=(width, height), sets=sets
        )


def soups(packer: type[Packer]) -> SearchStrategy[Soup]:
    """Soups for a packer, with at most one parameter at another value than its default."""
    from hypothesis import strategies as st

    number = st.one_of(st.floats(-3, 3, width=32), st.sampled_from(SPECIAL))
    point = st.lists(number, min_size=3, max_size=3)
    near = st.tuples(st.floats(-1.5, 1.5, width=32), st.floats(-1, 1, width=32), st.floats(-6, -1, width=32)).map(list)
    triangle = st.lists(st.one_of(near, point), min_size=3, max_size=3)
    changes: list[dict[str, Any]] = [{}] + [
        {name: value}
        for name, parameter in packer.parameters.items()
        for value in dict.fromkeys(parameter.sweep)
        if value != parameter.default
    ]

    @st.composite
    def soup(draw: st.DrawFn) -> Soup:
        corners = draw(st.lists(triangle, min_size=1, max_size=MOST_TRIANGLES))
        count = len(corners)
        some = st.lists(st.integers(0, count - 1), max_size=count, unique=True)
        sets = draw(st.lists(st.one_of(st.just(list(range(count))), some), min_size=1, max_size=MOST_FRAMES))
        return Soup(
            corners,
            draw(st.lists(st.integers(0, 1), min_size=count, max_size=count)),
            draw(st.one_of(st.just([0.0, 0.0, 0.0]), point)),
            draw(st.sampled_from([0.0, 30.0, 90.0, 180.0])),
            draw(st.sampled_from([0.0, -20.0, 90.0])),
            draw(st.sampled_from(VIEWS)),
            list(draw(st.sampled_from(ATLASES))),
            sets,
            draw(st.sampled_from(changes)),
        )

    return soup()


def try_soup(device: Device, packer: type[Packer], soup: Soup) -> TrialResult:
    """What comes out of a soup; parameters that a packer refuses in a sentence are its right."""
    try:
        stage = Stage.of(device, soup.case())
    except Exception as error:  # of the harness, then, and to be found as well
        return TrialResult("failed", told(error))
    return try_method(stage, lambda: packer(**soup.parameters), again=1)


def find_failure(
    device: Device,
    packer: type[Packer],
    examples: int,
    parameters: Mapping[str, Any] | None = None,
    timeout: float = 60.0,
) -> tuple[Soup, TrialResult] | None:
    """Try so many soups, always the same ones; the smallest that goes wrong and what is wrong, or None.

    parameters: of the packer, where not its defaults. timeout: seconds for one soup.
    """
    import hypothesis
    import hypothesis.errors

    failures: list[tuple[Soup, TrialResult]] = []

    def tried(soup: Soup) -> bool:
        """Whether all is well; else it is noted."""
        try:
            with time_limit(timeout, "fuzzing", who=packer.name):
                found = try_soup(device, packer, soup)
        except PackTimeoutError as error:
            found = TrialResult("timeout", str(error))
        if not (found.good or found.status == "refused"):
            failures.append((soup, found))
        return found.good or found.status == "refused"

    @hypothesis.settings(
        max_examples=examples,
        database=None,
        deadline=None,
        derandomize=True,
        report_multiple_bugs=False,
        suppress_health_check=list(hypothesis.HealthCheck),
        phases=(hypothesis.Phase.generate,),
        verbosity=hypothesis.Verbosity.quiet,
    )
    @hypothesis.given(soups(packer))
    def attempt(soup: Soup) -> None:
        assert tried(replace(soup, parameters={**(parameters or {}), **soup.parameters}))

    try:
        attempt()
    except (AssertionError, hypothesis.errors.HypothesisException):
        del failures[1:]  # hypothesis tries the first one again
        while not all(tried(soup) for soup in failures[-1][0].smaller(parameters or {})):
            pass  # from the smaller one on that is noted now
        return failures[-1]
    return None


def save_soup(folder: Path, packer: str, soup: Soup, found: TrialResult) -> Path:
    """Keep a soup as a file of the folder, and return its path."""
    text = json.dumps({"packer": packer, "found": f"{found.status}: {found.sentence}", **asdict(soup)}, indent=1)
    digest = hashlib.sha256(json.dumps(asdict(soup), sort_keys=True).encode()).hexdigest()[:8]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{packer}-{digest}.json"
    path.write_text(text + "\n", encoding="utf-8")
    return path


def read_soup(path: Path) -> tuple[str, Soup]:
    """The packer's name and the soup of a kept file."""
    values = json.loads(path.read_text(encoding="utf-8"))
    name = values.pop("packer")
    del values["found"]
    return name, Soup(**values)
