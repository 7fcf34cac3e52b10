"""Rule check_splits."""

from modlhmp.file_format import FileFormat, Recording
from modlhmp.logs import job_log
from modlhmp.plausibility import ask_about
from modlhmp.scenes import check_alike, read_scenes
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.split_checks import check_splits
from modlhmp.storage import write_json
from modlhmp.tracks import read_tracks

with job_log(snakemake.log[0]):
    recordings = [build(Recording, plain) for plain in snakemake.params.recordings]
    files = snakemake.input.tracks
    form, site = (build(kind, snakemake.params.dataset) for kind in (FileFormat, Site))
    if site.forecast_every_s is None:
        pairs = zip(recordings, files, strict=True)
        check_alike({one.name: read_scenes(file) for one, file in pairs if one.split == "test"})
    tracks = map(read_tracks, files)
    found = check_splits(zip(recordings, tracks, strict=True), site)
    warnings = ask_about(f"dataset {snakemake.wildcards.dataset}", found, form)
    write_json(snakemake.output[0], {"warnings": warnings})
