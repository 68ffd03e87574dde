"""Finding packers by name: those of installed packages through entry points, or anyone's own module or file."""

from __future__ import annotations

import difflib
import hashlib
import importlib
import importlib.util
import inspect
import os
import re
import shlex
import sys
import traceback
from collections.abc import Collection, Iterable, Mapping
from importlib.metadata import EntryPoint, entry_points
from math import isfinite
from pathlib import Path
from types import ModuleType
from typing import Any

from shading_atlas_bench.harness.errors import InputError, is_stop, plain, text_of, told
from shading_atlas_bench.packers.interface import COMMON, Packer, Paper, Parameter, Value
from shading_atlas_bench.reports.store.names import ALLOWED, fits_everywhere

GROUP = "shading_atlas_packers"
SPEC = re.compile(  # folders may have brackets and at signs
    r"(?P<target>.+\.py(?::\w+)?|[^\[\]@]+)(?:@(?P<setting>[^\[\]]*))?(?:\[(?P<values>[^\[\]]*)\])?"
)
SETTING_LAST = re.compile(r"(?P<target>.+?)(?:@[^\[\]]*)?(?P<brackets>\[[^\[\]]*\])@[^\[\]]*")
PUBLISHED = "published"
TRUTH = {"true": True, "yes": True, "on": True, "1": True, "false": False, "no": False, "off": False, "0": False}


def packer_names() -> list[str]:
    """The names of all installed packers, sorted; none of them is imported."""
    return sorted({entry.name for entry in entry_points(group=GROUP)})


def find_packers() -> dict[str, type[Packer]]:
    """All installed packers by name, imported.

    Raises ValueError if one cannot be imported or two packages claim one name.
    """
    return {name: _installed(name) for name in packer_names()}


def load_packer(spec: str) -> list[Packer]:
    """The packers a `--method` argument means, with their parameters set.

    spec: `all`, `NAME`, `package.module:Class` or `path/to/file.py:Class`, then perhaps `@published` for what its paper
        has where the defaults are other values, then perhaps `[parameter=value,parameter=value]`, for `all` with common
        parameters only. Values take the type of the parameter's default.

    Raises ValueError for an unknown name, parameter or value, naming the known ones and the nearest match, and for a
    packer whose own code fails, or which is not as packers/interface.py says.
    """
    try:
        return _loaded(spec.strip())
    except BaseException as error:  # making a packer runs anybody's code
        if is_stop(error) or (isinstance(error, ValueError) and _is_ours(error)):
            raise
        raise ValueError(f"{spec} cannot be made: {told(error)}.") from error


def _is_ours(error: BaseException) -> bool:
    """Whether the suite's own code raised it, whose sentences are whole."""
    raised = traceback.extract_tb(error.__traceback__)[-1].filename
    return Path(raised).resolve().is_relative_to(Path(__file__).resolve().parents[1])


def _loaded(spec: str) -> list[Packer]:
    parts = SPEC.fullmatch(spec)
    if parts is None:
        raise ValueError(_malformed(spec))
    target, text, setting = parts["target"].strip(), parts["values"] or "", parts["setting"]
    if setting is not None and setting.strip() != PUBLISHED:
        what = f"the unknown setting @{setting.strip()}" if setting.strip() else "no setting behind its @"
        brackets = f"[{text}]" if text else ""
        raise ValueError(f"The method {spec!r} has {what}: write {target}@{PUBLISHED}{brackets} or {target}{brackets}.")
    if target == "all":
        packers, parameters = list(find_packers().values()), COMMON
    else:
        packers = [_own(target) if ":" in target and not target.endswith(".py") else _installed(target)]
        parameters = packers[0].parameters
    values = _parse_values(target, parameters, text)
    return [_made(packer, (published_values(packer) if setting else {}) | values) for packer in packers]


def _made(kind: type[Packer], values: dict[str, Any]) -> Packer:
    """A packer with these parameters. Raises ValueError if it is not what its class says."""
    packer = kind(**values)
    if packer.name != kind.name or packer.atlas != kind.atlas:
        raise ValueError(f"{kind.name} changes its `name` or `atlas` when it is made: both must be its class'.")
    for name, parameter in kind.parameters.items():
        if objection := _objection(parameter, getattr(packer, name)):
            raise ValueError(f"{kind.name}: the parameter {name} {objection}.")
    return packer


def _objection(parameter: Parameter, value: object) -> str | None:
    """Why a parameter cannot have this value, as the end of a sentence, or None."""
    if not isinstance(value, (bool, int, float, str)) or type(value) not in (bool, int, float, str):
        return f"is a {type(value).__name__}: give true, false, a number or a text"
    if not (value.isprintable() if isinstance(value, str) else isfinite(value)):
        return "is no line of text and no finite number"
    return parameter.objection(value)


def refuse_code(specs: Iterable[str], source: str, instead: str) -> None:
    """Raise InputError for a method whose code lies in a file or module, not in an installed package.

    What a file names is data, and may be a stranger's: code is run where the command line names it. instead: what to do
    with code that one trusts, with `{}` for the method.
    """
    for spec in specs:
        parts = SPEC.fullmatch(spec.strip())
        if ":" in (parts["target"] if parts else spec):
            raise InputError(
                f"{source} names the code {spec}, and code that a file names is not run: if you trust it, "
                f"{instead.format(shlex.quote(spec))}."
            )


def _malformed(spec: str) -> str:
    """Why a spec cannot be taken apart."""
    if turned := SETTING_LAST.fullmatch(spec):
        right = f"{turned['target'].strip()}@{PUBLISHED}{turned['brackets']}"
        return f"The method {spec!r} has its setting behind the brackets: write {right}."
    return (
        f"The method {spec!r} is not of the form NAME, NAME[parameter=value,parameter=value] or "
        f"NAME@{PUBLISHED}[parameter=value,parameter=value]."
    )


def published_values(packer: type[Packer]) -> dict[str, Any]:
    """The parameters whose published value is not their default, with that value."""
    named = {name: parameter.published for name, parameter in packer.parameters.items()}
    return {name: value for name, value in named.items() if value is not None}


def default_values(packer: type[Packer]) -> dict[str, Value]:
    """All parameters with their defaults."""
    return {name: parameter.default for name, parameter in packer.parameters.items()}


def own_values(packer: Packer) -> dict[str, Value]:
    """All parameters of a packer with their values."""
    return {name: getattr(packer, name) for name in packer.parameters}


def variant_string(packer: Packer) -> str:
    """All parameters of a packer and their values as `a=1,b=2`, sorted by name: equal for equal packers only."""
    return variant_of(own_values(packer))


def variant_of(values: Mapping[str, Value]) -> str:
    """The same of parameters' values."""
    return ",".join(f"{name}={value_text(values[name])}" for name in sorted(values))


def label_of(packer: Packer, varied: Collection[str] = ()) -> str:
    """What a packer is called wherever its results are shown: `NAME` at its defaults, `NAME@published` as published,
    else with what differs from the nearer of the two in brackets. Equal for equal packers of one class only.

    varied: parameters that a sweep varies, which its contenders do not differ in; they are left out.
    """
    usual = default_values(type(packer))
    bases = {packer.name: usual, f"{packer.name}@{PUBLISHED}": usual | published_values(type(packer))}

    def texts(values: Mapping[str, Value]) -> dict[str, str]:
        return {name: value_text(value) for name, value in values.items() if name not in varied}

    shown = texts(own_values(packer)).items()
    own = {base: dict(shown - texts(values).items()) for base, values in bases.items()}
    base, differing = min(own.items(), key=lambda item: len(item[1]))  # the first of equals: the defaults
    brackets = ",".join(f"{name}={text}" for name, text in sorted(differing.items()))
    return f"{base}[{brackets}]" if brackets else base


def own_classes(packer: type[Packer]) -> list[type]:
    """The classes that a packer is made of: itself and all that it is derived from, without Packer's and Python's."""
    return [
        kind
        for kind in packer.__mro__
        if kind not in Packer.__mro__
        and (issubclass(kind, Packer) or kind.__module__.partition(".")[0] not in sys.stdlib_module_names)
    ]


def source_file(kind: type) -> Path:
    """The file that a class lies in.

    Raises ValueError where there is none, as in a zip.
    """
    try:
        file = Path(inspect.getfile(kind)).absolute()
    except (TypeError, OSError):
        raise ValueError(f"The class {kind.__qualname__} of {kind.__module__} lies in no file.") from None
    if not file.is_file():
        raise ValueError(f"The class {kind.__qualname__} lies in {file}, which is no file: install it as a folder.")
    return file


def nearest(word: str, known: list[str]) -> str:
    """The end of an error sentence about an unknown word: the nearest known one, if any, and all of them."""
    lowered = word.lower()
    close = [one for one in known if lowered and (one.lower() == lowered or one.startswith(lowered))]
    close = close or difflib.get_close_matches(lowered, known, n=1, cutoff=0.5)
    guess = f" Did you mean {close[0]!r}?" if close else ""
    return f"{guess} Known: {', '.join(known) or 'none'}."


def _installed(name: str) -> type[Packer]:
    entries = {entry.value: entry for entry in entry_points(group=GROUP) if entry.name == name}
    if not entries and name.endswith(".py"):
        raise ValueError(f"{name} is a file: name the packer's class in it, like {name}:MyPacker.")
    if not entries:
        raise ValueError(f"There is no packer {name!r}.{nearest(name, [*packer_names(), 'all'])}")
    if len(entries) > 1:
        raise ValueError(f"Two packages offer a packer {name!r} ({', '.join(sorted(entries))}): uninstall one of them.")
    (entry,) = entries.values()
    return _checked(_import_entry(entry), f"the packer {name!r} ({entry.value})")


def _import_entry(entry: EntryPoint) -> object:
    try:
        found: object = entry.load()
        return found
    except BaseException as error:
        if is_stop(error):
            raise
        raise ValueError(f"The packer {entry.name!r} ({entry.value}) cannot be imported: {_told(error)}.") from error


def _own(target: str) -> type[Packer]:
    """The class of `package.module:Class` or `path/to/file.py:Class`."""
    place, _, class_name = target.rpartition(":")
    module = _import_file(Path(place)) if place.endswith(".py") else _import_module(place)
    if not hasattr(module, class_name):
        classes = [name for name, value in vars(module).items() if inspect.isclass(value) and issubclass(value, Packer)]
        known = [name for name in classes if name != Packer.__name__]
        raise ValueError(f"{place} has no packer class {class_name!r}.{nearest(class_name, known)}")
    return _checked(getattr(module, class_name), target)


def _import_module(name: str) -> ModuleType:
    if os.getcwd() not in sys.path:  # a console script does not look in the working folder by itself
        sys.path.append(os.getcwd())
    try:
        return importlib.import_module(name)
    except BaseException as error:
        if is_stop(error):
            raise
        raise ValueError(f"The module {name!r} cannot be imported: {_told(error)}{_place(error)}.") from error


def _told(error: BaseException) -> str:
    """What stopped an import, which runs anybody's code."""
    says_all = isinstance(error, (ImportError, AttributeError, ValueError))
    return text_of(error) if says_all else f"{type(error).__name__}: {text_of(error)}"


def _import_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise ValueError(f"There is no file {path} to take a packer from.")
    digest = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]
    name = f"{path.stem}_{digest}"  # two files of one name must not be taken for the same module
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    if spec is None or spec.loader is None:
        raise ValueError(f"The file {path} is of no kind that Python imports.")
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException as error:
        del sys.modules[name]
        if is_stop(error):
            raise
        said = f"{type(error).__name__}: {text_of(error)}{_place(error, path)}.{_neighbour(error, path)}"
        raise ValueError(f"The file {path} cannot be imported: {said}") from error
    return module


def _place(error: BaseException, path: Path | None = None) -> str:
    """Where an import went wrong: the last line in this file, or else in any that was run; empty where an error says
    so itself, or no line was run."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [frame for frame in frames if path is not None and frame.filename == str(path)]
    code = [frame for frame in frames[1:] if not frame.filename.startswith("<") and "importlib" not in frame.filename]
    if isinstance(error, SyntaxError) or not (own or code):
        return ""
    last = (own or code)[-1]
    return f" ({Path(last.filename).name}, line {last.lineno})"


def _neighbour(error: BaseException, path: Path) -> str:
    """What to do where a file imports one beside it, which only packages can."""
    name = (error.name or "").partition(".")[0] if isinstance(error, ModuleNotFoundError) else ""
    if not name or not ((path.parent / f"{name}.py").is_file() or (path.parent / name).is_dir()):
        return ""
    return (
        f" {name} lies beside it: make a package of the folder, with an __init__.py, and name "
        f"{path.absolute().parent.name}.{path.stem}:CLASS in the folder above, or pip install it."
    )


def _checked(found: object, what: str) -> type[Packer]:
    if not (inspect.isclass(found) and issubclass(found, Packer)):
        raise ValueError(f"{what} is not a packer: it must be a subclass of shading_atlas_bench.Packer.")
    if inspect.isabstract(found):
        raise ValueError(f"{what} is unfinished: it lacks {', '.join(sorted(found.__abstractmethods__))}.")
    missing = [name for name in ("name", "paper") if not hasattr(found, name)]
    if missing:
        raise ValueError(f"{what} lacks the class attribute {' and '.join(missing)}.")
    if not fits_everywhere(found.name):
        name = plain(ascii(found.name), 40) if type(found.name) is str else f"of type {type(found.name).__name__}"
        raise ValueError(f"{what} has the name {name}, which files cannot have: take {ALLOWED}.")
    if wrong := _wrong_declarations(found):
        raise ValueError(f"{what} declares {wrong} otherwise than packers/interface.py says.")
    for kind in own_classes(found):
        source_file(kind)  # results name the files that they come from
    for name, common in COMMON.items():
        if type(found.parameters[name].default) is not type(common.default):
            raise ValueError(
                f"{what} has a parameter {name!r} of its own, which is one of all methods ({common.meaning}): give it "
                "another name."
            )
    return found


def _wrong_declarations(kind: type[Packer]) -> str:
    """Which attributes of a packer's class are not what the interface says; empty if none."""
    paper, parameters = kind.paper, kind.parameters
    fine = {
        "paper": type(paper) is Paper and _are_texts(paper.title, paper.doi) and type(paper.year) is int,
        "atlas": type(kind.atlas) is bool,
        "parameters": type(parameters) is dict
        and all(_are_texts(name) and name.isidentifier() for name in parameters)
        and all(type(one) is Parameter and _objection(one, one.default) is None for one in parameters.values()),
        "skips": type(kind.skips) is dict
        and all(type(texts) is tuple and len(texts) == 3 for texts in kind.skips.values())
        and all(_are_texts(name, *texts) for name, texts in kind.skips.items()),
    }
    return " and ".join(name for name, is_fine in fine.items() if not is_fine)


def _are_texts(*texts: object) -> bool:
    """Whether all of them are lines of text."""
    return all(type(text) is str and text.isprintable() for text in texts)


def _parse_values(target: str, parameters: dict[str, Parameter], text: str) -> dict[str, Any]:
    """The values that stand in the brackets behind a target."""
    values: dict[str, Any] = {}
    items = [part.strip() for part in text.split(",") if part.strip()]
    for item in items:
        name, equals, value = (part.strip() for part in item.partition("="))
        if name not in parameters and name.lstrip("@") == PUBLISHED:
            rest = ",".join(other for other in items if other is not item)
            right = f"{target}@{PUBLISHED}" + (f"[{rest}]" if rest else "")
            raise ValueError(f"{target}: {item!r} is no parameter but a setting: write {right}.")
        if not equals:
            raise ValueError(f"{target}: {item!r} is not of the form parameter=value.")
        if name not in parameters and target == "all":
            raise ValueError(
                f"{name!r} is not a parameter of all methods, as {', '.join(sorted(COMMON))} is: name the method that "
                "it belongs to in place of 'all'."
            )
        if name not in parameters:
            raise ValueError(f"{target} has no parameter {name!r}.{nearest(name, sorted(parameters))}")
        if name in values:
            raise ValueError(f"{target}: the parameter {name!r} is given twice.")
        values[name] = parse_value(target, name, parameters[name], value)
    return values


def parse_value(method: str, name: str, parameter: Parameter, text: str) -> Value:
    """`text` as the type of the parameter's default; a whole number may be written for a float.

    Raises ValueError for what cannot be read so, naming the method and the parameter.
    """
    kind = type(parameter.default)
    try:
        if kind is bool:
            return TRUTH[text.lower()]
        value: Value = kind(text)
    except (KeyError, ValueError):
        wanted = {bool: "true or false", int: "a whole number", float: "a number"}.get(kind, f"a {kind.__name__}")
        raise ValueError(f"{method}: {name} must be {wanted}, not {text!r}.") from None
    if kind is str and parameter.sweep and all(isinstance(known, str) for known in parameter.sweep):
        known = sorted({str(each) for each in (*parameter.sweep, parameter.default)})
        if value not in known:
            raise ValueError(f"{method}: {name} cannot be {text!r}.{nearest(text, known)}")
    return value


def value_text(value: Value) -> str:
    """A parameter's value as text that `parse_value` reads."""
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value)
    return str(value)
