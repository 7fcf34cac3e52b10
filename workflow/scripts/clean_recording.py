"""Rule clean_recording."""

import json
from pathlib import Path

from modlhmp.cleaning import clean_recording
from modlhmp.logs import job_log
from modlhmp.storage import provenance, write_text
from modlhmp.study.fetch import check_sum
from modlhmp.tracks import write_tracks

with job_log(snakemake.log[0]) as log:
    raw, recording = snakemake.input.raw, snakemake.params.recording
    source = next((s for s in snakemake.params.sources if s["file"] == recording["file"]), None)
    if source is not None:
        check_sum(raw, recording["file"], source.get("sha256"), snakemake.params.sums)
    path = Path(raw, recording["member"]) if recording["member"] else raw
    tracks, account = clean_recording(path, snakemake.params.dataset, recording)
    log.info("account: %s", account)
    write_text(snakemake.output.account, json.dumps(account, indent=2) + "\n")
    write_tracks(
        tracks,
        snakemake.output.tracks,
        **provenance(dict(snakemake.wildcards), dict(snakemake.params), snakemake.input),
    )
