"""Finding packers by name: those of installed packages through entry points, or anyone's own module or file."""

from __future__ import annotations

import difflib
import hashlib
import importlib
import importlib.util
import inspect
import os
import re
import sys
from collections.abc import Collection
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from types import ModuleType
from typing import Any

from packers.interface import COMMON, Packer, Parameter
from reports.names import ALLOWED, fits_everywhere

GROUP = "shading_atlas_packers"
SPEC = re.compile(  # folders may have brackets and at signs
    r"(?P<target>.+\.py(?::\w+)?|[^\[\]@]+)(?:@(?P<setting>[^\[\]]*))?(?:\[(?P<values>[^\[\]]*)\])?"
)
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
        has where the defaults are other values; all but the first may end in `[parameter=value,parameter=value]`.
        Values take the type of the parameter's default.

    Raises ValueError for an unknown name, parameter or value, naming the known ones and the nearest match.
    """
    spec = spec.strip()
    parts = SPEC.fullmatch(spec)
    if parts is None:
        raise ValueError(f"The method {spec!r} is not of the form NAME or NAME[parameter=value,parameter=value].")
    target, values = parts["target"].strip(), parts["values"]
    setting = parts["setting"] and parts["setting"].strip()
    if setting not in (None, PUBLISHED):
        raise ValueError(f"The method {spec!r} has the unknown setting @{setting}: {PUBLISHED} is the only one.")
    if target == "all" and values is None:
        return [packer(**published_values(packer, setting)) for packer in find_packers().values()]
    if target == "all":
        raise ValueError(f"Parameters belong to one method: name it in place of 'all' in {spec!r}.")
    packer = _own(target) if ":" in target and not target.endswith(".py") else _installed(target)
    return [packer(**published_values(packer, setting) | _parse_values(packer, values or ""))]


def published_values(packer: type[Packer], setting: str | None = PUBLISHED) -> dict[str, Any]:
    """The parameters whose published value is not their default, with that value; none for the setting None."""
    named = {name: parameter.published for name, parameter in packer.parameters.items()}
    return {name: value for name, value in named.items() if value is not None and setting == PUBLISHED}


def variant_string(packer: Packer) -> str:
    """All parameters of a packer and their values as `a=1,b=2`, sorted by name: equal for equal packers only."""
    return ",".join(f"{name}={value_text(getattr(packer, name))}" for name in sorted(packer.parameters))


def label_of(packer: Packer, varied: Collection[str] = ()) -> str:
    """What a packer is called wherever its results are shown: `NAME` at its defaults, `NAME@published` as published,
    else with what differs from the nearer of the two in brackets. Equal for equal packers of one class only.

    varied: parameters that a sweep varies, which its contenders do not differ in; they are left out.
    """
    kind = type(packer)
    bases = {packer.name: kind(), f"{packer.name}@{PUBLISHED}": kind(**published_values(kind))}
    names = [name for name in sorted(packer.parameters) if name not in varied]

    def values(one: Packer) -> dict[str, str]:
        return {name: value_text(getattr(one, name)) for name in names}

    own = {base: dict(values(packer).items() - values(one).items()) for base, one in bases.items()}
    base, differing = min(own.items(), key=lambda item: len(item[1]))  # the first of equals: the defaults
    brackets = ",".join(f"{name}={text}" for name, text in sorted(differing.items()))
    return f"{base}[{brackets}]" if brackets else base


def folder_name(method: str, variant: str) -> str:
    """The folder of a method's dumped frames: its name and a hash of its parameters."""
    digest = hashlib.sha256(variant.encode()).hexdigest()[:8]
    return f"{re.sub(r'[^A-Za-z0-9._]+', '_', method)}-{digest}"


def nearest(word: str, known: list[str]) -> str:
    """The end of an error sentence about an unknown word: the nearest known one, if any, and all of them."""
    close = difflib.get_close_matches(word, known, n=1, cutoff=0.5)
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


def _import_entry(entry: EntryPoint) -> Any:
    try:
        return entry.load()
    except (ImportError, AttributeError) as error:
        raise ValueError(f"The packer {entry.name!r} ({entry.value}) cannot be imported: {error}.") from error


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
    except (ImportError, ValueError) as error:
        raise ValueError(f"The module {name!r} cannot be imported: {error}.") from error


def _import_file(path: Path) -> ModuleType:
    if not path.is_file():
        raise ValueError(f"There is no file {path} to take a packer from.")
    digest = hashlib.sha256(str(path.resolve()).encode()).hexdigest()[:8]
    name = f"{path.stem}_{digest}"  # two files of one name must not be taken for the same module
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.spec_from_file_location(name, path)
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        del sys.modules[name]
        raise ValueError(f"The file {path} cannot be imported: {type(error).__name__}: {error}.") from error
    return module


def _checked(found: Any, what: str) -> type[Packer]:
    if not (inspect.isclass(found) and issubclass(found, Packer)):
        raise ValueError(f"{what} is not a packer: it must be a subclass of packers.interface.Packer.")
    if inspect.isabstract(found):
        raise ValueError(f"{what} is unfinished: it lacks {', '.join(sorted(found.__abstractmethods__))}.")
    missing = [name for name in ("name", "paper") if not hasattr(found, name)]
    if missing:
        raise ValueError(f"{what} lacks the class attribute {' and '.join(missing)}.")
    if not fits_everywhere(found.name):
        raise ValueError(f"{what} has the name {found.name!r}, which files cannot have: take {ALLOWED}.")
    for name, common in COMMON.items():
        if type(found.parameters[name].default) is not type(common.default):
            raise ValueError(
                f"{what} has a parameter {name!r} of its own, which is one of all methods ({common.meaning}): give it "
                "another name."
            )
    return found


def _parse_values(packer: type[Packer], text: str) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for item in filter(None, (part.strip() for part in text.split(","))):
        name, equals, value = (part.strip() for part in item.partition("="))
        if not equals:
            raise ValueError(f"{packer.name}: {item!r} is not of the form parameter=value.")
        if name not in packer.parameters:
            raise ValueError(f"{packer.name} has no parameter {name!r}.{nearest(name, sorted(packer.parameters))}")
        if name in values:
            raise ValueError(f"{packer.name}: the parameter {name!r} is given twice.")
        values[name] = parse_value(packer, name, packer.parameters[name], value)
    return values


def parse_value(packer: type[Packer], name: str, parameter: Parameter, text: str) -> Any:
    """`text` as the type of the parameter's default; a whole number may be written for a float."""
    kind = type(parameter.default)
    try:
        if kind is bool:
            return TRUTH[text.lower()]
        value = kind(text)
    except (KeyError, ValueError):
        wanted = {bool: "true or false", int: "a whole number", float: "a number"}.get(kind, f"a {kind.__name__}")
        raise ValueError(f"{packer.name}: {name} must be {wanted}, not {text!r}.") from None
    if kind is str and parameter.sweep and all(isinstance(known, str) for known in parameter.sweep):
        known = sorted({*parameter.sweep, parameter.default})
        if value not in known:
            raise ValueError(f"{packer.name}: {name} cannot be {text!r}.{nearest(text, known)}")
    return value


def value_text(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value)
    return str(value)
