"""What is generated from the typed settings is fresh, and what is shipped fits it."""

import dataclasses
import json

import pytest
import yaml

from modlhmp import datasets, file_format, kinds, options
from modlhmp.study import describe, settings
from modlhmp.yaml_file import read_yaml

REMEDY = "stale: run `make settings`"


@pytest.mark.parametrize("name", describe.schemas())
def test_the_schemas_are_fresh(name):
    stored = (describe.SCHEMAS / name).read_text(encoding="utf-8")
    assert stored == json.dumps(describe.schemas()[name], indent=1, ensure_ascii=False) + "\n", REMEDY


def test_no_other_schema_is_stored():
    assert {file.name for file in describe.SCHEMAS.iterdir()} == describe.schemas().keys()


@pytest.mark.parametrize("page", describe.READMES, ids=lambda page: page.relative_to(describe.ROOT).as_posix())
def test_the_tables_are_fresh(page):
    text = page.read_text(encoding="utf-8")
    assert text == describe.made_anew(text), REMEDY


def test_every_table_has_its_place():
    text = "".join(page.read_text(encoding="utf-8") for page in describe.READMES)
    for name in describe.tables():
        assert text.count(f"<!-- {name}: made by `make settings` -->") == 1, name
        assert text.count(f"<!-- end of {name} -->") == 1, name


def option_names(cls):
    return {field.name for field in dataclasses.fields(cls)}


def rows_of(text):
    """First cells of all rows of Markdown tables."""
    return {line.split("|")[1].strip().strip("`") for line in text.splitlines() if line.startswith("| `")}


@pytest.mark.parametrize(
    ("table", "classes"),
    [
        ("run", [settings.RunSettings]),
        ("sections", list(describe.SECTIONS.values())),
        ("kinds", [kind.options for kind in kinds.BUILT_IN if kind.learned or not kind.section]),
        ("maps", [kind.building for kind in kinds.BUILT_IN if kind.building is not None]),
        ("dataset", [datasets.DatasetFile]),
        ("dataset sections", [datasets.Files, datasets.Area, datasets.Source, file_format.Columns, file_format.Units]),
    ],
)
def test_the_tables_name_every_option(table, classes):
    made = describe.tables()
    assert describe.tables().keys() == made.keys()
    assert rows_of(made[table]) >= set().union(*map(option_names, classes))


def test_the_table_of_kinds_names_every_kind_that_forecasts():
    named = rows_of(describe.tables()["kinds"])
    for kind in kinds.BUILT_IN:
        assert (kind.name in named) == kind.is_method
    for option in option_names(options.Learning):
        assert f"`{option}`" in describe.tables()["kinds"]


# --- what is shipped fits the schemas -----------------------------------------------------------------------


@pytest.fixture(scope="module")
def fits():
    """Function (name of a schema, value): messages of what does not fit."""
    jsonschema = pytest.importorskip("jsonschema")
    validators = {name: jsonschema.Draft202012Validator(schema) for name, schema in describe.schemas().items()}
    return lambda name, value: [error.message for error in validators[name].iter_errors(value)]


def test_shipped_dataset_files_fit_the_schema(fits, config_folder):
    files = sorted((config_folder / "datasets").glob("*.yaml"))
    assert len(files) > 5
    for file in files:
        assert fits("dataset.schema.json", read_yaml(file, "a dataset file")) == [], file


def test_shipped_configurations_fit_the_schema(fits, config_folder):
    """Overlays as they are, since an editor sees one file."""
    files = [*config_folder.glob("*.yaml"), *config_folder.glob("lab/*.yaml")]
    assert len(files) > 7
    for file in files:
        assert fits("config.schema.json", yaml.safe_load(file.read_text())) == [], file


@pytest.mark.parametrize(
    ("wrong", "about"),
    [
        ({"rolout": {}}, "rolout"),
        ({"rollout": {"k": 0}}, "0"),
        ({"rollout": {"speed": "kernal"}}, "kernal"),
        ({"methods": {"mine": {"kind": "cvm", "options": {"k": 3}}}}, "k"),
        ({"seeds": []}, "[]"),
    ],
)
def test_an_editor_is_told_what_is_wrong(fits, wrong, about):
    (message,) = fits("config.schema.json", wrong)
    assert about in message


# --- links of pages to code -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("link", "begins"),
    [
        ("[`maps.cliff.build`](../src/modlhmp/maps/cliff.py#L1)", "def build("),
        ("[`maps.base.Mod.sample`](../src/modlhmp/maps/base.py#L1)", "    def sample("),
        ("[`maps.base.HourlyMod`](../src/modlhmp/maps/base.py#L1)", "class HourlyMod:"),
        ("[`twins.em`](../tests/reference/twins.py#L9999)", "def em("),
    ],
)
def test_links_to_functions_have_the_line_of_the_function(link, begins):
    path, line = describe.with_lines(f"see {link}.")[:-2].partition("](../")[2].split("#L")
    assert (describe.ROOT / path).read_text().splitlines()[int(line) - 1].startswith(begins)


@pytest.mark.parametrize("name", ["maps.cliff.gone", "maps.cliff.CliffMap.gone", "maps.base.sample"])
def test_a_link_to_a_function_that_is_gone_is_an_error(name):
    path = f"../src/modlhmp/{'/'.join(name.split('.')[:2])}.py"
    with pytest.raises(ValueError, match=rf"no function or class '{name}'; a page links to it"):
        describe.with_lines(f"[`{name}`]({path}#L3)")


def test_other_links_are_left_alone():
    text = "[numbers](numbers.json), [`a`](../config/real.yaml), [maps](../src/modlhmp/maps/), [`x`](method.md#ranking)"
    assert describe.with_lines(text) == text


def test_every_equation_of_the_paper_leads_to_code():
    """Each section of the page that has a formula or an algorithm names a function and what checks it."""
    page = (describe.ROOT / "docs/method.md").read_text(encoding="utf-8")
    parts = [part for part in page.split("\n## ")[1:] if "$$" in part or part.startswith("Algorithm")]
    assert len(parts) >= 12
    for part in parts:
        code = part.partition("* **Code**")[2]
        assert "](../src/modlhmp/" in code, part.splitlines()[0]
        assert "](../tests/reference/" in part or part.startswith("State"), part.splitlines()[0]


def test_the_command_line_is_told_whole():
    told = describe.commands()
    assert {"### modlhmp forecast", "### modlhmp map build", "### modlhmp live"} <= set(told.splitlines())
    assert max(map(len, told.splitlines())) <= 120
