"""Rule clean_recording."""

from pathlib import Path

from modlhmp.cleaning import clean_recording
from modlhmp.file_format import FileFormat, Recording
from modlhmp.logs import job_log
from modlhmp.origins import provenance, unchanged
from modlhmp.settings import build
from modlhmp.storage import write_json
from modlhmp.study.fetch import check_sum, listed_sources, record_sum
from modlhmp.tracks import write_tracks

with job_log(snakemake.log[0]) as log:
    params, raw = snakemake.params, snakemake.input.raw
    recording, files = build(Recording, params.recording), [raw] if isinstance(raw, str) else list(raw)
    fetched = listed_sources(files, recording.file, params.sources)
    for file, source in fetched.items():
        check_sum(file, source["file"], source["sha256"], params.sums)
    path = Path(files[0], recording.member) if recording.member else files[0]
    with unchanged(*files) as hashes:
        tracks, account = clean_recording(path, build(FileFormat, params.dataset), recording)
    for file, source in fetched.items():
        if not source["sha256"]:  # once it is known to be a recording
            record_sum(hashes[Path(file)], source["file"], params.sums)
    scenes = {"scenes": account.pop("scenes")} if "scenes" in account else {}
    log.info("account: %s", account)
    write_json(snakemake.output.account, account)
    # Where files lie is no setting: their names and bytes are among the sources.
    settings = {**params, "recording": {**params.recording, "people": [Path(one).name for one in recording.people]}}
    origin = provenance(dict(snakemake.wildcards), settings, snakemake.input, hashes)
    beside = scenes | {name: account[name] for name in ("owners", "persons") if name in account}
    write_tracks(tracks, snakemake.output.tracks, **origin, **beside)
