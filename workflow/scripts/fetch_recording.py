"""Rule fetch_recording."""

from modlhmp.fetch import fetch, missing_message
from modlhmp.logs import job_log
from modlhmp.storage import DataError

with job_log(snakemake.log[0]):
    dataset, file, path = snakemake.params.dataset, snakemake.params.file, snakemake.output[0]
    source = next((source for source in dataset["sources"] if source["file"] == file), None)
    if source is None:
        raise DataError(missing_message(file, path, dataset["owner_page"], dataset["title"]))
    fetch(source["url"], path, source.get("sha256"), snakemake.params.sums, name=file)
