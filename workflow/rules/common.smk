# Configuration, datasets and the helpers of the rule files. Nothing here makes a file.
#
# INPUTS   config/config.yaml and overlays, config/datasets/<name>.yaml, workflow/schemas/*
# OUTPUTS  DATASETS, METHODS and the small functions below
# STEPS    check the configuration, load the datasets, constrain the wildcards
import os
from pathlib import Path

import yaml
from snakemake.exceptions import WorkflowError

from modlhmp.networks import KINDS as LEARNED_KINDS
from modlhmp.maps import FOLLOWED, KINDS as MAP_KINDS, SAMPLED, map_path
from modlhmp.settings import (
    averaged_parts,
    check,
    check_config,
    check_datasets,
    check_tuned,
    ladder_methods,
    ladder_rows,
    load_dataset,
    members,
    method_settings,
    methods_run,
    validation_part,
)
from modlhmp.storage import DataError
from modlhmp.study.versions import code_version

ROOT = Path(workflow.current_basedir.get_path_or_uri(secret_free=True)).parents[1]


def data_root():
    """Folder of the recordings."""
    return os.environ.get("MODLHMP_DATA") or config["data_root"]


def load_schema(name):
    return yaml.safe_load(
        (ROOT / "workflow/schemas" / f"{name}.schema.yaml").read_text()
    )


try:
    check(config, load_schema("config"), "configuration")
    check_config(config, ROOT / "config/datasets")
    DATASETS = {
        name: load_dataset(
            ROOT / "config/datasets" / f"{name}.yaml",
            load_schema("dataset"),
            data_root(),
            demo_root=f"resources/demo/{config['run']}",
        )
        for name in config["datasets"]
    }
    check_datasets(DATASETS, config["run"])
    if config["evaluate_on"] == "validation":
        DATASETS = {name: validation_part(one) for name, one in DATASETS.items()}
    check_tuned(DATASETS, config, load_schema("config"))
except DataError as error:
    raise WorkflowError(f"\n{error}") from None


def titles_of(names):
    """Titles of methods by name."""
    return {name: config["methods"][name]["title"] for name in names}


RUN = config["run"]
EXHIBITS = f"paper_figures/{RUN}"
METHODS = {name: method_settings(config, name) for name in methods_run(config)}
TITLES = titles_of(config["compare"])  # the paper's exhibits show these
AVERAGES = [name for name in METHODS if METHODS[name]["kind"] == "average"]
LEARNED = [name for name in METHODS if METHODS[name]["kind"] in LEARNED_KINDS]

NO_METHOD = "(?!)"  # a wildcard constraint that nothing meets


wildcard_constraints:
    dataset="|".join(DATASETS),
    method="|".join(METHODS),
    recording="[^/]+",
    label="[A-Za-z0-9_-]+",


def code_of(script, *modules):
    """Hash of the code that a script's result depends on: an edit reruns exactly the rules that use it."""
    return code_version(ROOT / f"workflow/scripts/{script}.py", *modules)


def network_code(script, method):
    """The same for a script that uses a method's network."""
    return code_of(script, f"modlhmp.networks.{METHODS[method]['kind']}")


# The keys of a dataset file that decide a stage's result; the others only name and draw.
CLEANING_KEYS = (
    *(
        "reader",
        "timezone",
        "time_step_s",
        "cleaning",
        "frame_rate",
        "row_stride",
        "scale",
    ),
    *("columns", "header", "separator", "units"),
)
FORECAST_KEYS = (
    *("timezone", "time_step_s", "observed_rows", "horizon_s", "velocity"),
    "difference_weights",
)
SCORE_KEYS = (*FORECAST_KEYS, "paper_protocol")
STUDY_KEYS = ("name", *SCORE_KEYS)


def settings_of(dataset, keys=None):
    """A dataset's settings for these keys, or all but the lists of files: what a rule's result depends on."""
    settings = DATASETS[dataset]
    return {
        key: settings[key]
        for key in keys or sorted(settings.keys() - {"recordings", "sources"})
        if key in settings
    }


def recordings(dataset, split=None):
    """Recordings of a dataset, all or of one split, in the order of the dataset file."""
    return [r for r in DATASETS[dataset]["recordings"] if split in (None, r["split"])]


def recording(wildcards):
    """The recording that the wildcards name."""
    return next(
        r for r in recordings(wildcards.dataset) if r["name"] == wildcards.recording
    )


def same_day(dataset, name):
    """Names of the other recordings of a recording's day: their people were there as well."""
    day = next(r["day"] for r in recordings(dataset) if r["name"] == name)
    return [
        r["name"] for r in recordings(dataset) if r["day"] == day and r["name"] != name
    ]


def people(dataset, split):
    """Names of a split's recordings, and of all others of their days: whoever was there."""
    names = [
        name
        for r in recordings(dataset, split)
        for name in (r["name"], *same_day(dataset, r["name"]))
    ]
    return list(dict.fromkeys(names))


def track_files(split):
    """Input function: the clean recordings of a split."""

    def files(wildcards):
        return [
            f"results/{RUN}/{wildcards.dataset}/tracks/{r['name']}.parquet"
            for r in recordings(wildcards.dataset, split)
        ]

    return files


def method_of(dataset, name):
    """A method's settings, with what has been tuned for a dataset."""
    return method_settings(config, name, DATASETS[dataset]["tuned"])


def map_of(dataset, name):
    """The map that a method needs, nothing for one without."""
    kind = METHODS[name]["kind"]
    return map_path(f"results/{RUN}/{dataset}/maps", kind) if kind in MAP_KINDS else []


def exits_of(dataset, name):
    """The ways out, for a method that samples its map and uses them."""
    method = method_of(dataset, name)
    uses = method["kind"] in SAMPLED and method["options"]["exits"]
    return f"results/{RUN}/{dataset}/maps/exits.parquet" if uses else []


def method_map(wildcards):
    """Input function: `map_of` the method that the wildcards name."""
    return map_of(wildcards.dataset, wildcards.method)


def method_exits(wildcards):
    """Input function: `exits_of` the method that the wildcards name."""
    return exits_of(wildcards.dataset, wildcards.method)


def dataset_of_label(label):
    """Name of the dataset whose exhibits carry a label."""
    return next(name for name, dataset in DATASETS.items() if dataset["label"] == label)


def maps_of_label(*names):
    """Input function: maps of the dataset that a figure's label names."""

    def files(wildcards):
        folder = f"results/{RUN}/{dataset_of_label(wildcards.label)}/maps"
        return [f"{folder}/{name}" for name in names]

    return files


def floor_plan_of_label(wildcards):
    """Input function: the two files of that dataset's floor plan, if it has one."""
    return DATASETS[dataset_of_label(wildcards.label)]["floor_plan"]


def measured_runtimes(_wildcards):
    """Input function: what `snakemake runtime` has measured; nothing until that target has been run."""
    files = (Path(f"results/{RUN}/{name}/runtime.json") for name in DATASETS)
    return [str(file) for file in files if file.exists()]


def table_files(label):
    """The forms of a table; the report shows the HTML one."""
    return {
        **{kind: f"{EXHIBITS}/{label}.{kind}" for kind in ("csv", "tex", "md")},
        "html": report(
            f"{EXHIBITS}/{label}.html",
            caption=f"../report/{label}.rst",
            category="Tables",
            labels={"exhibit": TABLES[label], "dataset": "all"},
        ),
    }


SETTINGS = [settings_of(name) for name in DATASETS]
TABLES = {
    "tab_scenarios": "parameters",
    "tab_expres": "results",
    "tab_ttests": "t-tests",
    "tab_uncertainty": "distributions",
    "claims": "the paper's claims, tested",
    "tab_models": "trained networks",
}
BEYOND_KINDS = (*FOLLOWED, "average", "neural_map")
LABELS = [dataset["label"] for dataset in DATASETS.values()]
KINDS_RUN = {METHODS[name]["kind"] for name in TITLES}
