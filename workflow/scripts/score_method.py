"""Rule score_method."""

from modlhmp.floor_plan import load_floor_plan, moved
from modlhmp.forecasting.files import read_forecasts
from modlhmp.logs import job_log, progress
from modlhmp.origins import provenance
from modlhmp.scenes import read_scenes
from modlhmp.scoring.recording import score_recording
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.storage import DataError, write_pieces
from modlhmp.study.layout import Layout
from modlhmp.tracks import gap_limit, owner_ids, person_ids, read_tracks, with_owners, with_persons


def scored(files, params, names, log):
    """Errors of one recording after the other; `DataError` if there are none at all."""
    layout = Layout.around(params.run, snakemake.output[0])
    site = build(Site, params.dataset)
    plan, rows = None, 0
    if files.floor_plan:
        plan = moved(load_floor_plan(files.floor_plan[0]), params.origin_m)
    known = {number: owner for file in files.tracks for number, owner in owner_ids(file).items()}
    owners, persons = known or None, person_ids(*files.tracks)
    for recording, tracks in zip(params.recordings, progress(files.tracks, desc="recordings"), strict=True):
        forecasts = read_forecasts(layout.forecast(names.dataset, names.method, recording))
        errors = score_recording(read_tracks(tracks), forecasts, recording, site, plan, read_scenes(tracks))
        errors = with_persons(with_owners(errors, owners), persons)
        rows += errors.num_rows
        if errors.num_rows:
            yield errors
    if not rows:
        needed = site.observed_rows + 1
        gap_s = gap_limit(site.time_step_s)
        raise DataError(
            f"{names.dataset}: no test track (or scene) has {needed} rows without a gap over {gap_s:g} s to score"
        )
    log.info("%d rows of errors", rows)


with job_log(snakemake.log[0]) as log:
    errors = scored(snakemake.input, snakemake.params, snakemake.wildcards, log)
    origin = provenance(dict(snakemake.wildcards), dict(snakemake.params), snakemake.input)
    write_pieces(errors, snakemake.output[0], **origin)
