"""Scenes by name or from files."""

from __future__ import annotations

import difflib
import os
import struct
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from shading_atlas_bench.arithmetic.arrays import fixed
from shading_atlas_bench.scenes.assemble import assemble
from shading_atlas_bench.scenes.cache import fetch, scene_key, store
from shading_atlas_bench.scenes.cameras import CAMERAS, read_cameras
from shading_atlas_bench.scenes.features import content_digest, find_features
from shading_atlas_bench.scenes.files import MISSING, SceneFiles, absence, is_file, reason_of
from shading_atlas_bench.scenes.gltf import read_gltf
from shading_atlas_bench.scenes.inputs import InputFiles
from shading_atlas_bench.scenes.lights import add_lights
from shading_atlas_bench.scenes.memory import check_memory
from shading_atlas_bench.scenes.mesh_files import read_mesh_file
from shading_atlas_bench.scenes.model import Scene, SceneError
from shading_atlas_bench.scenes.raw import MAX_TEXTURE, RawScene
from shading_atlas_bench.scenes.repair import load_pymeshlab
from shading_atlas_bench.scenes.standing import GIVEN_UP, NARROWEST, Standing, decide

_READERS = {".glb": read_gltf, ".gltf": read_gltf}
_READERS |= dict.fromkeys((".obj", ".ply", ".stl", ".off"), read_mesh_file)

_MOST_DETAIL = 50_000_000
_STATES_METRES = (".glb", ".gltf")  # by their specification
_GUESSES = {1.0: "metres", 0.01: "centimetres"}  # of files that state no unit, where these make it a place
_OBJECT_SIZE = 2.0  # metres: what other files are taken to be, so that a view cell in metres means something
_OVERRULED = "One camera in a cameras.json beside the file decides instead."  # of what is wide enough for a place
_LIKELY = (1e-3, 1e5)  # metres: how large scenes are
_DRAWN = (1e-18, 1e18)  # metres: beyond, squared lengths leave float32's range in metres or in the scene's units

_PROCEDURAL = {
    "hall": "an indoor hall: a few very large surfaces, very many small ones, railings and pipes, 3 shadowed lights",
    "village": "an outdoor village: terrain, timber houses, masked foliage, sun and sky",
    "shells": "an object: nested see-through surfaces with bumps, alpha 0.5",
}


def list_scenes() -> dict[str, str]:
    """Names of the built-in scenes and what each is."""
    return dict(_PROCEDURAL)


def load_scene(
    name_or_path: str,
    *,
    unit: float | None = None,
    detail: int | None = None,
    repair: bool = False,
    decimate: float | None = None,
    seed: int = 0,
    cache: Path | None = None,
    allow_outside: bool = False,
    max_texture: int = MAX_TEXTURE,
) -> Scene:
    """A built-in scene by name, or a .glb, .gltf, .obj, .ply, .stl or .off file, here or among the real scenes.

    unit: metres per unit of a file, whatever it states. Without it that of `cameras.json` beside it counts, then the
        metre for glTF; of other files it is guessed, with a note.
    detail: triangles of a built-in scene, made from `seed`.
    repair: drop duplicate and degenerate faces and faces at non-manifold edges. decimate: ratio of triangles to keep.
    allow_outside: whether a file may name others that are not in its folder or below. max_texture: texels of a side
        that its textures are reduced to, with a note.
    cache: folder of loaded scenes; without it nothing is kept. The scene's arrays are read-only.
    Raises SceneError, one sentence, for everything that cannot be loaded.
    """
    _check_options(unit, detail, decimate, max_texture)
    options: dict[str, object] = {"name": name_or_path, "unit": unit, "repair": repair, "decimate": decimate}
    if name_or_path in _PROCEDURAL:
        if repair or decimate is not None:
            raise SceneError(f"{name_or_path} is made to size: use --detail instead of --repair and --decimate.")
        options |= {"detail": detail, "seed": seed}
        return _built_in(cache, options, lambda: _make(name_or_path, detail, seed))
    path = _existing(name_or_path)
    options |= {"name": _scene_name(path), "folder": str(path.parent.resolve()), "max_texture": max_texture}
    check_memory(path.stat().st_size, f"The file {path}")
    raw = RawScene(max_texture=max_texture)
    if cache is None:
        return fixed(_load_file(path, SceneFiles(path, allow_outside), raw, unit, repair, decimate))
    with _in_words(path):
        entry = cache / scene_key(options, [path])
    scene = fetch(entry, InputFiles(path, allow_outside).unchanged)
    if scene is None:
        files = InputFiles(path, allow_outside)
        scene = fixed(_load_file(path, files, raw, unit, repair, decimate))
        store(entry, scene, files.asked)
    return scene


def _check_options(unit: float | None, detail: int | None, decimate: float | None, max_texture: int) -> None:
    if unit is not None and not (np.isfinite(unit) and unit > 0):
        raise SceneError(f"The unit must be a positive number of metres, not {unit}.")
    if detail is not None and not 1 <= detail <= _MOST_DETAIL:
        raise SceneError(f"The detail must be between 1 and {_MOST_DETAIL:,} triangles, not {detail}.")
    if max_texture < 1:
        raise SceneError(f"The longest side of textures must be 1 texel or more, not {max_texture}.")
    if decimate is not None and not 0 < decimate <= 1:
        raise SceneError(f"The ratio of triangles to keep must be above 0 and at most 1, not {decimate}.")


def _built_in(cache: Path | None, options: Mapping[str, object], make: Callable[[], Scene]) -> Scene:
    """A built-in scene from the cache, or made and stored there."""
    entry = cache / scene_key(options, []) if cache else None
    scene = fetch(entry) if entry else None
    if scene is None:
        scene = fixed(make())
        if entry:
            store(entry, scene)
    return scene


def _make(name: str, detail: int | None, seed: int) -> Scene:
    if name == "hall":
        from shading_atlas_bench.scenes.hall import make_hall as make
    elif name == "village":
        from shading_atlas_bench.scenes.village import make_village as make
    else:
        from shading_atlas_bench.scenes.shells import make_shells as make
    return make(seed=seed) if detail is None else make(detail=detail, seed=seed)


def real_scenes() -> Path | None:
    """The folder of scenes that are no part of this project; None where BENCH_SCENES names none."""
    named = os.environ.get("BENCH_SCENES")
    return Path(named) if named else None


def scene_path(name: str) -> Path:
    """The file of that name, or else that in the folder of real scenes, where it is there."""
    here, folder = Path(name), real_scenes()
    return folder / name if folder and not is_file(here) and is_file(folder / name) else here


def _existing(name_or_path: str) -> Path:
    """The file meant, checked; raises SceneError naming the known scenes and formats otherwise."""
    path = scene_path(name_or_path)
    formats = ", ".join(_READERS)
    if is_file(path):
        if path.suffix.lower() in _READERS:
            return path
        raise SceneError(f"{path} is of a format that cannot be read; readable are {formats}.")
    if (why := absence(path)) != MISSING:
        raise SceneError(f"{path} {why}; name a scene file ({formats}).")
    if path.suffix or len(path.parts) > 1:
        folder = real_scenes()
        further = f", nor one of that name in {folder} (BENCH_SCENES)" if folder else ""
        raise SceneError(f"There is no scene file {path}{further}.")
    known = ", ".join(_PROCEDURAL)
    near = difflib.get_close_matches(name_or_path, _PROCEDURAL, n=1, cutoff=0.0)
    raise SceneError(f"There is no scene {name_or_path!r}; did you mean {near[0]!r}? Known are {known}, or a file.")


def _scene_name(path: Path) -> str:
    """What reports call a file: its own name, or its folder's where it is just called "scene"."""
    return path.resolve().parent.name if path.stem.lower() == "scene" else path.stem


def _load_file(
    path: Path, files: SceneFiles, raw: RawScene, unit: float | None, repair: bool, decimate: float | None
) -> Scene:
    """Read a file into the empty `raw`, and make a scene of it."""
    if repair or decimate is not None:
        load_pymeshlab()  # where it is missing, that is said before a large file is read
    with _in_words(path):
        _READERS[path.suffix.lower()](path, files, raw)
        cameras, stated_unit = read_cameras(files.exact(path, CAMERAS))
        raw.cameras = cameras + raw.cameras
        scene = assemble(_scene_name(path), raw, repair, decimate, str(path))
    standing = _scaled(scene, path, unit, stated_unit)
    if standing.given_up:
        scene.notes.append(GIVEN_UP)
    scene.place, scene.because = standing.place, standing.reason
    if not scene.cameras and min((scene.bounds[1] - scene.bounds[0])[[0, 2]]) * scene.metres_per_unit >= NARROWEST:
        scene.because += f" {_OVERRULED}"
    if standing.camera:
        scene.cameras = [standing.camera]
    scene.notes.append(add_lights(scene))
    scene.notes += _see_through(scene)
    scene.features = find_features(scene)
    scene.content_hash = content_digest(scene)
    return scene


def _scaled(scene: Scene, path: Path, unit: float | None, stated: float | None) -> Standing:
    """Set what a file's unit is; whether it is a place at that scale. Raises SceneError where nothing can be drawn."""
    source = "cameras.json" if stated else "glTF, which is in metres"
    stated = stated or (1.0 if path.suffix.lower() in _STATES_METRES else None)
    if unit is not None:
        if stated not in (None, unit):
            scene.notes.append(f"The unit is {unit:g} m as asked for, not {stated:g} m as stated ({source}).")
        scene.metres_per_unit, scene.unit_from = unit, "--unit"
    elif stated is not None:
        scene.metres_per_unit, scene.unit_from = stated, source
    else:
        return _guessed(scene)
    size = float(max(scene.bounds[1] - scene.bounds[0])) * scene.metres_per_unit
    if not _DRAWN[0] <= size <= _DRAWN[1]:
        sentence = f"is {size:.3g} m large by its unit ({scene.unit_from}), which single precision cannot draw"
        raise SceneError(f"{path} {sentence}; --unit sets another.")
    if not _LIKELY[0] <= size <= _LIKELY[1]:
        scene.notes.append(f"The scene is {size:.3g} m large by its unit ({scene.unit_from}); --unit sets another.")
    return decide(scene)


def _guessed(scene: Scene) -> Standing:
    """Set the unit of a file that states none: one in which the scene is a place, or that makes an object 2 m large."""
    given_up = False
    for unit, name in _GUESSES.items():
        scene.metres_per_unit, scene.unit_from = unit, f"a guess: {name}"
        standing = decide(scene)
        if standing.place:
            scene.notes.append(f"The file states no unit: it is taken to be in {name} (--unit changes that).")
            return standing
        given_up |= standing.given_up
    scene.metres_per_unit = _OBJECT_SIZE / float(max(scene.bounds[1] - scene.bounds[0]))
    scene.unit_from = f"a guess: the object is {_OBJECT_SIZE:g} m large"
    further = "" if scene.cameras else "; if it is a place, put a cameras.json with one camera beside it"
    size = f"{_OBJECT_SIZE:g} m large"
    scene.notes.append(f"The file states no unit: the object is taken to be {size} (--unit changes that{further}).")
    reason = f"No place was found in it, neither in {' nor in '.join(_GUESSES.values())}."
    return Standing(False, reason, given_up=given_up)


def _see_through(scene: Scene) -> list[str]:
    """Sentences on what others are seen through, and how."""
    used = np.bincount(scene.material_ids, minlength=len(scene.materials))
    triangles = {"blend": 0, "transmission": 0}
    for material, count in zip(scene.materials, used, strict=True):
        triangles["blend"] += int(count) * (material.alpha_mode == "blend")
        triangles["transmission"] += int(count) * (material.transmission > 0)
    sentences = {
        "blend": "Triangles of blended materials: {:,}.",
        "transmission": "Triangles that let light through (KHR_materials_transmission), blended as if thin: without "
        "refraction, and 90 % of the light that they let through passes unchanged in colour: {:,}.",
    }
    return [sentences[kind].format(count) for kind, count in triangles.items() if count]


@contextmanager
def _in_words(path: Path) -> Iterator[None]:
    """Whatever is raised while a file is read becomes one sentence."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    except SceneError as error:
        raise error if str(path) in str(error) else SceneError(f"{path} cannot be read: {error}") from error
    except OSError as error:
        other = f" ({error.filename})" if error.filename not in (None, str(path)) else ""
        raise SceneError(f"{path} cannot be read: {reason_of(error)}{other}.") from error
    except Exception as error:
        kind = path.suffix[1:].upper()
        raise SceneError(f"{path} cannot be read as {kind}: {_reason(error)}.") from error


def _reason(error: Exception) -> str:
    """A damaged file's error in words."""
    if isinstance(error, KeyError):
        return f"it lacks {error}"
    if isinstance(error, MemoryError):
        return "it claims to hold more than fits into memory"
    if isinstance(error, ImportError | UnicodeDecodeError):
        return "it is damaged, its text is in no known encoding"
    if isinstance(error, IndexError):
        return "it is damaged, something refers to what it does not have"
    if isinstance(error, struct.error):
        return "it is damaged or incomplete, it ends within its data"
    if isinstance(error, ValueError) and (text := str(error).strip()):
        return f"it is damaged or incomplete ({text.splitlines()[0].rstrip('.')})"
    return "it is damaged, a value in it is of another kind than its format has"
