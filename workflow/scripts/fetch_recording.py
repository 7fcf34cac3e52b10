"""Rule fetch_recording."""

from pathlib import Path

from modlhmp.file_format import FileFormat, Recording
from modlhmp.floor_plan import image_of
from modlhmp.logs import job_log
from modlhmp.settings import build
from modlhmp.storage import DataError
from modlhmp.study.fetch import fetch, missing_message, read_as


def read(file):
    """Read what came as what the dataset file says that it is."""
    if path in dataset["floor_plan"]:
        image_of(file)
    read_as(file, build(FileFormat, dataset), [build(Recording, one) for one in snakemake.params.recordings])


with job_log(snakemake.log[0]) as log:
    dataset, file, path = snakemake.params.dataset, snakemake.params.file, snakemake.output[0]
    source = next((source for source in dataset["sources"] if source["file"] == file), None)
    if Path(path).exists():
        log.info("%s has been put there meanwhile", path)
    elif source is None:
        message = missing_message(file, path, dataset["owner_page"] or "not listed", dataset["title"])
        if path in dataset["floor_plan"]:
            message += "\nThis one is a floor plan: to do without, write `floor_plan: null` in the dataset file."
        raise DataError(f"{message}\nMissing of this dataset: {', '.join(snakemake.params.missing)}")
    else:
        fetch(source["url"], path, source.get("sha256"), snakemake.params.sums, name=file, read=read)
