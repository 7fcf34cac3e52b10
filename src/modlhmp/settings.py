"""Configuration and dataset files: closed schemas, plain messages, recordings resolved to files."""

import difflib
import glob
import math
import os
import re
from datetime import date
from pathlib import Path
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

import jsonschema
import yaml

from modlhmp.cleaning import RULES
from modlhmp.floor_plan import image_of
from modlhmp.maps import KINDS as MAP_KINDS
from modlhmp.maps import SAMPLED
from modlhmp.networks import KINDS as LEARNED_KINDS
from modlhmp.readers.raw import COMPRESSED, find_recording
from modlhmp.storage import DataError

DATASET_DEFAULTS = {
    "time_step_s": 1.0,
    "observed_rows": 4,
    "cleaning": ["single_row", "gap_over_5s"],
    "paper_protocol": {"idle_filter": None},
    "floor_plan": None,
    "areas": [],
    "sources": [],
    "demo": False,
    "paper_results": None,
    "difference_weights": [0.48, 0.33, 0.19],
    "tuned": {},
}
THINNED = ("cliff", "episodes", "snippets")
VALIDATION_DAYS = 0.3
AVERAGED = ("average", "cvm", "episodes", "snippets", *(kind for kind in LEARNED_KINDS if kind != "mid"))
_READER_NEEDS = {
    "edinburgh": ("frame_rate", "scale"),
    "edinburgh_rows": ("frame_rate", "scale", "row_stride"),
    "delimited": ("columns",),
}
_RULE_NEEDS = {"min_points": "points", "start_end_margin": "polygons", "lift_loiterers": "polygons"}


def check(settings, schema, source):
    """Raise `DataError` naming `source`, the key and the remedy unless `settings` fit the JSON schema `schema`."""
    validator = jsonschema.Draft202012Validator(schema)
    problems = [
        _explain(error)
        for error in sorted(validator.iter_errors(settings), key=lambda e: [str(part) for part in e.path])
    ]
    if problems:
        raise DataError(f"{source}:\n  " + "\n  ".join(problems))


def _explain(error):
    where = ".".join(str(part) for part in error.absolute_path) or "top level"
    if error.validator == "additionalProperties":
        known = list(error.schema.get("properties", {}))
        unknown = [key for key in error.instance if key not in known]
        hints = [(key, difflib.get_close_matches(str(key), known, 1)) for key in unknown]
        return "; ".join(
            f"{where}: unknown key {key!r}"
            + (f", did you mean {hint[0]!r}?" if hint else f" (known: {', '.join(known)})")
            for key, hint in hints
        )
    if error.validator == "type" and isinstance(error.instance, str) and error.validator_value in {"integer", "number"}:
        # Snakemake hands on what stands inside lists and mappings of --config as text.
        return f"{where}: {error.message}; numbers inside lists and mappings belong in a file (--configfile)"
    hint = error.schema.get("description", "") if isinstance(error.schema, dict) else ""
    return f"{where}: {error.message}" + (f" ({hint})" if hint else "")


def check_config(config, datasets_folder):
    """Checks that a schema cannot say: names that must exist elsewhere in the configuration."""
    ladder = config["ladder"]
    named = {
        "compare": config["compare"],
        "studies.method": [config["studies"]["method"]],
        "studies.training.methods": config["studies"]["training"]["methods"],
        "uncertainty.methods": config["uncertainty"]["methods"],
        "comparisons": [name for pair in config["comparisons"] for name in pair],
        "ladder.reference": [ladder["reference"]],
        "ladder.rows": [method for method, _ in ladder["rows"]],
        "ladder.beside": [name for *pair, _ in ladder["beside"] for name in pair],
    }
    for name in config["methods"]:
        for member in members(config, name):
            if member not in config["methods"]:
                raise DataError(_unknown(f"methods.{name}.options.of", "method", member, config["methods"]))
            if config["methods"][member]["kind"] not in AVERAGED:
                raise DataError(
                    f"configuration, methods.{name}.options.of: {member} has no single path to be averaged; "
                    f"kinds that have are {', '.join(AVERAGED)}"
                )
    for name in config["methods"]:
        averaged_parts(config, name)
    for key, names in named.items():
        for name in names:
            if name not in config["methods"]:
                raise DataError(_unknown(key, "method", name, config["methods"]))
    for name in config["studies"]["training"]["methods"]:
        if config["methods"][name]["kind"] not in THINNED:
            raise DataError(f"configuration, studies.training: {name} is not of a kind {', '.join(THINNED)}")
    studied = config["studies"]["method"]
    if config["methods"][studied]["kind"] not in SAMPLED:
        raise DataError(f"configuration, studies.method: {studied} has no map to sample, so neither beta nor r_s")
    for name in config["uncertainty"]["methods"]:
        if config["methods"][name]["kind"] not in MAP_KINDS:
            raise DataError(
                f"configuration, uncertainty.methods: {name} has no samples to score; methods that have are of the "
                f"kinds {', '.join(MAP_KINDS)}"
            )
    known = sorted(file.stem for file in Path(datasets_folder).glob("*.yaml"))
    for name in config["datasets"]:
        if name not in known:
            raise DataError(_unknown("datasets", "dataset", name, known))


def methods_run(config):
    """Names of all methods that a run needs: those compared, those of the ladder, and those that others average."""
    names = [*config["compare"], *ladder_methods(config)]
    for name in names:  # grows while it is read
        names += [member for member in members(config, name) if member not in names]
    return list(dict.fromkeys(names))


def ladder_rows(config):
    """Rows of the ladder, none unless the last one's method is compared: whoever leaves that out wants no ladder."""
    rows = config["ladder"]["rows"]
    return rows if rows and rows[-1][0] in config["compare"] else []


def ladder_methods(config):
    """Methods of the ladder: its rungs, what they are compared with, and the pairs beside them; none without rungs."""
    ladder, rungs = config["ladder"], [method for method, _ in ladder_rows(config)]
    beside = [name for *pair, _ in ladder["beside"] for name in pair]
    return list(dict.fromkeys([*rungs, ladder["reference"], *beside])) if rungs else []


def members(config, name):
    """The methods whose forecasts a method averages; none for most."""
    method = config["methods"][name]
    return method.get("options", {}).get("of", []) if method["kind"] == "average" else []


def averaged_parts(config, name, within=()):
    """The methods that make their own forecasts of those that a method averages, itself if it averages none."""
    if name in within:
        raise DataError(f"configuration, methods.{name}.options.of: {' of '.join((*within, name))} averages itself")
    parts = [part for one in members(config, name) for part in averaged_parts(config, one, (*within, name))]
    return list(dict.fromkeys(parts)) or [name]


def method_settings(config, name, tuned=None):
    """All that a method's forecasts depend on: its `kind` and `options`, for a learned one also `learned`.

    Options come from the configuration's section for its kind (`rollout` for maps that are sampled, `episodes`,
    `snippets`, the budget's for networks), then from what a dataset file has `tuned` for the kind; the method's own
    `options` win, and over them what is `tuned` for the method itself. A learned method's may also name another
    `budget` or kind of `futures`.
    """
    tuned = tuned or {}
    kind = config["methods"][name]["kind"]
    own = {**tuned.get(kind, {}), **config["methods"][name].get("options", {}), **tuned.get(name, {})}
    if kind in LEARNED_KINDS:
        learned = {key: own.get(key, value) for key, value in config["learned"].items() if key != "threads"}
        sizes = {key: value for key, value in own.items() if key not in learned}
        return {"kind": kind, "options": {**config["budgets"][learned["budget"]][kind], **sizes}, "learned": learned}
    if kind in SAMPLED:
        return {"kind": kind, "options": {**config["rollout"], **own}}
    if kind == "cvm":
        return {"kind": kind, "options": {"velocity": config["rollout"]["velocity"], **own}}
    return {"kind": kind, "options": {**config.get(kind, {}), **own}}


def _unknown(key, what, name, known):
    close = difflib.get_close_matches(name, list(known), 1)
    hint = f"did you mean {close[0]!r}?" if close else f"known: {', '.join(known)}"
    return f"configuration, {key}: no {what} named {name!r}; {hint}"


def check_datasets(datasets, run):
    """Checks between datasets: exhibits of two must not overwrite each other, nor pass for the demo's."""
    labels = [dataset["label"] for dataset in datasets.values()]
    if twice := {label for label in labels if labels.count(label) > 1}:
        names = [name for name, dataset in datasets.items() if dataset["label"] in twice]
        raise DataError(f"datasets {', '.join(names)}: their exhibits carry the same `label`; change one")
    if run == "demo" and not all(dataset["demo"] for dataset in datasets.values()):
        raise DataError("configuration, run: `demo` is for the demo's recordings; give your run a name of its own")


def validation_part(dataset):
    """The dataset without its test recordings: part of the training recordings stands in for them.

    The last `VALIDATION_DAYS` of the training days, rounded up; a single day is cut by blocks of time
    (`cleaning.held_out`), which gives two recordings of each. What is chosen in such a run has not seen the test set.
    """
    training = [recording for recording in dataset["recordings"] if recording["split"] == "train"]
    days = sorted({recording["day"] for recording in training})
    if len(days) > 1:
        held = days[-math.ceil(VALIDATION_DAYS * len(days)) :]
        parts = [{**r, "split": "test" if r["day"] in held else "train"} for r in training]
    else:
        names = {"fit": "train", "validation": "test"}
        parts = [
            {**r, "name": f"{r['name']}-{part}", "part": part, "split": split}
            for r in training
            for part, split in names.items()
        ]
    return {**dataset, "recordings": parts}


def check_tuned(datasets, config, schema):
    """Options that dataset files have `tuned` must be of a kind or method that exists, and ones that it takes."""
    kinds = {method["kind"]: {"kind": method["kind"], "title": ""} for method in config["methods"].values()}
    tunable = {**kinds, **config["methods"]}
    known = {name: method for name, method in tunable.items() if method["kind"] != "average"}
    for dataset in datasets.values():
        for name, options in dataset["tuned"].items():
            source = f"config/datasets/{dataset['name']}.yaml, tuned"
            if name not in known:
                raise DataError(_unknown(source, "kind or method", name, known))
            merged = {**known[name], "options": {**known[name].get("options", {}), **options}}
            check({**config, "methods": {**config["methods"], name: merged}}, schema, source)


def load_dataset(path, schema, data_root, demo_root=None):
    """Load a dataset file, check it, fill its defaults and resolve its recordings.

    They lie under `data_root`, generated ones under `demo_root` where that is given.

    `floor_plan` becomes the list of its files, YAML and image (if the YAML is there); empty where there is none.
    Each of the returned `recordings` has `name`, `path`, `stored` (the file on disk: `path`, or the archive that it
    leads into) and `member` of it, `file` (`stored` under `data_root`), `exists`, `day`, `start` and `split`.
    A file that does not exist keeps the path where it is expected.
    """
    try:
        listed = yaml.safe_load(Path(path).read_text(encoding="utf-8"))
    except (yaml.YAMLError, ValueError) as error:  # ValueError: also a date that does not exist
        raise DataError(f"{path}: not valid YAML in UTF-8 ({error})") from None
    if not isinstance(listed, dict):
        raise DataError(f"{path}: a dataset file is a mapping of keys, see config/README.md")
    listed = _dates_as_text(listed)
    check(listed, schema, path)
    dataset = {"label": Path(path).stem, **DATASET_DEFAULTS, **listed, "name": Path(path).stem}
    _check_dataset(path, dataset)
    data_root = demo_root if dataset["demo"] and demo_root else data_root
    dataset["recordings"] = [
        found for entry in dataset["recordings"] for found in _resolve(path, entry, dataset, data_root)
    ]
    dataset["floor_plan"] = _floor_plan_files(path, dataset, data_root)
    names = [recording["name"] for recording in dataset["recordings"]]
    if twice := {name for name in names if names.count(name) > 1}:
        raise DataError(f"{path}: two recordings are named {', '.join(sorted(twice))}; give the files different names")
    for split in ("train", "test"):
        if not any(recording["split"] == split for recording in dataset["recordings"]):
            raise DataError(
                f"{path}: no recording has `split: {split}`; maps need training, scores need test recordings"
            )
    return dataset


def _check_dataset(path, dataset):
    try:
        ZoneInfo(dataset["timezone"])
    except (ZoneInfoNotFoundError, ValueError, OSError):
        raise DataError(
            f"{path}: timezone {dataset['timezone']!r} is unknown; use a name such as Europe/London"
        ) from None
    for key in _READER_NEEDS.get(dataset["reader"], ()):
        if dataset.get(key) is None:
            raise DataError(f"{path}: reader {dataset['reader']!r} needs the key {key!r}")
    units = dataset.get("units", {})
    for unit, key in (("px", "scale"), ("frame", "frame_rate")):
        if unit in units.values() and dataset.get(key) is None:
            raise DataError(f"{path}: units in {unit!r} need the key {key!r}")
    has_velocity = dataset["reader"] in {"atc", "atc_1hz"} or "speed" in dataset.get("columns", {})
    if dataset["velocity"] == "columns" and not has_velocity:
        raise DataError(f"{path}: velocity: columns needs speed and heading columns; use velocity: differences")
    if ("speed" in dataset.get("columns", {})) != ("heading" in dataset.get("columns", {})):
        raise DataError(f"{path}: columns: give both speed and heading, or neither")
    first, last = dataset["hours"]
    if first >= last:
        raise DataError(f"{path}: hours [{first}, {last}] are empty; say [first, one after the last]")
    if "figure_hours" not in dataset:
        dataset["figure_hours"] = sorted({first, (first + last - 1) // 2, last - 1})
    if not re.fullmatch(r"[A-Za-z0-9_-]+", dataset["label"]):
        raise DataError(f"{path}: name the file with letters, digits, _ and - only, or give it a `label` of these")
    no_clock = dataset["reader"].startswith("edinburgh") or units.get("time") == "frame"
    if no_clock and not all(entry.get("start") for entry in dataset["recordings"]):
        raise DataError(
            f'{path}: the files have no clock; every entry of `recordings` needs a `start`, such as "09:00"'
        )
    steps = dataset["horizon_s"] / dataset["time_step_s"]
    if abs(steps - round(steps)) > 1e-9 or steps < 1:
        raise DataError(
            f"{path}: horizon_s {dataset['horizon_s']} is not a multiple of time_step_s {dataset['time_step_s']}"
        )
    for entry in dataset["cleaning"]:
        name, options = (entry, {}) if isinstance(entry, str) else next(iter(entry.items()))
        if name not in RULES:
            raise DataError(f"{path}: " + _unknown("cleaning", "rule", name, RULES))
        if set(options) != ({_RULE_NEEDS[name]} if name in _RULE_NEEDS else set()):
            raise DataError(
                f"{path}: cleaning rule {name} takes {_RULE_NEEDS.get(name, 'no option')}, got {sorted(options)}"
            )
        if "points" in options and not (type(options["points"]) is int and options["points"] > 0):
            raise DataError(
                f"{path}: cleaning rule {name}: points {options['points']!r} is not a positive whole number"
            )
        if "polygons" in options and not _are_polygons(options["polygons"]):
            raise DataError(f"{path}: cleaning rule {name}: polygons must be lists of at least three [x, y] corners")
    for area in dataset["areas"]:
        if not _are_polygons(area["polygons"]):
            raise DataError(f"{path}: area {area['title']}: polygons must be lists of at least three [x, y] corners")


def _are_polygons(value):
    """Whether `value` is a list of polygons: lists of three or more [x, y]."""
    return (
        isinstance(value, list)
        and value
        and all(isinstance(polygon, list) and len(polygon) >= 3 for polygon in value)
        and all(
            isinstance(corner, list) and len(corner) == 2 and all(type(part) in (int, float) for part in corner)
            for polygon in value
            for corner in polygon
        )
    )


def _floor_plan_files(path, dataset, data_root):
    if dataset["floor_plan"] is None:
        return []
    file = Path(data_root) / dataset["floor_plan"]
    if dataset["demo"]:  # made by the workflow
        return [str(file), str(file.with_suffix(".pgm"))]
    if not file.exists():  # asked for like a missing recording
        return [str(file)]
    if not image_of(file).exists():
        raise DataError(f"{file}: image {image_of(file)} does not exist; put it there, or correct `image`")
    return [str(file), str(image_of(file))]


def _resolve(path, entry, dataset, data_root):
    """One `recordings` entry to the recordings it stands for."""
    try:
        date.fromisoformat(entry["day"])
    except ValueError:
        raise DataError(f"{path}: day {entry['day']!r} is not a date like 2012-10-24") from None
    root, listed = Path(data_root), entry["files"]
    found = [find_recording(root / listed)]
    if glob.has_magic(listed):
        found = [root / file for file in sorted(glob.glob(listed, root_dir=root))]
    if not found:
        raise DataError(
            f"{path}: no file matches {root / listed}; correct `files`, or `data_root` in the configuration"
        )
    return [
        {
            "name": _stem(file or listed),
            "path": str(file or root / listed),
            "stored": stored,
            "member": member,
            "file": os.path.relpath(stored, root),
            "exists": file is not None,
            "day": entry["day"],
            "start": entry.get("start"),
            "split": entry["split"],
            "part": None,
        }
        for file in found
        for stored, member in [_stored(file or root / listed)]
    ]


def _stored(file):
    """The file on disk that holds a recording, and the member of it that `archive.zip/member.csv` names."""
    before, inside, member = str(file).partition(".zip/")
    return (before + ".zip", member) if inside else (str(file), None)


def _stem(file):
    name = Path(file).name
    for suffix in COMPRESSED:
        name = name.removesuffix(suffix)
    stem, _, suffix = name.rpartition(".")
    return stem if stem and suffix in {"csv", "txt", "tsv", "ndjson", "dat"} else name


def _dates_as_text(value):
    """YAML turns 2012-10-24 into a date; the schema and JSON want text."""
    if isinstance(value, dict):
        return {key: _dates_as_text(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_dates_as_text(entry) for entry in value]
    return value.isoformat() if isinstance(value, date) else value
