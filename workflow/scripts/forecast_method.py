"""Rules forecast_method and forecast_with_network."""

from modlhmp.forecasting.files import STORED, write_forecasts
from modlhmp.forecasting.recording import forecast_recording
from modlhmp.forecasting.windows import windows
from modlhmp.logs import job_log
from modlhmp.methods import Method, make_forecaster
from modlhmp.origins import provenance
from modlhmp.scenes import read_scenes
from modlhmp.settings import build
from modlhmp.site import Site
from modlhmp.study.layout import Layout
from modlhmp.tracks import owner_ids, read_tracks

with job_log(snakemake.log[0]) as log:
    params, files, names = snakemake.params, snakemake.input, snakemake.wildcards
    layout = Layout.around(params.run, snakemake.output[0])
    method, site = Method.of(params.method), build(Site, params.dataset)
    learned = method.learning is not None
    path, exits = files.get("weights") or files.get("map"), files.get("exits")
    device = method.learning.device if learned else "auto"
    forecaster = make_forecaster(method.kind, method.options, site, path, exits, device, snakemake.threads)
    made_of = [files.summary] if learned else [file for file in (path, exits) if file]
    for recording, others in params.recordings.items():
        own, *rest = [layout.tracks(names.dataset, name) for name in (recording, *others)]
        key = (names.dataset, names.method, recording)
        tracks, scenes = read_tracks(own), read_scenes(own)
        forecasts = forecast_recording(
            tracks, forecaster, site, key, method.futures, params.seeds,
            map(read_tracks, rest) if learned else None, STORED, scenes,
        )  # fmt: skip
        origin = provenance({**names, "recording": recording}, dict(params), [own, *rest, *made_of])
        wanted = windows(tracks, site, scenes)
        t0 = wanted.t0 if wanted.several else None
        write_forecasts(
            layout.forecast(names.dataset, names.method, recording), forecasts, t0, owner_ids(own), **origin
        )
        asked = "" if scenes is None else f" of {len(scenes.begin)} scenes"
        log.info("%s: %d forecasts%s", recording, len(wanted.t0), asked)
